//! Sweeps, which are computed on demand.

use std::ops::ControlFlow;

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::{
    fit_input::PROGRAM_VERSION,
    on_demand::{OnDemand, Work, WorkState},
};
use crate::inference::{
    FitError, FitSettings,
    sweep::{
        GapSweep, GapSweepReport, ShareSweep, ShareSweepReport, SimulatedCell, Simulation,
        SweepError,
    },
};
use crate::model::{ChoiceModel, ChoiceProblem};

/// What is to be computed, with the hash of all that it depends on.
#[derive(Debug, Clone)]
pub struct SweepInput {
    kind: Kind,
    simulation: Simulation,
    hash: String,
}

#[derive(Debug, Clone)]
enum Kind {
    Share(ShareSweep),
    Gap(GapSweep),
}

/// A finished sweep.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum SweepResult {
    /// Over the share of an action.
    Share(ShareSweepReport),
    /// Over the gap of expected rewards.
    Gap(GapSweepReport),
}

#[derive(Serialize)]
struct Canonical<'a> {
    program: &'a str,
    /// The same cells make another report.
    sweep: String,
    models: Vec<&'a str>,
    seeds: usize,
    settings: &'a FitSettings,
    cells: Vec<(&'a str, &'a ChoiceProblem, &'a [u64])>,
}

impl SweepInput {
    /// A share sweep with these models, so many seeds, and the settings of the study.
    ///
    /// # Errors
    /// As [`Simulation::new`].
    pub fn share(
        sweep: ShareSweep,
        models: Vec<&'static ChoiceModel>,
        seeds: usize,
        settings: FitSettings,
    ) -> Result<Self, SweepError> {
        let cells = sweep.cells();
        Self::new(Kind::Share(sweep), cells, models, seeds, settings)
    }

    /// A gap sweep.
    ///
    /// # Errors
    /// As [`Simulation::new`].
    pub fn gap(
        sweep: GapSweep,
        models: Vec<&'static ChoiceModel>,
        seeds: usize,
        settings: FitSettings,
    ) -> Result<Self, SweepError> {
        let cells = sweep.cells();
        Self::new(Kind::Gap(sweep), cells, models, seeds, settings)
    }

    fn new(
        kind: Kind,
        cells: Vec<SimulatedCell>,
        models: Vec<&'static ChoiceModel>,
        seeds: usize,
        settings: FitSettings,
    ) -> Result<Self, SweepError> {
        let canonical = Canonical {
            program: PROGRAM_VERSION,
            sweep: format!("{kind:?}"),
            models: models.iter().map(|model| model.id).collect(),
            seeds,
            settings: &settings,
            cells: cells
                .iter()
                .map(|cell| {
                    (
                        cell.problem.id.as_str(),
                        &cell.problem.problem,
                        cell.counts.as_slice(),
                    )
                })
                .collect(),
        };
        let text = serde_json::to_vec(&canonical)
            .expect("plain data with text keys always turns into JSON");
        let hash = data_encoding::HEXLOWER.encode(&Sha256::digest(text));
        Ok(Self {
            kind,
            simulation: Simulation::new(cells, models, seeds, settings)?,
            hash,
        })
    }

    /// How many fits it takes.
    pub fn fits(&self) -> usize {
        self.simulation.tasks()
    }
}

/// How far a sweep is.
pub type SweepState = WorkState<SweepResult>;

/// The sweeps of one server.
pub type Sweeps = OnDemand<SweepInput>;

impl Work for SweepInput {
    type Output = SweepResult;

    const NAME: &'static str = "sweep";

    fn hash(&self) -> &str {
        &self.hash
    }

    fn fits(&self) -> usize {
        self.fits()
    }

    fn run(
        &self,
        watch: &mut dyn FnMut(usize) -> ControlFlow<()>,
    ) -> Result<SweepResult, FitError> {
        let mut scores = Vec::with_capacity(self.fits());
        for task in 0..self.fits() {
            scores.push(self.simulation.run(task, &mut |_| watch(task))?);
        }
        Ok(match &self.kind {
            Kind::Share(sweep) => SweepResult::Share(sweep.report(&self.simulation, &scores)),
            Kind::Gap(sweep) => SweepResult::Gap(sweep.report(&self.simulation, &scores)),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use tokio_util::sync::CancellationToken;

    use super::*;
    use crate::inference::FittedProblem;
    use crate::jobs::{Asker, on_demand::QUEUE};
    use crate::model::NOISY_RATIONAL;

    fn input(n: u64) -> SweepInput {
        let actions = [
            ("stable", vec![(1.0, 20.0)]),
            ("unstable", vec![(0.2, 105.0), (0.8, 0.0)]),
        ];
        let problem = FittedProblem {
            id: "cups".to_owned(),
            problem: ChoiceProblem::from_outcomes(actions).unwrap(),
        };
        let sweep = ShareSweep::new(problem, None, n).unwrap();
        let settings = FitSettings {
            reference_reward: Some(105.0),
            draws: 200,
            ..FitSettings::default()
        };
        SweepInput::share(sweep, vec![&NOISY_RATIONAL], 1, settings).unwrap()
    }

    fn wait(sweeps: &Sweeps, input: &SweepInput) -> Arc<SweepResult> {
        loop {
            match sweeps.ask(input, Asker::Known) {
                SweepState::Ready(result) => return result,
                SweepState::Running { .. } => std::thread::yield_now(),
                SweepState::Failed(message) => panic!("{message}"),
            }
        }
    }

    #[test]
    fn a_sweep_is_computed_once_and_kept() {
        let sweeps = Sweeps::new(CancellationToken::new());
        let first = sweeps.ask(&input(2), Asker::Known);
        assert!(
            matches!(
                first,
                SweepState::Running {
                    done: 0,
                    of: 3,
                    ahead: 0
                }
            ),
            "{first:?}"
        );
        let result = wait(&sweeps, &input(2));
        assert!(Arc::ptr_eq(&result, &wait(&sweeps, &input(2))));
        // The worker ended and starts again for another input.
        assert_ne!(*result, *wait(&sweeps, &input(3)));
    }

    #[test]
    fn no_more_wait_than_may_and_the_next_one_hears_how_many() {
        let stop = CancellationToken::new();
        stop.cancel();
        // Nobody works the queue off.
        let sweeps = Sweeps::new(stop);
        for (ahead, n) in (2..2 + QUEUE as u64).enumerate() {
            let state = sweeps.ask(&input(n), Asker::Known);
            assert!(
                matches!(state, SweepState::Running { ahead: found, .. } if found == ahead),
                "{state:?}"
            );
        }
        for n in [99, 100] {
            let state = sweeps.ask(&input(n), Asker::Known);
            assert!(
                matches!(state, SweepState::Running { ahead: QUEUE, .. }),
                "{state:?}"
            );
        }
        assert!(matches!(
            sweeps.ask(&input(2), Asker::Known),
            SweepState::Running { .. }
        ));
    }

    #[test]
    fn strangers_leave_places_for_researchers() {
        // Once it has stopped nothing is computed, and what is asked for waits.
        let stop = CancellationToken::new();
        stop.cancel();
        let sweeps = Sweeps::new(stop);
        let ahead = |n, asker| match sweeps.ask(&input(n), asker) {
            SweepState::Running { ahead, .. } => ahead,
            SweepState::Ready(_) | SweepState::Failed(_) => panic!("it cannot be over"),
        };
        assert_eq!(ahead(10, Asker::Stranger), 0);
        assert_eq!(ahead(20, Asker::Stranger), 1);
        assert_eq!(ahead(30, Asker::Stranger), QUEUE, "no place");
        assert_eq!(ahead(40, Asker::Known), 2);
        assert_eq!(ahead(10, Asker::Stranger), 0, "it is waited for already");
    }
}
