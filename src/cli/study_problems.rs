//! The problems of a study that is built in or lies in a file.

use std::path::Path;

use anyhow::{Context, ensure};

use crate::inference::FittedProblem;
use crate::study::{Study, built_in};

/// The study with this id among the built-in ones, or else the one in this file.
pub(super) fn study_from(name: &str) -> anyhow::Result<Study> {
    let known = built_in();
    let found = known
        .iter()
        .find(|(file, _)| file.strip_suffix(".toml") == Some(name));
    if let Some((file, text)) = found {
        return Ok(Study::parse(file, text)?);
    }
    let text = std::fs::read_to_string(Path::new(name)).with_context(|| {
        let ids: Vec<&str> = known
            .iter()
            .filter_map(|(file, _)| file.strip_suffix(".toml"))
            .collect();
        format!(
            "cannot read {name}, which is no built-in study either ({})",
            ids.join(", ")
        )
    })?;
    Ok(Study::parse(name, &text)?)
}

/// The problems of a study's fitted cells, all of which one person answers.
pub(super) fn fitted_problems(study: &Study) -> anyhow::Result<Vec<FittedProblem>> {
    let fitted = study.cells().iter().filter(|cell| cell.fitted);
    let problems: Vec<FittedProblem> = fitted
        .filter_map(|cell| {
            Some(FittedProblem {
                id: cell.id.to_string(),
                problem: cell.problem.clone()?,
            })
        })
        .collect();
    ensure!(
        !problems.is_empty(),
        "study `{}` has no question that is fitted",
        study.id()
    );
    Ok(problems)
}
