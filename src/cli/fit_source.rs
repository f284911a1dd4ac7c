//! What the choices of a fit are about: problems, priors and settings, from files or from a study.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};

use super::choice_files::read_problems;
use super::values::{weighting_floor, with_floor};
use crate::inference::{FitSettings, FittedProblem, Priors, default_reference_reward};
use crate::jobs::{changed_priors, fit_settings};
use crate::study::{self, Study};

/// Where problems and settings come from.
#[derive(Debug, clap::Args)]
pub(super) struct SourceArguments {
    /// Problems: {"ID":{"ACTION":[[p,R],...],...},...}
    #[arg(
        long,
        value_name = "FILE.json",
        required_unless_present = "study",
        conflicts_with = "study"
    )]
    problems: Option<PathBuf>,
    /// A study instead of problems: the id of a built-in one, or a file; its fitted cells are fitted together, with its
    /// priors, options and reference reward
    #[arg(long, value_name = "ID|FILE.toml")]
    study: Option<String>,
    /// Lower bound of the priors of gamma and delta, from 0 to below 1 [default: 0.28, or as the study says]
    #[arg(long, value_name = "X", value_parser = weighting_floor)]
    weighting_floor: Option<f64>,
    /// Priors in TOML, with the keys of `[fit.priors]` in a study file; those that it leaves out stay as they are
    #[arg(long, value_name = "FILE.toml")]
    prior: Option<PathBuf>,
    /// Reward that gives tau its unit; by default the study's, or the largest gain or loss of the problems
    #[arg(long, value_name = "X", value_parser = reference_reward, allow_negative_numbers = true)]
    reference_reward: Option<f64>,
}

/// What is fitted, and with which settings.
pub(super) struct Source {
    /// The file or study that was named.
    pub(super) name: String,
    pub(super) problems: Vec<FittedProblem>,
    pub(super) settings: FitSettings,
    /// Signed reward that gives τ its unit, as in the settings.
    pub(super) reference_reward: f64,
}

impl Source {
    pub(super) fn read(arguments: &SourceArguments) -> anyhow::Result<Self> {
        let (name, problems, mut settings) = match (&arguments.study, &arguments.problems) {
            (Some(wanted), _) => {
                let study = read_study(wanted)?;
                let problems = fitted_problems(&study);
                let settings = fit_settings(&study, FitSettings::default().seed);
                (format!("study {}", study.id()), problems, settings)
            }
            (None, Some(path)) => {
                let name = path.display().to_string();
                (name, read_problems(path)?, FitSettings::default())
            }
            (None, None) => bail!("neither --problems nor --study is given"),
        };
        settings.priors = priors(
            settings.priors,
            arguments.weighting_floor,
            arguments.prior.as_deref(),
        )?;
        let reference_reward = match arguments.reference_reward.or(settings.reference_reward) {
            Some(reward) => reward,
            None => default_reference_reward(&problems).with_context(|| name.clone())?,
        };
        settings.reference_reward = Some(reference_reward);
        Ok(Self {
            name,
            problems,
            settings,
            reference_reward,
        })
    }
}

/// The built-in study of this id, or the one in a file whose name ends in `.toml`.
pub(super) fn read_study(wanted: &str) -> anyhow::Result<Study> {
    if wanted.ends_with(".toml") {
        let text =
            std::fs::read_to_string(wanted).with_context(|| format!("cannot read {wanted}"))?;
        return Ok(Study::parse(wanted, &text)?);
    }
    let studies = study::built_in();
    let ids = || {
        studies
            .iter()
            .filter_map(|(name, _)| name.strip_suffix(".toml"))
    };
    let found = studies
        .iter()
        .find(|(name, _)| name.strip_suffix(".toml") == Some(wanted));
    let (name, text) = found.with_context(|| {
        format!(
            "unknown study `{wanted}`, built in are {}; the name of a file ends in .toml",
            ids().collect::<Vec<_>>().join(", ")
        )
    })?;
    Ok(Study::parse(name, text)?)
}

/// The problems of the cells that are fitted, under the cells' ids.
pub(super) fn fitted_problems(study: &Study) -> Vec<FittedProblem> {
    let fitted = study.cells().iter().filter(|cell| cell.fitted);
    fitted
        .filter_map(|cell| {
            Some(FittedProblem {
                id: cell.id.to_string(),
                problem: cell.problem.clone()?,
            })
        })
        .collect()
}

fn priors(mut priors: Priors, floor: Option<f64>, path: Option<&Path>) -> anyhow::Result<Priors> {
    if let Some(low) = floor {
        priors = with_floor(priors, low);
    }
    let Some(path) = path else { return Ok(priors) };
    let shown = path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {shown}"))?;
    let changes = study::Priors::parse(&shown, &text)?;
    for (name, change) in [("gamma", changes.gamma), ("delta", changes.delta)] {
        ensure!(
            floor.is_none() || change.is_none(),
            "--weighting-floor and {shown} both give a prior of `{name}`, allowed is one of the two"
        );
    }
    Ok(changed_priors(priors, &changes))
}

fn reference_reward(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(reward) if reward.is_finite() && reward != 0.0 => Ok(reward),
        _ => Err("allowed is a finite number other than 0".to_owned()),
    }
}
