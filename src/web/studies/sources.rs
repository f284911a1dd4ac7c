//! What people chose, by where they came from.

use std::collections::BTreeSet;

use askama::Template;
use askama_web::WebTemplate;
use axum::{Extension, extract::Path};

use super::{
    super::{
        Error,
        access::Caller,
        accounts::Who,
        assets,
        results::{count, decimal, percent, percents, shown},
    },
    Head, Parts,
};
use crate::{
    inference::{comparison, wilson_interval},
    store::{AskedProblem, SourceCount},
    study::{Cell, StudyId},
};

#[derive(Template, WebTemplate)]
#[template(path = "studies/sources.html")]
pub(super) struct SourcesPage {
    head: Head,
    rows: Vec<Row>,
}

/// The answers of people from one source to one cell.
struct Row {
    cell: String,
    source: String,
    n: String,
    /// What is counted: the cell's first action.
    action: String,
    chosen: String,
    share: String,
    interval: String,
    /// The exact test against one half, where the cell has two actions: p, and p by Holm's correction over all rows.
    p: [String; 2],
}

/// GET `/studies/STUDY/sources`.
pub(super) async fn show(
    (store, catalogue, settings): Parts,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
) -> Result<SourcesPage, Error> {
    let snapshot = shown(&store, &catalogue, &settings, &study).await?;
    let served = &snapshot.study;
    let counts = store
        .choices_by_source(&study, settings.population, snapshot.analysis_set())
        .await?;
    Ok(SourcesPage {
        rows: rows(served.cells(), &counts),
        head: Head::new(&store, &settings, &caller, served, "/sources").await?,
    })
}

/// The cells in file order, each with its sources in alphabetical order. Answers to problems that the study no longer
/// asks stay out.
fn rows(cells: &[Cell], counts: &[SourceCount]) -> Vec<Row> {
    let sources: BTreeSet<Option<&str>> =
        counts.iter().map(|count| count.source.as_deref()).collect();
    let mut rows = Vec::new();
    let mut tests = Vec::new();
    for cell in cells {
        let Some(first) = cell.actions.first() else {
            continue;
        };
        let asked = AskedProblem::of(cell);
        for source in &sources {
            let of_cell = counts.iter().filter(|count| {
                count.source.as_deref() == *source
                    && count.cell == asked.cell
                    && count.hash == asked.hash
            });
            let (mut n, mut chosen) = (0, 0);
            for count in of_cell {
                n += count.n;
                if count.action == first.id {
                    chosen += count.n;
                }
            }
            if n == 0 {
                continue;
            }
            if cell.actions.len() == 2 {
                tests.push((rows.len(), comparison::exact_half(chosen, n)));
            }
            let (low, high) = wilson_interval(chosen, n);
            rows.push(Row {
                cell: cell.label.clone(),
                source: source.unwrap_or("(no label)").to_owned(),
                n: count(n),
                action: first.label.clone(),
                chosen: count(chosen),
                share: percent(Some(chosen as f64 / n as f64)),
                interval: percents(Some(low), Some(high)),
                p: ["–", "–"].map(str::to_owned),
            });
        }
    }
    let p_values: Vec<f64> = tests.iter().map(|(_, p)| *p).collect();
    for ((row, p), corrected) in tests.iter().zip(comparison::holm(&p_values)) {
        rows[*row].p = [p_text(*p), p_text(corrected)];
    }
    rows
}

fn p_text(p: f64) -> String {
    if p < 0.001 {
        "< 0.001".to_owned()
    } else {
        decimal(Some(p), 3)
    }
}
