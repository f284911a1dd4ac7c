//! Fits what changed, in the background: one fit at a time on a thread of its own, never delaying answers.

use std::{
    any::Any,
    collections::HashSet,
    ops::ControlFlow,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
    time::Duration,
};

use tokio::sync::{broadcast::error::RecvError, mpsc, oneshot};
use tokio_util::sync::CancellationToken;

use super::{Catalogue, FitReport, StudyCounts, fit_input::FitInput, fit_report::blob};
use crate::{
    inference::{FitError, fit},
    store::{self, FitOutcome, FitState, NewFit, Population, Store},
    study::Study,
};

/// A change whose notice was missed is found by then.
const POLL_INTERVAL: Duration = Duration::from_secs(30);
/// How often one and the same input is tried.
const MAX_ATTEMPTS: u32 = 3;
/// Pause after the database failed.
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
    // Failures that were logged already.
    let mut told = HashSet::new();
    while !stop.is_cancelled() {
        match refit_next(&store, &catalogue, population, &worker, &mut told).await {
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
            () = tokio::time::sleep(POLL_INTERVAL) => {}
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
    told: &mut HashSet<String>,
) -> Result<Progress, store::Error> {
    let mut due: Option<Due> = None;
    for study in catalogue.studies() {
        if let Some(found) = most_behind(store, study, population).await?
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
    let input = Arc::new(input);
    // No answer means that the server is ending.
    let Some(finished) = worker.fit(input.clone()).await else {
        return Ok(Progress::Idle);
    };
    if let FitOutcome::Failed(message) = &finished.outcome
        && told.insert(input.hash.clone())
    {
        tracing::error!(study = %study.id(), plan = %input.plan, part = %input.part, model = input.model.id, message, "a fit failed");
    }
    store
        .save_fit(NewFit {
            study: study.id().clone(),
            population,
            key: input.key(),
            input_hash: input.hash.clone(),
            data_version,
            version,
            seed: input.settings.seed,
            attempts,
            cpu_ms: finished.cpu_ms,
            outcome: finished.outcome,
            draws: finished.draws,
        })
        .await?;
    Ok(Progress::Fitted)
}

/// A fit that is to be run.
struct Due {
    study: Arc<Study>,
    input: FitInput,
    data_version: i64,
    /// The data that the part was last fitted to; the oldest goes first, so that no part waits for ever while answers keep
    /// arriving.
    fitted_at: Option<i64>,
    attempts: u32,
}

async fn most_behind(
    store: &Store,
    study: &Arc<Study>,
    population: Population,
) -> Result<Option<Due>, store::Error> {
    // The version first: a change in between makes the fit look older than it is, and it is looked at again.
    let data_version = store.totals(study.id(), population).await?.data_version;
    let counts = StudyCounts::new(study, &store.cell_counts(study.id(), population).await?);
    let latest = store.latest_fits(study.id(), population).await?;
    let due = FitInput::all(study, &counts)
        .into_iter()
        .filter(|input| input.data.n() > 0)
        .filter_map(|input| {
            let fit = latest.iter().find(|fit| input.is_of(fit));
            let attempts = match fit {
                Some(fit) if fit.input_hash == input.hash => match fit.outcome.state() {
                    FitState::Converged | FitState::Unconverged => return None,
                    FitState::Failed if fit.attempts >= MAX_ATTEMPTS => return None,
                    FitState::Failed => fit.attempts + 1,
                },
                Some(_) | None => 1,
            };
            let fitted_at = fit.map(|fit| fit.data_version);
            Some(Due {
                study: study.clone(),
                input,
                data_version,
                fitted_at,
                attempts,
            })
        });
    // The first of equally old ones: file order.
    Ok(due.min_by_key(|due| due.fitted_at))
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
