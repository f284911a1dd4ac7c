//! `riskaware study exclude|include`: whether a participant's answers are analysed. A server may run meanwhile.

use std::{io::Write, path::PathBuf};

use anyhow::Context;
use clap::Args;

use crate::{
    cli::audit,
    clock::Clock,
    store::{ExclusionReason, Population, RunId, Store},
    study::StudyId,
};

/// Who is left out, and why.
#[derive(Debug, Clone, Args)]
pub struct ExcludeArguments {
    #[command(flatten)]
    participant: Participant,
    /// Why, in one line; it is written to the log, so name nobody in it
    #[arg(long)]
    reason: String,
}

/// Who is taken in again.
#[derive(Debug, Clone, Args)]
pub struct IncludeArguments {
    #[command(flatten)]
    participant: Participant,
}

#[derive(Debug, Clone, Args)]
struct Participant {
    /// The study's id
    id: String,
    /// The participant's number, as exports have it
    participant: i64,
    /// The database file
    #[arg(long, env = "RISKAWARE_DATABASE", default_value = "riskaware.db")]
    database: PathBuf,
}

/// Leaves a participant out of the analysis, and writes that to the log in one transaction with it.
pub(super) async fn exclude(arguments: ExcludeArguments) -> anyhow::Result<()> {
    let reason = ExclusionReason::new(&arguments.reason).context("--reason")?;
    change(&arguments.participant, Some(reason)).await
}

/// Takes a participant in again, and writes that to the log in one transaction with it.
pub(super) async fn include(arguments: IncludeArguments) -> anyhow::Result<()> {
    change(&arguments.participant, None).await
}

async fn change(participant: &Participant, because: Option<ExclusionReason>) -> anyhow::Result<()> {
    let database = &participant.database;
    let store = Store::open_beside(database, Clock::start())
        .await
        .with_context(|| format!("opening the database {}", database.display()))?;
    let done = change_in(&store, participant, because).await;
    store.close().await;
    writeln!(std::io::stdout().lock(), "{}", done?)?;
    Ok(())
}

async fn change_in(
    store: &Store,
    participant: &Participant,
    because: Option<ExclusionReason>,
) -> anyhow::Result<String> {
    let study = StudyId::from(participant.id.as_str());
    let (number, people) = (participant.participant, Population::People);
    let when = store.totals(&study, people).await?.in_words();
    let run = RunId::from(number);
    let recording =
        |action, detail| store.recording(audit::entry(action, Some(&study), Some(detail)));
    match because {
        Some(reason) => {
            let detail = format!("participant {number}: {reason}; {when}");
            let actor = audit::ACTOR.to_owned();
            recording("leave a participant out", detail)
                .exclude(&study, people, run, reason, actor)
                .await?;
        }
        None => {
            let detail = format!("participant {number}; {when}");
            recording("take a participant in again", detail)
                .include(&study, people, run)
                .await?;
        }
    }
    let now = store.totals(&study, people).await?;
    Ok(format!(
        "study {study}: {} finished, {} of them left out of the analysis",
        now.completed, now.excluded_completed
    ))
}
