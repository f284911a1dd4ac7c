//! `riskaware import`: answers that were given elsewhere, also while a server runs.

use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use clap::Args;

use super::audit;
use crate::{
    clock::Clock,
    import::{self, Mapping},
    store::Store,
    study::{Study, StudyId},
};

/// What to import.
#[derive(Debug, Clone, Args)]
pub struct Arguments {
    /// The study's id
    study: StudyId,
    /// The answers as CSV, one row per question: participant, problem (or a column per factor), action
    #[arg(long)]
    file: PathBuf,
    /// What the file calls columns and values (TOML), where it uses other words
    #[arg(long, value_name = "MAPPING")]
    map: Option<PathBuf>,
    /// Where the answers come from, for tables by source
    #[arg(long)]
    source: String,
    /// The database file; a server may be using it
    #[arg(long, env = "RISKAWARE_DATABASE", default_value = "riskaware.db")]
    database: PathBuf,
}

/// Stores the whole file or nothing.
///
/// # Errors
/// When a file cannot be read, a row is faulty, or somebody in it was imported before.
pub async fn run(arguments: Arguments) -> anyhow::Result<()> {
    let Arguments {
        study,
        file,
        map,
        source,
        database,
    } = arguments;
    ensure!(
        !source.trim().is_empty(),
        "--source is empty; allowed: a label such as lab-2019"
    );
    let clock = Clock::start();
    let store = Store::open_beside(&database, clock.clone())
        .await
        .with_context(|| format!("opening the database {}", database.display()))?;
    let version = store
        .study(&study)
        .await
        .with_context(|| format!("study {study} in {}", database.display()))?
        .version;
    let stored = store.study_version(version).await?;
    let name = format!("version {} of {study}", stored.number);
    let parsed = Study::parse_stored(&name, &stored.text)?;
    let mapping = match &map {
        None => Mapping::default(),
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .with_context(|| format!("reading {}", path.display()))?;
            Mapping::parse(&text, &Mapping::allowed(&parsed))
                .with_context(|| format!("mapping {}", path.display()))?
        }
    };
    let answers = std::fs::read(&file).with_context(|| format!("reading {}", file.display()))?;
    let imported = match import::read(&parsed, &mapping, clock.now(), &answers) {
        Ok(imported) => imported,
        Err(faults) => bail!(
            "nothing was imported, because {} {} of {} cannot be taken:{faults}",
            faults.count(),
            if faults.count() == 1 { "cell" } else { "cells" },
            file.display()
        ),
    };
    let names = imported.runs.iter().map(|run| run.participant.as_str());
    let known = store.imported_before(&study, source.trim(), names).await?;
    if !known.is_empty() {
        bail!(
            "nothing was imported, because {} of these participants were imported before: {}",
            known.len(),
            known.join(", ")
        );
    }
    let detail = format!("{} people, source {}", imported.runs.len(), source.trim());
    let entry = audit::entry("import answers", Some(&study), Some(detail));
    let people = store
        .recording(entry)
        .import(&study, version, source.trim(), imported.runs)
        .await?;
    store.close().await;
    println!(
        "{} answers of {people} people are imported into {study}; {} rows of practice or unanswered questions are left out",
        imported.answers, imported.left_out
    );
    Ok(())
}
