//! Whether a database is well: everything that a server checks at its start, and what only a look at all rows tells.

use std::os::unix::fs::MetadataExt;
use std::path::Path;

use serde::Serialize;
use sqlx::Connection;

use super::disk::{self, with_suffix};
use super::open::{self, Schema};
use super::{Disagreement, Error, OpenError, Store};
use crate::clock::Clock;

/// What one check found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub check: &'static str,
    /// How it is.
    pub health: Health,
    /// What was found.
    pub found: String,
    /// What to do; empty where nothing is to be done.
    pub advice: String,
}

/// How something is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Health {
    /// As it should be.
    Sound,
    /// Worth knowing, and nothing is lost.
    Note,
    /// Something has to be done.
    Wrong,
}

impl Finding {
    /// A finding with nothing to do.
    pub fn sound(check: &'static str, found: impl Into<String>) -> Self {
        Self {
            check,
            health: Health::Sound,
            found: found.into(),
            advice: String::new(),
        }
    }

    /// A finding that asks for nothing at once.
    pub fn note(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self {
            check,
            health: Health::Note,
            found: found.into(),
            advice: advice.into(),
        }
    }

    /// A finding that asks for something.
    pub fn wrong(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self {
            check,
            health: Health::Wrong,
            found: found.into(),
            advice: advice.into(),
        }
    }
}

const RESTORE: &str =
    "keep this file as it is, and restore the latest backup to a new one (riskaware restore)";

/// Examines a database, also while a server uses it. Nothing is changed.
///
/// # Errors
/// When there is no such file.
pub async fn examine(database: &Path, clock: Clock) -> Result<Vec<Finding>, OpenError> {
    open::require_file(database)?;
    let mut findings = vec![place(database), name(database)];
    // A damaged file can fail at any question that it is asked.
    if let Err(error) = look_inside(database, clock, &mut findings).await {
        findings.push(Finding::wrong(
            "reading",
            format!("it cannot be read through: {}", with_cause(&error)),
            RESTORE,
        ));
    }
    Ok(findings)
}

/// An error with what SQLite said.
fn with_cause(error: &OpenError) -> String {
    let cause = std::error::Error::source(error).map(ToString::to_string);
    cause.map_or_else(|| error.to_string(), |cause| format!("{error}: {cause}"))
}

async fn look_inside(
    database: &Path,
    clock: Clock,
    findings: &mut Vec<Finding>,
) -> Result<(), OpenError> {
    let mut connection = open::reading_connection(database).await?;
    let failed = open::at(database);
    let schema = open::schema(&mut connection).await.map_err(&failed)?;
    findings.push(schema_finding(schema));
    let journal: String = sqlx::query_scalar("pragma journal_mode")
        .fetch_one(&mut connection)
        .await
        .map_err(&failed)?;
    findings.push(if journal == "wal" {
        let bytes = std::fs::metadata(with_suffix(database, "-wal")).map_or(0, |log| log.len());
        Finding::sound("journal", format!("wal, its log has {} KiB", bytes >> 10))
    } else {
        Finding::note(
            "journal",
            format!("{journal}, as in a backup"),
            "nothing; the server sets wal when it starts",
        )
    });
    let damage: Vec<String> = sqlx::query_scalar("pragma integrity_check(20)")
        .fetch_all(&mut connection)
        .await
        .map_err(&failed)?;
    findings.push(if damage == ["ok"] {
        Finding::sound("integrity", "no damaged page or index")
    } else {
        Finding::wrong("integrity", damage.join("; "), RESTORE)
    });
    let broken: Vec<(String, i64)> = sqlx::query_as(
        r#"select "table", count(*) from pragma_foreign_key_check group by "table" order by 1"#,
    )
    .fetch_all(&mut connection)
    .await
    .map_err(&failed)?;
    findings.push(if broken.is_empty() {
        Finding::sound("references", "every row that is referred to is there")
    } else {
        let listed: Vec<String> = broken
            .iter()
            .map(|(table, rows)| format!("{rows} rows of table {table}"))
            .collect();
        Finding::wrong(
            "references",
            format!("{} refer to rows that are missing", listed.join(", ")),
            RESTORE,
        )
    });
    connection.close().await.map_err(&failed)?;
    if schema == Schema::Current {
        let store = Store::open_to_read(database, clock).await?;
        findings.push(agreement(
            "answers",
            "every answer is what its run's events give",
            store.check_answers().await,
        ));
        findings.push(agreement(
            "counters",
            "every counter is the count of its answers",
            store.check_counters().await,
        ));
        store.close().await;
    }
    Ok(())
}

fn place(database: &Path) -> Finding {
    match disk::require_trustworthy(database) {
        Ok(free_mib) => Finding::sound("disk", format!("a local disk with {free_mib} MiB free")),
        Err(error) => Finding::wrong(
            "disk",
            error.to_string(),
            "move the database to a local disk with space left, while no server runs",
        ),
    }
}

fn name(database: &Path) -> Finding {
    match std::fs::metadata(database).map(|file| file.nlink()) {
        Ok(1) => Finding::sound("name", "the file has one name"),
        Ok(names) => Finding::wrong(
            "name",
            format!("the file has {names} names (hard links)"),
            "remove all but one while no server runs",
        ),
        Err(error) => Finding::wrong("name", error.to_string(), "look at the file's folder"),
    }
}

fn schema_finding(schema: Schema) -> Finding {
    let known = open::newest_schema();
    match schema {
        Schema::Current => Finding::sound("schema", format!("{known}, that of this program")),
        Schema::Older(found) => Finding::note(
            "schema",
            format!("{found}, and this program works with {known}"),
            "start the server once; it keeps a copy and upgrades",
        ),
        Schema::Newer(found) => Finding::wrong(
            "schema",
            format!("{found}, and this program knows schemas up to {known}"),
            "use the riskaware that wrote it, or restore a backup from before its upgrade",
        ),
        Schema::None => Finding::wrong(
            "schema",
            "no tables of riskaware",
            "check the path of --database",
        ),
    }
}

fn agreement(check: &'static str, sound: &str, found: Result<Vec<Disagreement>, Error>) -> Finding {
    match found {
        Ok(disagreements) if disagreements.is_empty() => Finding::sound(check, sound),
        Ok(disagreements) => {
            let first = &disagreements[0];
            Finding::wrong(
                check,
                // Not what was expected and found: that is what people answered, and this text is passed on.
                format!(
                    "{} disagreements; the first: {}",
                    disagreements.len(),
                    first.place
                ),
                "make a backup, report it as a bug with this text, and do not analyse these answers until it is settled",
            )
        }
        Err(error) => Finding::wrong(check, error.to_string(), RESTORE),
    }
}
