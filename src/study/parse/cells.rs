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
    let mut cells: Vec<Cell> = Vec::new();
    for AskedCell { cell, at } in asked {
        match cells.iter().find(|earlier| earlier.id == cell.id) {
            None => cells.push(cell),
            Some(earlier) if earlier.problem != cell.problem => {
                return Err(at.fault(
                    format!(
                        "cell `{}` for the second time, with another choice problem",
                        cell.id
                    ),
                    "one choice problem per cell: a factor for what differs",
                ));
            }
            Some(earlier) if earlier.fitted != cell.fitted => {
                return Err(at.fault(
                    format!(
                        "cell `{}` for the second time, once fitted and once not",
                        cell.id
                    ),
                    "the same `fitted` wherever a cell is asked about",
                ));
            }
            Some(_) => {}
        }
    }
    Ok(cells)
}
