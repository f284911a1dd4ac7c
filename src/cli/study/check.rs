//! `riskaware study check`: what is wrong with study files, and what they amount to.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, ensure};
use clap::Args;
use serde_json::{Value, json};

use super::{report, warnings};
use crate::{
    cli::output,
    study::{ParseError, Study, StudyId, Timestamp},
};

/// Which files to check.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The study files, or folders of them (*.toml)
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Write JSON in place of the report: an object for one file, an array for several or a folder
    #[arg(long)]
    json: bool,
}

/// A file and what came out.
struct Checked {
    name: String,
    outcome: Result<Study, Wrong>,
}

/// Why a file is refused.
enum Wrong {
    /// It cannot be read.
    Unreadable(io::Error),
    /// It has mistakes.
    Mistakes(Vec<ParseError>),
    /// Another one of the files describes the same study.
    Twice { id: StudyId, other: String },
}

/// Checks the files as of `now`. The exit status is 1 if one is refused; warnings leave it at 0.
///
/// # Errors
/// When a folder cannot be listed or holds no study file, or the report cannot be written.
pub(super) fn run(arguments: &Arguments, now: Timestamp) -> anyhow::Result<ExitCode> {
    let mut names = Vec::new();
    for path in &arguments.files {
        if path.is_dir() {
            names.extend(files_of(path)?);
        } else {
            names.push(path.clone());
        }
    }
    let is_one = matches!(arguments.files.as_slice(), [only] if !only.is_dir());
    let mut seen = BTreeMap::new();
    let checked: Vec<Checked> = names.iter().map(|path| check(path, &mut seen)).collect();
    let report = match (checked.as_slice(), arguments.json, is_one) {
        ([only], true, true) => format!("{:#}\n", as_json(only, now)),
        (checked, true, _) => {
            let reports: Vec<Value> = checked.iter().map(|one| as_json(one, now)).collect();
            format!("{:#}\n", json!(reports))
        }
        ([only], false, true) => as_text(only, now),
        (checked, false, _) => checked
            .iter()
            .map(|one| format!("== {}\n{}\n", one.name, as_text(one, now)))
            .chain([total(checked)])
            .collect(),
    };
    output::print(report.as_bytes())?;
    Ok(if checked.iter().all(|one| one.outcome.is_ok()) {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// The study files of a folder by name: those that `serve --studies` would read.
fn files_of(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let entries = fs::read_dir(folder);
    for entry in entries.with_context(|| format!("cannot list {}", folder.display()))? {
        let path = entry
            .with_context(|| format!("cannot list {}", folder.display()))?
            .path();
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            files.push(path);
        }
    }
    ensure!(
        !files.is_empty(),
        "{} holds no study file; their names end with .toml",
        folder.display()
    );
    files.sort();
    Ok(files)
}

fn check(path: &Path, seen: &mut BTreeMap<StudyId, String>) -> Checked {
    let name = path.display().to_string();
    let outcome = match fs::read_to_string(path) {
        Err(error) => Err(Wrong::Unreadable(error)),
        Ok(text) => match Study::check(&name, &text) {
            Err(mistakes) => Err(Wrong::Mistakes(mistakes)),
            Ok(study) => match seen.insert(study.id().clone(), name.clone()) {
                Some(other) => Err(Wrong::Twice {
                    id: study.id().clone(),
                    other,
                }),
                None => Ok(study),
            },
        },
    };
    Checked { name, outcome }
}

fn as_json(checked: &Checked, now: Timestamp) -> Value {
    let name = &checked.name;
    let errors = match &checked.outcome {
        Ok(study) => {
            let mut report = report::as_json(study);
            report["file"] = json!(name);
            report["warnings"] = json!(warnings::of(study, now));
            report["errors"] = json!([]);
            return report;
        }
        Err(Wrong::Mistakes(errors)) => errors
            .iter()
            .map(|error| error_as_json(error.line(), error.key(), error.found(), error.allowed()))
            .collect(),
        Err(Wrong::Unreadable(error)) => vec![error_as_json(
            None,
            "",
            &error.to_string(),
            "a text file in UTF-8",
        )],
        Err(Wrong::Twice { id, other }) => vec![error_as_json(
            None,
            "id",
            &format!("`{id}`, which {other} has"),
            "an id of its own",
        )],
    };
    json!({ "file": name, "errors": errors })
}

fn error_as_json(line: Option<usize>, key: &str, found: &str, allowed: &str) -> Value {
    json!({ "line": line, "key": key, "found": found, "allowed": allowed })
}

fn as_text(checked: &Checked, now: Timestamp) -> String {
    let name = &checked.name;
    match &checked.outcome {
        Ok(study) => report::as_text(study, &warnings::of(study, now)),
        Err(Wrong::Mistakes(errors)) => refusal(errors),
        Err(Wrong::Unreadable(error)) => {
            format!("{name}: found {error}; allowed: a text file in UTF-8\n")
        }
        Err(Wrong::Twice { id, other }) => {
            format!("{name}, id: found `{id}`, which {other} has; allowed: an id of its own\n")
        }
    }
}

fn total(checked: &[Checked]) -> String {
    let wrong: Vec<&str> = checked
        .iter()
        .filter(|one| one.outcome.is_err())
        .map(|one| one.name.as_str())
        .collect();
    if wrong.is_empty() {
        format!("{} files, none is refused.\n", checked.len())
    } else {
        format!(
            "{} files, {} refused: {}\n",
            checked.len(),
            wrong.len(),
            wrong.join(", ")
        )
    }
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
