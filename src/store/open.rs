//! Opening a database: settings that durability rests on, the schema, the server's secret.

use std::cmp::Ordering;
use std::path::Path;
use std::time::Duration;

use rand::TryRng;
use rand::rngs::SysRng;
use sqlx::migrate::Migrator;
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePool, SqlitePoolOptions,
    SqliteSynchronous,
};
use sqlx::{ConnectOptions, Connection};

use super::disk::with_suffix;
use super::token::Secret;
use super::{OpenError, backup};
use crate::study::Timestamp;

static MIGRATIONS: Migrator = sqlx::migrate!("./migrations");

/// The write-ahead log is cut back to this size when it starts anew.
const JOURNAL_LIMIT_BYTES: &str = "67108864";

/// Pages in the write-ahead log before a commit copies them to the database: 16 MiB, so that few commits pay for it.
const CHECKPOINT_PAGES: &str = "4096";

/// How long another process may hold the write lock before a batch gives up.
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);

/// The settings of every connection.
fn settings(path: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .create_if_missing(true)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        .busy_timeout(BUSY_TIMEOUT)
        .pragma("journal_size_limit", JOURNAL_LIMIT_BYTES)
        .pragma("wal_autocheckpoint", CHECKPOINT_PAGES)
        .pragma("secure_delete", "on")
        .disable_statement_logging()
}

/// The one connection that writes.
pub(super) async fn writing_connection(path: &Path) -> Result<SqliteConnection, OpenError> {
    let mut connection = settings(path).connect().await.map_err(at(path))?;
    require_settings(&mut connection, path).await?;
    Ok(connection)
}

/// The connections that read.
pub(super) async fn reading_pool(path: &Path, connections: u32) -> Result<SqlitePool, OpenError> {
    let pool = SqlitePoolOptions::new()
        .max_connections(connections)
        .acquire_timeout(BUSY_TIMEOUT)
        .connect_with(settings(path).pragma("query_only", "on"))
        .await
        .map_err(at(path))?;
    let mut connection = pool.acquire().await.map_err(at(path))?;
    let query_only: i64 = sqlx::query_scalar("pragma query_only")
        .fetch_one(&mut *connection)
        .await
        .map_err(at(path))?;
    require("query_only", query_only.to_string(), "1")?;
    Ok(pool)
}

/// Reads back what the promise to lose nothing rests on: a pragma that does not take is not an error to SQLite.
async fn require_settings(connection: &mut SqliteConnection, path: &Path) -> Result<(), OpenError> {
    let (journal, synchronous, foreign_keys, secure_delete): (String, i64, i64, i64) =
        sqlx::query_as(
            r#"
        select journal_mode, synchronous, foreign_keys, secure_delete
        from pragma_journal_mode, pragma_synchronous, pragma_foreign_keys, pragma_secure_delete
        "#,
        )
        .fetch_one(connection)
        .await
        .map_err(at(path))?;
    require("journal_mode", journal, "wal")?;
    require("synchronous", synchronous.to_string(), "2")?;
    require("foreign_keys", foreign_keys.to_string(), "1")?;
    require("secure_delete", secure_delete.to_string(), "1")
}

fn require(name: &'static str, found: String, wanted: &'static str) -> Result<(), OpenError> {
    if found == wanted {
        Ok(())
    } else {
        Err(OpenError::Pragma {
            name,
            found,
            wanted,
        })
    }
}

/// A connection that changes nothing, to a database that may be in use or none of ours.
pub(super) async fn reading_connection(path: &Path) -> Result<SqliteConnection, OpenError> {
    reading_settings(path).connect().await.map_err(at(path))
}

/// The settings of a connection that does not even set a pragma that is stored in the file.
pub(super) fn reading_settings(path: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .read_only(true)
        .busy_timeout(BUSY_TIMEOUT)
        .disable_statement_logging()
}

/// The connections of a command that only reads; see [`reading_pool`] for those of a server.
pub(super) async fn read_only_pool(path: &Path, connections: u32) -> Result<SqlitePool, OpenError> {
    SqlitePoolOptions::new()
        .max_connections(connections)
        .acquire_timeout(BUSY_TIMEOUT)
        .connect_with(reading_settings(path))
        .await
        .map_err(at(path))
}

/// The schema of a database beside the one that this program works with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Schema {
    /// No tables of ours.
    None,
    /// To be migrated.
    Older(i64),
    /// The one.
    Current,
    /// Of a newer program.
    Newer(i64),
}

/// The number of the newest schema that this program knows.
pub(super) fn newest_schema() -> i64 {
    MIGRATIONS
        .iter()
        .map(|migration| migration.version)
        .max()
        .unwrap_or(0)
}

/// Which schema a database has.
pub(super) async fn schema(connection: &mut SqliteConnection) -> Result<Schema, sqlx::Error> {
    Ok(match schema_version(connection).await? {
        None => Schema::None,
        Some(version) => match version.cmp(&newest_schema()) {
            Ordering::Less => Schema::Older(version),
            Ordering::Equal => Schema::Current,
            Ordering::Greater => Schema::Newer(version),
        },
    })
}

/// Brings the schema up to date. An existing database is copied before.
///
/// Foreign keys are off meanwhile: inside a transaction they cannot be switched off, and rebuilding a table would
/// then delete or refuse the rows that refer to it. So where something changed, all references and the row counts
/// are checked afterwards.
pub(super) async fn migrate(path: &Path) -> Result<(), OpenError> {
    let mut connection = settings(path)
        .foreign_keys(false)
        .connect()
        .await
        .map_err(at(path))?;
    match schema(&mut connection).await.map_err(at(path))? {
        Schema::None | Schema::Current => {}
        Schema::Newer(found) => {
            return Err(OpenError::LaterSchema {
                path: path.to_owned(),
                found,
                known: newest_schema(),
            });
        }
        Schema::Older(found) => {
            keep_copy(&mut connection, path, found).await?;
            note_rows(&mut connection).await.map_err(at(path))?;
        }
    }
    MIGRATIONS.run(&mut connection).await?;
    require_whole(&mut connection, path).await?;
    connection.close().await.map_err(at(path))
}

/// What must never get lost.
const COUNTED: [&str; 4] = ["run", "step", "event", "answer"];

/// Writes down how many rows there are before a migration. The note stands until the migrated database was found whole:
/// one that was not, or that nobody came to check, is refused at each start and not only at the first.
async fn note_rows(connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    let mut transaction = connection.begin().await?;
    sqlx::raw_sql(
        r#"
        drop table if exists unchecked_migration;
        create table unchecked_migration (
            runs integer not null, steps integer not null, events integer not null, answers integer not null
        ) strict;
        insert into unchecked_migration (runs, steps, events, answers)
        select
            (select count(*) from run), (select count(*) from step),
            (select count(*) from event), (select count(*) from answer);
        "#,
    )
    .execute(&mut *transaction)
    .await?;
    transaction.commit().await
}

/// Whether a migration was made and not found good.
async fn is_unchecked(connection: &mut SqliteConnection) -> Result<bool, sqlx::Error> {
    sqlx::query_scalar(
        "select exists (select 1 from sqlite_schema where type = 'table' and name = 'unchecked_migration')",
    )
    .fetch_one(connection)
    .await
}

/// Checks a migrated database against the note of [`note_rows`], and removes the note from one that is whole.
async fn require_whole(connection: &mut SqliteConnection, path: &Path) -> Result<(), OpenError> {
    if !is_unchecked(connection).await.map_err(at(path))? {
        return Ok(());
    }
    let before: Option<(i64, i64, i64, i64)> =
        sqlx::query_as("select runs, steps, events, answers from unchecked_migration")
            .fetch_optional(&mut *connection)
            .await
            .map_err(at(path))?;
    let (runs, steps, events, answers) = before.unwrap_or_default();
    let after = rows(connection).await.map_err(at(path))?;
    for ((table, before), after) in COUNTED
        .into_iter()
        .zip([runs, steps, events, answers])
        .zip(after)
    {
        if after < before {
            return Err(OpenError::RowsLost {
                table,
                before,
                after,
            });
        }
    }
    require_whole_references(connection, path).await?;
    sqlx::query("drop table unchecked_migration")
        .execute(connection)
        .await
        .map_err(at(path))?;
    Ok(())
}

/// Refuses a path where no file is: a command that writes must not make an empty database.
pub(super) fn require_file(path: &Path) -> Result<(), OpenError> {
    if path.is_file() {
        Ok(())
    } else {
        Err(OpenError::Missing(path.to_owned()))
    }
}

/// Refuses a database whose schema is not this program's.
pub(super) async fn require_schema(path: &Path) -> Result<(), OpenError> {
    let mut connection = reading_connection(path).await?;
    let found = schema(&mut connection).await.map_err(at(path))?;
    let is_unchecked = is_unchecked(&mut connection).await.map_err(at(path))?;
    connection.close().await.map_err(at(path))?;
    if is_unchecked && found == Schema::Current {
        return Err(OpenError::Unchecked(path.to_owned()));
    }
    let known = newest_schema();
    match found {
        Schema::Current => Ok(()),
        Schema::None => Err(OpenError::NoSchema(path.to_owned())),
        Schema::Newer(found) => Err(OpenError::LaterSchema {
            path: path.to_owned(),
            found,
            known,
        }),
        Schema::Older(found) => Err(OpenError::EarlierSchema {
            path: path.to_owned(),
            found,
            known,
        }),
    }
}

/// Copies a database beside itself before it is migrated. An upgrade that was interrupted left a copy of its own.
async fn keep_copy(
    connection: &mut SqliteConnection,
    path: &Path,
    found: i64,
) -> Result<(), OpenError> {
    let name = format!(".before-schema-{}", newest_schema());
    let mut copy = with_suffix(path, &name);
    let mut attempt = 1;
    while copy.exists() {
        attempt += 1;
        copy = with_suffix(path, &format!("{name}-{attempt}"));
    }
    backup::copy_to(connection, path, &copy)
        .await
        .map_err(|source| OpenError::NoCopy {
            path: path.to_owned(),
            source: Box::new(source),
        })?;
    tracing::warn!(
        copy = %copy.display(),
        "the database has schema {found} and is upgraded to schema {}; a copy of it as it was is kept",
        newest_schema()
    );
    Ok(())
}

/// The last migration that was applied; none in a new database.
async fn schema_version(connection: &mut SqliteConnection) -> Result<Option<i64>, sqlx::Error> {
    let is_new: bool = sqlx::query_scalar(
        "select not exists (select 1 from sqlite_schema where type = 'table' and name = '_sqlx_migrations')",
    )
    .fetch_one(&mut *connection)
    .await?;
    if is_new {
        return Ok(None);
    }
    sqlx::query_scalar("select max(version) from _sqlx_migrations")
        .fetch_one(connection)
        .await
}

/// How many rows there are of what must never get lost: runs, events, answers.
async fn rows(connection: &mut SqliteConnection) -> Result<[i64; 4], sqlx::Error> {
    let (runs, steps, events, answers) = sqlx::query_as(
        r#"
        select
            (select count(*) from run), (select count(*) from step),
            (select count(*) from event), (select count(*) from answer)
        "#,
    )
    .fetch_one(connection)
    .await?;
    Ok([runs, steps, events, answers])
}

async fn require_whole_references(
    connection: &mut SqliteConnection,
    path: &Path,
) -> Result<(), OpenError> {
    let broken: Option<(String, i64)> = sqlx::query_as(
        r#"
        select "table", count(*)
        from pragma_foreign_key_check
        group by "table"
        limit 1
        "#,
    )
    .fetch_optional(connection)
    .await
    .map_err(at(path))?;
    match broken {
        Some((table, broken)) => Err(OpenError::BrokenReferences { table, broken }),
        None => Ok(()),
    }
}

/// The key of this server's hashes, made at the first start.
pub(super) async fn secret(
    connection: &mut SqliteConnection,
    path: &Path,
    now: Timestamp,
) -> Result<Secret, OpenError> {
    let mut bytes = [0_u8; 32];
    SysRng
        .try_fill_bytes(&mut bytes)
        .map_err(|err| OpenError::Random(err.to_string()))?;
    sqlx::query("insert or ignore into server (id, secret, created_at_ms) values (1, ?, ?)")
        .bind(bytes.as_slice())
        .bind(now.0)
        .execute(&mut *connection)
        .await
        .map_err(at(path))?;
    stored_secret(connection, path).await
}

/// The key of a database's hashes.
pub(super) async fn stored_secret(
    connection: &mut SqliteConnection,
    path: &Path,
) -> Result<Secret, OpenError> {
    let stored: Vec<u8> = sqlx::query_scalar("select secret from server")
        .fetch_one(connection)
        .await
        .map_err(at(path))?;
    let length = stored.len();
    let bytes = stored.try_into().map_err(|_| OpenError::Pragma {
        name: "secret's length",
        found: length.to_string(),
        wanted: "32",
    })?;
    Ok(Secret::new(bytes))
}

pub(super) fn at(path: &Path) -> impl Fn(sqlx::Error) -> OpenError + '_ {
    |source| OpenError::Database {
        path: path.to_owned(),
        source,
    }
}
