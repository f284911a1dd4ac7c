//! `riskaware user` and `riskaware token`: accounts and API tokens from a terminal, while a server runs or not.

mod password;
pub(super) mod token;
pub(super) mod user;

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use crate::{
    clock::Clock,
    store::{AuditEntry, AuditOutcome, Store},
    study::Timestamp,
};

/// Which database is meant.
#[derive(Debug, Clone, Args)]
pub(super) struct DatabaseArgs {
    /// The database file
    #[arg(
        long,
        global = true,
        env = "RISKAWARE_DATABASE",
        default_value = "riskaware.db"
    )]
    database: PathBuf,
}

impl DatabaseArgs {
    async fn open(&self) -> anyhow::Result<Store> {
        Store::open_beside(&self.database, Clock::start())
            .await
            .with_context(|| format!("opening the database {}", self.database.display()))
    }
}

/// Writes to the log that a command did this.
async fn record(store: &Store, action: &str, detail: String) -> anyhow::Result<()> {
    let entry = AuditEntry {
        actor: "command".to_owned(),
        action: action.to_owned(),
        study: None,
        detail: Some(detail),
        outcome: AuditOutcome::Done,
    };
    store.log(entry).await.context("writing to the log")
}

/// A moment as a date with a time of day, in UTC.
fn shown(at: Timestamp) -> String {
    jiff::Timestamp::from_millisecond(at.0).map_or_else(
        |_| at.0.to_string(),
        |at| at.strftime("%Y-%m-%d %H:%M").to_string(),
    )
}
