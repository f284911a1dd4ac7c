//! `riskaware sweep`: the simulated sweeps of models.md, section 9.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use rayon::prelude::*;

use super::choice_files::read_problems;
use super::fit_source::read_study;
use super::output::print;
use super::parallel::{pool, progress_bar};
use super::values::{model, weighting_floor, with_floor};
use super::{sweep_drawing, sweep_text};
use crate::inference::sweep::{
    DEFAULT_ANSWERS, DEFAULT_SEEDS, DEFAULT_STEPS, GapSweep, GapSweepReport, Pattern, Score,
    ShareSweep, ShareSweepReport, SimulatedCell, Simulation, Variation,
};
use crate::inference::{FitSettings, FittedProblem, default_reference_reward, uninterrupted};
use crate::jobs::{fit_settings, swept_problems};
use crate::model::{ChoiceModel, PAPER_MODELS};

/// What stands for "the default" where `--gap` has no value.
const DEFAULT_GAP: &str = "";

/// Fits models to simulated answers: each share of the suboptimal action, or (with --gap) each gap of expected rewards.
///
/// The share sweep scores every model by ln KL against k of n answers on the suboptimal action, k = 0 … n, over many seeds;
/// the ends, where all answers are the same, are scored against smoothed shares and marked. With --gap one number of
/// the problems varies while the answers stay as they are.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// A built-in study's id, or a study file; its settings are used
    #[arg(
        long,
        value_name = "ID|FILE.toml",
        default_value = "driving",
        conflicts_with = "problems"
    )]
    study: String,
    /// A fitted cell of the study; by default the first one, and with --gap one for each distinct problem
    #[arg(long, value_name = "ID", conflicts_with = "problems")]
    cell: Option<String>,
    /// Problems instead of a study: {"ID":{"ACTION":[[p,R],...],...},...}
    #[arg(long, value_name = "FILE.json")]
    problems: Option<PathBuf>,
    /// A problem of the file; by default the first one, and with --gap all of them
    #[arg(long, value_name = "ID", requires = "problems")]
    problem: Option<String>,
    /// The action whose share runs (by default the one with the lowest expected reward); with --gap the action that
    /// --count answers are on (by default the safest one). The others choose the best of the remaining actions
    #[arg(long, value_name = "ACTION")]
    action: Option<String>,
    /// Answers at each point, from 2 to 1000000
    #[arg(long, value_name = "N", default_value_t = DEFAULT_ANSWERS, value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    n: u64,
    /// With --gap: answers on the held action; by default five sixths, the paper's pattern
    #[arg(long, value_name = "K", requires = "gap")]
    count: Option<u64>,
    /// What varies: ACTION:REWARD=FROM..TO for a reward, such as stop:-50=-26..-474, or ACTION:p(REWARD)=FROM..TO for its
    /// probability. Without a value: the sure reward over the range that leaves the optimal actions as they are
    #[arg(long, value_name = "WHAT=FROM..TO", num_args = 0..=1, default_missing_value = DEFAULT_GAP)]
    gap: Option<String>,
    /// With --gap: how many values, both ends included
    #[arg(long, value_name = "N", default_value_t = DEFAULT_STEPS as u32, value_parser = clap::value_parser!(u32).range(2..=1000))]
    steps: u32,
    /// Fits per point and model, with the seeds SEED, SEED+1, ...
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SEEDS as u32, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    seeds: u32,
    /// First random seed: the same seed gives the same numbers, whatever the number of threads
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Models to fit, separated by commas; gaps are scored against the first
    #[arg(
        long, value_name = "MODEL,...", value_delimiter = ',', value_parser = model,
        default_values = PAPER_MODELS.map(|model| model.id)
    )]
    models: Vec<&'static ChoiceModel>,
    /// Lower bound of the priors of gamma and delta; by default that of the study
    #[arg(long, value_name = "X", value_parser = weighting_floor)]
    weighting_floor: Option<f64>,
    /// Threads; by default one for each processor
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print JSON for machines
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print CSV: one row per point and model
    #[arg(long)]
    csv: bool,
    /// Also write a drawing
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
}

/// A finished sweep, to be printed.
pub(super) enum Report {
    Share(ShareSweepReport),
    Gap(GapSweepReport),
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (problems, mut settings) = match &arguments.problems {
        Some(path) => of_file(arguments, path)?,
        None => of_study(arguments)?,
    };
    if let Some(floor) = arguments.weighting_floor {
        settings.priors = with_floor(settings.priors, floor);
    }
    let report = match &arguments.gap {
        None => {
            // At least one problem was found.
            let sweep = ShareSweep::new(
                problems[0].clone(),
                arguments.action.as_deref(),
                arguments.n,
            )?;
            let (simulation, scores) = simulate(sweep.cells(), arguments, settings)?;
            Report::Share(sweep.report(&simulation, &scores))
        }
        Some(text) => {
            let variation = if text == DEFAULT_GAP {
                Variation::default_for(&problems)?
            } else {
                text.parse()?
            };
            let pattern = Pattern::Held {
                action: arguments.action.clone(),
                count: arguments.count.unwrap_or(arguments.n * 5 / 6),
                n: arguments.n,
            };
            let sweep = GapSweep::new(&problems, variation, arguments.steps as usize, &pattern)?;
            let (simulation, scores) = simulate(sweep.cells(), arguments, settings)?;
            Report::Gap(sweep.report(&simulation, &scores))
        }
    };
    if let Some(path) = &arguments.svg {
        std::fs::write(path, sweep_drawing::svg(&report))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    let text = if arguments.json {
        let mut text = match &report {
            Report::Share(report) => serde_json::to_string(report)?,
            Report::Gap(report) => serde_json::to_string(report)?,
        };
        text.push('\n');
        text
    } else if arguments.csv {
        sweep_text::csv(&report)?
    } else {
        sweep_text::table(&report)
    };
    print(text.as_bytes())
}

/// All fits, with a bar on a terminal.
fn simulate(
    cells: Vec<SimulatedCell>,
    arguments: &Arguments,
    settings: FitSettings,
) -> anyhow::Result<(Simulation, Vec<Score>)> {
    let mut models: Vec<&'static ChoiceModel> = Vec::new();
    for model in &arguments.models {
        if !models.contains(model) {
            models.push(model);
        }
    }
    let seeds = arguments.seeds as usize;
    let simulation = Simulation::new(cells, models, seeds, settings)?;
    let bar = progress_bar(simulation.tasks() as u64);
    let scores: Result<Vec<Score>, _> = pool(arguments.threads)?.install(|| {
        (0..simulation.tasks())
            .into_par_iter()
            .map(|task| {
                let score = simulation.run(task, &mut uninterrupted);
                bar.inc(1);
                score
            })
            .collect()
    });
    bar.finish_and_clear();
    Ok((simulation, scores?))
}

fn of_file(
    arguments: &Arguments,
    path: &Path,
) -> anyhow::Result<(Vec<FittedProblem>, FitSettings)> {
    let all = read_problems(path)?;
    // Of all problems, so that each of them is fitted under the same prior.
    let reference_reward =
        default_reference_reward(&all).with_context(|| format!("{}", path.display()))?;
    let settings = FitSettings {
        reference_reward: Some(reference_reward),
        seed: arguments.seed,
        ..FitSettings::default()
    };
    let Some(id) = &arguments.problem else {
        return Ok((all, settings));
    };
    match all.iter().find(|problem| problem.id == *id) {
        Some(problem) => Ok((vec![problem.clone()], settings)),
        None => {
            let known: Vec<&str> = all.iter().map(|problem| problem.id.as_str()).collect();
            bail!(
                "{} has no problem `{id}`, allowed are {}",
                path.display(),
                known.join(", ")
            )
        }
    }
}

fn of_study(arguments: &Arguments) -> anyhow::Result<(Vec<FittedProblem>, FitSettings)> {
    let study = read_study(&arguments.study)?;
    let settings = fit_settings(&study, arguments.seed);
    let swept = swept_problems(&study);
    let Some(id) = &arguments.cell else {
        let problems: Vec<FittedProblem> = swept.into_iter().map(|swept| swept.problem).collect();
        ensure!(
            !problems.is_empty(),
            "study {} has no fitted cell",
            study.id()
        );
        return Ok((problems, settings));
    };
    let found = swept
        .iter()
        .find(|swept| swept.cells.iter().any(|cell| cell.as_str() == id));
    match found {
        Some(swept) => {
            let problem = FittedProblem {
                id: id.clone(),
                problem: swept.problem.problem.clone(),
            };
            Ok((vec![problem], settings))
        }
        None => {
            let known: Vec<&str> = swept
                .iter()
                .flat_map(|swept| &swept.cells)
                .map(|cell| cell.as_str())
                .collect();
            bail!(
                "study {} has no fitted cell `{id}`, allowed are {}",
                study.id(),
                known.join(", ")
            )
        }
    }
}
