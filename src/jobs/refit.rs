//! Fits what changed, in the background, never delaying answers.
//!
//! Two threads. The live one carries out rounds: all parts of a study whose answers changed, each from the fit before
//! it on, which takes about a millisecond; what comes out is provisional. The other one fits from nothing: parts that no
//! fit was made of yet, parts whose refits take long, and, once a study is idle or closed, everything provisional, which
//! becomes final.

use std::{collections::HashMap, sync::Arc, time::Duration};

use tokio::{sync::broadcast::error::RecvError, task::JoinHandle, time::Instant};
use tokio_util::sync::CancellationToken;

use super::{
    Catalogue, Snapshot,
    due::{Due, MAX_ATTEMPTS, Waits},
    fit_input::FitInput,
    fit_report::blob,
    fitting::{self, FitFailure},
    lane::{Ended, Lane},
    live_fits::LiveFit,
    quiet::Quiet,
};
use crate::{
    store::{self, FitKey, FitOutcome, NewFit, Population, Store, StudyState, VersionId},
    study::{Study, StudyId},
};

/// A change whose notice was missed is found by then.
const POLL_INTERVAL: Duration = Duration::from_secs(30);
/// Pause after the database or a fit failed; after each further failure of the same fit four times the one before.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// Processor time after which a round is stored and what is left waits for the next, so that other studies have their
/// turn.
const ROUND_US: u64 = 20_000;
/// A part whose refit takes longer than this has no place among the live ones.
const SLOW_US: u64 = 50_000;

/// Refits the current studies of one population whenever their answers changed, until `stop`.
///
/// What is behind follows from input hashes, so nothing is lost by a restart. The counts are read anew before each round:
/// a hundred answers that arrive during one round cause one round more, not a hundred.
pub async fn run(
    store: Store,
    catalogue: Arc<Catalogue>,
    population: Population,
    stop: CancellationToken,
) {
    let mut changes = store.subscribe();
    let (live, cold) = match (Lane::start("refit"), Lane::start("cold fit")) {
        (Ok(live), Ok(cold)) => (Arc::new(live), Arc::new(cold)),
        (Err(error), _) | (_, Err(error)) => {
            tracing::error!(%error, "the threads for fits could not be started; nothing is fitted");
            return;
        }
    };
    let mut refits = Refits {
        store,
        catalogue,
        population,
        stop: stop.clone(),
        live: Place::of(live),
        cold: Place::of(cold),
        failures: Failures::default(),
        quiet: Quiet::default(),
        waits: Waits::default(),
    };
    while !stop.is_cancelled() {
        if let Err(error) = refits.look().await {
            refits.rest_after(&error).await;
        }
        let wake = refits.wake(Instant::now());
        tokio::select! {
            change = changes.recv() => match change {
                Ok(_) | Err(RecvError::Lagged(_)) => {}
                Err(RecvError::Closed) => break,
            },
            ended = refits.live.ended() => refits.note(ended).await,
            ended = refits.cold.ended() => refits.note(ended).await,
            () = tokio::time::sleep_until(wake) => {}
            () = stop.cancelled() => break,
        }
    }
    refits.live.finish().await;
    refits.cold.finish().await;
}

struct Refits {
    store: Store,
    catalogue: Arc<Catalogue>,
    population: Population,
    stop: CancellationToken,
    live: Place,
    cold: Place,
    failures: Failures,
    quiet: Quiet,
    waits: Waits,
}

/// A thread and what runs there.
struct Place {
    lane: Arc<Lane>,
    running: Option<Running>,
    /// When each study had its last turn here, counted in rounds.
    turns: HashMap<StudyId, u64>,
}

struct Running {
    task: JoinHandle<RoundEnd>,
    study: StudyId,
    keys: Vec<FitKey>,
    data_version: i64,
    /// A final fit of answers that are not the latest any more is of no use.
    is_final: bool,
    cancel: CancellationToken,
}

type RoundEnd = Result<Vec<Failed>, store::Error>;

/// A fit that broke off.
struct Failed {
    study: StudyId,
    input: Arc<FitInput>,
    attempts: u32,
    message: String,
}

impl Place {
    fn of(lane: Arc<Lane>) -> Self {
        Self {
            lane,
            running: None,
            turns: HashMap::new(),
        }
    }

    /// When this study had its last turn: 0 for never.
    fn turn_of(&self, study: &StudyId) -> u64 {
        self.turns.get(study).copied().unwrap_or(0)
    }

    fn take_turn(&mut self, study: &StudyId) {
        let last = self.turns.values().copied().max().unwrap_or(0);
        self.turns.insert(study.clone(), last + 1);
    }

    /// What came out of what runs here, once it has ended; for ever if nothing runs.
    async fn ended(&mut self) -> RoundEnd {
        let Some(running) = &mut self.running else {
            return std::future::pending().await;
        };
        let ended = (&mut running.task).await;
        self.running = None;
        ended.unwrap_or_else(|error| {
            tracing::error!(%error, "a round of fits ended badly");
            Ok(Vec::new())
        })
    }

    async fn finish(&mut self) {
        if self.running.is_some()
            && let Err(error) = self.ended().await
        {
            tracing::debug!(%error, "the last fits were not stored");
        }
    }

    fn has(&self, study: &StudyId, key: &FitKey) -> bool {
        self.running
            .as_ref()
            .is_some_and(|running| running.study == *study && running.keys.contains(key))
    }
}

impl Refits {
    /// Looks at all studies and starts what is due where a thread is free.
    async fn look(&mut self) -> Result<(), store::Error> {
        let now = Instant::now();
        let mut live: Option<Round> = None;
        let mut cold: Option<Round> = None;
        let catalogue = self.catalogue.clone();
        for study in catalogue.studies() {
            let id = study.id();
            let read = Snapshot::read(&self.store, &self.catalogue, self.population, id).await?;
            let Some((snapshot, (version, _))) = read.zip(self.catalogue.current(id)) else {
                continue;
            };
            self.catalogue.live_fits.forget_before(
                id,
                self.population,
                snapshot.people.erased_version,
            );
            self.quiet.note(id, snapshot.version.data_version, now);
            self.cold.cancel_if_needless(&snapshot);
            let round = |dues, turn| Round {
                study: snapshot.study.clone(),
                version,
                data_version: snapshot.version.data_version,
                turn,
                dues,
            };
            let (mut of_live, of_cold) = self.due(&snapshot, now);
            // A round may end early.
            of_live.sort_by_key(Due::urgency);
            let turn = self.live.turn_of(id);
            if !of_live.is_empty() && live.as_ref().is_none_or(|other| turn < other.turn) {
                live = Some(round(of_live, turn));
            }
            if let Some(first) = of_cold.into_iter().min_by_key(Due::urgency) {
                let turn = self.cold.turn_of(id);
                // In no study does anything become final while another one waits for its first fit.
                let is_sooner = |other: &Round| {
                    let of = |due: &Due, turn| (due.is_final, turn, due.urgency());
                    of(&first, turn) < of(&other.dues[0], other.turn)
                };
                if cold.as_ref().is_none_or(is_sooner) {
                    cold = Some(round(vec![first], turn));
                }
            }
        }
        for (round, is_live) in [(live, true), (cold, false)] {
            if let Some(round) = round {
                self.start(round, is_live);
            }
        }
        Ok(())
    }

    /// What of a study is due: on the live thread, and on the other one.
    fn due(&mut self, snapshot: &Snapshot, now: Instant) -> (Vec<Due>, Vec<Due>) {
        let id = snapshot.study.id();
        let watched = &snapshot.curve_plan().id;
        let is_settled = snapshot.state == StudyState::Closed || self.quiet.is_idle(id, now);
        let (mut live, mut cold) = (Vec::new(), Vec::new());
        for part in &snapshot.fits {
            let key = part.input.key();
            let data_version = snapshot.version.data_version;
            let since = if part.is_behind {
                let fitted_at = part.fit.as_ref().map(|fit| fit.data_version);
                self.waits.since(id, &key, fitted_at, data_version)
            } else {
                self.waits.end(id, &key);
                data_version
            };
            if self.failures.is_resting(&part.input.hash, now)
                || self.live.has(id, &key)
                || self.cold.has(id, &key)
            {
                continue;
            }
            let known = self.catalogue.live_fits.get(id, self.population, &key);
            let is_watched = part.plan == *watched;
            let Some(due) = Due::of(part, known, is_settled, since, is_watched) else {
                continue;
            };
            match &due.previous {
                Some(previous) if previous.warm_us <= SLOW_US => live.push(due),
                Some(_) | None => cold.push(due),
            }
        }
        if self.live.running.is_some() {
            live.clear();
        }
        if self.cold.running.is_some() {
            cold.clear();
        }
        (live, cold)
    }

    fn start(&mut self, round: Round, is_live: bool) {
        let place = if is_live {
            &mut self.live
        } else {
            &mut self.cold
        };
        place.take_turn(round.study.id());
        let cancel = self.stop.child_token();
        place.running = Some(Running {
            study: round.study.id().clone(),
            keys: round.dues.iter().map(|due| due.input.key()).collect(),
            data_version: round.data_version,
            is_final: round.dues.iter().all(|due| due.is_final),
            cancel: cancel.clone(),
            task: tokio::spawn(round.carry_out(
                self.store.clone(),
                self.catalogue.clone(),
                self.population,
                place.lane.clone(),
                cancel,
            )),
        });
    }

    async fn note(&mut self, ended: RoundEnd) {
        match ended {
            Ok(failed) => {
                for Failed {
                    study,
                    input,
                    attempts,
                    message,
                } in failed
                {
                    if self.failures.note(&input.hash, attempts, Instant::now()) {
                        tracing::error!(%study, plan = %input.plan, part = %input.part, model = input.model.id, message, "a fit failed");
                    }
                }
            }
            Err(error) => self.rest_after(&error).await,
        }
    }

    async fn rest_after(&self, error: &store::Error) {
        let is_busy = matches!(error, store::Error::Busy);
        if !is_busy && !self.stop.is_cancelled() {
            tracing::error!(%error, "refits could not read or write the database");
        }
        tokio::select! {
            () = tokio::time::sleep(RETRY_PAUSE) => {}
            () = self.stop.cancelled() => {}
        }
    }

    /// When to look again at the latest.
    fn wake(&self, now: Instant) -> Instant {
        let wake = self.failures.wake(now);
        self.quiet.wake(now).map_or(wake, |idle| wake.min(idle))
    }
}

impl Place {
    /// Stops a final fit of a study whose answers have changed since it began.
    fn cancel_if_needless(&self, snapshot: &Snapshot) {
        if let Some(running) = &self.running
            && running.is_final
            && running.study == *snapshot.study.id()
            && running.data_version != snapshot.version.data_version
        {
            running.cancel.cancel();
        }
    }
}

/// Fits of one study, one after the other; those of one plan are stored, and so shown, together.
struct Round {
    study: Arc<Study>,
    version: VersionId,
    data_version: i64,
    turn: u64,
    dues: Vec<Due>,
}

impl Round {
    async fn carry_out(
        self,
        store: Store,
        catalogue: Arc<Catalogue>,
        population: Population,
        lane: Arc<Lane>,
        stop: CancellationToken,
    ) -> RoundEnd {
        let study = self.study.id();
        let (mut fits, mut failures) = (Vec::new(), Vec::new());
        let mut spent_us = 0;
        for due in &self.dues {
            if spent_us > ROUND_US {
                break;
            }
            let is_next_plan = |done: &NewFit| done.key.plan != due.input.plan;
            if fits.last().is_some_and(is_next_plan) {
                store.save_fits(std::mem::take(&mut fits)).await?;
            }
            let work = {
                let (input, previous) = (due.input.clone(), due.previous.clone());
                let stop = stop.clone();
                move || fitting::run(&input, previous.as_deref(), &stop)
            };
            let Ok(done) = lane.run(work).await.map_err(|Ended| ()) else {
                return Ok(Vec::new());
            };
            spent_us += done.cpu_us;
            let cpu_ms = done.cpu_ms();
            let warm_us = due.previous.as_ref().map_or(0, |_| done.cpu_us);
            let mut new = NewFit {
                study: study.clone(),
                population,
                key: due.input.key(),
                input_hash: due.input.hash.clone(),
                data_version: self.data_version,
                version: self.version,
                seed: due.input.settings.seed,
                attempts: due.attempts,
                is_provisional: false,
                cpu_ms,
                outcome: FitOutcome::Failed(String::new()),
                draws: None,
            };
            let message = match done.result {
                Ok(Ok(fitted)) => {
                    new.is_provisional = fitted.fit.summary.provisional;
                    new.outcome = fitted.outcome;
                    // Those of a provisional fit are kept in memory: they would be most of what is written.
                    new.draws = (!new.is_provisional).then(|| blob(&fitted.fit.draws));
                    let live = LiveFit {
                        data_version: self.data_version,
                        input_hash: new.input_hash.clone(),
                        is_provisional: new.is_provisional,
                        report: Arc::new(fitted.report),
                        draws: Arc::new(fitted.fit.draws),
                        warm_start: fitted.fit.warm_start,
                        warm_us,
                    };
                    // Before it is stored: whoever hears of it finds it.
                    catalogue
                        .live_fits
                        .keep(study, population, new.key.clone(), live);
                    fits.push(new);
                    continue;
                }
                Ok(Err(FitFailure::Stopped)) => continue,
                Ok(Err(failure)) => failure.to_string(),
                Err(panic) => panic,
            };
            new.outcome = FitOutcome::Failed(message.clone());
            fits.push(new);
            failures.push(Failed {
                study: study.clone(),
                input: due.input.clone(),
                attempts: due.attempts,
                message,
            });
        }
        if !fits.is_empty() {
            store.save_fits(fits).await?;
        }
        Ok(failures)
    }
}

/// Inputs whose fit failed while this server runs, and until when each rests. A rest delays no other part.
#[derive(Debug, Default)]
struct Failures(HashMap<String, Instant>);

impl Failures {
    /// Lets an input rest, longer after each attempt; whether it failed for the first time.
    fn note(&mut self, hash: &str, attempts: u32, now: Instant) -> bool {
        // An input that rests no more has been replaced by newer answers, or will be noted again.
        self.0.retain(|known, until| known == hash || *until > now);
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
