//! Sweeps as a table and as CSV.

use std::fmt::Write;

use super::sweep::Report;
use crate::inference::sweep::{GapSweepReport, ShareSweepReport, SweepHead, SweepScore};

/// The table for people.
pub(super) fn table(report: &Report) -> String {
    match report {
        Report::Share(report) => share_table(report),
        Report::Gap(report) => gap_table(report),
    }
}

fn share_table(report: &ShareSweepReport) -> String {
    let expected: Vec<String> = report
        .expected_rewards
        .iter()
        .map(|(action, reward)| format!("{action} {}", short(*reward)))
        .collect();
    let mut text = format!(
        "{}: share of {} (the rest {}), {} answers; expected rewards: {}\n{}\nreference level {:.2}\n\n",
        report.problem,
        report.action,
        report.rest,
        report.n,
        expected.join(", "),
        made(&report.head),
        report.reference_level
    );
    let width = columns(&mut text, "share", &report.head);
    for point in &report.points {
        let mark = if point.unanimous { "*" } else { "" };
        let label = format!("{}/{}{mark}", point.count, report.n);
        let _ = write!(text, "{label:>12}");
        for (_, score) in point.models.iter() {
            let _ = write!(text, "  {:>width$}", mean_sd(score));
        }
        text.push('\n');
    }
    text.push_str("* all answers are the same: against smoothed shares, no reference level\n");
    text.push_str(&unconverged(
        report.points.iter().flat_map(|point| point.models.iter()),
    ));
    text
}

fn gap_table(report: &GapSweepReport) -> String {
    let mut text = format!("{}; {}\n", report.vary, made(&report.head));
    for series in &report.series {
        let _ = writeln!(
            text,
            "\n{}: gap is the expected reward of {} minus the best other\n",
            series.problem, series.held
        );
        let width = columns(&mut text, "value", &report.head);
        for point in &series.points {
            let _ = write!(text, "{:>12}", short(point.value));
            for (_, score) in point.models.iter() {
                let _ = write!(text, "  {:>width$}", mean_sd(score));
            }
            let _ = write!(text, "   gap {:>8}", short(point.gap));
            for (model, difference) in point.difference.iter() {
                let difference = match (difference.mean, difference.standard_error) {
                    (Some(mean), Some(error)) => format!("{mean:.2} (se {error:.2})"),
                    (Some(mean), None) => format!("{mean:.2}"),
                    (None, _) => "-".to_owned(),
                };
                let _ = write!(text, "   {model} closer by {difference}");
            }
            let counts: Vec<String> = point.counts.iter().map(u64::to_string).collect();
            let _ = writeln!(text, "   answers {}", counts.join(":"));
        }
    }
    let points = report.series.iter().flat_map(|series| &series.points);
    text.push_str(&unconverged(points.flat_map(|point| point.models.iter())));
    text
}

fn columns(text: &mut String, first: &str, head: &SweepHead) -> usize {
    let width = head.models.iter().map(String::len).fold(14, usize::max);
    let _ = write!(text, "{first:>12}");
    for model in &head.models {
        let _ = write!(text, "  {model:>width$}");
    }
    text.push('\n');
    width
}

fn made(head: &SweepHead) -> String {
    let reference = head.reference_reward.map_or_else(String::new, |reward| {
        format!(", reference reward {}", short(reward))
    });
    format!(
        "ln KL, mean ± sd over {} independent draws of each of {} fits, seeds {} to {}{reference}",
        head.samples,
        head.seeds,
        head.seed,
        head.seed.wrapping_add(head.seeds as u64 - 1)
    )
}

fn unconverged<'a>(scores: impl Iterator<Item = (&'a str, &'a SweepScore)>) -> String {
    let left_out: usize = scores.map(|(_, score)| score.unconverged).sum();
    if left_out == 0 {
        String::new()
    } else {
        format!("{left_out} fits are left out because their chains did not converge\n")
    }
}

fn mean_sd(score: &SweepScore) -> String {
    match (score.ln_kl.mean, score.ln_kl.sd) {
        (Some(mean), Some(sd)) => format!("{mean:.2} ± {sd:.2}"),
        (None, Some(_) | None) | (Some(_), None) => "-".to_owned(),
    }
}

/// A number without the noise of its last digits.
fn short(value: f64) -> String {
    format!("{}", (value * 1e6).round() / 1e6)
}

/// One row per point and model.
pub(super) fn csv(report: &Report) -> anyhow::Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let scores = |score: &SweepScore| {
        let ln_kl = &score.ln_kl;
        let mut fields: Vec<String> = [
            ln_kl.mean,
            ln_kl.sd,
            ln_kl.median,
            ln_kl.q5,
            ln_kl.q95,
            score.standard_error,
        ]
        .map(number)
        .to_vec();
        fields.push(ln_kl.exact_zeros.to_string());
        fields.push(score.unconverged.to_string());
        fields
    };
    const SCORES: [&str; 8] = [
        "mean",
        "sd",
        "median",
        "q5",
        "q95",
        "standard_error",
        "exact_zeros",
        "unconverged",
    ];
    match report {
        Report::Share(report) => {
            let head = [
                "problem",
                "action",
                "n",
                "count",
                "share",
                "unanimous",
                "reference",
                "model",
            ];
            writer.write_record(head.iter().chain(&SCORES))?;
            for point in &report.points {
                for (model, score) in point.models.iter() {
                    let mut row = vec![
                        report.problem.clone(),
                        report.action.clone(),
                        report.n.to_string(),
                        point.count.to_string(),
                        point.share.to_string(),
                        point.unanimous.to_string(),
                        number((!point.unanimous).then_some(report.reference_level)),
                        model.to_owned(),
                    ];
                    row.extend(scores(score));
                    writer.write_record(row)?;
                }
            }
        }
        Report::Gap(report) => {
            let head = [
                "problem",
                "held",
                "value",
                "gap",
                "counts",
                "unanimous",
                "model",
            ];
            let last = ["closer_by", "closer_by_standard_error"];
            writer.write_record(head.iter().chain(&SCORES).chain(&last))?;
            for series in &report.series {
                for point in &series.points {
                    for (model, score) in point.models.iter() {
                        let counts: Vec<String> = point.counts.iter().map(u64::to_string).collect();
                        let mut row = vec![
                            series.problem.clone(),
                            series.held.clone(),
                            short(point.value),
                            short(point.gap),
                            counts.join(":"),
                            point.unanimous.to_string(),
                            model.to_owned(),
                        ];
                        row.extend(scores(score));
                        let difference = point.difference.get(model);
                        row.push(number(difference.and_then(|difference| difference.mean)));
                        row.push(number(
                            difference.and_then(|difference| difference.standard_error),
                        ));
                        writer.write_record(row)?;
                    }
                }
            }
        }
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}
