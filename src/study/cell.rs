//! Cells of the design, and baseline questions.

use super::{ActionId, BlockId, CellId, FactorId, LevelId, QuestionId};
use crate::model::ChoiceProblem;

/// One combination of factor levels that is asked about, such as information=explicit, time=timed, risk=low.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Level ids in factor order joined by `/`; the question's id in a study without factors.
    pub id: CellId,
    /// The labels of the levels, for people.
    pub label: String,
    /// The level of every factor, in factor order.
    pub levels: Vec<(FactorId, LevelId)>,
    /// Whether the choices of this cell are fitted; if not, its action distribution is still shown.
    pub fitted: bool,
    /// What each action leads to; `None` where the question withholds a probability or a reward. A fitted cell has one.
    pub problem: Option<ChoiceProblem>,
    /// The time limit of its questions, before anybody's time factor.
    pub limit_ms: Option<u64>,
    /// The actions that can be chosen, in file order.
    pub actions: Vec<ActionLabel>,
}

/// An action's id and its text on pages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ActionLabel {
    /// The id that is stored.
    pub id: ActionId,
    /// The text that people read.
    pub label: String,
}

/// A baseline question: its expected rewards lie far apart, so that one action is clearly the best. Never fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct Baseline {
    /// The block that asks it.
    pub block: BlockId,
    /// Its id in that block.
    pub question: QuestionId,
    /// A short description for tables.
    pub label: String,
    /// What each action leads to.
    pub problem: ChoiceProblem,
    /// The time limit, before anybody's time factor.
    pub limit_ms: Option<u64>,
    /// The action with the highest expected reward.
    pub optimal: ActionId,
}
