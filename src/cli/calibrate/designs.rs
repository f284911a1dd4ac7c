//! The designs on which fits are calibrated.

use anyhow::Context;
use clap::ValueEnum;

use crate::cli::fit_source::{fitted_problems, read_study};
use crate::inference::{FitSettings, FittedProblem};
use crate::jobs::fit_settings;
use crate::model::{ChoiceProblem, OrderedMap};

/// A built-in design: small, pooled with losses only, and with gains and losses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Design {
    /// One problem with gains, 50 answers
    Cups,
    /// The driving study's fitted cells together, losses only, 30 answers in each
    Driving,
    /// Kahneman and Tversky's problems of 1979, gains and losses, 20 answers in each
    Gambles,
}

impl Design {
    /// The name on the command line and in results.
    pub(super) const fn id(self) -> &'static str {
        match self {
            Self::Cups => "cups",
            Self::Driving => "driving",
            Self::Gambles => "gambles",
        }
    }

    /// How many people answer each problem.
    pub(super) const fn people(self) -> u64 {
        match self {
            Self::Cups => 50,
            Self::Driving => 30,
            Self::Gambles => 20,
        }
    }

    /// Its problems, and how models are fitted to them.
    pub(super) fn problems(self) -> anyhow::Result<(Vec<FittedProblem>, FitSettings)> {
        match self {
            Self::Cups => {
                let problem = ChoiceProblem::from_outcomes([
                    ("stable", vec![(1.0, 20.0)]),
                    ("unstable", vec![(0.2, 105.0), (0.8, 0.0)]),
                ])?;
                let id = "cups".to_owned();
                Ok((vec![FittedProblem { id, problem }], FitSettings::default()))
            }
            Self::Driving => {
                let study = read_study("driving")?;
                let settings = fit_settings(&study, FitSettings::default().seed);
                Ok((fitted_problems(&study), settings))
            }
            Self::Gambles => {
                let text = include_str!("../../../examples/kahneman-tversky-1979/problems.json");
                let problems: OrderedMap<ChoiceProblem> =
                    serde_json::from_str(text).context("the problems of 1979")?;
                let problem = |(id, problem)| FittedProblem { id, problem };
                let problems = problems.0.into_iter().map(problem).collect();
                Ok((problems, FitSettings::default()))
            }
        }
    }
}
