//! `riskaware fit`: models fitted to choices in files.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::choice_files::{ChoiceFile, read_choices};
use super::fit_comparison::{compare, write_comparison};
use super::fit_factor;
use super::fit_files::FileArguments;
use super::fit_source::{Source, SourceArguments};
use super::fit_table::write_table;
use super::output::print;
use super::values::model;
use crate::clock::Clock;
use crate::inference::comparison::Comparison;
use crate::inference::factor::FactorReport;
use crate::inference::{Fit, FitSettings, FitSummary, Progress, fit};
use crate::model::{ChoiceModel, OrderedMap, PAPER_MODELS};

/// Fits models to choices and prints what they say, as a table or as JSON.
///
/// Exits with status 1 when chains have not converged; then only diagnostics are printed.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    source: SourceArguments,
    /// Choices: CSV with columns problem and action, and optionally participant, count and status (with it, rows
    /// that are not `answered` or of no problem given are left out and counted); other columns are ignored
    #[arg(long, value_name = "FILE.csv")]
    choices: PathBuf,
    /// Also split the choices by a column of the file, such as source, participant or a factor, and compare its values:
    /// each model is fitted to each of them alone, and to all of them together
    #[arg(long, value_name = "COLUMN")]
    by: Option<String>,
    /// Print JSON for machines
    #[arg(long)]
    json: bool,
    /// Random seed: the same seed gives the same draws
    #[arg(long, value_name = "N", default_value_t = FitSettings::default().seed)]
    seed: u64,
    /// Chains, from 2 to 64
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=64))]
    chains: u32,
    /// Draws kept per chain, from 100 to 100000
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = clap::value_parser!(u32).range(100..=100_000))]
    draws: u32,
    /// Models to fit, separated by commas
    #[arg(
        long, value_name = "MODEL,...", value_delimiter = ',', value_parser = model,
        default_values = PAPER_MODELS.map(|model| model.id)
    )]
    models: Vec<&'static ChoiceModel>,
    /// Compare models in full: also predict each problem from the others and try other priors, which takes many fits
    #[arg(long)]
    compare: bool,
    /// Print the results of chains that have not converged too
    #[arg(long)]
    show_unconverged: bool,
    #[command(flatten)]
    files: FileArguments,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let source = Source::read(&arguments.source)?;
    let ChoiceFile {
        data,
        unit,
        left_out,
        levels,
    } = read_choices(&arguments.choices, source.problems, arguments.by.as_deref())?;
    let settings = FitSettings {
        chains: arguments.chains as usize,
        draws: arguments.draws as usize,
        seed: arguments.seed,
        ..source.settings
    };
    arguments.files.check(&arguments.models, settings.chains)?;
    let mut fits: Vec<Fit> = Vec::new();
    for model in &arguments.models {
        if fits.iter().all(|fit| fit.model != *model) {
            let fitted = with_progress(model, |watch| fit(model, &data, &settings, watch))
                .with_context(|| format!("cannot fit {}", model.id))?;
            fits.push(fitted);
        }
    }
    let comparison = compare(&data, unit, &fits, &settings, arguments.compare)?;
    let by = match &arguments.by {
        Some(column) => {
            let models: Vec<&'static ChoiceModel> = fits.iter().map(|fit| fit.model).collect();
            Some(fit_factor::compare(column, levels, &models, &settings)?)
        }
        None => None,
    };
    let mut text = Vec::new();
    if arguments.json {
        let shown = |fit: &Fit| {
            let summary = &fit.summary;
            if arguments.show_unconverged {
                summary.clone()
            } else {
                summary.shown()
            }
        };
        let report = Report {
            models: fits
                .iter()
                .map(|fit| (fit.model.id.to_owned(), shown(fit)))
                .collect(),
            comparison,
            n: data.n(),
            left_out: left_out.unanswered,
            other_problems: left_out.other_problems,
            seed: arguments.seed,
            reference_reward: source.reference_reward,
            by,
        };
        serde_json::to_writer(&mut text, &report)?;
        text.push(b'\n');
    } else {
        write_table(
            &mut text,
            &data,
            left_out,
            &fits,
            arguments.show_unconverged,
        )?;
        if let Some(comparison) = &comparison {
            write_comparison(&mut text, comparison)?;
        }
        if let Some(by) = &by {
            fit_factor::write_table(&mut text, by)?;
        }
    }
    let shown: Vec<&Fit> = fits
        .iter()
        .filter(|fit| fit.summary.converged || arguments.show_unconverged)
        .collect();
    arguments.files.write_draws(&data, &shown)?;
    arguments.files.write_report(
        &format!("{} with {}", arguments.choices.display(), source.name),
        &data,
        &fits,
        arguments.show_unconverged,
        Clock::start().now(),
    )?;
    print(&text)?;
    let unconverged: Vec<&str> = fits
        .iter()
        .filter(|fit| !fit.summary.converged)
        .map(|fit| fit.model.id)
        .collect();
    if !unconverged.is_empty() {
        bail!(
            "the chains of {} have not converged, so there is no result; more draws (--draws) may help",
            unconverged.join(", ")
        );
    }
    Ok(())
}

#[derive(Serialize)]
struct Report {
    models: OrderedMap<FitSummary>,
    /// Of two models or more.
    comparison: Option<Comparison>,
    n: u64,
    left_out: u64,
    other_problems: u64,
    seed: u64,
    reference_reward: f64,
    /// The values of a column compared, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    by: Option<FactorReport>,
}

/// Runs a fit with a spinner, which shows itself on a terminal only.
fn with_progress<T>(
    model: &ChoiceModel,
    fit: impl FnOnce(&mut dyn FnMut(Progress) -> ControlFlow<()>) -> T,
) -> T {
    let bar = ProgressBar::new_spinner();
    bar.set_style(ProgressStyle::default_spinner());
    bar.enable_steady_tick(Duration::from_millis(100));
    let label = model.label;
    let mut known = None;
    let result = fit(&mut |progress| {
        if known != Some(progress) {
            known = Some(progress);
            bar.set_message(match progress {
                Progress::WarmingUp => format!("{label}: warming up"),
                Progress::Sampling { round } => format!("{label}: sampling, round {round}"),
                Progress::Climbing => format!("{label}: looking for the highest likelihood"),
            });
        }
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    result
}
