//! The values of a column compared, for `riskaware fit --by`.

use std::io::{self, Write};
use std::ops::ControlFlow;

use anyhow::Context;

use super::choice_files::ChoiceLevel;
use super::fit_comparison::with_error;
use super::fit_table::{mean_and_sd, note, short};
use super::parallel::progress_bar;
use crate::inference::FitSettings;
use crate::inference::factor::{
    Contrast, FactorDesign, FactorPart, FactorPartReport, FactorReport, FactorVerdict,
    compare_levels,
};
use crate::model::{ChoiceModel, model_named};

/// Fits each model to the choices of each value, and to all of them.
pub(super) fn compare(
    column: &str,
    levels: Vec<ChoiceLevel>,
    models: &[&'static ChoiceModel],
    settings: &FitSettings,
) -> anyhow::Result<FactorReport> {
    let design = FactorDesign {
        factor: column.to_owned(),
        levels: levels
            .iter()
            .map(|level| (level.name.clone(), level.people))
            .collect(),
        parts: models
            .iter()
            .map(|model| FactorPart {
                id: "all".to_owned(),
                label: "All problems together".to_owned(),
                model,
                settings: settings.clone(),
                levels: levels.iter().map(|level| level.data.clone()).collect(),
            })
            .collect(),
    };
    let bar = progress_bar(design.fits() as u64);
    bar.set_message(format!("values of {column}"));
    let compared = compare_levels(&design, &mut |done| {
        bar.set_position(done as u64);
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    compared.with_context(|| format!("cannot compare the values of `{column}`"))
}

/// Writes how much there is of each value, then what each model says.
pub(super) fn write_table(out: &mut dyn Write, report: &FactorReport) -> io::Result<()> {
    writeln!(out)?;
    writeln!(
        out,
        "Values of {}, each with fits of its own\n  {:<24} {:>8} {:>8}",
        report.factor, "", "people", "choices"
    )?;
    for level in &report.levels {
        let people = level
            .people
            .map_or_else(|| "-".to_owned(), |people| people.to_string());
        writeln!(out, "  {:<24} {people:>8} {:>8}", level.label(), level.n)?;
    }
    for (model, found) in report.models.iter() {
        let label = model_named(model).map_or(model, |model| model.label);
        writeln!(out)?;
        match &found.evidence {
            None => writeln!(
                out,
                "{label} by {}: a fit did not converge, so nothing is said on whether they differ",
                report.factor
            )?,
            Some(evidence) => writeln!(
                out,
                "{label} by {}: {}\n  ln Bayes factor of separate to shared parameters: {} (depends on the priors)\n  ln evidence: separate {}, shared {}",
                report.factor,
                words(evidence.verdict),
                with_error(
                    evidence.ln_bayes_factor.value,
                    Some(evidence.ln_bayes_factor.se)
                ),
                with_error(evidence.separate.value, Some(evidence.separate.se)),
                with_error(evidence.shared.value, Some(evidence.shared.se)),
            )?,
        }
        for part in &found.parts {
            write_levels(out, report, part)?;
            write_contrasts(out, &part.contrasts)?;
        }
    }
    if report.levels.len() > 2 {
        writeln!(
            out,
            "Each value is held against all others together. These are many probabilities, not corrected for their number: \
             the Bayes factor is the one test of the whole."
        )?;
    }
    Ok(())
}

fn words(verdict: FactorVerdict) -> &'static str {
    match verdict {
        FactorVerdict::Differ => "they differ",
        FactorVerdict::Alike => "one set of parameters does for all",
        FactorVerdict::Undecided => "undecided whether they differ",
    }
}

fn write_levels(
    out: &mut dyn Write,
    report: &FactorReport,
    part: &FactorPartReport,
) -> io::Result<()> {
    writeln!(
        out,
        "  {:<15} {:>10} ± {:<10} {:>10} (5 % to 95 %)",
        "", "mean", "sd", "median"
    )?;
    for (level, fit) in report.levels.iter().zip(&part.levels) {
        let state = if fit.converged {
            "converged"
        } else {
            "NOT CONVERGED"
        };
        let ln_kl = fit
            .ln_kl
            .as_ref()
            .map_or_else(|| "-".to_owned(), mean_and_sd);
        writeln!(
            out,
            "  {}: {state}, ln KL {ln_kl}, seed {}",
            level.label(),
            fit.seed
        )?;
        for (name, found) in fit.parameters.iter().flat_map(|all| all.iter()) {
            writeln!(
                out,
                "    {name:<13} {:>10} ± {:<10} {:>10} ({} to {}){}",
                short(found.mean),
                short(found.sd),
                short(found.q50),
                short(found.q5),
                short(found.q95),
                note(found),
            )?;
        }
    }
    Ok(())
}

fn write_contrasts(out: &mut dyn Write, contrasts: &[Contrast]) -> io::Result<()> {
    for contrast in contrasts {
        writeln!(
            out,
            "  {}: median (5 % to 95 %), probability that the first is larger",
            contrast.label()
        )?;
        for (name, found) in contrast.differences.iter() {
            let note = if found.informed {
                ""
            } else {
                "  not informed in both"
            };
            writeln!(
                out,
                "    {name:<13} {:>10} ({} to {})  {:.3}{note}",
                short(found.q50),
                short(found.q5),
                short(found.q95),
                found.probability_larger,
            )?;
        }
    }
    Ok(())
}
