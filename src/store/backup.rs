//! Copies of a database, and what makes one trustworthy.
//!
//! A copy is made by SQLite in one read transaction (`vacuum into`), so it is consistent while a server writes. It gets
//! its name only once it is whole and on disk.

use std::fs::File;
use std::path::{Path, PathBuf};

use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;

use super::disk::{Lock, create_private, with_suffix};
use super::open::{self, Schema};
use super::{OpenError, Store};

/// Why a copy was not made.
#[derive(Debug, thiserror::Error)]
pub enum CopyError {
    /// Nothing is overwritten.
    #[error("{} exists already and is not overwritten; give another name, or move it away", .0.display())]
    Exists(PathBuf),
    /// There is nothing to copy.
    #[error("{} does not exist", .0.display())]
    Missing(PathBuf),
    /// The copy cannot be written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is no sound database of this program.
    #[error("{} is not restored: {}", path.display(), problems.join("; "))]
    Unsound {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problems: Vec<String>,
    },
    /// The database cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
}

/// Copies a database, which a server may be using, to a new file.
///
/// # Errors
/// When the database does not exist or is none of this program, the copy's name is taken, or reading or writing fails.
pub async fn back_up(database: &Path, copy: &Path) -> Result<(), CopyError> {
    if !database.exists() {
        return Err(CopyError::Missing(database.to_owned()));
    }
    let mut connection = open::reading_connection(database).await?;
    let schema = open::schema(&mut connection)
        .await
        .map_err(open::at(database))?;
    if schema == Schema::None {
        return Err(OpenError::NoSchema(database.to_owned()).into());
    }
    let written = copy_to(&mut connection, database, copy).await;
    connection.close().await.map_err(open::at(database))?;
    written
}

/// Copies a backup to where a server is to find it, after checking it.
///
/// # Errors
/// When the backup is missing or unsound, when there is a database at the target or a server holds it.
pub async fn restore(backup: &Path, database: &Path) -> Result<(), CopyError> {
    if !backup.exists() {
        return Err(CopyError::Missing(backup.to_owned()));
    }
    // Before the lock too, which would leave a file beside what is not this command's.
    if let Err(taken) = require_free(database) {
        if with_suffix(database, ".lock").exists() {
            Lock::take(database)?;
        }
        return Err(taken);
    }
    let mut connection = open::reading_connection(backup).await?;
    let problems = soundness(&mut connection).await.map_err(open::at(backup))?;
    if !problems.is_empty() {
        return Err(CopyError::Unsound {
            path: backup.to_owned(),
            problems,
        });
    }
    let _lock = Lock::take(database)?;
    require_free(database)?;
    let written = copy_to(&mut connection, backup, database).await;
    connection.close().await.map_err(open::at(backup))?;
    written
}

fn require_free(database: &Path) -> Result<(), CopyError> {
    // A log without its database would be replayed into the restored one.
    for path in [
        database.to_owned(),
        with_suffix(database, "-wal"),
        with_suffix(database, "-journal"),
    ] {
        if path.exists() {
            return Err(CopyError::Exists(path));
        }
    }
    Ok(())
}

impl Store {
    /// Copies this database to a new file, as [`back_up`] does.
    ///
    /// # Errors
    /// As [`back_up`].
    pub async fn back_up(&self, copy: &Path) -> Result<(), CopyError> {
        back_up(self.path(), copy).await
    }
}

/// What is wrong with a database file, in words; nothing in a sound one.
///
/// # Errors
/// When it cannot be read at all.
pub(super) async fn soundness(
    connection: &mut SqliteConnection,
) -> Result<Vec<String>, sqlx::Error> {
    let damage: Vec<String> = sqlx::query_scalar("pragma integrity_check(20)")
        .fetch_all(&mut *connection)
        .await?;
    let mut problems: Vec<String> = damage.into_iter().filter(|line| line != "ok").collect();
    match open::schema(connection).await? {
        Schema::Current | Schema::Older(_) => {}
        Schema::None => problems.push("it holds no tables of riskaware".to_owned()),
        Schema::Newer(found) => problems.push(format!(
            "its schema is {found}, and this program knows schemas up to {}",
            open::newest_schema()
        )),
    }
    let broken: Vec<(String, i64)> = sqlx::query_as(
        r#"select "table", count(*) from pragma_foreign_key_check group by "table" order by 1"#,
    )
    .fetch_all(connection)
    .await?;
    problems.extend(broken.into_iter().map(|(table, rows)| {
        format!("{rows} rows of table {table} refer to rows that do not exist")
    }));
    Ok(problems)
}

/// Writes a copy beside its final name, syncs it, and gives it the name.
pub(super) async fn copy_to(
    connection: &mut SqliteConnection,
    database: &Path,
    copy: &Path,
) -> Result<(), CopyError> {
    let failed = |source| CopyError::File {
        path: copy.to_owned(),
        source,
    };
    if copy.exists() {
        return Err(CopyError::Exists(copy.to_owned()));
    }
    let partial = with_suffix(copy, ".partial");
    // What an attempt left that was interrupted.
    match std::fs::remove_file(&partial) {
        Err(err) if err.kind() != std::io::ErrorKind::NotFound => return Err(failed(err)),
        Err(_) | Ok(()) => {}
    }
    let name = partial.to_str().ok_or_else(|| {
        failed(std::io::Error::other(
            "the name is no UTF-8, which SQLite needs",
        ))
    })?;
    // SQLite fills an empty file as it would make a new one, and would let others read that one while it is written.
    create_private(&partial)?;
    let written = sqlx::query("vacuum into ?")
        .bind(name)
        .execute(connection)
        .await;
    if let Err(err) = written {
        drop(std::fs::remove_file(&partial));
        return Err(open::at(database)(err).into());
    }
    let finish = || -> std::io::Result<()> {
        // Whoever may not read the database may not read its copy.
        std::fs::set_permissions(&partial, std::fs::metadata(database)?.permissions())?;
        File::open(&partial)?.sync_all()?;
        std::fs::rename(&partial, copy)?;
        let folder = match copy.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            Some(_) | None => Path::new("."),
        };
        File::open(folder)?.sync_all()
    };
    finish().map_err(failed)
}
