//! The cells that the questions amount to.

use super::design::{Design, Levels};
use crate::study::document::{Fault, KeyPath};
use crate::study::step::{ChoiceQuestion, Role};
use crate::study::{ActionLabel, Cell};

/// A question that belongs to a cell, and where it stands.
pub(super) struct AskedCell {
    cell: Cell,
    at: KeyPath,
}

impl AskedCell {
    /// The cell of a question, if it belongs to one.
    pub(super) fn of(
        question: &ChoiceQuestion,
        design: &Design<'_>,
        levels: &Levels,
        limit_ms: Option<u64>,
        at: &KeyPath,
    ) -> Option<Self> {
        let id = question.cell.clone()?;
        let label = if levels.is_empty() {
            id.to_string()
        } else {
            design.label(levels)
        };
        let cell = Cell {
            id,
            label,
            levels: question.levels.clone(),
            fitted: question.role == Role::Fitted,
            problem: question.problem.clone(),
            limit_ms,
            actions: question
                .actions
                .iter()
                .map(|action| ActionLabel {
                    id: action.id.clone(),
                    label: action.label.clone(),
                })
                .collect(),
        };
        Some(Self {
            cell,
            at: at.clone(),
        })
    }
}

/// Every cell once, in file order. Asking for the same cell again is allowed as long as it is the same question.
pub(super) fn collect(asked: Vec<AskedCell>) -> Result<Vec<Cell>, Fault> {
    let mut distinct: Vec<AskedCell> = Vec::new();
    for again in asked {
        match distinct
            .iter()
            .find(|earlier| earlier.cell.id == again.cell.id)
        {
            Some(earlier) => check_same(earlier, &again)?,
            None => distinct.push(again),
        }
    }
    Ok(distinct.into_iter().map(|asked| asked.cell).collect())
}

fn check_same(earlier: &AskedCell, again: &AskedCell) -> Result<(), Fault> {
    let (difference, allowed) = if earlier.cell.problem != again.cell.problem
        || earlier.cell.actions != again.cell.actions
    {
        (
            "with another choice problem",
            "one choice problem per cell: a factor for what differs",
        )
    } else if earlier.cell.limit_ms != again.cell.limit_ms {
        (
            "with another time limit",
            "one time limit per cell: a factor for what differs",
        )
    } else if earlier.cell.fitted != again.cell.fitted {
        (
            "once fitted and once not",
            "the same `fitted` wherever a cell is asked about",
        )
    } else {
        return Ok(());
    };
    Err(again.at.fault(
        format!("cell `{}` for the second time, {difference}", again.cell.id),
        allowed,
    ))
}
