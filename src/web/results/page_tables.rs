//! The tables of the results page, with the columns that static/js/figures writes when numbers change.

use super::{
    accuracy::{Accuracy, PaperScore, PooledRow, Score},
    format::{count, decimal, interval, mean_sd, percent, percents},
    summary::{CellRow, FitRow, Share, Summary},
    table::{Align, Cell, Table},
};
use crate::{
    inference::accuracy::TTest,
    jobs::PartState,
    model::{NOISY_RATIONAL, OrderedMap, RISK_AWARE},
};

/// Risk-Aware first, as in every figure.
const MODELS: [&crate::model::ChoiceModel; 2] = [&RISK_AWARE, &NOISY_RATIONAL];

/// What people chose in each cell of the design, in file order.
pub(super) fn actions(summary: &Summary) -> Table {
    let mut table = Table::new(&[
        ("Cell", Align::Words),
        ("Action", Align::Words),
        ("n", Align::Numbers),
        ("Chosen", Align::Numbers),
        ("95 % Wilson", Align::Words),
        ("Risk-Aware (90 %)", Align::Words),
        ("Noisy Rational (90 %)", Align::Words),
    ]);
    for cell in &summary.cells {
        for action in &cell.actions {
            let mut row = vec![
                cell.label.clone(),
                action.label.clone(),
                count(cell.n),
                percent(action.share),
                percents(action.low, action.high),
            ];
            row.extend(MODELS.map(|model| predicted(cell, model.id, &action.id)));
            table.row(row);
        }
    }
    table
}

fn predicted(cell: &CellRow, model: &str, action: &str) -> String {
    let share: Option<&Share> = cell
        .predicted
        .get(model)
        .and_then(Option::as_ref)
        .and_then(|shares| shares.get(action));
    match share {
        Some(share) => {
            format!(
                "{} ({})",
                percent(Some(share.mean)),
                percents(Some(share.q5), Some(share.q95))
            )
        }
        None if cell.fitted => "–".to_owned(),
        None => "not fitted".to_owned(),
    }
}

/// How many answers of each cell count, and which do not.
pub(super) fn exclusions(summary: &Summary) -> Table {
    let mut table = Table::new(&[
        ("Cell", Align::Words),
        ("Valid answers", Align::Numbers),
        ("Counted", Align::Numbers),
        ("Late", Align::Numbers),
        ("Timed out", Align::Numbers),
    ]);
    for cell in &summary.cells {
        table.row([
            cell.label.clone(),
            count(cell.before_exclusions),
            count(cell.n),
            count(cell.late),
            count(cell.timed_out),
        ]);
    }
    table
}

/// Baseline questions, where one action is plainly better.
pub(super) fn checks(summary: &Summary) -> Option<Table> {
    let baseline = summary.checks.baseline.as_ref()?;
    let mut table = Table::new(&[
        ("Problem", Align::Words),
        ("Better action", Align::Words),
        ("n", Align::Numbers),
        ("Chose it", Align::Numbers),
        ("95 % Wilson", Align::Numbers),
    ]);
    for row in &baseline.problems {
        let label = summary
            .actions
            .iter()
            .find(|action| action.id == row.optimal)
            .map(|action| action.label.as_str());
        table.row([
            row.label.clone(),
            label.unwrap_or(&row.optimal).to_owned(),
            count(row.n),
            percent(row.share),
            percents(row.low, row.high),
        ]);
    }
    table.row([
        "Together".to_owned(),
        String::new(),
        count(baseline.n),
        percent(baseline.share),
        percents(baseline.low, baseline.high),
    ]);
    Some(table)
}

/// ln KL of both models in each fitted cell.
pub(super) fn ln_kl(accuracy: &Accuracy) -> Table {
    let mut table = Table::new(&[
        ("Cell", Align::Words),
        ("n", Align::Numbers),
        ("Model", Align::Words),
        ("ln KL, mean ± sd", Align::Numbers),
        ("Median", Align::Numbers),
        ("5–95 %", Align::Numbers),
        ("Exact draws", Align::Numbers),
        ("Reference", Align::Numbers),
    ]);
    for cell in &accuracy.cells {
        for model in MODELS {
            let score = score(&cell.models, model.id);
            let mark = if cell.unanimous { " (unanimous)" } else { "" };
            table.row([
                format!("{}{mark}", cell.label),
                count(cell.n),
                model.label.to_owned(),
                mean_sd(
                    score.and_then(|score| score.mean),
                    score.and_then(|score| score.sd),
                    2,
                ),
                decimal(score.and_then(|score| score.median), 2),
                interval(
                    score.and_then(|score| score.q5),
                    score.and_then(|score| score.q95),
                    2,
                ),
                score.map_or_else(|| "–".to_owned(), |score| count(score.zeros as u64)),
                decimal(cell.reference, 2),
            ]);
        }
    }
    table
}

fn score<'a>(models: &'a OrderedMap<Option<Score>>, model: &str) -> Option<&'a Score> {
    models.get(model).and_then(Option::as_ref)
}

/// Pooled ln KL with tests, the paper's row below ours.
pub(super) fn pooled(accuracy: &Accuracy, rows: &[PooledRow]) -> Table {
    let mut table = Table::new(&[
        ("Cells", Align::Words),
        ("From", Align::Words),
        ("Risk-Aware", Align::Numbers),
        ("Noisy Rational", Align::Numbers),
        ("Paired t", Align::Numbers),
        ("Welch t", Align::Numbers),
        ("Cells left out", Align::Numbers),
    ]);
    for row in rows {
        let model = |id| {
            let score = score(&row.models, id);
            mean_sd(
                score.and_then(|score| score.mean),
                score.and_then(|score| score.sd),
                2,
            )
        };
        table.row([
            row.label.clone(),
            "these answers".to_owned(),
            model(RISK_AWARE.id),
            model(NOISY_RATIONAL.id),
            test(row.paired_t.as_ref()),
            test(row.welch_t.as_ref()),
            count(row.left_out as u64),
        ]);
        for paper in accuracy
            .paper
            .iter()
            .filter(|paper| paper.label == row.label)
        {
            let model = |score: Option<&PaperScore>| {
                mean_sd(
                    score.map(|score| score.mean),
                    score.map(|score| score.sd),
                    1,
                )
            };
            let t = match (paper.t, paper.df, &paper.p) {
                (Some(t), Some(df), Some(p)) => {
                    format!("t({df}) = {}, p {}", decimal(Some(t), 2), sign(p))
                }
                (Some(t), Some(df), None) => format!("t({df}) = {}", decimal(Some(t), 2)),
                (Some(_), None, Some(_) | None) | (None, Some(_) | None, Some(_) | None) => {
                    "–".to_owned()
                }
            };
            table.row([
                row.label.clone(),
                "the paper".to_owned(),
                model(paper.risk_aware.as_ref()),
                model(paper.noisy_rational.as_ref()),
                t,
                "–".to_owned(),
                "–".to_owned(),
            ]);
        }
    }
    table
}

fn test(test: Option<&TTest>) -> String {
    let Some(test) = test else {
        return "–".to_owned();
    };
    let df = if test.df.fract() == 0.0 {
        format!("{}", test.df)
    } else {
        format!("{:.1}", test.df)
    };
    let p = if test.p < 0.001 {
        "< .001".to_owned()
    } else {
        format!("= {}", format!("{:.3}", test.p).trim_start_matches('0'))
    };
    format!("t({df}) = {}, p {p}", decimal(Some(test.t), 2))
}

fn sign(p: &str) -> String {
    if p.starts_with(['<', '>', '=']) {
        p.to_owned()
    } else {
        format!("= {p}")
    }
}

/// The state of each fit.
pub(super) fn fits(summary: &Summary) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Part", Align::Words),
        ("Model", Align::Words),
        ("State", Align::Words),
        ("largest R̂", Align::Numbers),
        ("smallest ESS", Align::Numbers),
        ("Draws", Align::Numbers),
        ("Seed", Align::Numbers),
        ("Message", Align::Prose),
    ]);
    for fit in &summary.fits {
        table.rows.push(fit_row(fit));
    }
    table
}

fn fit_row(fit: &FitRow) -> Vec<Cell> {
    vec![
        fit.plan_label.clone().into(),
        fit.part_label.clone().into(),
        fit.model_label.into(),
        state(fit),
        decimal(fit.rhat_max, 3).into(),
        fit.ess_min
            .map_or_else(|| "–".to_owned(), |ess| count(ess.round() as u64))
            .into(),
        fit.draws.map_or_else(|| "–".to_owned(), count).into(),
        fit.seed
            .map_or_else(|| "–".to_owned(), |seed| seed.to_string())
            .into(),
        fit.message.clone().unwrap_or_default().into(),
    ]
}

fn state(fit: &FitRow) -> Cell {
    let (id, word) = match fit.state {
        PartState::Converged if fit.provisional => ("converged", "converged, provisional"),
        PartState::Unconverged if fit.provisional => {
            ("unconverged", "not converged yet, provisional")
        }
        PartState::Waiting => ("waiting", "waiting"),
        PartState::Running => ("running", "running"),
        PartState::Converged => ("converged", "converged"),
        PartState::Unconverged => ("unconverged", "not converged yet"),
        PartState::Failed => ("failed", "failed"),
    };
    Cell::State { id, word }
}
