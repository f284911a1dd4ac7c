//! The kinds of steps: what each shows, and which replies it accepts.
//!
//! A new kind is one variant of [`Step`] and one module here.

mod assessment;
mod choice;
mod consent;
mod field;
mod fields;
mod form;
mod info;
mod replays;
mod thanks;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use assessment::{AfterFailure, Assessment};
pub use choice::{ActionView, ChoiceStep, ClientTiming, InputDevice};
pub(super) use choice::{ChoiceQuestion, Role};
pub(super) use consent::ConsentText;
pub use consent::{Clause, ConsentStep, DeclinedPage};
pub use field::{Field, FieldKind, FieldOption, LikertItem};
pub use fields::Fields;
pub(super) use form::FormText;
pub use form::{Check, FormStep};
pub use info::InfoStep;
pub(super) use info::InfoText;
pub(super) use replays::ReplaysText;
pub use replays::{NamedReplay, ReplaysStep, Viewing};
pub use thanks::ThanksStep;

use super::definition::{Block, BlockBody, Ending, Study};
use super::draw::THANKS_BLOCK;
use super::{ActionId, BlockId, QuestionId, ReplayId, StepKind, StepPlan, Words};

/// A step of a run, ready to be shown.
#[derive(Debug, Clone)]
pub enum Step<'a> {
    /// Asks for consent.
    Consent(ConsentStep<'a>),
    /// Tells something; a button goes on.
    Info(InfoStep<'a>),
    /// Shows replays of towers being built.
    Replays(ReplaysStep<'a>),
    /// Asks to choose an action.
    Choice(ChoiceStep<'a>),
    /// Asks to fill in fields.
    Form(FormStep<'a>),
    /// The end of the run.
    Thanks(ThanksStep<'a>),
}

/// A checked reply to a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reply", rename_all = "snake_case")]
pub enum Reply {
    /// Agreed to take part.
    Agreed,
    /// Agreed to take part where the consent has clauses of its own.
    AgreedTo {
        /// Whether each clause was ticked, by its id.
        clauses: BTreeMap<String, bool>,
    },
    /// Declined to take part.
    Declined,
    /// Read an info step and went on.
    Continued,
    /// Watched the replays of a step.
    Watched {
        /// One for each replay; none from a page without scripts, which tells in words what happened.
        viewings: Vec<Viewing>,
    },
    /// Chose an action.
    Chose {
        /// The action, one of those that the step offers.
        action: ActionId,
    },
    /// The page says that its countdown ended before anything was chosen. Whether that is so is for the server's
    /// clock to decide.
    GaveUp,
    /// Filled in a form.
    Filled {
        /// The answers by field id, those left empty left out: numbers, texts, option ids, or lists of option ids. Own
        /// words beside the option `other` stand under the field's id with `-other` added, the answers on a scale under
        /// the ids of its items, and whether a comprehension check was passed under [`FormStep::PASSED`].
        values: serde_json::Map<String, serde_json::Value>,
    },
}

impl Reply {
    /// The fields of a form as they were filled in, to show them again.
    pub fn fields(&self) -> Fields {
        let Self::Filled { values } = self else {
            return Fields::new();
        };
        let shown = |value: &serde_json::Value| match value {
            serde_json::Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        let posted = values.iter().flat_map(|(name, value)| match value {
            serde_json::Value::Array(several) => several
                .iter()
                .map(|value| (name.clone(), shown(value)))
                .collect(),
            value => vec![(name.clone(), shown(value))],
        });
        posted.collect()
    }
}

/// A field of a posted form that is not acceptable.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {message}")]
pub struct FieldError {
    /// The field's name in the form.
    pub field: String,
    /// What to do about it, for the person who fills it in.
    pub message: String,
}

/// A stored step that does not fit the study version it is said to come from.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StepError {
    /// The block does not exist, or is of another kind.
    #[error("study {study} has no {} block {block}", kind.as_str())]
    Block {
        /// The study's id.
        study: String,
        /// The block named by the step.
        block: BlockId,
        /// The step's kind.
        kind: StepKind,
    },
    /// The question does not exist, or the step names none.
    #[error("block {block} has no question {question:?}")]
    Question {
        /// The block.
        block: BlockId,
        /// The question named by the step.
        question: Option<QuestionId>,
    },
    /// The stored order of replays is not one of those that the block shows.
    #[error("block {block} has no such order of replays: {replays:?}")]
    Replays {
        /// The block.
        block: BlockId,
        /// The stored order.
        replays: Vec<ReplayId>,
    },
    /// The stored order of actions names other actions than the question has.
    #[error("question {question} of block {block} has no such order of actions: {actions:?}")]
    Actions {
        /// The block.
        block: BlockId,
        /// The question.
        question: QuestionId,
        /// The stored order.
        actions: Vec<ActionId>,
    },
}

impl Step<'_> {
    /// Checks what a page posted for this step.
    ///
    /// Fields that the step does not know are ignored.
    ///
    /// # Errors
    /// Every field that is missing or not acceptable.
    pub fn read(&self, fields: &Fields, words: &Words) -> Result<Reply, Vec<FieldError>> {
        match self {
            Self::Consent(step) => step.read(fields, words),
            Self::Info(_) => Ok(Reply::Continued),
            Self::Replays(step) => step.read(fields, words),
            Self::Choice(step) => step.read(fields, words),
            Self::Form(step) => step.read(fields, words),
            Self::Thanks(step) => step.read(),
        }
    }
}

impl Study {
    /// What a stored step shows. `plan` must come from this version of the study.
    ///
    /// # Errors
    /// When the study has no such step.
    pub fn step<'a>(&'a self, plan: &StepPlan) -> Result<Step<'a>, StepError> {
        let missing = || StepError::Block {
            study: self.id.to_string(),
            block: plan.block.clone(),
            kind: plan.kind,
        };
        if plan.kind == StepKind::Thanks && plan.block == *THANKS_BLOCK {
            return Ok(Step::Thanks(ThanksStep {
                completion: self.ending(Ending::Completed),
            }));
        }
        let block = self
            .blocks
            .iter()
            .find(|block| block.id == plan.block)
            .ok_or_else(missing)?;
        step_of_block(block, plan).unwrap_or_else(|| Err(missing()))
    }
}

/// The step that `plan` names in `block`; `None` if the block holds no step of that kind.
fn step_of_block<'a>(block: &'a Block, plan: &StepPlan) -> Option<Result<Step<'a>, StepError>> {
    match (plan.kind, &block.body) {
        (StepKind::Consent, BlockBody::Consent(text)) => Some(Ok(Step::Consent(text.step()))),
        (StepKind::Info, BlockBody::Info(text)) => Some(Ok(Step::Info(text.step()))),
        (StepKind::Info, BlockBody::Choice(choices)) => choices
            .start
            .as_ref()
            .map(|text| Ok(Step::Info(text.step()))),
        (StepKind::Replays, BlockBody::Replays(text)) => {
            Some(ReplaysStep::new(&block.id, text, plan).map(Step::Replays))
        }
        (StepKind::Choice, BlockBody::Choice(choices)) => {
            Some(ChoiceStep::new(&block.id, &choices.questions, plan).map(Step::Choice))
        }
        (StepKind::Form, BlockBody::Form(text)) => Some(Ok(Step::Form(text.step()))),
        (
            StepKind::Consent
            | StepKind::Info
            | StepKind::Replays
            | StepKind::Choice
            | StepKind::Form
            | StepKind::Thanks,
            BlockBody::Consent(_)
            | BlockBody::Info(_)
            | BlockBody::Replays(_)
            | BlockBody::Choice(_)
            | BlockBody::Form(_),
        ) => None,
    }
}
