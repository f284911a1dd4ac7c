//! Fits what changed, in the background: one fit at a time on a thread of its own, never delaying answers.

use std::{
    any::Any,
    collections::HashMap,
    ops::ControlFlow,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
    time::Duration,
};

use tokio::{
    sync::{broadcast::error::RecvError, mpsc, oneshot},
    time::Instant,
};
use tokio_util::sync::CancellationToken;

use super::{Catalogue, FitReport, Snapshot, fit_input::FitInput, fit_report::blob};
use crate::{
    inference::{FitError, fit},
    store::{self, FitOutcome, FitState, NewFit, Population, Store},
    study::Study,
};

/// A change whose notice was missed is found by then.
const POLL_INTERVAL: Duration = Duration::from_secs(30);
/// How often one and the same input is tried.
const MAX_ATTEMPTS: u32 = 3;
/// Pause after the database or a fit failed; after each further failure of the same fit four times the one before.
const RETRY_PAUSE: Duration = Duration::from_secs(1);

/// Refits the current studies of one population whenever their answers changed, until `stop`.
///
/// What is behind follows from input hashes, so nothing is lost by a restart. The counts are read anew before each fit:
/// a hundred answers that arrive during one fit cause one fit more, not a hundred.
pub async fn run(
    store: Store,
    catalogue: Arc<Catalogue>,
    population: Population,
    stop: CancellationToken,
) {
    let mut changes = store.subscribe();
    let worker = match Worker::start(stop.clone()) {
        Ok(worker) => worker,
        Err(error) => {
            tracing::error!(%error, "the thread for fits could not be started; nothing is fitted");
            return;
        }
    };
    let mut failures = Failures::default();
    while !stop.is_cancelled() {
        match refit_next(&store, &catalogue, population, &worker, &mut failures).await {
            Ok(Progress::Fitted) => continue,
            Ok(Progress::Idle) => {}
            Err(store::Error::Busy) => pause(&stop).await,
            Err(error) => {
                if !stop.is_cancelled() {
                    tracing::error!(%error, "refits could not read or write the database");
                }
                pause(&stop).await;
            }
        }
        tokio::select! {
            change = changes.recv() => match change {
                Ok(_) | Err(RecvError::Lagged(_)) => {}
                Err(RecvError::Closed) => return,
            },
            () = tokio::time::sleep_until(failures.wake(Instant::now())) => {}
            () = stop.cancelled() => {}
        }
    }
}

async fn pause(stop: &CancellationToken) {
    tokio::select! {
        () = tokio::time::sleep(RETRY_PAUSE) => {}
        () = stop.cancelled() => {}
    }
}

enum Progress {
    Fitted,
    Idle,
}

/// Runs the fit that is furthest behind, if one is.
async fn refit_next(
    store: &Store,
    catalogue: &Catalogue,
    population: Population,
    worker: &Worker,
    failures: &mut Failures,
) -> Result<Progress, store::Error> {
    let mut due: Option<Due> = None;
    for study in catalogue.studies() {
        let Some(snapshot) = Snapshot::read(store, catalogue, population, study.id()).await? else {
            continue;
        };
        if let Some(found) = most_behind(&snapshot, failures, Instant::now())
            && due
                .as_ref()
                .is_none_or(|due| found.fitted_at < due.fitted_at)
        {
            due = Some(found);
        }
    }
    let Some(due) = due else {
        return Ok(Progress::Idle);
    };
    let Some((version, _)) = catalogue.current(due.study.id()) else {
        return Ok(Progress::Idle);
    };
    let Due {
        study,
        input,
        data_version,
        attempts,
        ..
    } = due;
    // No answer means that the server is ending.
    let Some(finished) = worker.fit(input.clone()).await else {
        return Ok(Progress::Idle);
    };
    if let FitOutcome::Failed(message) = &finished.outcome
        && failures.note(&input.hash, attempts, Instant::now())
    {
        tracing::error!(study = %study.id(), plan = %input.plan, part = %input.part, model = input.model.id, message, "a fit failed");
    }
    store
        .save_fits(vec![NewFit {
            study: study.id().clone(),
            population,
            key: input.key(),
            input_hash: input.hash.clone(),
            data_version,
            version,
            seed: input.settings.seed,
            attempts,
            is_provisional: false,
            cpu_ms: finished.cpu_ms,
            outcome: finished.outcome,
            draws: finished.draws,
        }])
        .await?;
    Ok(Progress::Fitted)
}

/// Inputs whose fit failed while this server runs, and until when each rests. A rest delays no other part.
#[derive(Debug, Default)]
struct Failures(HashMap<String, Instant>);

impl Failures {
    /// Lets an input rest, longer after each attempt; whether it failed for the first time.
    fn note(&mut self, hash: &str, attempts: u32, now: Instant) -> bool {
        let pause = RETRY_PAUSE * 4_u32.pow(attempts.clamp(1, MAX_ATTEMPTS) - 1);
        self.0.insert(hash.to_owned(), now + pause).is_none()
    }

    fn is_resting(&self, hash: &str, now: Instant) -> bool {
        self.0.get(hash).is_some_and(|until| *until > now)
    }

    /// When to look again at the latest.
    fn wake(&self, now: Instant) -> Instant {
        let rests = self.0.values().copied().filter(|until| *until > now);
        rests.fold(now + POLL_INTERVAL, Instant::min)
    }
}

/// A fit that is to be run.
struct Due {
    study: Arc<Study>,
    input: Arc<FitInput>,
    data_version: i64,
    /// The data that the part was last fitted to; the oldest goes first, so that no part waits for ever while answers keep
    /// arriving.
    fitted_at: Option<i64>,
    attempts: u32,
}

fn most_behind(snapshot: &Snapshot, failures: &Failures, now: Instant) -> Option<Due> {
    let due = snapshot.fits.iter().filter_map(|part| {
        if part.input.data.n() == 0 || failures.is_resting(&part.input.hash, now) {
            return None;
        }
        let attempts = match &part.fit {
            Some(fit) if fit.input_hash == part.input.hash => match fit.outcome.state() {
                FitState::Converged | FitState::Unconverged => return None,
                FitState::Failed if fit.attempts >= MAX_ATTEMPTS => return None,
                FitState::Failed => fit.attempts + 1,
            },
            Some(_) | None => 1,
        };
        Some(Due {
            study: snapshot.study.clone(),
            input: part.input.clone(),
            data_version: snapshot.version.data_version,
            fitted_at: part.fit.as_ref().map(|fit| fit.data_version),
            attempts,
        })
    });
    // The first of equally old ones: file order.
    due.min_by_key(|due| due.fitted_at)
}

/// The thread on which fits run. It ends when its worker is dropped.
struct Worker {
    jobs: mpsc::UnboundedSender<Job>,
}

struct Job {
    input: Arc<FitInput>,
    done: oneshot::Sender<Finished>,
}

struct Finished {
    outcome: FitOutcome,
    draws: Option<Vec<u8>>,
    cpu_ms: u64,
}

impl Worker {
    fn start(stop: CancellationToken) -> std::io::Result<Self> {
        let (jobs, mut queue) = mpsc::unbounded_channel::<Job>();
        std::thread::Builder::new()
            .name("refit".to_owned())
            .spawn(move || {
                step_back();
                while let Some(job) = queue.blocking_recv() {
                    if let Some(finished) = finish(&job.input, &stop) {
                        // Nobody waits any more when the server ends.
                        drop(job.done.send(finished));
                    }
                }
            })?;
        Ok(Self { jobs })
    }

    /// The finished fit; `None` when the server is ending.
    async fn fit(&self, input: Arc<FitInput>) -> Option<Finished> {
        let (done, finished) = oneshot::channel();
        self.jobs.send(Job { input, done }).ok()?;
        finished.await.ok()
    }
}

/// Lets answers go first: on Linux a thread has a priority of its own.
fn step_back() {
    if let Err(error) = rustix::process::nice(10) {
        tracing::debug!(%error, "the priority of fits could not be lowered");
    }
}

fn finish(input: &FitInput, stop: &CancellationToken) -> Option<Finished> {
    let started = processor_ms();
    // A fault in one fit must not take the others with it.
    let result = catch_unwind(AssertUnwindSafe(|| run_fit(input, stop)));
    let (outcome, draws) = match result {
        Ok(Ok((outcome, draws))) => (outcome, Some(draws)),
        Ok(Err(FitFailure::Fit(FitError::Stopped))) => return None,
        Ok(Err(failure)) => (FitOutcome::Failed(failure.to_string()), None),
        Err(panic) => (FitOutcome::Failed(panic_message(panic.as_ref())), None),
    };
    Some(Finished {
        outcome,
        draws,
        cpu_ms: processor_ms().saturating_sub(started),
    })
}

/// The processor time of this thread so far.
fn processor_ms() -> u64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    let millis = time.tv_sec * 1000 + time.tv_nsec / 1_000_000;
    u64::try_from(millis).unwrap_or(0)
}

#[derive(Debug, thiserror::Error)]
enum FitFailure {
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error("the result could not be written as JSON: {0}")]
    Report(#[from] serde_json::Error),
}

fn run_fit(
    input: &FitInput,
    stop: &CancellationToken,
) -> Result<(FitOutcome, Vec<u8>), FitFailure> {
    let mut watch = |_| {
        if stop.is_cancelled() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let fit = fit(input.model, &input.data, &input.settings, &mut watch)?;
    let result = serde_json::to_string(&FitReport::new(input, &fit))?;
    let outcome = if fit.summary.converged {
        FitOutcome::Converged(result)
    } else {
        FitOutcome::Unconverged(result)
    };
    Ok((outcome, blob(&fit.draws)))
}

fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    format!(
        "the program has a fault: {}",
        text.unwrap_or_else(|| "no message".to_owned())
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_fit_rests_longer_each_time_and_others_do_not() {
        let now = Instant::now();
        let mut failures = Failures::default();
        assert_eq!(failures.wake(now), now + POLL_INTERVAL);

        assert!(failures.note("a", 1, now));
        assert!(failures.is_resting("a", now) && !failures.is_resting("b", now));
        let second = now + Duration::from_secs(1);
        assert_eq!(failures.wake(now), second);
        assert!(!failures.is_resting("a", second));

        assert!(!failures.note("a", 2, second), "it was told already");
        assert_eq!(failures.wake(second), second + Duration::from_secs(4));
    }
}
