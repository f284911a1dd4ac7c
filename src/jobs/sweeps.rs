//! Sweeps on demand: one at a time on a thread of low priority, kept by what they depend on.
//!
//! A sweep is a pure function of its input, and takes seconds. So it is computed when somebody asks for it, at most one at a
//! time, and the latest ones are kept in memory; a restart forgets them.

use std::{
    collections::{HashMap, VecDeque},
    ops::ControlFlow,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use serde::Serialize;
use sha2::{Digest, Sha256};
use tokio_util::sync::CancellationToken;

use super::fit_input::PROGRAM_VERSION;
use crate::inference::{
    FitError, FitSettings,
    sweep::{
        GapSweep, GapSweepReport, ShareSweep, ShareSweepReport, SimulatedCell, Simulation,
        SweepError,
    },
};
use crate::model::{ChoiceModel, ChoiceProblem};

/// Sweeps that may wait for their turn.
const QUEUE: usize = 8;
/// How many of these places strangers may take.
const QUEUE_OF_STRANGERS: usize = 2;
/// Finished sweeps that are kept.
const KEPT: usize = 64;

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

/// Who asks for a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asker {
    /// Somebody with an account or a token, or whoever sits at this machine.
    Known,
    /// Anybody, of a public study: finds no place where researchers might need it.
    Stranger,
}

/// How far a sweep is.
#[derive(Debug, Clone)]
pub enum SweepState {
    /// Others come first, or it is being computed.
    Running {
        /// Fits that are done.
        done: usize,
        /// All fits.
        of: usize,
        /// Sweeps that come before it.
        ahead: usize,
    },
    /// Done.
    Ready(Arc<SweepResult>),
    /// Broke off with a message.
    Failed(String),
}

/// The sweeps of one server.
#[derive(Debug, Clone)]
pub struct Sweeps {
    shared: Arc<Mutex<Shared>>,
    stop: CancellationToken,
}

#[derive(Debug, Default)]
struct Shared {
    /// The one that is being computed.
    current: Option<(String, Arc<AtomicUsize>, usize)>,
    queue: VecDeque<SweepInput>,
    finished: HashMap<String, Result<Arc<SweepResult>, String>>,
    /// The keys of `finished`, oldest first.
    order: VecDeque<String>,
    has_worker: bool,
}

impl Sweeps {
    /// No sweep yet; what is being computed ends with `stop`.
    pub fn new(stop: CancellationToken) -> Self {
        Self {
            shared: Arc::default(),
            stop,
        }
    }

    /// The sweep of this input: finished, or on its way from now on.
    pub fn ask(&self, input: &SweepInput, asker: Asker) -> SweepState {
        let mut shared = self.lock();
        let of = input.fits();
        match shared.finished.get(&input.hash) {
            Some(Ok(result)) => return SweepState::Ready(result.clone()),
            Some(Err(message)) => return SweepState::Failed(message.clone()),
            None => {}
        }
        if let Some((hash, done, of)) = &shared.current
            && *hash == input.hash
        {
            return SweepState::Running {
                done: done.load(Ordering::Relaxed),
                of: *of,
                ahead: 0,
            };
        }
        let running = usize::from(shared.current.is_some());
        let waiting = shared
            .queue
            .iter()
            .position(|other| other.hash == input.hash);
        let places = match asker {
            Asker::Known => QUEUE,
            Asker::Stranger => QUEUE_OF_STRANGERS,
        };
        let place = match waiting {
            Some(place) => place,
            // Whoever asks again gets a place once there is one.
            None if shared.queue.len() >= places => QUEUE,
            None => {
                shared.queue.push_back(input.clone());
                shared.queue.len() - 1
            }
        };
        if !shared.has_worker && !self.stop.is_cancelled() {
            let worker = self.clone();
            let started = std::thread::Builder::new()
                .name("sweep".to_owned())
                .spawn(move || worker.work());
            match started {
                Ok(_) => shared.has_worker = true,
                Err(error) => tracing::error!(%error, "the thread for sweeps could not be started"),
            }
        }
        SweepState::Running {
            done: 0,
            of,
            ahead: place + running,
        }
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        // Nothing can be left half done under this lock.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Computes until nothing waits.
    fn work(&self) {
        // Behind answers, pages and refits.
        if let Err(error) = rustix::process::nice(19) {
            tracing::debug!(%error, "the priority of sweeps could not be lowered");
        }
        while let Some((input, done)) = self.next() {
            let result = catch_unwind(AssertUnwindSafe(|| compute(&input, &done, &self.stop)));
            let result = match result {
                Ok(Ok(result)) => Ok(Arc::new(result)),
                Ok(Err(FitError::Stopped)) => return,
                Ok(Err(error)) => Err(error.to_string()),
                Err(_) => Err("the program has a fault".to_owned()),
            };
            if let Err(error) = &result {
                tracing::error!(error, "a sweep failed");
            }
            let mut shared = self.lock();
            shared.current = None;
            if shared.order.len() >= KEPT
                && let Some(oldest) = shared.order.pop_front()
            {
                shared.finished.remove(&oldest);
            }
            shared.order.push_back(input.hash.clone());
            shared.finished.insert(input.hash, result);
        }
    }

    fn next(&self) -> Option<(SweepInput, Arc<AtomicUsize>)> {
        let mut shared = self.lock();
        let next = shared.queue.pop_front();
        match next {
            Some(input) => {
                let done = Arc::new(AtomicUsize::new(0));
                shared.current = Some((input.hash.clone(), done.clone(), input.fits()));
                Some((input, done))
            }
            None => {
                // Under the same lock under which another request would start the next worker.
                shared.has_worker = false;
                None
            }
        }
    }
}

fn compute(
    input: &SweepInput,
    done: &AtomicUsize,
    stop: &CancellationToken,
) -> Result<SweepResult, FitError> {
    let mut watch = |_| {
        if stop.is_cancelled() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let mut scores = Vec::with_capacity(input.fits());
    for task in 0..input.fits() {
        scores.push(input.simulation.run(task, &mut watch)?);
        done.store(task + 1, Ordering::Relaxed);
    }
    Ok(match &input.kind {
        Kind::Share(sweep) => SweepResult::Share(sweep.report(&input.simulation, &scores)),
        Kind::Gap(sweep) => SweepResult::Gap(sweep.report(&input.simulation, &scores)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::FittedProblem;
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
        assert_eq!(sweeps.lock().queue.len(), QUEUE);
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
