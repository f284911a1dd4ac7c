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
//! * `taking_part`, `unused_arrivals`, `draw`: arriving, starting, sending in forms; the steps that a start may lead to,
//! * `studies`, `runs`, `withdraw`, `counts`, `answers`, `bonuses`, `fits`, `comparisons`, `checkpoints`: one file per
//!   group of tables,
//! * `progress`, `quality`, `sources`: what researchers watch while a study runs: steps, times, participants and what is notable
//!   about them,
//! * `exclusions`: who is left out of the analysis;
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
mod draw;
mod effects;
mod error;
mod exclusions;
mod fits;
mod import;
mod job;
mod load;
mod moment;
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
mod taking_part;
mod token;
mod unused_arrivals;
mod withdraw;
mod writer;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use sqlx::Connection;
use sqlx::sqlite::SqlitePool;
use tokio::sync::{Mutex, broadcast, mpsc};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

pub use accounts::{
    Account, AccountName, AccountNameError, ApiToken, AuditEntry, AuditRow, NewAccount,
    NewApiToken, Password, PasswordError, PasswordHash, SESSION_IDLE_MS, SESSION_LIFE_MS, Session,
    TokenState, Verified,
};
pub use answers::{AnswerKey, AnswerRow, EventRow, FormAnswer};
pub use backup::{CopyError, Restored, back_up, restore};
pub use bonuses::{BonusRow, PaidChoice};
pub use check::Disagreement;
pub use checkpoints::{Checkpoint, LookCount, NewCheckpoints, Reached, Stopping};
pub use comparisons::{Comparison, NewComparison};
pub use counts::{CellCount, Pattern, Totals};
pub use doctor::{Finding, Health, examine};
pub use draw::{draw_run, drawn_step};
pub use error::{Error, OpenError};
pub use exclusions::{ExcludedByHand, Exclusion, ExclusionReason, ReasonError};
pub use fits::{Fit, FitKey, FitOutcome, NewFit};
pub use import::{ImportedAnswer, ImportedRun};
pub use job::{AskedProblem, CandidateRun, DrawnStep};
pub use moment::Moment;
pub use names::{
    AccountId, AnalysisSet, AnswerStatus, ApiTokenId, AuditOutcome, EventId, EventKind, FitId,
    FitState, Population, ProblemId, Role, RunId, RunState, Scope, StudyState, UnknownName,
    Verdict, VersionId, VersionNumber,
};
pub use participants::{ParticipantRow, StepAnswer};
pub use progress::{LEFT_AFTER_MS, StepProgress};
pub use quality::{FAST_CHOICE_MS, ParticipantFilter, WatchedParticipant};
pub use rules::Submission;
pub use runs::{ArrivalView, RunView, StepView, StoredCount};
pub use sources::SourceCount;
pub use studies::{StudyRow, StudyVersion};
pub use taking_part::{NewArrival, NewRun, Receipt, Started, Submitted};
pub use token::{Token, TokenError, TokenHash};

use crate::clock::Clock;
use crate::study::{StudyId, Timestamp};
use disk::Lock;
use job::{Job, Rare, Ticket};
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
    /// What is written to the log with each change that is made through this handle.
    entry: Option<Arc<AuditEntry>>,
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
            entry: None,
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
            entry: None,
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

    /// A handle through which each change of studies, accounts or data is written to the log with this entry, in one
    /// transaction: neither stands without the other. A change that is refused leaves no entry.
    pub fn recording(&self, entry: AuditEntry) -> Self {
        Self {
            entry: Some(Arc::new(entry)),
            ..self.clone()
        }
    }

    async fn wait_for<T>(&self, job: impl FnOnce(Ticket<T>) -> Job) -> Result<T, Error> {
        let (ticket, waiter) = Ticket::new();
        let job = match (job(ticket), &self.entry) {
            (Job::Rare(rare), Some(entry)) => {
                let entry = AuditEntry::clone(entry);
                Job::Rare(Rare::Recorded(Box::new(rare), entry, self.now()))
            }
            (job, _) => job,
        };
        self.enqueue(job)?;
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
