//! The page of a study's simulated sweeps; every number that is there stands in its tables as text.

use askama::Template;
use askama_web::WebTemplate;

use super::{
    format::{count, decimal, mean_sd, percent, percents},
    sweep::{ObservedRow, Outcome, Sweep},
    table::{Align, Cell, Table},
};
use crate::{
    inference::sweep::{GapSweepReport, ShareSweepReport, SweepScore},
    jobs::{Snapshot, SweepResult, swept_problems},
    model::{NOISY_RATIONAL, OrderedMap, RISK_AWARE},
    study::RewardUnit,
    web::{
        accounts::{Bar, Who},
        assets,
    },
};

#[derive(Template, WebTemplate)]
#[template(path = "results/sweep.html")]
pub(super) struct SweepPage {
    bar: Bar,
    study: String,
    title: String,
    simulated: bool,
    cells: Vec<CellOption>,
    n: u64,
    /// The queries under which scripts ask for the numbers.
    share_query: String,
    gap_query: String,
    share: Figure,
    gap: Figure,
    optimal: Figure,
    commands: Vec<String>,
    is_running: bool,
}

/// A problem that can be chosen.
struct CellOption {
    id: String,
    label: String,
    selected: bool,
}

/// A figure that a script draws, with the table that holds its numbers.
struct Figure {
    kind: &'static str,
    title: &'static str,
    subtitle: &'static str,
    plan: Option<String>,
    caption: String,
    table: Table,
}

/// What the page's address asks for.
#[derive(Debug, Clone, Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PageQuery {
    pub cell: Option<crate::study::CellId>,
    pub n: Option<u64>,
    pub seeds: Option<usize>,
    pub steps: Option<usize>,
}

impl SweepPage {
    pub(super) fn new(
        snapshot: &Snapshot,
        query: &PageQuery,
        n: u64,
        share: &Sweep,
        gap: &Sweep,
        bar: Bar,
    ) -> Self {
        let study = &snapshot.study;
        let unit = study.reward_unit();
        let mut share_query = format!("n={n}");
        let mut gap_query = String::new();
        if let Some(cell) = &query.cell {
            share_query.push_str(&format!("&cell={cell}"));
        }
        if let Some(seeds) = query.seeds {
            share_query.push_str(&format!("&seeds={seeds}"));
            gap_query.push_str(&format!("seeds={seeds}&"));
        }
        if let Some(steps) = query.steps {
            gap_query.push_str(&format!("steps={steps}"));
        }
        let is_running = |sweep: &Sweep| matches!(sweep.outcome, Outcome::Running { .. });
        let cells = swept_problems(study).into_iter().enumerate();
        Self {
            bar,
            study: study.id().to_string(),
            title: study.title().to_owned(),
            simulated: snapshot.population.is_simulated(),
            cells: cells
                .map(|(index, swept)| CellOption {
                    selected: match &query.cell {
                        Some(cell) => swept.cells.contains(cell),
                        None => index == 0,
                    },
                    id: swept.problem.id,
                    label: swept.label,
                })
                .collect(),
            n,
            share_query,
            gap_query,
            is_running: is_running(share) || is_running(gap),
            commands: [share, gap]
                .into_iter()
                .filter_map(|sweep| sweep.command.clone())
                .collect(),
            share: Figure {
                kind: "sweep",
                title: "Only Risk-Aware follows people who choose what is worse",
                subtitle: "ln KL from simulated answers to each model’s predictions (natural logarithm; lower is closer), mean ± sd over draws and seeds. Hollow ends: everybody chose the same, scored against smoothed shares.",
                plan: None,
                caption: caption(share),
                table: match &share.outcome {
                    Outcome::Ready { result } => share_table(result),
                    Outcome::Running { .. } => Table::default(),
                },
            },
            gap: Figure {
                kind: "gap_sweep",
                title: "Which model one takes matters most where the options are close",
                subtitle: "ln KL of Noisy Rational minus ln KL of Risk-Aware (above 0 Risk-Aware is closer), mean ± sd, while one reward of the problem varies and the answers stay as they are. Left of 0 most of these people choose what is worse.",
                plan: None,
                caption: caption(gap),
                table: match &gap.outcome {
                    Outcome::Ready { result } => gap_table(result, &gap.labels, unit),
                    Outcome::Running { .. } => Table::default(),
                },
            },
            optimal: Figure {
                kind: "optimal",
                title: "Do people here choose what is better, the more it is better?",
                subtitle: "Share of people in this study who chose the action with the highest expected reward, with 95 % Wilson intervals, against how much better it is. Filled: cells of the design; hollow: baseline questions. Questions with one gap stand side by side.",
                plan: None,
                caption: format!(
                    "n = {} answers · data version {}",
                    count(gap.observed.iter().flatten().map(|row| row.n).sum::<u64>()),
                    snapshot.version.data_version
                ),
                table: optimal_table(gap.observed.as_deref().unwrap_or_default(), unit),
            },
        }
    }
}

fn caption(sweep: &Sweep) -> String {
    match &sweep.outcome {
        Outcome::Running { done, of, ahead: 0 } => format!(
            "Being computed: {} of {} fits are done. Reload the page to see the numbers.",
            count(*done as u64),
            count(*of as u64)
        ),
        Outcome::Running { ahead, .. } => {
            format!("Waits for {ahead} other sweeps. Reload the page to see the numbers.")
        }
        Outcome::Ready { result } => {
            let (head, what) = match result.as_ref() {
                SweepResult::Share(report) => (
                    &report.head,
                    format!("Simulated answers, n = {} at each point", report.n),
                ),
                SweepResult::Gap(report) => {
                    (&report.head, format!("Simulated answers, {}", report.vary))
                }
            };
            format!(
                "{what} · {} seeds from {} · {} draws each",
                head.seeds, head.seed, head.samples
            )
        }
    }
}

fn score(models: &OrderedMap<SweepScore>, id: &str) -> String {
    models.get(id).map_or_else(
        || "–".to_owned(),
        |score| mean_sd(score.ln_kl.mean, score.ln_kl.sd, 2),
    )
}

fn share_table(result: &SweepResult) -> Table {
    let mut table = Table::new(&[
        ("Share", Align::Words),
        ("Answers", Align::Numbers),
        ("Risk-Aware, ln KL", Align::Numbers),
        ("Noisy Rational, ln KL", Align::Numbers),
        ("Reference", Align::Numbers),
    ]);
    let SweepResult::Share(ShareSweepReport {
        points,
        n,
        reference_level,
        ..
    }) = result
    else {
        return table;
    };
    for point in points {
        let mark = if point.unanimous { " (smoothed)" } else { "" };
        table.row([
            format!("{}{mark}", percent(Some(point.share))),
            format!("{} of {n}", point.count),
            score(&point.models, RISK_AWARE.id),
            score(&point.models, NOISY_RATIONAL.id),
            decimal((!point.unanimous).then_some(*reference_level), 2),
        ]);
    }
    table
}

fn gap_table(result: &SweepResult, labels: &OrderedMap<String>, unit: &RewardUnit) -> Table {
    let mut table = Table::new(&[
        ("Problem", Align::Words),
        ("Value", Align::Numbers),
        ("Gap", Align::Numbers),
        ("Risk-Aware, ln KL", Align::Numbers),
        ("Noisy Rational, ln KL", Align::Numbers),
        ("Risk-Aware closer by", Align::Numbers),
    ]);
    let SweepResult::Gap(GapSweepReport { series, .. }) = result else {
        return table;
    };
    for series in series {
        for point in &series.points {
            let difference = point.difference.get(RISK_AWARE.id);
            table.row([
                labels
                    .get(&series.problem)
                    .cloned()
                    .unwrap_or_else(|| series.problem.clone()),
                unit.format(rounded(point.value)),
                unit.format(rounded(point.gap)),
                score(&point.models, RISK_AWARE.id),
                score(&point.models, NOISY_RATIONAL.id),
                difference.map_or_else(
                    || "–".to_owned(),
                    |difference| mean_sd(difference.mean, difference.sd, 2),
                ),
            ]);
        }
    }
    table
}

fn optimal_table(rows: &[ObservedRow], unit: &RewardUnit) -> Table {
    let mut table = Table::new(&[
        ("Question", Align::Words),
        ("Kind", Align::Words),
        ("Gap", Align::Numbers),
        ("n", Align::Numbers),
        ("Optimal", Align::Numbers),
        ("95 % Wilson", Align::Words),
    ]);
    for row in rows {
        let kind = if row.baseline { "baseline" } else { "cell" };
        table.row([
            row.label.clone(),
            kind.to_owned(),
            unit.format(rounded(row.gap)),
            count(row.n),
            percent(row.share),
            percents(row.low, row.high),
        ]);
    }
    table
}

fn rounded(value: f64) -> f64 {
    // Adding 0 keeps −0 from being shown.
    (value * 1e6).round() / 1e6 + 0.0
}
