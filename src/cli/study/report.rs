//! The preview of a study.

use std::fmt::Write;

use serde_json::{Value, json};

use super::warnings::rounded;
use crate::study::{DURATION_RULE, Flag, Include, OutlinedStep, Study};

/// The preview for machines.
pub(super) fn as_json(study: &Study) -> Value {
    let cells: Vec<Value> = study
        .cells()
        .iter()
        .map(|cell| {
            let expected: serde_json::Map<String, Value> = cell
                .problem
                .iter()
                .flat_map(|problem| problem.actions())
                .map(|action| {
                    let expected = rounded(action.prospect.expected_reward());
                    (action.name.clone(), json!(expected))
                })
                .collect();
            json!({
                "id": cell.id,
                "label": cell.label,
                "fitted": cell.fitted,
                "problem": cell.problem,
                "expected_rewards": expected,
            })
        })
        .collect();
    let outline = study.outline();
    let steps: Vec<Value> = outline
        .iter()
        .map(|step| {
            json!({
                "block": step.block,
                "kind": step.kind,
                "question": step.question,
                "title": step.title,
                "limit_ms": step.limit_ms,
                "purpose": step.purpose,
                "shuffled": step.is_shuffled,
                "words": step.words,
                "seconds": rounded(step.seconds),
            })
        })
        .collect();
    json!({
        "id": study.id(),
        "title": study.title(),
        "hash": study.hash(),
        "conditions": study.conditions().iter().map(|condition| &condition.id).collect::<Vec<_>>(),
        "analysis": {
            "include": match study.include() {
                Include::Completed => "completed",
                Include::All => "all",
            },
            "exclude": study.exclude(),
        },
        "cells": cells,
        "steps": steps,
        "minutes": { "told": study.minutes(), "expected": rounded(minutes(&outline)), "rule": DURATION_RULE },
    })
}

fn minutes(outline: &[OutlinedStep]) -> f64 {
    outline.iter().map(|step| step.seconds).sum::<f64>() / 60.0
}

/// The preview for people.
pub(super) fn as_text(study: &Study, warnings: &[String]) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write_text(&mut text, study, warnings);
    text
}

fn write_text(text: &mut String, study: &Study, warnings: &[String]) -> std::fmt::Result {
    writeln!(text, "{}: {}", study.id(), study.title())?;
    writeln!(text, "version {}", &study.hash()[..12])?;
    writeln!(text, "\nCells")?;
    for cell in study.cells() {
        let fitted = if cell.fitted { "" } else { " (not fitted)" };
        writeln!(text, "  {}{fitted}", cell.id)?;
        match &cell.problem {
            None => writeln!(text, "    the question withholds something")?,
            Some(problem) => {
                for action in problem.actions() {
                    let outcomes: Vec<String> = action
                        .prospect
                        .outcomes()
                        .iter()
                        .map(|outcome| {
                            let reward = study.reward_unit().format(outcome.reward);
                            format!("{} with {}", reward, rounded(outcome.probability))
                        })
                        .collect();
                    let expected = rounded(action.prospect.expected_reward());
                    writeln!(
                        text,
                        "    {}: {}; expected {}",
                        action.name,
                        outcomes.join(", "),
                        study.reward_unit().format(expected)
                    )?;
                }
            }
        }
    }
    for baseline in study.baseline() {
        writeln!(
            text,
            "  {}: baseline, best is {}",
            baseline.question, baseline.optimal
        )?;
    }
    if !study.conditions().is_empty() {
        writeln!(text, "\nConditions, of which each person meets one")?;
        for condition in study.conditions() {
            writeln!(text, "  {}", condition.id)?;
        }
    }
    let outline = study.outline();
    writeln!(text, "\nA run, in order")?;
    for step in &outline {
        write_step(text, step)?;
    }
    writeln!(
        text,
        "\nExpected duration: {:.1} minutes; people are told {}.\n  ({DURATION_RULE})",
        minutes(&outline),
        study.minutes()
    )?;
    if let Some(bonus) = study.bonus() {
        writeln!(
            text,
            "Bonus: {} and {} {} per unit of reward, never below 0.",
            bonus.format(bonus.endowment),
            bonus.rate,
            bonus.currency
        )?;
    }
    writeln!(text, "Analysis: {}.", analysis(study))?;
    match warnings {
        [] => writeln!(text, "\nNo mistakes and no warnings."),
        warnings => {
            writeln!(text, "\nNo mistakes. Warnings")?;
            warnings
                .iter()
                .try_for_each(|warning| writeln!(text, "  * {warning}"))
        }
    }
}

/// Whose answers are analysed.
fn analysis(study: &Study) -> String {
    let included = match study.include() {
        Include::Completed => "answers of people who finished",
        Include::All => "every valid answer from the moment when it is given",
    };
    let flags: Vec<&str> = study.exclude().iter().copied().map(Flag::deed).collect();
    if flags.is_empty() {
        return format!("{included}; no rule leaves anybody out");
    }
    format!(
        "{included}; left out when their run ends: whoever {}",
        flags.join(", or ")
    )
}

fn write_step(text: &mut String, step: &OutlinedStep) -> std::fmt::Result {
    let name = match &step.question {
        Some(question) => format!("{}/{question}", step.block),
        None => step.block.to_string(),
    };
    let limit = match step.limit_ms {
        Some(limit_ms) => format!(", {} s", limit_ms as f64 / 1_000.0),
        None => String::new(),
    };
    let purpose = step.purpose.map_or(String::new(), |purpose| {
        let shuffled = if step.is_shuffled {
            ", in random order"
        } else {
            ""
        };
        format!(", {purpose}{shuffled}")
    });
    let kind = step.kind.as_str();
    writeln!(text, "  {kind:8} {name:28} {}{limit}{purpose}", step.title)
}
