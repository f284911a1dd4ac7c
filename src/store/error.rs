//! What can go wrong in the store.

use std::path::PathBuf;
use std::sync::Arc;

use super::{CopyError, StudyState};
use crate::study::NotAdmitted;

/// Why the store did not do what it was asked for.
///
/// It can be cloned because one failed commit is told to everybody who waited for it.
#[derive(Debug, Clone, thiserror::Error)]
pub enum Error {
    /// There is no such thing.
    #[error("{0} not found")]
    NotFound(&'static str),
    /// It contradicts what is stored, which stands.
    #[error("{0} exists already with other content")]
    Conflict(&'static str),
    /// Too much is waiting to be written, or another process holds the database: try again shortly.
    #[error("the database is busy, try again in a moment")]
    Busy,
    /// The study takes nobody in at the moment.
    #[error("study {study} is {}", in_words(*.state))]
    Closed {
        /// The study's id.
        study: String,
        /// What it is instead of open.
        state: StudyState,
    },
    /// The study takes people in, but not this one or not now.
    #[error("{0}")]
    NotAdmitted(NotAdmitted),
    /// The rules of a run do not allow it.
    #[error("{0}")]
    Refused(String),
    /// The disk is full or failed, or the store is shut: nothing is stored at the moment.
    #[error("answers cannot be stored at the moment: {0}")]
    Unavailable(&'static str),
    /// The database said no.
    #[error("database: {0}")]
    Database(Arc<sqlx::Error>),
}

impl From<sqlx::Error> for Error {
    fn from(err: sqlx::Error) -> Self {
        match &err {
            sqlx::Error::Database(inner) if inner.is_unique_violation() => {
                Self::Conflict("a row with this key")
            }
            _ => match fault(&err) {
                Fault::Busy => Self::Busy,
                Fault::Full => Self::Unavailable("the disk is full"),
                Fault::Disk => Self::Unavailable("the disk failed"),
                Fault::Statement => Self::Database(Arc::new(err)),
            },
        }
    }
}

/// What an error of SQLite means for the connection that met it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    /// Another process holds the lock.
    Busy,
    /// No space is left; it may come back.
    Full,
    /// Reading or writing failed: the connection is not to be trusted.
    Disk,
    /// This statement with these values.
    Statement,
}

/// Sorts an error of SQLite by its primary result code (<https://sqlite.org/rescode.html>).
pub(super) fn fault(err: &sqlx::Error) -> Fault {
    match err {
        sqlx::Error::Database(inner) => {
            let code: i32 = inner.code().and_then(|code| code.parse().ok()).unwrap_or(0);
            match code & 0xff {
                5 | 6 => Fault::Busy,
                13 => Fault::Full,
                // Read-only, I/O error, corrupt, cannot open, locking protocol, not a database.
                8 | 10 | 11 | 14 | 15 | 26 => Fault::Disk,
                _ => Fault::Statement,
            }
        }
        sqlx::Error::PoolTimedOut => Fault::Busy,
        sqlx::Error::Io(_) | sqlx::Error::PoolClosed | sqlx::Error::WorkerCrashed => Fault::Disk,
        _ => Fault::Statement,
    }
}

fn in_words(state: StudyState) -> &'static str {
    match state {
        StudyState::Draft => "being prepared",
        StudyState::Open | StudyState::Paused | StudyState::Closed => state.as_str(),
    }
}

/// Why a database cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Another server holds it.
    #[error("database {} is in use by another riskaware server; stop that one first, or give another --database", .0.display())]
    InUse(PathBuf),
    /// The file has a second name.
    #[error("database {} has a second name on this disk (a hard link); with two names its log would be written twice, so remove one", .0.display())]
    Linked(PathBuf),
    /// There is no file where one must be.
    #[error("there is no database at {}; `riskaware serve` makes one", .0.display())]
    Missing(PathBuf),
    /// The file holds no tables of this program.
    #[error("{} is not a riskaware database", .0.display())]
    NoSchema(PathBuf),
    /// A later program migrated it.
    #[error(
        "database {} has schema {found} of a later riskaware; this one knows schemas up to {known}. Use the later program, or restore a backup from before its upgrade (it kept one beside the database, named *.before-schema-{found})",
        path.display()
    )]
    LaterSchema {
        /// The database.
        path: PathBuf,
        /// Its schema.
        found: i64,
        /// The last schema of this program.
        known: i64,
    },
    /// It was not migrated yet.
    #[error("database {} has schema {found}, this riskaware needs {known}; start `riskaware serve` on it once, which brings it up to date", path.display())]
    EarlierSchema {
        /// The database.
        path: PathBuf,
        /// Its schema.
        found: i64,
        /// The schema of this program.
        known: i64,
    },
    /// The lock file cannot be written.
    #[error("lock file {}: {source}", path.display())]
    Lock {
        /// The lock file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A network file system, where SQLite's locks and syncs cannot be trusted.
    #[error("database {} is on a network file system ({name}), where answers could be lost; put it on a local disk", path.display())]
    NetworkFileSystem {
        /// The database.
        path: PathBuf,
        /// The file system's name.
        name: &'static str,
    },
    /// Too little space.
    #[error("only {free_mib} MiB of disk are free at {}; at least {least_mib} MiB are needed", path.display())]
    DiskFull {
        /// The folder of the database.
        path: PathBuf,
        /// What is free.
        free_mib: u64,
        /// What is needed.
        least_mib: u64,
    },
    /// The file system cannot be asked.
    #[error("folder {}: {source}", path.display())]
    Folder {
        /// The folder of the database.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A setting that durability rests on did not take.
    #[error("pragma {name} is {found}, not {wanted}; the database would not keep its promises")]
    Pragma {
        /// The setting.
        name: &'static str,
        /// What the connection says.
        found: String,
        /// What it must be.
        wanted: &'static str,
    },
    /// Without a copy nothing is migrated.
    #[error("database {} is not upgraded, because no copy of it can be kept: {source}", path.display())]
    NoCopy {
        /// The database.
        path: PathBuf,
        /// Why not.
        source: Box<CopyError>,
    },
    /// The schema could not be brought up to date.
    #[error("migration: {0}")]
    Migration(#[from] sqlx::migrate::MigrateError),
    /// Rows point at rows that are not there.
    #[error("after the migrations, {broken} rows of table {table} refer to rows that do not exist")]
    BrokenReferences {
        /// The table.
        table: String,
        /// How many of its rows.
        broken: i64,
    },
    /// A migration was made, and the database was not found whole after it.
    #[error(
        "{} was migrated and not found whole afterwards; start a server with it to be told why, or go back to the copy that was kept beside it",
        .0.display()
    )]
    Unchecked(PathBuf),
    /// A migration lost rows.
    #[error(
        "the migrations left {after} of {before} rows in table {table}; go back to the copy that was kept beside the database"
    )]
    RowsLost {
        /// The table.
        table: &'static str,
        /// Rows before.
        before: i64,
        /// Rows after.
        after: i64,
    },
    /// Anything else that SQLite says.
    #[error("database {}: {source}", path.display())]
    Database {
        /// The database.
        path: PathBuf,
        /// What SQLite said.
        source: sqlx::Error,
    },
    /// The operating system gave no random numbers for the server's secret.
    #[error("no random numbers from the operating system: {0}")]
    Random(String),
}
