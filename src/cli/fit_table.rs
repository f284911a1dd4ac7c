//! What fits say, as a table for people.

use std::io::{self, Write};

use super::choice_files::LeftOut;
use crate::inference::accuracy::{CellAccuracy, LnKl, Shares, pooled};
use crate::inference::{ChoiceData, Fit, ParameterSummary, QuantityDiagnostics, Source};
use crate::model::{Curvature, Parameter};

/// Writes a comparison of the models with chance, then each model's parameters, then what each predicts.
pub(super) fn write_table(
    out: &mut dyn Write,
    data: &ChoiceData,
    left_out: LeftOut,
    fits: &[Fit],
    show_unconverged: bool,
) -> io::Result<()> {
    writeln!(
        out,
        "{} choices in {} problems, {} rows left out as not answered, {} as of other problems",
        data.n(),
        data.problems().len(),
        left_out.unanswered,
        left_out.other_problems
    )?;
    let shown: Vec<&Fit> = fits
        .iter()
        .filter(|fit| fit.summary.converged || show_unconverged)
        .collect();
    write_comparison(out, data, &shown)?;
    for fit in fits {
        writeln!(out)?;
        write_diagnostics(out, fit)?;
        if fit.summary.converged || show_unconverged {
            write_parameters(out, fit)?;
            write_loss_aversion(out, fit, &shown)?;
        }
        let notes = &fit.summary.notes;
        for note in notes
            .iter()
            .filter(|note| fit.summary.converged || show_unconverged || note.is_diagnostic())
        {
            writeln!(out, "  Note: {note}")?;
        }
    }
    if !shown.is_empty() {
        write_predictions(out, data, &shown)?;
    }
    Ok(())
}

fn write_comparison(out: &mut dyn Write, data: &ChoiceData, fits: &[&Fit]) -> io::Result<()> {
    writeln!(out)?;
    writeln!(
        out,
        "{:<16} {:>12} {:>12}   ln KL, mean ± sd",
        "", "max ln L", "ln evidence"
    )?;
    let by_chance: f64 = data
        .problems()
        .iter()
        .zip(data.totals())
        .map(|(problem, counts)| {
            let n: u64 = counts.iter().sum();
            -(n as f64) * (problem.problem.actions().len() as f64).ln()
        })
        .sum();
    let chance = chance_accuracy(data);
    let cells: Vec<&CellAccuracy> = chance.iter().collect();
    writeln!(
        out,
        "{:<16} {by_chance:>12.4} {by_chance:>12.4}   {}",
        "random",
        mean_and_sd(&pooled(&cells, Shares::Observed))
    )?;
    for fit in fits {
        let cells: Vec<&CellAccuracy> = fit.accuracy.iter().collect();
        let evidence = fit.summary.log_marginal_likelihood.map_or_else(
            || format!("{:>12}", "-"),
            |evidence| format!("{:>12.4}", evidence.value),
        );
        writeln!(
            out,
            "{:<16} {:>12.4} {evidence}   {}",
            fit.model.label,
            fit.summary.max_log_likelihood.unwrap_or(f64::NAN),
            mean_and_sd(&pooled(&cells, Shares::Observed))
        )?;
    }
    Ok(())
}

fn chance_accuracy(data: &ChoiceData) -> Vec<CellAccuracy> {
    let cells = data.problems().iter().zip(data.totals());
    cells
        .filter_map(|(problem, counts)| {
            let even = vec![-(counts.len() as f64).ln(); counts.len()];
            CellAccuracy::of(&problem.id, counts, &[&even])
        })
        .collect()
}

pub(super) fn mean_and_sd(ln_kl: &LnKl) -> String {
    match (ln_kl.mean, ln_kl.sd) {
        (Some(mean), Some(sd)) => format!("{mean:.2} ± {sd:.2}"),
        (Some(mean), None) => format!("{mean:.2}"),
        (None, _) => "-".to_owned(),
    }
}

fn write_diagnostics(out: &mut dyn Write, fit: &Fit) -> io::Result<()> {
    let summary = &fit.summary;
    let diagnostics = &summary.diagnostics;
    let all = || {
        diagnostics
            .parameters
            .iter()
            .chain(diagnostics.predicted.iter())
            .map(|(_, found)| *found)
    };
    let worst = |value: fn(QuantityDiagnostics) -> f64, low: bool| {
        all()
            .map(value)
            .fold(if low { f64::INFINITY } else { 0.0 }, |worst, value| {
                if value.is_nan() || worst.is_nan() {
                    f64::NAN
                } else if low {
                    worst.min(value)
                } else {
                    worst.max(value)
                }
            })
    };
    writeln!(
        out,
        "{}: {} ({} chains of {} draws, acceptance {}, worst R-hat {:.4}, bulk ESS {:.0}, tail ESS {:.0}, seed {})",
        fit.model.label,
        if summary.converged {
            "converged"
        } else {
            "NOT CONVERGED"
        },
        summary.chains,
        summary.draws,
        summary
            .acceptance
            .map_or_else(|| "-".to_owned(), |share| format!("{share:.2}")),
        worst(|found| found.rhat, false),
        worst(|found| found.ess_bulk, true),
        worst(|found| found.ess_tail, true),
        summary.seed,
    )?;
    Ok(())
}

fn write_parameters(out: &mut dyn Write, fit: &Fit) -> io::Result<()> {
    writeln!(
        out,
        "  {:<13} {:>10} {:>10} {:>10} {:>10} {:>10}   {:<23} max L",
        "", "mean", "sd", "5 %", "50 %", "95 %", "prior 5 % to 95 %"
    )?;
    let Some(parameters) = &fit.summary.parameters else {
        return Ok(());
    };
    for (name, found) in parameters.iter() {
        let prior = format!("{} to {}", short(found.prior_q5), short(found.prior_q95));
        let best = fit.summary.max_likelihood_parameters.as_ref();
        let best = best.and_then(|best| best.get(name).copied().flatten());
        let note = note(found);
        writeln!(
            out,
            "  {name:<13} {:>10} {:>10} {:>10} {:>10} {:>10}   {prior:<23} {}{note}",
            short(found.mean),
            short(found.sd),
            short(found.q5),
            short(found.q50),
            short(found.q95),
            best.map_or_else(|| "-".to_owned(), short),
        )?;
    }
    Ok(())
}

/// That the choices say nothing about a parameter, or hardly anything.
pub(super) fn note(found: &ParameterSummary) -> &'static str {
    match found.source {
        Source::Prior => "  the prior: no choice depends on it",
        Source::Choices if !found.informed => "  not informed by these choices",
        Source::Choices => "",
    }
}

/// Loss aversion where it depends on the amount, with what a model of one curvature says beside it.
fn write_loss_aversion(out: &mut dyn Write, fit: &Fit, shown: &[&Fit]) -> io::Result<()> {
    let Some(amounts) = &fit.summary.loss_aversion else {
        return Ok(());
    };
    writeln!(out, "  loss aversion -v(-x)/v(x), median (5 % to 95 %)")?;
    for at in amounts {
        writeln!(
            out,
            "    at {:<10} {:>10} ({} to {})",
            at.amount,
            short(at.q50),
            short(at.q5),
            short(at.q95)
        )?;
    }
    let one_curvature = shown.iter().find_map(|other| {
        let has_one =
            other.model.curvature == Curvature::Shared && other.model.is_free(Parameter::Lambda);
        let lambda = other.summary.parameters.as_ref()?.get("lambda")?;
        has_one.then_some((other.model.label, lambda))
    });
    if let Some((label, lambda)) = one_curvature {
        writeln!(
            out,
            "    any amount    {:>10} ({} to {}) in {label}",
            short(lambda.q50),
            short(lambda.q5),
            short(lambda.q95)
        )?;
    }
    Ok(())
}

fn write_predictions(out: &mut dyn Write, data: &ChoiceData, fits: &[&Fit]) -> io::Result<()> {
    writeln!(out)?;
    write!(
        out,
        "{:<24} {:<16} {:>7} {:>9}",
        "problem", "action", "n", "observed"
    )?;
    for fit in fits {
        write!(out, "  {:>24}", fit.model.label)?;
    }
    writeln!(out)?;
    for (problem, counts) in data.problems().iter().zip(data.totals()) {
        let n: u64 = counts.iter().sum();
        for (action, count) in problem.problem.names().zip(counts) {
            let share = if n == 0 {
                "-".to_owned()
            } else {
                format!("{:.3}", *count as f64 / n as f64)
            };
            write!(out, "{:<24} {action:<16} {count:>7} {share:>9}", problem.id)?;
            for fit in fits {
                let predicted = fit.summary.predicted.as_ref();
                let found = predicted.and_then(|map| map.get(&problem.id)?.get(action));
                let text = found.map_or_else(String::new, |share| {
                    format!("{:.3} ({:.3} to {:.3})", share.mean, share.q5, share.q95)
                });
                write!(out, "  {text:>24}")?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}

/// Four digits, however large or small.
pub(super) fn short(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || (1e-3..1e5).contains(&size) {
        let digits = if size >= 1000.0 {
            0
        } else if size >= 10.0 {
            2
        } else {
            4
        };
        format!("{value:.digits$}")
    } else {
        format!("{value:.3e}")
    }
}
