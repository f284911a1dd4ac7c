//! Sweeps: models fitted to simulated answers, while the share of an action or one number of the problem runs.
//!
//! * [`Simulation`]: many small fits, cut into tasks that depend on nothing but their own number, so that any number of
//!   threads gives the same result;
//! * [`ShareSweep`]: one problem, every share of its suboptimal action;
//! * [`GapSweep`]: one pattern of answers, every gap between the expected rewards.
//!
//! Source: models.md, section 9; the paper's simulation and its claim that close expected rewards matter most.

mod gap;
mod share;

use std::ops::ControlFlow;

use serde::Serialize;

pub use gap::{
    DEFAULT_STEPS, Difference, GapPoint, GapSeries, GapSweep, GapSweepReport, Pattern, Variation,
    VariedNumber,
};
pub use share::{SharePoint, ShareSweep, ShareSweepReport};

use super::accuracy::LnKl;
use super::diagnostics::variance;
use super::{ChoiceData, ChoiceDataError, FitError, FitSettings, FittedProblem, Progress, fit};
use crate::model::{ChoiceModel, ChoiceProblemError, OrderedMap};

/// Answers per cell that are simulated unless another number is asked for: as many people as in the paper's study.
pub const DEFAULT_ANSWERS: u64 = 30;

/// Fits per point unless another number is asked for.
pub const DEFAULT_SEEDS: usize = 20;

/// Simulated answers to one problem.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedCell {
    /// The problem.
    pub problem: FittedProblem,
    /// How often each action was chosen.
    pub counts: Vec<u64>,
}

/// Every model fitted to every simulated cell with every seed.
///
/// Fit number i of a cell has the seed `settings.seed` + i, for every cell and model: each one can be repeated alone with
/// `riskaware fit`. All of them share one reference reward, or else a problem that changes would change its prior.
#[derive(Debug, Clone)]
pub struct Simulation {
    data: Vec<ChoiceData>,
    models: Vec<&'static ChoiceModel>,
    seeds: usize,
    settings: FitSettings,
}

/// What one fit of a simulation found: ln KL of its independent samples, or nothing where chains did not converge.
#[derive(Debug, Clone, PartialEq)]
pub struct Score(Option<Vec<Option<f64>>>);

/// How one model does on one simulated cell, over all seeds.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct SweepScore {
    /// ln KL over the samples of all seeds: against the shares themselves, or against smoothed shares (n_a + ½)/(n + A/2)
    /// where all answers are the same.
    pub ln_kl: LnKl,
    /// Monte-Carlo standard error of the mean: the standard deviation of the seeds' means over the root of their number.
    pub standard_error: Option<f64>,
    /// Fits left out because their chains did not converge.
    pub unconverged: usize,
}

impl Simulation {
    /// A simulation of these cells.
    ///
    /// * `seeds`: fits per cell and model, at least 1.
    /// * `settings.reference_reward` should be that of the study; if it is left out, it is the default one of the problems.
    ///
    /// # Errors
    /// When there is no model or seed, or a cell's counts have another shape than its problem.
    pub fn new(
        cells: Vec<SimulatedCell>,
        models: Vec<&'static ChoiceModel>,
        seeds: usize,
        settings: FitSettings,
    ) -> Result<Self, SweepError> {
        if models.is_empty() || seeds == 0 {
            return Err(SweepError::Nothing);
        }
        let data = cells.into_iter().map(|cell| {
            ChoiceData::from_counts(vec![cell.problem], vec![cell.counts]).map_err(SweepError::from)
        });
        Ok(Self {
            data: data.collect::<Result<_, _>>()?,
            models,
            seeds,
            settings,
        })
    }

    /// How many fits there are; they are numbered from 0.
    pub fn tasks(&self) -> usize {
        self.data.len() * self.models.len() * self.seeds
    }

    /// Runs one fit. `watch` stops it by answering `Break`.
    ///
    /// # Errors
    /// As [`fit`].
    pub fn run(
        &self,
        task: usize,
        watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Score, FitError> {
        let (row, seed) = (task / self.seeds, task % self.seeds);
        let data = &self.data[row / self.models.len()];
        let model = self.models[row % self.models.len()];
        let settings = FitSettings {
            seed: self.settings.seed.wrapping_add(seed as u64),
            ..self.settings.clone()
        };
        let fit = fit(model, data, &settings, watch)?;
        let cell = fit.accuracy.into_iter().next();
        Ok(Score(cell.filter(|_| fit.summary.converged).map(|cell| {
            if cell.unanimous {
                cell.smoothed_samples
            } else {
                cell.samples
            }
        })))
    }

    /// The scores of all tasks in the order of their numbers, by cell and model.
    fn by_cell(&self, scores: &[Score]) -> Vec<OrderedMap<SweepScore>> {
        let of_cell = |cell: &[Score]| {
            let models = self.models.iter().zip(cell.chunks(self.seeds));
            models
                .map(|(model, scores)| (model.id.to_owned(), SweepScore::of(scores)))
                .collect()
        };
        scores
            .chunks(self.seeds * self.models.len())
            .map(of_cell)
            .collect()
    }

    /// What stands in the caption of a figure.
    fn head(&self) -> SweepHead {
        SweepHead {
            models: self
                .models
                .iter()
                .map(|model| model.id.to_owned())
                .collect(),
            seed: self.settings.seed,
            seeds: self.seeds,
            samples: self.settings.samples,
            chains: self.settings.chains,
            draws: self.settings.draws,
            reference_reward: self.settings.reference_reward,
        }
    }
}

impl SweepScore {
    fn of(scores: &[Score]) -> Self {
        let converged: Vec<&[Option<f64>]> = scores
            .iter()
            .filter_map(|score| score.0.as_deref())
            .collect();
        let means: Vec<f64> = converged
            .iter()
            .filter_map(|samples| LnKl::of(samples).mean)
            .collect();
        let whole = means.len() == converged.len() && means.len() > 1;
        Self {
            ln_kl: LnKl::of(&converged.concat()),
            standard_error: whole.then(|| (variance(&means) / means.len() as f64).sqrt()),
            unconverged: scores.len() - converged.len(),
        }
    }
}

/// How a sweep was made.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct SweepHead {
    /// Models in the order of their columns.
    pub models: Vec<String>,
    /// Seed of each cell's first fit; the others follow one by one.
    pub seed: u64,
    /// Fits per cell and model.
    pub seeds: usize,
    /// Independent samples per fit.
    pub samples: usize,
    /// Chains per fit.
    pub chains: usize,
    /// Draws kept per chain.
    pub draws: usize,
    /// Signed reward that gives τ its unit; null where each problem has its own.
    pub reference_reward: Option<f64>,
}

/// Why there is no sweep.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SweepError {
    /// Nothing would be fitted.
    #[error("a sweep needs at least one model, one seed and one problem")]
    Nothing,
    /// Too few answers.
    #[error("a sweep needs 2 or more answers, found {n}")]
    TooFewAnswers {
        /// How many.
        n: u64,
    },
    /// No action is worse than another.
    #[error(
        "all actions of problem `{problem}` have the same expected reward, so none is suboptimal; name an action"
    )]
    NoSuboptimalAction {
        /// The problem's id.
        problem: String,
    },
    /// The problem has no such action.
    #[error("`{action}` is no action of problem `{problem}`, allowed are {allowed}")]
    UnknownAction {
        /// What was asked for.
        action: String,
        /// The problem's id.
        problem: String,
        /// The actions there are.
        allowed: String,
    },
    /// More answers on one action than there are answers.
    #[error("{count} of {n} answers cannot be on one action; allowed is 0 to {n}")]
    TooManyOnAction {
        /// How many.
        count: u64,
        /// Of how many.
        n: u64,
    },
    /// The problem has no such outcome.
    #[error("action `{action}` of problem `{problem}` has no outcome with reward {reward}")]
    UnknownOutcome {
        /// The action.
        action: String,
        /// The problem's id.
        problem: String,
        /// What was looked for.
        reward: f64,
    },
    /// A sure outcome leaves nothing for the others.
    #[error(
        "reward {reward} of action `{action}` comes for sure, so its probability cannot vary; vary the reward"
    )]
    SureOutcome {
        /// The action.
        action: String,
        /// Its reward.
        reward: f64,
    },
    /// The number cannot take the value.
    #[error("with the value {value}: {source}")]
    Value {
        /// The value.
        value: f64,
        /// What is wrong then.
        source: ChoiceProblemError,
    },
    /// A number that varies was described in another form.
    #[error(
        "`{text}` does not say what varies; allowed is ACTION:REWARD=FROM..TO for a reward, such as stop:-50=-26..-474, \
         or ACTION:p(REWARD)=FROM..TO for its probability"
    )]
    Variation {
        /// What was given.
        text: String,
    },
    /// No number stands out.
    #[error(
        "no sure reward that all problems share could vary; say what varies (ACTION:REWARD=FROM..TO)"
    )]
    NoDefaultVariation,
    /// Too few steps.
    #[error("a gap sweep needs 2 or more steps, found {steps}")]
    TooFewSteps {
        /// How many.
        steps: usize,
    },
    /// Counts do not belong to the problem.
    #[error(transparent)]
    Data(#[from] ChoiceDataError),
}

/// Where the action with this name stands.
fn position(problem: &FittedProblem, action: &str) -> Result<usize, SweepError> {
    problem.problem.position(action).ok_or_else(|| {
        let names: Vec<&str> = problem.problem.names().collect();
        SweepError::UnknownAction {
            action: action.to_owned(),
            problem: problem.id.clone(),
            allowed: names.join(", "),
        }
    })
}

/// Expected rewards of all actions, in order.
fn expected_rewards(problem: &FittedProblem) -> Vec<f64> {
    let actions = problem.problem.actions().iter();
    actions
        .map(|action| action.prospect.expected_reward())
        .collect()
}

/// The action with the highest expected reward beside `other`; the first of several.
fn best_beside(expected: &[f64], other: usize) -> usize {
    let others = (0..expected.len()).filter(|action| *action != other);
    others
        .reduce(|best, action| {
            if expected[action] > expected[best] {
                action
            } else {
                best
            }
        })
        // A choice problem has two actions or more.
        .unwrap_or(other)
}

/// Counts with everything on two actions.
fn counts_on(actions: usize, on: [(usize, u64); 2]) -> Vec<u64> {
    let mut counts = vec![0; actions];
    for (action, count) in on {
        counts[action] = count;
    }
    counts
}

fn is_unanimous(counts: &[u64]) -> bool {
    counts.contains(&counts.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::uninterrupted;
    use crate::model::{ChoiceProblem, PAPER_MODELS};

    /// The driving study's question: a fine of 50 for sure, or a ticket of 500 with this probability.
    pub(super) fn driving(p: f64, stop_first: bool) -> FittedProblem {
        let accelerate = ("accelerate", vec![(p, -500.0), (1.0 - p, 0.0)]);
        let stop = ("stop", vec![(1.0, -50.0)]);
        let actions = if stop_first {
            [stop, accelerate]
        } else {
            [accelerate, stop]
        };
        FittedProblem {
            id: format!("p{p}"),
            problem: ChoiceProblem::from_outcomes(actions).unwrap(),
        }
    }

    pub(super) fn settings() -> FitSettings {
        FitSettings {
            reference_reward: Some(-500.0),
            draws: 200,
            ..FitSettings::default()
        }
    }

    pub(super) fn scores(simulation: &Simulation) -> Vec<Score> {
        let tasks = 0..simulation.tasks();
        tasks
            .map(|task| simulation.run(task, &mut uninterrupted).unwrap())
            .collect()
    }

    /// Tasks may run in any order and on any thread; the order of the actions is no information.
    #[test]
    fn a_task_depends_on_its_number_alone_and_not_on_the_order_of_actions() {
        let simulation = |stop_first: bool| {
            let counts = if stop_first { [3, 7] } else { [7, 3] };
            let cell = SimulatedCell {
                problem: driving(0.95, stop_first),
                counts: counts.to_vec(),
            };
            Simulation::new(vec![cell], PAPER_MODELS.to_vec(), 2, settings()).unwrap()
        };
        let forwards = scores(&simulation(false));
        let other = simulation(true);
        let mut backwards: Vec<Score> = (0..other.tasks())
            .rev()
            .map(|task| other.run(task, &mut uninterrupted).unwrap())
            .collect();
        backwards.reverse();
        let by_model = |simulation: &Simulation, scores: &[Score]| -> Vec<Vec<f64>> {
            let cells = simulation.by_cell(scores);
            let models = cells[0].iter();
            models
                .map(|(_, score)| vec![score.ln_kl.mean.unwrap(), score.ln_kl.sd.unwrap()])
                .collect()
        };
        let (one, two) = (
            by_model(&simulation(false), &forwards),
            by_model(&other, &backwards),
        );
        for (one, two) in one.iter().flatten().zip(two.iter().flatten()) {
            assert!((one - two).abs() < 1e-9, "{one} {two}");
        }
    }

    #[test]
    fn fits_that_did_not_converge_are_left_out_and_counted() {
        let samples = |value: f64| Score(Some(vec![Some(value), Some(value + 1.0)]));
        let found = SweepScore::of(&[samples(-3.0), Score(None), samples(-5.0)]);
        assert_eq!((found.unconverged, found.ln_kl.samples), (1, 4));
        assert_eq!(found.ln_kl.mean, Some(-3.5));
        // Means −2.5 and −4.5: sd √2, over √2 seeds.
        assert!((found.standard_error.unwrap() - 1.0).abs() < 1e-12);
        let none = SweepScore::of(&[Score(None)]);
        assert_eq!((none.ln_kl.mean, none.standard_error), (None, None));
    }

    #[test]
    fn nothing_to_fit_is_refused() {
        let found = Simulation::new(Vec::new(), Vec::new(), 1, settings());
        assert_eq!(found.unwrap_err(), SweepError::Nothing);
    }
}
