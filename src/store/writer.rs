//! The task that owns the writing connection: takes what waits, commits it together, then answers.
//!
//! No delay is added to make batches bigger: one forms while the commit before it reaches the disk.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;
use tokio::sync::{broadcast, mpsc};
use tokio_util::sync::CancellationToken;

use super::error::{Fault, fault};
use super::job::{Job, Rare};
use super::{
    Change, Error, accounts, batch, checkpoints, comparisons, exclusions, fits, import, open,
    studies, unused_arrivals, withdraw,
};

/// How many jobs one commit takes at most.
pub(super) const BATCH: usize = 512;

/// After so long without a job the write-ahead log is copied into the database.
const IDLE: Duration = Duration::from_secs(2);

/// What others can see of the writer.
#[derive(Debug, Clone, Default)]
pub(super) struct Health {
    /// Set while nothing can be stored.
    pub(super) stopped: Arc<AtomicBool>,
    /// Cancelled when the disk has failed for good.
    pub(super) failed: CancellationToken,
    /// Set while the last commit is one that did not reach the disk.
    pub(super) commit_failed: Arc<AtomicBool>,
    pub(super) commits: Arc<AtomicU64>,
}

pub(super) struct Writer {
    path: PathBuf,
    connection: SqliteConnection,
    changes: broadcast::Sender<Change>,
    health: Health,
    /// Whether the connection was opened anew and has not committed since: the next failure is final.
    is_second_chance: bool,
    /// What the write-ahead log holds that the database file does not.
    log: Log,
    /// When an erasure is next tried to be carried through to the log.
    next_truncation: Instant,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Log {
    Copied,
    Written,
    /// Erased rows still stand in it, so that it is to be cut to nothing.
    Erased,
}

/// What a commit did beside what its jobs are told.
#[derive(Debug, Default)]
pub(super) struct Written {
    pub(super) changes: Vec<Change>,
    /// Whether something about a person was removed, so that the log is to be emptied.
    pub(super) erased: bool,
}

impl Writer {
    pub(super) fn new(
        path: PathBuf,
        connection: SqliteConnection,
        changes: broadcast::Sender<Change>,
        health: Health,
    ) -> Self {
        Self {
            path,
            connection,
            changes,
            health,
            is_second_chance: false,
            // A server that ended badly may have left erased rows in it.
            log: Log::Erased,
            next_truncation: Instant::now(),
        }
    }

    /// Runs until the queue is closed and empty.
    pub(super) async fn run(mut self, mut queue: mpsc::Receiver<Job>, close: CancellationToken) {
        loop {
            let mut jobs = Vec::new();
            let taken = tokio::select! {
                taken = queue.recv_many(&mut jobs, BATCH) => taken,
                () = tokio::time::sleep(IDLE), if self.log != Log::Copied => {
                    self.checkpoint().await;
                    continue;
                }
                // What is queued already is still written: after this, receiving ends once the queue is empty.
                () = close.cancelled(), if !queue.is_closed() => {
                    queue.close();
                    continue;
                }
            };
            if taken == 0 {
                break;
            }
            self.write(jobs).await;
            // Under load the writer is never idle, and what was erased must still leave the log.
            if self.log == Log::Erased && self.next_truncation <= Instant::now() {
                self.checkpoint().await;
            }
        }
        self.checkpoint().await;
        if let Err(err) = self.connection.close().await {
            tracing::error!(error = %err, "the database did not close well");
        }
    }

    /// Commits jobs together; where one of them is bad, each alone.
    async fn write(&mut self, jobs: Vec<Job>) {
        if jobs.len() > 1 {
            let Some(jobs) = self.write_together(jobs).await else {
                return;
            };
            tracing::warn!(
                jobs = jobs.len(),
                "a batch was rolled back and is written job by job"
            );
            for job in jobs {
                self.write_alone(job).await;
            }
        } else {
            for job in jobs {
                self.write_alone(job).await;
            }
        }
    }

    async fn write_alone(&mut self, job: Job) {
        if let Some(rejected) = self.write_together(vec![job]).await {
            for job in rejected {
                job.fail(&Error::Unavailable("the job was not carried out"));
            }
        }
    }

    /// Commits jobs together and answers them. Gives them back if the batch was rolled back for what one of them
    /// says; a single such job is answered with its error.
    async fn write_together(&mut self, mut jobs: Vec<Job>) -> Option<Vec<Job>> {
        if self.health.failed.is_cancelled() {
            fail_all(jobs, &Error::Unavailable("the disk failed"));
            return None;
        }
        match self.commit(&mut jobs).await {
            Ok(Written { changes, erased }) => {
                self.is_second_chance = false;
                self.health.commit_failed.store(false, Ordering::Release);
                self.health.commits.fetch_add(1, Ordering::Relaxed);
                if erased && self.log != Log::Erased {
                    self.next_truncation = Instant::now() + IDLE;
                }
                self.log = self
                    .log
                    .max(if erased { Log::Erased } else { Log::Written });
                jobs.into_iter().for_each(Job::deliver);
                for change in changes {
                    // Nobody listens: nobody has a results page open.
                    drop(self.changes.send(change));
                }
                None
            }
            Err(err) => match fault(&err) {
                Fault::Statement if jobs.len() > 1 => Some(jobs),
                Fault::Statement => {
                    tracing::error!(error = %err, "a job could not be written");
                    fail_all(jobs, &err.into());
                    None
                }
                Fault::Busy | Fault::Full => {
                    self.health.commit_failed.store(true, Ordering::Release);
                    tracing::error!(error = %err, jobs = jobs.len(), "a batch could not be written");
                    fail_all(jobs, &err.into());
                    None
                }
                Fault::Disk => {
                    tracing::error!(error = %err, jobs = jobs.len(), "the disk failed");
                    self.health.commit_failed.store(true, Ordering::Release);
                    self.health.stopped.store(true, Ordering::Release);
                    fail_all(jobs, &err.into());
                    self.reopen().await;
                    None
                }
            },
        }
    }

    /// One transaction: immediate, because it reads the state of the runs before it writes. Dropped before its
    /// commit it rolls back.
    async fn commit(&mut self, jobs: &mut [Job]) -> Result<Written, sqlx::Error> {
        let mut transaction = self.connection.begin_with("begin immediate").await?;
        let mut written = Written::default();
        // Rare jobs stand between groups of frequent ones, in the order in which they came.
        for group in jobs.chunk_by_mut(|one, next| one.is_hot() && next.is_hot()) {
            match group {
                [Job::Rare(rare)] => {
                    written.erased |= rare.erases();
                    let changes = write_rare(&mut transaction, rare).await?;
                    written.changes.extend(changes);
                }
                frequent => {
                    let done = batch::write(&mut transaction, frequent).await?;
                    written.erased |= done.erased;
                    written.changes.extend(done.changes);
                }
            }
        }
        transaction.commit().await?;
        Ok(written)
    }

    /// After a disk error the connection is not trusted any more: once, a new one is tried.
    async fn reopen(&mut self) {
        if self.is_second_chance {
            tracing::error!("the disk failed again: the server has to end");
            self.health.failed.cancel();
            return;
        }
        match open::writing_connection(&self.path).await {
            Ok(connection) => {
                self.connection = connection;
                self.is_second_chance = true;
                self.health.stopped.store(false, Ordering::Release);
                tracing::warn!("the database was opened anew after a disk error");
            }
            Err(err) => {
                tracing::error!(error = %err, "the database cannot be opened anew: the server has to end");
                self.health.failed.cancel();
            }
        }
    }

    /// Copies the log into the database. After an erasure the log is also emptied, which readers can delay: then the
    /// next attempt follows [`IDLE`] later.
    async fn checkpoint(&mut self) {
        let outcome = match self.log {
            Log::Copied => return,
            Log::Written => self.copy_log("passive").await.map(|_| Log::Copied),
            Log::Erased => self
                .empty_log()
                .await
                .map(|is_busy| if is_busy { Log::Erased } else { Log::Copied }),
        };
        self.next_truncation = Instant::now() + IDLE;
        match outcome {
            Ok(log) => self.log = log,
            Err(err) => tracing::warn!(error = %err, "the write-ahead log was not copied"),
        }
    }

    /// Without waiting for readers, because whoever answers waits meanwhile. Says whether some are in the way.
    async fn empty_log(&mut self) -> Result<bool, sqlx::Error> {
        let usual: i64 = sqlx::query_scalar("pragma busy_timeout")
            .fetch_one(&mut self.connection)
            .await?;
        sqlx::query("pragma busy_timeout = 100")
            .execute(&mut self.connection)
            .await?;
        let is_busy = self.copy_log("truncate").await;
        sqlx::query(sqlx::AssertSqlSafe(format!(
            "pragma busy_timeout = {usual}"
        )))
        .execute(&mut self.connection)
        .await?;
        is_busy
    }

    /// Says whether somebody was in the way: a busy checkpoint is a row, not an error.
    async fn copy_log(&mut self, mode: &'static str) -> Result<bool, sqlx::Error> {
        let pragma = sqlx::AssertSqlSafe(format!("pragma wal_checkpoint({mode})"));
        let (is_busy, _, _): (bool, i64, i64) = sqlx::query_as(pragma)
            .fetch_one(&mut self.connection)
            .await?;
        Ok(is_busy)
    }
}

fn fail_all(jobs: Vec<Job>, err: &Error) {
    for job in jobs {
        job.fail(err);
    }
}

async fn write_rare(
    connection: &mut SqliteConnection,
    rare: &mut Rare,
) -> Result<Vec<Change>, sqlx::Error> {
    match rare {
        Rare::Publish(publish, ticket) => {
            let (version, changes) = studies::publish(connection, publish).await?;
            ticket.hold(Ok(version));
            Ok(changes)
        }
        Rare::SetState(study, state, ticket) => {
            let changes = studies::set_state(connection, study, *state).await?;
            let is_known = !changes.is_empty();
            ticket.hold(if is_known {
                Ok(())
            } else {
                Err(Error::NotFound("study"))
            });
            Ok(changes)
        }
        Rare::SetEnds(study, ends_at, ticket) => {
            ticket.hold(Ok(studies::set_ends(connection, study, *ends_at).await?));
            Ok(Vec::new())
        }
        Rare::Withdraw(run, at, ticket) => {
            let changes = withdraw::erase(connection, *run, *at).await?;
            ticket.hold(Ok(()));
            Ok(changes)
        }
        Rare::Exclude(change, at, ticket) => {
            let (done, changes) = exclusions::change(connection, change, *at).await?;
            ticket.hold(done);
            Ok(changes)
        }
        Rare::SaveFits(fits, at, ticket) => {
            let (ids, changes) = fits::save(connection, fits, *at).await?;
            ticket.hold(Ok(ids));
            Ok(changes)
        }
        Rare::SaveComparison(comparison, at, ticket) => {
            let changes = comparisons::save(connection, comparison, *at).await?;
            ticket.hold(Ok(()));
            Ok(changes)
        }
        Rare::SaveCheckpoints(new, at, ticket) => {
            let (is_first, changes) = checkpoints::save(connection, new, *at).await?;
            ticket.hold(Ok(is_first));
            Ok(changes)
        }
        Rare::ForgetPeople(study, versions, before, ticket) => {
            let forgotten = withdraw::forget_people(connection, study, versions, *before).await?;
            ticket.hold(Ok(forgotten));
            Ok(Vec::new())
        }
        Rare::ForgetArrivals(before, ticket) => {
            ticket.hold(Ok(unused_arrivals::forget(connection, *before).await?));
            Ok(Vec::new())
        }
        Rare::Account(change, at, ticket) => {
            ticket.hold(accounts::write(connection, change, *at).await?);
            Ok(Vec::new())
        }
        Rare::Recorded(recorded, entry, at) => {
            let changes = Box::pin(write_rare(connection, recorded)).await?;
            if recorded.is_done() {
                accounts::append(connection, entry, *at).await?;
            }
            Ok(changes)
        }
        Rare::Import(import, ticket) => {
            let (imported, changes) = import::write(connection, import).await?;
            ticket.hold(imported);
            Ok(changes)
        }
    }
}
