//! How fitted models compare, for `riskaware fit`.

use std::io::{self, Write};
use std::ops::ControlFlow;
use std::time::Duration;

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};

use crate::inference::comparison::{
    BayesFactor, Comparison, ComparisonProgress, ComparisonSettings, HeldOut, KnownFit, LadderStep,
    LeaveOneOutDifference, OBSERVED_SHARE, Pair, PlanData, PriorChange, Unit, compare_models,
};
use crate::inference::{ChoiceData, Fit, FitSettings};
use crate::model::{ChoiceModel, MODELS};

/// Compares models that were fitted together; nothing for one alone.
///
/// * `full`: also hold problems out and change priors, for which every model is fitted again.
pub(super) fn compare(
    data: &ChoiceData,
    unit: Unit,
    fits: &[Fit],
    settings: &FitSettings,
    full: bool,
) -> anyhow::Result<Option<Comparison>> {
    if fits.len() < 2 {
        return Ok(None);
    }
    // The family stands in the order of the ladder, whatever the order of the arguments.
    let models: Vec<&'static ChoiceModel> = MODELS
        .into_iter()
        .filter(|model| fits.iter().any(|fit| fit.model == *model))
        .collect();
    let known: Vec<KnownFit> = fits
        .iter()
        .map(|fit| KnownFit {
            part: 0,
            fit: fit.clone().into(),
        })
        .collect();
    let wanted = if full {
        ComparisonSettings::full(settings.seed)
    } else {
        ComparisonSettings::BRIEF
    };
    let plan = PlanData::whole(data, unit);
    let bar = ProgressBar::new_spinner();
    bar.set_style(ProgressStyle::default_spinner());
    bar.enable_steady_tick(Duration::from_millis(100));
    let mut known_progress = None;
    let compared = compare_models(&plan, &models, settings, &known, &wanted, &mut |progress| {
        if known_progress != Some(progress) {
            known_progress = Some(progress);
            bar.set_message(message(progress));
        }
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    compared.map(Some).context("cannot compare the models")
}

fn message(progress: ComparisonProgress) -> String {
    match progress {
        ComparisonProgress::Fitting(model) => format!("{}: fitting", model.label),
        ComparisonProgress::LeavingOut(model) => format!("{}: leaving out", model.label),
        ComparisonProgress::ChangingPriors(model) => format!("{}: changing priors", model.label),
        ComparisonProgress::HoldingOut(model) => format!("{}: holding out", model.label),
        ComparisonProgress::Resampling(model) => format!("{}: resampling", model.label),
    }
}

/// Writes the ladder, then what speaks for each model against the one before.
pub(super) fn write_comparison(out: &mut dyn Write, comparison: &Comparison) -> io::Result<()> {
    writeln!(out)?;
    match comparison.unit {
        Unit::Participant => writeln!(
            out,
            "Prediction of {} people, each left out in turn (nats)",
            comparison.units
        )?,
        Unit::Answer => writeln!(
            out,
            "Prediction of {} answers, each left out in turn, since the file does not say who gave which (nats)",
            comparison.units
        )?,
    }
    writeln!(
        out,
        "{:<28} {:>12} {:>11} {:>20} {:>12} {:>11} {:>20}",
        "", "left out", "per answer", "gain ± se", "held out", "per answer", "gain ± se"
    )?;
    for step in &comparison.ladder {
        write_step(out, step)?;
    }
    for pair in &comparison.pairs {
        write_pair(out, comparison, pair)?;
    }
    if let Some(held_out) = &comparison.held_out {
        write_held_out(out, held_out)?;
    }
    Ok(())
}

fn write_step(out: &mut dyn Write, step: &LadderStep) -> io::Result<()> {
    let mut line = format!("{:<28}", step.label);
    for found in [step.units, step.problems] {
        let Some(found) = found else {
            line += &format!(" {:>12} {:>11} {:>20}", "-", "-", "-");
            continue;
        };
        let gain = found
            .gain
            .map_or_else(|| "-".to_owned(), |gain| with_error(gain.value, gain.se));
        line += &format!(
            " {:>12.2} {:>11.4} {gain:>20}",
            found.score, found.per_answer
        );
    }
    writeln!(out, "{}", line.trim_end())
}

fn write_pair(out: &mut dyn Write, comparison: &Comparison, pair: &Pair) -> io::Result<()> {
    let label = |id: &str| {
        let known = comparison.models.get(id);
        known.map_or_else(|| id.to_owned(), |model| model.label.clone())
    };
    writeln!(
        out,
        "{} against {}:",
        label(&pair.first),
        label(&pair.second)
    )?;
    if let Some(left_out) = &pair.leave_one_out {
        write_left_out(out, left_out)?;
    }
    if let Some(held_out) = pair.held_out {
        writeln!(
            out,
            "  held out one at a time: {} over {} distinct problems",
            with_error(held_out.value, held_out.se),
            held_out.units
        )?;
    }
    if let Some(factor) = &pair.bayes_factor {
        write_bayes_factor(out, factor)?;
    }
    Ok(())
}

fn write_left_out(out: &mut dyn Write, left_out: &LeaveOneOutDifference) -> io::Result<()> {
    let note = if left_out.distinguishable {
        ""
    } else {
        ", not distinguishable"
    };
    writeln!(
        out,
        "  left out one at a time: {}{note}",
        with_error(left_out.difference.value, left_out.difference.se)
    )
}

fn write_bayes_factor(out: &mut dyn Write, factor: &BayesFactor) -> io::Result<()> {
    let words = factor
        .words
        .map_or_else(String::new, |words| format!(", {} evidence", words.label()));
    writeln!(
        out,
        "  ln Bayes factor: {}{words} (depends on the priors)",
        with_error(factor.ln.value, Some(factor.ln.se))
    )?;
    for row in factor.sensitivity.iter().flatten() {
        let change = match row.change {
            PriorChange::TauLogSd => "log-sd of tau",
            PriorChange::WeightingFloor => "lower end of gamma and delta",
            PriorChange::LambdaLogSd => "log-sd of lambda",
        };
        let found = row.ln.map_or_else(
            || "a fit did not converge".to_owned(),
            |ln| with_error(ln.value, Some(ln.se)),
        );
        let mark = if row.in_use { " (in use)" } else { "" };
        writeln!(out, "    {change} {}: {found}{mark}", row.value)?;
    }
    Ok(())
}

fn write_held_out(out: &mut dyn Write, held_out: &HeldOut) -> io::Result<()> {
    let shares = held_out.scores.get(OBSERVED_SHARE).copied().flatten();
    if let Some(shares) = shares {
        writeln!(
            out,
            "Observed shares of the other problems score {:.2} on held-out problems, {:.4} per answer",
            shares.score, shares.per_answer
        )?;
    }
    Ok(())
}

pub(super) fn with_error(value: f64, se: Option<f64>) -> String {
    match se {
        Some(se) => format!("{value:+.2} ± {se:.2}"),
        None => format!("{value:+.2}"),
    }
}
