//! `riskaware study new`: a study file to start from.

use std::{
    fs::File,
    io::Write,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use clap::Args;

use crate::study::{Study, built_in, starter};

/// Where to begin, and where to write.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Begin with a copy of this built-in study in place of the commented starter
    #[arg(long, value_name = "STUDY")]
    from: Option<String>,
    /// The new study's id; if left out, the name of the file
    #[arg(long)]
    id: Option<String>,
    /// The file to write; one that exists is never overwritten
    file: PathBuf,
}

/// Writes the file.
///
/// # Errors
/// When the built-in study is unknown, the id is not allowed, or the file exists or cannot be written.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let file = &arguments.file;
    let id = match &arguments.id {
        Some(id) => id.clone(),
        None => id_of(file)?,
    };
    let (old, text) = match &arguments.from {
        Some(from) => (from.as_str(), built_in_text(from)?),
        None => ("my-study", starter()),
    };
    let text = as_draft(text, old, &id);
    // What is written is what `study check` accepts; only the id is not ours.
    Study::parse(&file.display().to_string(), &text)?;
    let mut written = File::create_new(file).with_context(|| {
        format!(
            "cannot make {}; allowed: a new file in a folder that exists",
            file.display()
        )
    })?;
    written
        .write_all(text.as_bytes())
        .with_context(|| format!("cannot write {}", file.display()))?;
    println!(
        "{} holds the study `{id}`. Change it, then: riskaware study check {}",
        file.display(),
        file.display()
    );
    Ok(())
}

fn id_of(file: &Path) -> anyhow::Result<String> {
    let stem = file.file_stem().and_then(|stem| stem.to_str());
    stem.map(str::to_lowercase)
        .with_context(|| format!("{} names no file", file.display()))
}

fn built_in_text(id: &str) -> anyhow::Result<&'static str> {
    let studies = built_in();
    let name = format!("{id}.toml");
    let Some((_, text)) = studies.iter().find(|(file, _)| *file == name) else {
        let known: Vec<&str> = studies
            .iter()
            .filter_map(|(file, _)| file.strip_suffix(".toml"))
            .collect();
        bail!(
            "--from {id:?}: there is no such built-in study; there are: {}",
            known.join(", ")
        );
    };
    Ok(text)
}

/// The text with another id, and without the key that opens the built-in studies at once.
fn as_draft(text: &str, old: &str, id: &str) -> String {
    let old = format!("id = \"{old}\"");
    let lines = text.lines().filter(|line| !is_open_key(line));
    let mut draft = String::with_capacity(text.len());
    let mut is_replaced = false;
    for line in lines {
        // The first such line is the study's own id: it stands above all tables.
        if !is_replaced && line.starts_with(&old) {
            draft.push_str(&line.replacen(&old, &format!("id = \"{id}\""), 1));
            is_replaced = true;
        } else {
            draft.push_str(line);
        }
        draft.push('\n');
    }
    draft
}

fn is_open_key(line: &str) -> bool {
    line.strip_prefix("open")
        .is_some_and(|rest| rest.trim_start().starts_with('='))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_is_a_draft_with_an_id_of_its_own() {
        let text = "format = 1\nid = \"driving\"  # the id\nopen = true\n[x]\nid = \"driving\"\nopening = 1\n";
        let draft = as_draft(text, "driving", "mine");
        assert_eq!(
            draft,
            "format = 1\nid = \"mine\"  # the id\n[x]\nid = \"driving\"\nopening = 1\n"
        );
    }
}
