//! Whether the aggregates of a study may be seen without an account.

use sqlx::sqlite::SqliteConnection;

use super::accounts::AccountChange;
use super::{Error, Store};
use crate::study::StudyId;

impl Store {
    /// Whether the aggregates of a study may be seen without an account. An unknown study is not public.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn is_public(&self, study: &StudyId) -> Result<bool, Error> {
        let is_public: Option<bool> =
            sqlx::query_scalar("select is_public from study where id = ?")
                .bind(study.as_str())
                .fetch_optional(&self.pool)
                .await?;
        Ok(is_public.unwrap_or(false))
    }

    /// Shows the aggregates of a study to everybody, or not any more.
    ///
    /// # Errors
    /// `NotFound` for an unknown study.
    pub async fn set_public(&self, study: &StudyId, is_public: bool) -> Result<(), Error> {
        let change = AccountChange::SetPublic(study.clone(), is_public);
        self.change_account(change).await.map(drop)
    }
}

pub(super) async fn set_public(
    connection: &mut SqliteConnection,
    study: &StudyId,
    is_public: bool,
) -> Result<Result<i64, Error>, sqlx::Error> {
    let changed = sqlx::query("update study set is_public = ? where id = ?")
        .bind(is_public)
        .bind(study.as_str())
        .execute(connection)
        .await?
        .rows_affected();
    Ok(if changed > 0 {
        Ok(1)
    } else {
        Err(Error::NotFound("study"))
    })
}
