//! The database: all SQL, the rules under which answers enter it, and what is read from it.
//!
//! One task owns the one connection that writes ([`Store`] queues jobs for it); a few read-only connections answer
//! everything else. A job's caller hears of success only when the commit that holds it is on disk.
//!
//! In reading order:
//! * `open`, `disk`: which databases are accepted, and how they are set up,
//! * `names`, `token`, `error`: ids, states, links, errors,
//! * `rules`: the pure rules of a run,
//! * `job`, `writer`: the queue, the group commit, what happens when the disk fails,
//! * `batch`, `load`, `effects`: one group of participants' jobs: loaded, judged and written with a fixed number of
//!   statements,
//! * `accounts`, `sharing`: who may use the server, and which studies everybody may see,
//! * `studies`, `runs`, `withdraw`, `counts`, `answers`, `bonuses`, `fits`, `comparisons`, `checkpoints`: one file per
//!   group of tables,
//! * `progress`, `quality`, `sources`: what researchers watch while a study runs: steps, times, participants and what is notable
//!   about them,
//! * `participants`: one row per person, for exports; `backup`: copies; `import`: answers from elsewhere,
//! * `doctor`: whether a database is well,
//! * `check`: whether answers and counters agree with the events that they come from.

mod accounts;
mod answers;
mod backup;
mod batch;
mod bonuses;
mod check;
mod checkpoints;
mod comparisons;
mod counts;
mod disk;
mod doctor;
mod effects;
mod error;
mod fits;
mod import;
mod job;
mod load;
mod names;
mod open;
mod participants;
mod progress;
mod quality;
mod rules;
mod runs;
mod sharing;
mod sources;
mod studies;
mod token;
mod withdraw;
mod writer;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use sha2::{Digest, Sha256};
use sqlx::Connection;
use sqlx::sqlite::SqlitePool;
use tokio::sync::{Mutex, broadcast, mpsc};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

pub use accounts::{
    Account, AccountName, AccountNameError, ApiToken, AuditEntry, AuditRow, NewAccount,
    NewApiToken, Password, PasswordError, PasswordHash, SESSION_IDLE_MS, SESSION_LIFE_MS, Session,
    TokenState,
};
pub use answers::{AnswerKey, AnswerRow, EventRow, FormAnswer};
pub use backup::{CopyError, back_up, restore};
pub use bonuses::{BonusRow, PaidChoice};
pub use check::Disagreement;
pub use checkpoints::{Checkpoint, LookCount, NewCheckpoints, Reached, Stopping};
pub use comparisons::{Comparison, NewComparison};
pub use counts::{CellCount, Pattern, Totals};
pub use doctor::{Finding, Health, examine};
pub use error::{Error, OpenError};
pub use fits::{Fit, FitKey, FitOutcome, NewFit};
pub use import::{ImportedAnswer, ImportedRun};
pub use job::{AskedProblem, CandidateRun, DrawnStep};
pub use names::{
    AccountId, AnalysisSet, AnswerStatus, ApiTokenId, AuditOutcome, EventId, EventKind, FitId,
    FitState, Population, ProblemId, Role, RunId, RunState, Scope, StudyState, UnknownName,
    Verdict, VersionId, VersionNumber,
};
pub use participants::{ParticipantRow, StepAnswer};
pub use progress::{LEFT_AFTER_MS, StepProgress};
pub use quality::{FAST_CHOICE_MS, Flag, ParticipantFilter, WatchedParticipant};
pub use rules::Submission;
pub use runs::{ArrivalView, RunView, StepView, StoredCount, draw_run, drawn_step};
pub use sources::SourceCount;
pub use studies::{StudyRow, StudyVersion};
pub use token::{Token, TokenError, TokenHash};

use crate::clock::Clock;
use crate::study::{NotAdmitted, StudyId, TimeFactor, Timestamp};
use disk::Lock;
use job::{Arrive, Hot, Job, Publish, Rare, Show, Start, Submit, Ticket};
use token::Secret;
use writer::Writer;

/// How a database is opened.
#[derive(Debug, Clone)]
pub struct Options {
    /// The database file; made if it is not there.
    pub path: PathBuf,
    /// How many jobs may wait for the writer before [`Error::Busy`].
    pub queue: usize,
    /// How many connections read.
    pub readers: u32,
}

impl Options {
    /// The usual settings.
    pub fn at(path: impl Into<PathBuf>) -> Self {
        // Twice what one commit takes: the next batch fills up while the disk syncs the current one.
        Self {
            path: path.into(),
            queue: 2 * writer::BATCH,
            readers: 4,
        }
    }
}

/// The database of one server. Clones share it.
#[derive(Debug, Clone)]
pub struct Store {
    pool: SqlitePool,
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    path: PathBuf,
    clock: Clock,
    secret: Secret,
    jobs: mpsc::Sender<Job>,
    changes: broadcast::Sender<Change>,
    health: writer::Health,
    close: CancellationToken,
    writer: Mutex<Option<JoinHandle<()>>>,
    /// None beside a server, which holds it.
    _lock: Option<Lock>,
}

/// Something that the pages of a study show has changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// The study.
    pub study: StudyId,
    /// Of whom.
    pub population: Population,
    /// Moves with every change of the data.
    pub data_version: i64,
    /// Moves with every change of what is shown, new fits included.
    pub page_version: i64,
}

/// Somebody who followed a link to a study.
#[derive(Debug, Clone, Default)]
pub struct NewArrival {
    /// The recruiting platform and the person's id there, if the link gave them.
    pub person: Option<(String, String)>,
    /// All recruiting parameters as they are to be stored; see [`Store::recruiting_id`] for hashed ones.
    pub recruiting: BTreeMap<String, String>,
    /// Where the person comes from, for tables by source.
    pub source: Option<String>,
    /// The language of the texts, where the study has several.
    pub language: Option<String>,
    /// A look at the study that is never counted, which is possible in each of its states.
    pub is_preview: bool,
    /// Why nobody new may start; who is under way may come back all the same.
    pub refusal: Option<NotAdmitted>,
}

/// How a run begins.
#[derive(Debug, Clone)]
pub struct NewRun {
    /// The study whose button was pressed; the arrival must be one of it.
    pub study: StudyId,
    /// The study version that its texts come from.
    pub version: VersionId,
    /// What it would be in each condition, see [`draw_run`]: it becomes the first of those whose condition has the
    /// fewest people under way or finished.
    pub candidates: Vec<CandidateRun>,
    /// How many people may be under way or finished.
    pub quota: Option<u32>,
    /// After so many milliseconds it gives its place back if it is not finished.
    pub time_limit_ms: Option<i64>,
    /// Why nobody new may start; who is under way may come back all the same.
    pub refusal: Option<NotAdmitted>,
    /// Extra time, asked for before the start.
    pub factor: TimeFactor,
    /// Real or simulated.
    pub population: Population,
    /// A language other than that of the arrival.
    pub language: Option<String>,
    /// A look at the study that is never counted.
    pub is_preview: bool,
}

/// Where pressing the start button led.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Started {
    /// The run's link.
    pub link: Token,
    /// The run.
    pub run: RunId,
    /// How far it is: a person who has finished gets no second run.
    pub state: RunState,
    /// Whether the link may withdraw.
    pub is_owner: bool,
    /// Whether the run was there before.
    pub is_resumed: bool,
}

/// The same for the same form, however often it is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Receipt {
    /// The event that keeps the form.
    pub event: EventId,
    /// The step.
    pub position: u32,
    /// What the rules made of it.
    pub verdict: Verdict,
    /// When it was judged.
    pub at: Timestamp,
}

/// A form that is on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Submitted {
    /// The receipt of the first form with this key.
    pub receipt: Receipt,
    /// `Retry` or `Conflict` where the key was used before, else as in the receipt.
    pub verdict: Verdict,
    /// The run's state now.
    pub state: RunState,
    /// The run's current step now.
    pub position: u32,
}

impl Store {
    /// Opens a database for serving: checks the disk, takes the lock, migrates, reads the settings back, and starts
    /// the writer on the current tokio runtime.
    ///
    /// # Errors
    /// When the database cannot keep what the server promises; see [`OpenError`].
    pub async fn open(options: Options, clock: Clock) -> Result<Self, OpenError> {
        let path = options.path;
        disk::require_trustworthy(&path)?;
        let lock = Lock::take(&path)?;
        disk::create_private(&path)?;
        open::migrate(&path).await?;
        Self::set_up(Options { path, ..options }, clock, Some(lock)).await
    }

    /// Opens a database that a server may be serving meanwhile: for commands that write.
    ///
    /// Nothing is locked and nothing is migrated, so a database of another schema than this program's is refused, and
    /// so is a file that is not there. Each change is one immediate transaction of the same functions that the
    /// server's writer calls; [`Store::close`] waits until all are on disk.
    ///
    /// # Errors
    /// When the database is missing, of another schema, or cannot keep what the server promises; see [`OpenError`].
    pub async fn open_beside(path: impl Into<PathBuf>, clock: Clock) -> Result<Self, OpenError> {
        let path = path.into();
        open::require_file(&path)?;
        disk::require_trustworthy(&path)?;
        open::require_schema(&path).await?;
        let options = Options {
            readers: 1,
            ..Options::at(path)
        };
        Self::set_up(options, clock, None).await
    }

    /// Starts the writer and the readers on a database of the current schema.
    async fn set_up(options: Options, clock: Clock, lock: Option<Lock>) -> Result<Self, OpenError> {
        let path = options.path;
        let mut connection = open::writing_connection(&path).await?;
        let secret = open::secret(&mut connection, &path, clock.now()).await?;
        let pool = open::reading_pool(&path, options.readers).await?;

        let (jobs, queue) = mpsc::channel(options.queue);
        // A listener that falls this far behind reads the current versions instead.
        let (changes, _) = broadcast::channel(256);
        let (health, close) = (writer::Health::default(), CancellationToken::new());
        let writer = Writer::new(path.clone(), connection, changes.clone(), health.clone());
        let writer = tokio::spawn(writer.run(queue, close.clone()));
        let shared = Shared {
            path,
            clock,
            secret,
            jobs,
            changes,
            health,
            close,
            writer: Mutex::new(Some(writer)),
            _lock: lock,
        };
        Ok(Self {
            pool,
            shared: Arc::new(shared),
        })
    }

    /// Opens a database for reading, also beside a server that uses it: nothing is locked, migrated or written, and
    /// whatever would write is refused as if the server were shutting down.
    ///
    /// # Errors
    /// When there is no such database, or its schema is not that of this program.
    pub async fn open_to_read(path: impl Into<PathBuf>, clock: Clock) -> Result<Self, OpenError> {
        let path = path.into();
        open::require_file(&path)?;
        open::require_schema(&path).await?;
        let mut connection = open::reading_connection(&path).await?;
        let secret = open::stored_secret(&mut connection, &path).await?;
        let closed = connection.close().await;
        closed.map_err(open::at(&path))?;
        let pool = open::read_only_pool(&path, 2).await?;
        // Nobody receives: each job is refused.
        let (jobs, _) = mpsc::channel(1);
        let (changes, _) = broadcast::channel(1);
        let shared = Shared {
            path,
            clock,
            secret,
            jobs,
            changes,
            health: writer::Health::default(),
            close: CancellationToken::new(),
            writer: Mutex::new(None),
            _lock: None,
        };
        Ok(Self {
            pool,
            shared: Arc::new(shared),
        })
    }

    /// Writes what is waiting, then closes the database. Later jobs are refused.
    pub async fn close(&self) {
        self.shared.close.cancel();
        if let Some(writer) = self.shared.writer.lock().await.take()
            && let Err(err) = writer.await
        {
            tracing::error!(error = %err, "the writer ended badly");
        }
        self.pool.close().await;
    }

    /// The clock that deadlines are measured with.
    pub fn clock(&self) -> &Clock {
        &self.shared.clock
    }

    /// The database file.
    pub fn path(&self) -> &Path {
        &self.shared.path
    }

    /// Tells of every change from now on, after its commit. A listener that lags reads the versions anew.
    pub fn subscribe(&self) -> broadcast::Receiver<Change> {
        self.shared.changes.subscribe()
    }

    /// Whether an answer that came now could be stored, as far as is known: the writer runs, and its last commit
    /// reached the disk.
    pub fn is_taking_answers(&self) -> bool {
        let health = &self.shared.health;
        !health.stopped.load(Ordering::Acquire)
            && !health.failed.is_cancelled()
            && !health.commit_failed.load(Ordering::Acquire)
            && !self.shared.jobs.is_closed()
    }

    /// Waits until the disk has failed for good: the server is to end, so that its supervisor starts it anew.
    pub async fn failed(&self) {
        self.shared.health.failed.cancelled().await;
    }

    /// How many commits there were since the start, for metrics.
    pub fn commits(&self) -> u64 {
        self.shared.health.commits.load(Ordering::Relaxed)
    }

    /// Stores that somebody followed a link to a study, under a token from the caller's generator.
    ///
    /// # Errors
    /// `NotFound` for an unknown study, `Closed` for one that takes nobody in and `NotAdmitted` where the arrival says
    /// so, except for a preview and for a person of a recruiting platform who has a run there.
    pub async fn arrive(
        &self,
        token: &Token,
        study: &StudyId,
        arrival: NewArrival,
    ) -> Result<(), Error> {
        let (platform, platform_key) = match &arrival.person {
            Some((platform, person)) => {
                let key = self.shared.secret.platform_key(study, platform, person);
                (Some(platform.clone()), Some(key))
            }
            None => (None, None),
        };
        let recruiting = (!arrival.recruiting.is_empty()).then(|| json(&arrival.recruiting));
        let arrive = Arrive {
            token: token.hash(),
            study: study.clone(),
            platform,
            platform_key,
            recruiting,
            source: arrival.source,
            language: arrival.language,
            is_preview: arrival.is_preview,
            refusal: arrival.refusal,
            at: self.now(),
        };
        self.wait_for(|ticket| Job::Hot(Hot::Arrive(arrive, ticket)))
            .await
    }

    /// Starts the run of an arrival, or finds the one that it or the same person of a recruiting platform has.
    ///
    /// # Errors
    /// `NotFound` for an unknown or expired arrival or one of another study, `Closed` where a new run would be needed and the study takes
    /// nobody in, `NotAdmitted` where `run` says so or no place is left (a preview starts in any case).
    pub async fn start(&self, arrival: &Token, run: NewRun) -> Result<Started, Error> {
        let start = Box::new(Start {
            arrival: arrival.hash(),
            study: run.study,
            link: self.shared.secret.run_token(arrival),
            version: run.version,
            candidates: run.candidates,
            quota: run.quota,
            time_limit_ms: run.time_limit_ms,
            refusal: run.refusal,
            factor: run.factor,
            population: run.population,
            language: run.language,
            is_preview: run.is_preview,
            at: self.now(),
        });
        self.wait_for(|ticket| Job::Hot(Hot::Start(start, ticket)))
            .await
    }

    /// Judges and stores a form. It is on disk when this returns.
    ///
    /// # Errors
    /// `NotFound` for an unknown run, `Refused` where the run's rules say no.
    pub async fn submit(&self, run: RunId, submission: Submission) -> Result<Submitted, Error> {
        self.submit_form(run, None, submission).await
    }

    /// The same for a form that was sent on a link: the one that completes the run shows the completion code.
    ///
    /// # Errors
    /// As [`Store::submit`].
    pub async fn submit_on(
        &self,
        link: &Token,
        run: RunId,
        submission: Submission,
    ) -> Result<Submitted, Error> {
        self.submit_form(run, Some(link.hash()), submission).await
    }

    async fn submit_form(
        &self,
        run: RunId,
        link: Option<TokenHash>,
        submission: Submission,
    ) -> Result<Submitted, Error> {
        if !(1..=64).contains(&submission.key.len()) {
            return Err(Error::Refused(format!(
                "the form's key has {} bytes; 1 to 64 are allowed",
                submission.key.len()
            )));
        }
        let body = json(&rules::Body::of(&submission));
        let body_hash = data_encoding::HEXLOWER.encode(&Sha256::digest(&body));
        let submit = Submit {
            run,
            link,
            submission,
            body,
            body_hash,
            at: self.now(),
        };
        self.wait_for(|ticket| Job::Hot(Hot::Submit(submit, ticket)))
            .await
    }

    /// Closes the timed questions whose time ran out with nobody there, and ends the runs that were not finished in
    /// their time, which frees their places. Returns how many. For a task that calls it every second; nothing is written where nothing is overdue.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn close_overdue(&self) -> Result<usize, Error> {
        let now = self.now();
        if !self.is_anything_overdue(now).await? {
            return Ok(0);
        }
        self.wait_for(|ticket| Job::Hot(Hot::CloseOverdue(now, ticket)))
            .await
    }

    /// Erases everything about a run but that it was: answers, events, steps, recruiting ids, its share of the
    /// counts. Done once, it stays done.
    ///
    /// # Errors
    /// `NotFound` for an unknown link, `Refused` for one that does not belong to whoever started the run.
    pub async fn withdraw(&self, link: &Token) -> Result<(), Error> {
        let view = self.run(link).await?;
        if !view.is_owner {
            return Err(Error::Refused(
                "only the link with which the run was started can withdraw it".to_owned(),
            ));
        }
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::Withdraw(view.run, now, ticket)))
            .await
    }

    /// Erases a run as [`Store::withdraw`] does, for somebody who asked for it in another way than by their link.
    ///
    /// # Errors
    /// `NotFound` for a run that is not one of this study.
    pub async fn erase(
        &self,
        study: &StudyId,
        population: Population,
        run: RunId,
    ) -> Result<(), Error> {
        self.run_state(study, population, run).await?;
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::Withdraw(run, now, ticket)))
            .await
    }

    /// Makes a study's text the current version, and the study itself if it is new, in the state `state_if_new`. The
    /// same text again is the version that it was.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn publish(
        &self,
        study: &StudyId,
        hash: &str,
        text: &str,
        state_if_new: StudyState,
    ) -> Result<VersionId, Error> {
        let publish = Publish {
            study: study.clone(),
            hash: hash.to_owned(),
            text: text.to_owned(),
            state_if_new,
            at: self.now(),
        };
        self.wait_for(|ticket| Job::Rare(Rare::Publish(publish, ticket)))
            .await
    }

    /// Opens, pauses or closes a study.
    ///
    /// # Errors
    /// `NotFound` for an unknown study.
    pub async fn set_study_state(&self, study: &StudyId, state: StudyState) -> Result<(), Error> {
        let study = study.clone();
        self.wait_for(|ticket| Job::Rare(Rare::SetState(study, state, ticket)))
            .await
    }

    /// Stores fits together, in one commit; those of one study change its page once. Left out are fits that counted
    /// somebody who has withdrawn since.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn save_fits(&self, fits: Vec<NewFit>) -> Result<Vec<FitId>, Error> {
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::SaveFits(fits, now, ticket)))
            .await
    }

    /// Stores a comparison in place of the plan's earlier one.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn save_comparison(&self, comparison: NewComparison) -> Result<(), Error> {
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::SaveComparison(Box::new(comparison), now, ticket)))
            .await
    }

    /// Stores checkpoints, and that a rule for stopping was reached. Says whether it was reached for the first time.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn save_checkpoints(&self, new: NewCheckpoints) -> Result<bool, Error> {
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::SaveCheckpoints(Box::new(new), now, ticket)))
            .await
    }

    /// Removes arrivals of more than a day ago that started nothing. Returns how many.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn forget_arrivals(&self) -> Result<u64, Error> {
        let before = Timestamp(self.now().0 - runs::ARRIVAL_LIFE_MS);
        self.wait_for(|ticket| Job::Rare(Rare::ForgetArrivals(before, ticket)))
            .await
    }

    /// Erases the links of a study's runs and what recruiting platforms told of their people, after its retention date.
    /// Answers stay, and nobody can tell any more whose they are. Runs under way are left alone for a day. Returns how many runs were made anonymous.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn forget_people(&self, study: &StudyId) -> Result<u64, Error> {
        let before = Timestamp(self.now().0 - runs::ARRIVAL_LIFE_MS);
        if !self.is_anybody_known(study, before).await? {
            return Ok(0);
        }
        let study = study.clone();
        self.wait_for(|ticket| Job::Rare(Rare::ForgetPeople(study, before, ticket)))
            .await
    }

    /// What stands for a recruiting id in a study that stores no plain ones.
    pub fn recruiting_id(&self, study: &StudyId, parameter: &str, value: &str) -> String {
        self.shared.secret.recruiting_id(study, parameter, value)
    }

    /// The id that a recruiting platform gave to a participant, where the study stored it as it came: the one among the
    /// link's parameters whose keyed hash is the participant's.
    pub fn plain_platform_id<'a>(
        &self,
        study: &StudyId,
        participant: &'a ParticipantRow,
    ) -> Option<&'a str> {
        let platform = participant.platform.as_deref()?;
        let key = participant.platform_key.as_deref()?;
        let mut values = participant.recruiting.values();
        values
            .find(|value| self.shared.secret.platform_key(study, platform, value) == key)
            .map(String::as_str)
    }

    /// The completion code of a run whose study gives each run its own.
    pub fn completion_code(&self, run: RunId) -> String {
        self.shared.secret.completion_code(run)
    }

    fn now(&self) -> Timestamp {
        self.shared.clock.now()
    }

    /// Marks the current step as shown, once that is on disk.
    async fn show(&self, run: RunId, position: u32) -> Result<(), Error> {
        let show = Show {
            run,
            position,
            at: self.now(),
        };
        self.wait_for(|ticket| Job::Hot(Hot::Show(show, ticket)))
            .await
    }

    /// Marks the current step as shown with some later commit. Where the queue is full the page goes out unmarked:
    /// of an untimed question only the server's own response time is then unknown.
    fn show_later(&self, run: RunId, position: u32) {
        let (ticket, _) = Ticket::new();
        let show = Show {
            run,
            position,
            at: self.now(),
        };
        if let Err(err) = self.enqueue(Job::Hot(Hot::Show(show, ticket))) {
            tracing::debug!(run = run.get(), error = %err, "a page view was not stored");
        }
    }

    async fn wait_for<T>(&self, job: impl FnOnce(Ticket<T>) -> Job) -> Result<T, Error> {
        let (ticket, waiter) = Ticket::new();
        self.enqueue(job(ticket))?;
        waiter
            .await
            .unwrap_or(Err(Error::Unavailable("the server is shutting down")))
    }

    fn enqueue(&self, job: Job) -> Result<(), Error> {
        if self.shared.health.stopped.load(Ordering::Acquire) {
            return Err(Error::Unavailable("the disk failed"));
        }
        self.shared.jobs.try_send(job).map_err(|err| match err {
            mpsc::error::TrySendError::Full(_) => Error::Busy,
            mpsc::error::TrySendError::Closed(_) => {
                Error::Unavailable("the server is shutting down")
            }
        })
    }
}

/// A parameter for `json_each`, or a column that holds JSON.
fn json(value: &impl serde::Serialize) -> String {
    // Only maps with keys other than texts, and failing serialisers, can go wrong; there are none here.
    serde_json::to_string(value).expect("plain data turn into JSON")
}
