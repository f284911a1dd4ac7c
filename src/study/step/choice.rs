//! The step that asks to choose an action.

use serde::{Deserialize, Serialize};

use super::{FieldError, Fields, Reply, StepError};
use crate::model::ChoiceProblem;
use crate::study::{ActionId, BlockId, CellId, FactorId, LevelId, QuestionId, StepPlan, Words};

/// A question as the study file words it, placeholders filled in.
#[derive(Debug, Clone)]
pub(in crate::study) struct ChoiceQuestion {
    pub(in crate::study) id: QuestionId,
    pub(in crate::study) levels: Vec<(FactorId, LevelId)>,
    pub(in crate::study) title: String,
    pub(in crate::study) text_html: String,
    pub(in crate::study) scene: Option<String>,
    pub(in crate::study) actions: Vec<ActionView>,
    pub(in crate::study) problem: Option<ChoiceProblem>,
    pub(in crate::study) cell: Option<CellId>,
    pub(in crate::study) role: Role,
}

/// What the answers to a question are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::study) enum Role {
    /// They enter the fits.
    Fitted,
    /// Their action distribution is shown, and they are not fitted.
    ShownOnly,
    /// They are compared with the optimal action.
    Baseline,
    /// They are stored and never counted.
    Practice,
}

/// An action as the page offers it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ActionView {
    /// The value that the form sends.
    pub id: ActionId,
    /// The action's name.
    pub label: String,
    /// What it leads to.
    pub detail: String,
}

/// Asks to choose an action. The form's field is `action` with an action's id; `timed_out` with the value `1` says
/// that the countdown ended.
#[derive(Debug, Clone)]
pub struct ChoiceStep<'a> {
    /// The heading.
    pub title: &'a str,
    /// The text as HTML.
    pub text_html: &'a str,
    /// The drawn scene beside the text.
    pub scene: Option<&'a str>,
    /// The actions in the order of this run.
    pub actions: Vec<&'a ActionView>,
    /// The time limit, before the person's time factor.
    pub limit_ms: Option<u64>,
    /// The factor levels that the question has.
    pub levels: &'a [(FactorId, LevelId)],
    /// The cell that an answer counts in; none for practice, baseline and questions outside the design.
    pub cell: Option<&'a CellId>,
    /// What each action leads to; none where the question withholds it.
    pub problem: Option<&'a ChoiceProblem>,
    /// Stored and never counted.
    pub practice: bool,
    /// A baseline question.
    pub baseline: bool,
    /// Whether the answer enters the fits.
    pub fitted: bool,
    /// Which question of its block this is, counted from 1.
    pub number: usize,
    /// How many questions its block asks.
    pub of: usize,
}

impl<'a> ChoiceStep<'a> {
    pub(super) fn new(
        block: &BlockId,
        questions: &'a [ChoiceQuestion],
        plan: &StepPlan,
    ) -> Result<Self, StepError> {
        let question = questions
            .iter()
            .find(|question| Some(&question.id) == plan.question.as_ref())
            .ok_or_else(|| StepError::Question {
                block: block.clone(),
                question: plan.question.clone(),
            })?;
        let actions =
            in_order(&question.actions, &plan.data.actions).ok_or_else(|| StepError::Actions {
                block: block.clone(),
                question: question.id.clone(),
                actions: plan.data.actions.clone(),
            })?;
        Ok(Self {
            title: &question.title,
            text_html: &question.text_html,
            scene: question.scene.as_deref(),
            actions,
            limit_ms: plan.limit_ms,
            levels: &question.levels,
            cell: question.cell.as_ref(),
            problem: question.problem.as_ref(),
            practice: question.role == Role::Practice,
            baseline: question.role == Role::Baseline,
            fitted: question.role == Role::Fitted,
            number: plan.data.number.unwrap_or(1),
            of: plan.data.of.unwrap_or(questions.len()),
        })
    }

    pub(super) fn read(&self, fields: &Fields, words: &Words) -> Result<Reply, Vec<FieldError>> {
        let chosen = fields
            .get("action")
            .map(String::as_str)
            .filter(|action| !action.is_empty());
        if let Some(chosen) = chosen {
            if let Some(action) = self.actions.iter().find(|action| action.id == *chosen) {
                return Ok(Reply::Chose {
                    action: action.id.clone(),
                });
            }
        } else if self.limit_ms.is_some()
            && fields.get("timed_out").is_some_and(|value| value == "1")
        {
            return Ok(Reply::GaveUp);
        }
        let labels: Vec<&str> = self
            .actions
            .iter()
            .map(|action| action.label.as_str())
            .collect();
        Err(vec![FieldError {
            field: "action".to_owned(),
            message: words.choose_action(&labels.join(", ")),
        }])
    }
}

/// The actions in a stored order; all of them exactly once, or `None`. An empty order is that of the file.
fn in_order<'a>(actions: &'a [ActionView], order: &[ActionId]) -> Option<Vec<&'a ActionView>> {
    if order.is_empty() {
        return Some(actions.iter().collect());
    }
    let distinct: std::collections::BTreeSet<&ActionId> = order.iter().collect();
    if order.len() != actions.len() || distinct.len() != actions.len() {
        return None;
    }
    order
        .iter()
        .map(|id| actions.iter().find(|action| action.id == *id))
        .collect()
}

/// What the page itself measured. It never decides anything: a claim that makes no sense is taken as not measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ClientTiming {
    /// Milliseconds from the frame that showed the question to the choice.
    pub client_rt_ms: Option<u64>,
    /// What the choice was made with.
    pub input: Option<InputDevice>,
    /// Milliseconds during which the page was hidden or out of focus.
    pub hidden_ms: Option<u64>,
}

/// What a choice was made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum InputDevice {
    /// A mouse.
    Mouse,
    /// A finger on a screen.
    Touch,
    /// A pen.
    Pen,
    /// A keyboard, or whatever acts like one, such as a screen reader.
    Keyboard,
}

impl InputDevice {
    /// The name under which it is stored.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Mouse => "mouse",
            Self::Touch => "touch",
            Self::Pen => "pen",
            Self::Keyboard => "keyboard",
        }
    }
}

impl ClientTiming {
    /// The longest time that is taken for a measurement: a day.
    const LONGEST_MS: f64 = 86_400_000.0;

    /// Reads the fields `client_rt_ms`, `input` and `hidden_ms`.
    pub fn read(fields: &Fields) -> Self {
        let millis = |name: &str| {
            let value: f64 = fields.get(name)?.trim().parse().ok()?;
            (0.0..=Self::LONGEST_MS)
                .contains(&value)
                .then(|| value.round() as u64)
        };
        let input = match fields.get("input").map(String::as_str) {
            Some("mouse") => Some(InputDevice::Mouse),
            Some("touch") => Some(InputDevice::Touch),
            Some("pen") => Some(InputDevice::Pen),
            Some("keyboard") => Some(InputDevice::Keyboard),
            Some(_) | None => None,
        };
        Self {
            client_rt_ms: millis("client_rt_ms"),
            input,
            hidden_ms: millis("hidden_ms"),
        }
    }
}
