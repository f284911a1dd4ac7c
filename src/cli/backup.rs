//! `riskaware backup` and `riskaware restore`: copies of a database.

use std::path::PathBuf;

use clap::Args;

use crate::store;

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
    store::restore(&file, &database).await?;
    println!("{} is restored from {}", database.display(), file.display());
    Ok(())
}
