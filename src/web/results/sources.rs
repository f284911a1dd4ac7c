//! What people chose, and how the models fit them, by where they came from.

use std::{collections::BTreeSet, sync::Arc, time::Duration};

use serde::Serialize;

use crate::{
    inference::{comparison, factor::FactorReport, wilson_interval},
    jobs::{Snapshot, SourceComparison, SourceFits, StudySource, WorkState},
    store::{AskedProblem, SourceCount, Store},
    study::{Cell, FitPlan},
    web::Error,
};

/// Where people came from, and whether that makes a difference.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Sources {
    pub study: String,
    pub data_version: i64,
    /// The plan in whose parts the models are fitted.
    pub plan: String,
    #[serde(skip)]
    pub plan_label: String,
    /// Where people came from, those without a label first.
    pub sources: Vec<StudySource>,
    /// How often the first action of each cell was chosen.
    pub choices: Vec<SourceChoices>,
    /// The models fitted to each source, or how far they are.
    pub fits: SourceFitting,
}

/// The answers of people from one source to one cell.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct SourceChoices {
    pub cell: String,
    #[serde(skip)]
    pub label: String,
    /// Null for people without a label.
    pub source: Option<String>,
    /// Answers.
    pub n: u64,
    /// What is counted: the cell's first action.
    pub action: String,
    #[serde(skip)]
    pub action_label: String,
    pub chosen: u64,
    pub share: f64,
    /// 95 % Wilson interval.
    pub low: f64,
    pub high: f64,
    /// Exact test against one half; null where the cell has more actions than two.
    pub p: Option<f64>,
    /// The same by Holm's correction over all rows.
    pub p_holm: Option<f64>,
}

/// How far the fits are.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[serde(tag = "state", rename_all = "snake_case")]
pub(in crate::web) enum SourceFitting {
    /// Fewer than two sources have enough choices.
    NothingToCompare,
    /// Fits that are done, of how many, and comparisons that come first.
    Running {
        done: usize,
        of: usize,
        ahead: usize,
    },
    /// All numbers.
    Ready {
        #[schema(value_type = FactorReport)]
        result: Arc<FactorReport>,
    },
}

impl Sources {
    /// Counts, and asks for the fits.
    ///
    /// * `patience`: how long to wait for them.
    pub(in crate::web) async fn read(
        store: &Store,
        source_fits: &SourceFits,
        snapshot: &Snapshot,
        plan: &FitPlan,
        patience: Duration,
    ) -> Result<Self, Error> {
        let study = &snapshot.study;
        let of = (study.id(), snapshot.population, snapshot.analysis_set());
        let counts = store.choices_by_source(of.0, of.1, of.2).await?;
        let people = store.people_by_source(of.0, of.1, of.2).await?;
        let comparison = SourceComparison::new(snapshot, plan, &counts, &people);
        let fitting = match &comparison.input {
            None => SourceFitting::NothingToCompare,
            Some(input) => match source_fits.wait(input, patience).await {
                WorkState::Running { done, of, ahead } => {
                    SourceFitting::Running { done, of, ahead }
                }
                WorkState::Ready(result) => SourceFitting::Ready { result },
                WorkState::Failed(message) => {
                    return Err(Error::Internal(anyhow::anyhow!(
                        "the fits by source failed: {message}"
                    )));
                }
            },
        };
        Ok(Self {
            study: study.id().to_string(),
            data_version: snapshot.version.data_version,
            plan: plan.id.to_string(),
            plan_label: plan.label.clone(),
            sources: comparison.sources,
            choices: choices(study.cells(), &counts),
            fits: fitting,
        })
    }
}

/// The cells in file order, each with its sources in alphabetical order. Answers to problems that the study no longer
/// asks stay out.
fn choices(cells: &[Cell], counts: &[SourceCount]) -> Vec<SourceChoices> {
    let sources: BTreeSet<Option<&str>> =
        counts.iter().map(|count| count.source.as_deref()).collect();
    let mut rows = Vec::new();
    for cell in cells {
        let Some(first) = cell.actions.first() else {
            continue;
        };
        let asked = AskedProblem::new(cell.id.to_string(), cell.problem.as_ref());
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
            let (low, high) = wilson_interval(chosen, n);
            rows.push(SourceChoices {
                cell: cell.id.to_string(),
                label: cell.label.clone(),
                source: source.map(str::to_owned),
                n,
                action: first.id.to_string(),
                action_label: first.label.clone(),
                chosen,
                share: chosen as f64 / n as f64,
                low,
                high,
                p: (cell.actions.len() == 2).then(|| comparison::exact_half(chosen, n)),
                p_holm: None,
            });
        }
    }
    let tested: Vec<f64> = rows.iter().filter_map(|row| row.p).collect();
    let tests = rows.iter_mut().filter(|row| row.p.is_some());
    for (row, corrected) in tests.zip(comparison::holm(&tested)) {
        row.p_holm = Some(corrected);
    }
    rows
}
