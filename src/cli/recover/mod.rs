//! `riskaware recover`: what a study of a given size would find.

mod report;

use anyhow::{Context, bail, ensure};
use rayon::prelude::*;

use self::report::{Report, write_table};
use super::fit_source::{Source, SourceArguments};
use super::values::{model, parameter};
use super::{output::print, parallel};
use crate::inference::recovery::{Recovery, Replicate, Scenario, Truth};
use crate::inference::{FitSettings, Quantity};
use crate::model::{ChoiceModel, NOISY_RATIONAL, RISK_AWARE};

/// Simulates studies of several sizes, fits two models to each, and tells how well parameters are recovered and how
/// often the right model wins, each figure with its Monte-Carlo error.
///
/// Every simulated person answers each problem once.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    source: SourceArguments,
    /// The model that people follow
    #[arg(long, default_value = RISK_AWARE.id, value_parser = model)]
    model: &'static ChoiceModel,
    /// The model to compare it with [default: noisy_rational, or risk_aware if that is the model]
    #[arg(long, value_name = "MODEL", value_parser = model)]
    rival: Option<&'static ChoiceModel>,
    /// A true parameter, such as alpha=0.88; once for each parameter of the model, or never: then each study's people
    /// are drawn from the prior
    #[arg(long = "parameter", value_name = "NAME=VALUE", value_parser = parameter)]
    parameters: Vec<(String, f64)>,
    /// How many people take part, separated by commas
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [10, 20, 50, 100], value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    n: Vec<u64>,
    /// Simulated studies of each size
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    replicates: u32,
    /// The parameter whose 90 % interval is shown beside the comparison of models, such as gamma
    #[arg(long, value_name = "NAME", value_parser = quantity)]
    interval: Option<Quantity>,
    /// Draws kept per chain in each fit, from 100 to 100000
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = clap::value_parser!(u32).range(100..=100_000))]
    draws: u32,
    /// Random seed
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Threads; by default one for each processor. The result does not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Print JSON for machines
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let source = Source::read(&arguments.source)?;
    let model = arguments.model;
    let rival = arguments.rival.unwrap_or(if model == &NOISY_RATIONAL {
        &RISK_AWARE
    } else {
        &NOISY_RATIONAL
    });
    ensure!(
        model != rival,
        "--model and --rival are both {model}, allowed are two models"
    );
    if let Some(Quantity::Parameter(parameter)) = arguments.interval
        && !model.is_free(parameter)
    {
        bail!("--interval {parameter}: {model} has no such parameter");
    }
    let scenario = Scenario {
        model,
        rival,
        problems: source.problems,
        people: 0,
        truth: truth(model, &arguments.parameters)?,
        settings: FitSettings {
            draws: arguments.draws as usize,
            ..source.settings
        },
    };
    let recoveries = simulate(&scenario, arguments)?;
    let report = Report {
        source: &source.name,
        scenario: &scenario,
        seed: arguments.seed,
        interval: arguments.interval,
        recoveries: &recoveries,
    };
    let mut text = Vec::new();
    if arguments.json {
        serde_json::to_writer(&mut text, &report.json())?;
        text.push(b'\n');
    } else {
        write_table(&mut text, &report)?;
    }
    print(&text)
}

/// All studies of all sizes, the smallest first as they were given.
fn simulate(scenario: &Scenario, arguments: &Arguments) -> anyhow::Result<Vec<Recovery>> {
    let replicates = u64::from(arguments.replicates);
    let bar = parallel::progress_bar(arguments.n.len() as u64 * replicates);
    let of_size = |&people: &u64| -> anyhow::Result<Recovery> {
        bar.set_message(format!("{people} people"));
        let scenario = Scenario {
            people,
            ..scenario.clone()
        };
        let found: anyhow::Result<Vec<Replicate>> = (0..replicates)
            .into_par_iter()
            .map(|number| {
                let replicate = scenario.replicate(arguments.seed, number);
                bar.inc(1);
                replicate.with_context(|| format!("{people} people, study {number}"))
            })
            .collect();
        Ok(Recovery::of(people, &found?))
    };
    let found =
        parallel::pool(arguments.threads)?.install(|| arguments.n.iter().map(of_size).collect());
    bar.finish_and_clear();
    found
}

fn truth(model: &ChoiceModel, parameters: &[(String, f64)]) -> anyhow::Result<Truth> {
    if parameters.is_empty() {
        return Ok(Truth::Prior);
    }
    let entries = parameters
        .iter()
        .map(|(name, value)| (name.as_str(), *value));
    let known = model.parameters_from(entries).context("--parameter")?;
    for (name, value) in parameters {
        // Their bias is measured on the logarithm.
        ensure!(
            *value > 0.0,
            "--parameter {name} is {value}, allowed here is above 0"
        );
    }
    Ok(Truth::Known(known))
}

fn quantity(text: &str) -> Result<Quantity, String> {
    Quantity::try_from(text.trim().to_owned())
}
