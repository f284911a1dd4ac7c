//! One moment of the database, for tables that have to tell the same of the same people.

use sqlx::sqlite::SqliteConnection;
use sqlx::{ConnectOptions, Sqlite, Transaction};

use super::{Error, RunId, Store, open};

/// The database as it is when it is first read through this: nothing that changes afterwards is seen.
///
/// Dropping it ends the reading. While it lasts the journal grows, so that nobody should wait for a slow reader in between.
#[derive(Debug)]
pub struct Moment(Held);

#[derive(Debug)]
enum Held {
    /// One of the connections that everybody reads with.
    Shared(Transaction<'static, Sqlite>),
    /// Its own, since it is held for longer.
    Own(SqliteConnection),
}

impl Store {
    /// A moment that is read for no longer than a page takes.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn moment(&self) -> Result<Moment, Error> {
        Ok(Moment(Held::Shared(self.pool.begin().await?)))
    }

    /// A moment that whole tables are read of, on a connection of its own, so that it keeps no page waiting.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn long_moment(&self) -> Result<Moment, Error> {
        let mut connection = open::reading_settings(self.path()).connect().await?;
        sqlx::query("begin").execute(&mut connection).await?;
        Ok(Moment(Held::Own(connection)))
    }

    /// The last run that began, whatever its study; all that follow have higher numbers.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn last_run(&self) -> Result<RunId, Error> {
        Ok(sqlx::query_scalar("select ifnull(max(id), 0) from run")
            .fetch_one(&self.pool)
            .await?)
    }
}

impl Moment {
    pub(super) fn connection(&mut self) -> &mut SqliteConnection {
        match &mut self.0 {
            Held::Shared(transaction) => transaction,
            Held::Own(connection) => connection,
        }
    }
}
