//! `riskaware study check`: what is wrong with a study file, and what it amounts to.

use std::{fs, path::PathBuf, process::ExitCode};

use anyhow::Context;
use clap::Args;
use serde_json::json;

use super::{report, warnings};
use crate::{
    cli::output,
    study::{ParseError, Study},
};

/// Which file to check.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The study file
    file: PathBuf,
    /// Write one JSON object in place of the report
    #[arg(long)]
    json: bool,
}

/// Checks the file. The exit status is 1 if it is refused; warnings leave it at 0.
///
/// # Errors
/// When the file cannot be read, or the report not be written.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let name = arguments.file.display().to_string();
    let text =
        fs::read_to_string(&arguments.file).with_context(|| format!("cannot read {name}"))?;
    let checked = Study::check(&name, &text);
    let report = match (&checked, arguments.json) {
        (Ok(study), true) => {
            let mut report = report::as_json(study);
            report["warnings"] = json!(warnings::of(study));
            report["errors"] = json!([]);
            format!("{report:#}\n")
        }
        (Ok(study), false) => report::as_text(study, &warnings::of(study)),
        (Err(errors), true) => {
            let errors: Vec<_> = errors.iter().map(error_as_json).collect();
            format!("{:#}\n", json!({ "file": name, "errors": errors }))
        }
        (Err(errors), false) => refusal(errors),
    };
    output::print(report.as_bytes())?;
    Ok(match checked {
        Ok(_) => ExitCode::SUCCESS,
        Err(_) => ExitCode::FAILURE,
    })
}

fn error_as_json(error: &ParseError) -> serde_json::Value {
    json!({
        "line": error.line(),
        "key": error.key(),
        "found": error.found(),
        "allowed": error.allowed(),
    })
}

fn refusal(errors: &[ParseError]) -> String {
    let mut text: String = errors.iter().map(|error| format!("{error}\n")).collect();
    let count = match errors.len() {
        1 => "1 mistake".to_owned(),
        count => format!("{count} mistakes"),
    };
    text.push_str(&format!(
        "\n{count}. Each part of the file names its first one only: check again when these are mended.\n"
    ));
    text
}
