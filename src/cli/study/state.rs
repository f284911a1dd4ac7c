//! `riskaware study open|pause|close`: whether a study takes people in. A server may run meanwhile.

use std::{io::Write, path::PathBuf};

use anyhow::Context;
use clap::Args;

use crate::{
    cli::audit,
    clock::Clock,
    store::{Error, Store, StudyState},
    study::StudyId,
};

/// Which study, and where.
#[derive(Debug, Clone, Args)]
pub struct Arguments {
    /// The study's id
    id: String,
    /// The database file
    #[arg(long, env = "RISKAWARE_DATABASE", default_value = "riskaware.db")]
    database: PathBuf,
}

/// What is to become of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    Open,
    Pause,
    Close,
}

impl Change {
    fn state(self) -> StudyState {
        match self {
            Self::Open => StudyState::Open,
            Self::Pause => StudyState::Paused,
            Self::Close => StudyState::Closed,
        }
    }

    fn action(self) -> &'static str {
        match self {
            Self::Open => "open study",
            Self::Pause => "pause study",
            Self::Close => "close study",
        }
    }
}

/// Changes the state, and writes that to the log in one transaction with it.
pub(super) async fn run(arguments: Arguments, change: Change) -> anyhow::Result<()> {
    let database = &arguments.database;
    let store = Store::open_beside(database, Clock::start())
        .await
        .with_context(|| format!("opening the database {}", database.display()))?;
    let changed = set_state(&store, &StudyId::from(arguments.id.as_str()), change).await;
    store.close().await;
    writeln!(std::io::stdout().lock(), "{}", changed?)?;
    Ok(())
}

async fn set_state(store: &Store, id: &StudyId, change: Change) -> anyhow::Result<String> {
    let earlier = match store.study(id).await {
        Ok(row) => row.state,
        Err(Error::NotFound(_)) => {
            let known: Vec<String> = store
                .studies()
                .await?
                .iter()
                .map(|row| row.id.to_string())
                .collect();
            anyhow::bail!(
                "no study {id} in this database; it has {}",
                if known.is_empty() {
                    "none".to_owned()
                } else {
                    known.join(", ")
                }
            );
        }
        Err(error) => return Err(error.into()),
    };
    let detail = Some(format!("it was {earlier}"));
    let recording = store.recording(audit::entry(change.action(), Some(id), detail));
    recording.set_study_state(id, change.state()).await?;
    Ok(format!(
        "study {id}: {earlier} before, {} now",
        change.state()
    ))
}
