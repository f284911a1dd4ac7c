//! `riskaware doctor`: whether a database is well, also while a server uses it.

use std::{path::PathBuf, process::ExitCode};

use anyhow::Context;
use clap::Args;
use serde::Serialize;

use super::output::print;
use crate::{
    clock::Clock,
    jobs::{Catalogue, Snapshot},
    store::{self, Finding, Health, Population, Store},
};

/// What to examine.
#[derive(Debug, Clone, Args)]
pub struct Arguments {
    /// The database file
    #[arg(long, env = "RISKAWARE_DATABASE", default_value = "riskaware.db")]
    database: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    database: String,
    healthy: bool,
    findings: Vec<Finding>,
}

/// Examines the database and says what it found; the status is 1 where something has to be done.
///
/// # Errors
/// When there is no such file.
pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { database, json } = arguments;
    let mut findings = store::examine(&database, Clock::start())
        .await
        .with_context(|| format!("examining {}", database.display()))?;
    let is_sound = |check: &str| {
        let mut found = findings.iter().filter(|finding| finding.check == check);
        found.any(|finding| finding.health == Health::Sound)
    };
    if is_sound("schema") && is_sound("integrity") {
        findings.push(fits(&database).await?);
    }
    let report = Report {
        database: database.display().to_string(),
        healthy: findings
            .iter()
            .all(|finding| finding.health != Health::Wrong),
        findings,
    };
    let text = if json {
        serde_json::to_string_pretty(&report)? + "\n"
    } else {
        in_words(&report)
    };
    print(text.as_bytes())?;
    Ok(if report.healthy {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// Whether each study's fits are those of its answers.
async fn fits(database: &std::path::Path) -> anyhow::Result<Finding> {
    let store = Store::open_to_read(database, Clock::start()).await?;
    let catalogue = match Catalogue::stored(&store).await {
        Ok(catalogue) => catalogue,
        Err(error) => {
            return Ok(Finding::wrong(
                "fits",
                error.to_string(),
                "serve this database with the program that wrote it",
            ));
        }
    };
    let mut behind = Vec::new();
    for study in catalogue.studies() {
        for population in [Population::People, Population::Simulated] {
            let snapshot = Snapshot::read(&store, &catalogue, population, study.id()).await?;
            let not_final = snapshot.map_or(0, |snapshot| snapshot.final_alone().1.len());
            if not_final > 0 {
                behind.push(format!("{not_final} of {}", study.id()));
            }
        }
    }
    store.close().await;
    Ok(if behind.is_empty() {
        Finding::sound("fits", "every fit is a final one of all answers")
    } else {
        Finding::note(
            "fits",
            format!("not final: {}", behind.join(", ")),
            "nothing; a server fits them while it runs",
        )
    })
}

fn in_words(report: &Report) -> String {
    let mut text = String::new();
    for finding in &report.findings {
        let mark = match finding.health {
            Health::Sound => "ok",
            Health::Note => "note",
            Health::Wrong => "WRONG",
        };
        text.push_str(&format!(
            "{mark:<6}{:<12}{}\n",
            finding.check, finding.found
        ));
        if !finding.advice.is_empty() {
            text.push_str(&format!("{:<18}to do: {}\n", "", finding.advice));
        }
    }
    text.push_str(if report.healthy {
        "the database is well\n"
    } else {
        "something has to be done\n"
    });
    text
}
