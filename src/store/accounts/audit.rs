//! The log of who did what, and whether they were let. Only appended to: triggers refuse everything else.

use sqlx::sqlite::SqliteConnection;

use super::super::{AuditOutcome, Error, Store};
use super::change::AccountChange;
use crate::study::{StudyId, Timestamp};

/// Something that is to be written down.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuditEntry {
    /// An account's or token's name, `command` for a command on this machine, or `nobody`.
    pub actor: String,
    /// What was done or tried, such as `export answers.csv`.
    pub action: String,
    /// On which study.
    pub study: Option<StudyId>,
    /// More about it, never a secret.
    pub detail: Option<String>,
    /// Whether it was let.
    pub outcome: AuditOutcome,
}

/// Something that was written down.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuditRow {
    /// Its place in the log, for paging.
    pub id: i64,
    /// When.
    pub at: Timestamp,
    /// What.
    pub entry: AuditEntry,
}

#[derive(sqlx::FromRow)]
struct Row {
    id: i64,
    at_ms: i64,
    actor: String,
    action: String,
    study_id: Option<String>,
    detail: Option<String>,
    outcome: String,
}

impl Row {
    fn read(self) -> Result<AuditRow, Error> {
        Ok(AuditRow {
            id: self.id,
            at: Timestamp(self.at_ms),
            entry: AuditEntry {
                actor: self.actor,
                action: self.action,
                study: self.study_id.map(StudyId::from),
                detail: self.detail,
                outcome: self
                    .outcome
                    .parse()
                    .map_err(|err| sqlx::Error::Decode(Box::new(err)))?,
            },
        })
    }
}

impl Store {
    /// Writes something down. It is on disk when this returns.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn log(&self, entry: AuditEntry) -> Result<(), Error> {
        self.change_account(AccountChange::Log(entry))
            .await
            .map(drop)
    }

    /// The newest entries of the log before a given one, the newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn audit(&self, before: Option<i64>, limit: u32) -> Result<Vec<AuditRow>, Error> {
        let rows: Vec<Row> = sqlx::query_as(
            r#"
            select id, at_ms, actor, action, study_id, detail, outcome
            from audit
            where id < ?
            order by id desc
            limit ?
            "#,
        )
        .bind(before.unwrap_or(i64::MAX))
        .bind(limit)
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter().map(Row::read).collect()
    }

    /// The newest looks at a study's results that were let, the newest first. Watching how a study goes is none, and one that
    /// was refused is none either: nothing was seen.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn looks_at(&self, study: &StudyId, limit: u32) -> Result<Vec<AuditRow>, Error> {
        let rows: Vec<Row> = sqlx::query_as(
            r#"
            select id, at_ms, actor, action, study_id, detail, outcome
            from audit
            where study_id = ?
            and outcome = 'done'
            and (action like 'look at %' or action = 'predict')
            and action <> 'look at the participants'
            order by id desc
            limit ?
            "#,
        )
        .bind(study.as_str())
        .bind(limit)
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter().map(Row::read).collect()
    }
}

pub(in crate::store) async fn append(
    connection: &mut SqliteConnection,
    entry: &AuditEntry,
    at: Timestamp,
) -> Result<i64, sqlx::Error> {
    sqlx::query_scalar(
        r#"
        insert into audit (at_ms, actor, action, study_id, detail, outcome)
        values (?, ?, ?, ?, ?, ?)
        returning id
        "#,
    )
    .bind(at.0)
    .bind(&entry.actor)
    .bind(&entry.action)
    .bind(entry.study.as_ref().map(StudyId::as_str))
    .bind(&entry.detail)
    .bind(entry.outcome.as_str())
    .fetch_one(connection)
    .await
}
