//! `riskaware user` and `riskaware token`: accounts and API tokens from a terminal, while a server runs or not.

mod password;
pub(super) mod token;
pub(super) mod user;

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use super::audit;
use crate::{clock::Clock, store::Store, study::Timestamp};

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

/// A handle that writes to the log that a command did this, in one transaction with the change.
fn recording(store: &Store, action: &str, detail: String) -> Store {
    store.recording(audit::entry(action, None, Some(detail)))
}

/// A moment as a date with a time of day, in UTC.
fn shown(at: Timestamp) -> String {
    jiff::Timestamp::from_millisecond(at.0).map_or_else(
        |_| at.0.to_string(),
        |at| at.strftime("%Y-%m-%d %H:%M").to_string(),
    )
}
