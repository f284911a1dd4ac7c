//! `riskaware backup` and `riskaware restore`: copies of a database.

use std::path::PathBuf;

use clap::Args;

use super::audit;
use crate::{
    clock::Clock,
    store::{self, Store},
};

/// What to copy to where.
#[derive(Debug, Clone, Args)]
pub struct BackupArguments {
    /// The copy, which must not exist
    file: PathBuf,
    /// The database file; a server may be using it
    #[arg(long, env = "RISKAWARE_DATABASE", default_value = "riskaware.db")]
    database: PathBuf,
}

/// What to restore to where.
#[derive(Debug, Clone, Args)]
pub struct RestoreArguments {
    /// The copy that `riskaware backup` made
    file: PathBuf,
    /// The database file to make, which must not exist
    #[arg(long)]
    database: PathBuf,
}

/// Makes a copy.
///
/// # Errors
/// When the database is missing, the copy exists, or writing fails.
pub async fn back_up(arguments: BackupArguments) -> anyhow::Result<()> {
    let BackupArguments { file, database } = arguments;
    // Before the copy is made, so that it holds the entry too.
    match Store::open_beside(&database, Clock::start()).await {
        Ok(store) => {
            let detail = Some(file.display().to_string());
            audit::record(&store, "back up the database", None, detail).await?;
            store.close().await;
        }
        // The database of an earlier program can be copied before it is upgraded.
        Err(error) => tracing::warn!(%error, "this copy does not stand in the log"),
    }
    store::back_up(&database, &file).await?;
    println!("{} holds a copy of {}", file.display(), database.display());
    Ok(())
}

/// Checks a copy and puts it in a database's place.
///
/// # Errors
/// When the copy is missing or unsound, or there is a database already.
pub async fn restore(arguments: RestoreArguments) -> anyhow::Result<()> {
    let RestoreArguments { file, database } = arguments;
    let restored = store::restore(&file, &database).await?;
    println!("{} is restored from {}", database.display(), file.display());
    let Some(last_event) = restored.last_event else {
        println!("nobody had taken part when that copy was made");
        return Ok(());
    };
    let moment = jiff::Timestamp::from_millisecond(last_event.0)?;
    println!("the last thing that happened in it was at {moment:.0}");
    println!(
        "who withdrew after that, or was erased, is in it again: erase them again, on /studies/STUDY/participants"
    );
    println!(
        "everybody has to log in again; passwords, disabled accounts and tokens are as they were then"
    );
    if restored.tokens > 0 {
        println!(
            "{} API tokens are not revoked in it: look through them with `riskaware token list --database {}`",
            restored.tokens,
            database.display()
        );
    }
    Ok(())
}
