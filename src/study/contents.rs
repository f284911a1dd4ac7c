//! What a study asks, block by block: for codebooks and for texts that go with data.

use super::definition::{BlockBody, Study};
use super::step::{ActionView, ConsentStep, Field, NamedReplay, Role};
use super::{BlockId, QuestionId};

/// A block with what it shows.
#[derive(Debug, Clone)]
pub struct BlockContents<'a> {
    /// The block.
    pub block: &'a BlockId,
    /// Its heading; none for a block of questions, each of which has its own, without a start page.
    pub title: Option<&'a str>,
    /// Its text as HTML.
    pub text_html: Option<&'a str>,
    /// The button that leads on, where the study file names it.
    pub button: Option<&'a str>,
    /// What is shown after a wrong attempt, as HTML, where it is a comprehension check.
    pub hint_html: Option<&'a str>,
    /// What it asks.
    pub asks: Asks<'a>,
}

/// What a block asks.
#[derive(Debug, Clone)]
pub enum Asks<'a> {
    /// For nothing.
    Nothing,
    /// To watch replays.
    Replays(&'a [NamedReplay]),
    /// For consent.
    Consent(ConsentStep<'a>),
    /// To choose actions.
    Choices {
        /// The time limit of each question.
        limit_ms: Option<u64>,
        /// The questions, in file order.
        questions: Vec<AskedQuestion<'a>>,
    },
    /// To fill in fields.
    Fields(&'a [Field]),
}

/// A question of a choice block.
#[derive(Debug, Clone, Copy)]
pub struct AskedQuestion<'a> {
    /// Its id in the block.
    pub id: &'a QuestionId,
    /// Its heading.
    pub title: &'a str,
    /// Its text as HTML.
    pub text_html: &'a str,
    /// Whether it is for practice, and never counted.
    pub practice: bool,
    /// What can be chosen.
    pub actions: &'a [ActionView],
    /// The cell or the baseline question in words, where it is one.
    pub label: Option<&'a str>,
}

impl Study {
    /// All blocks in file order.
    pub fn contents(&self) -> impl Iterator<Item = BlockContents<'_>> {
        self.blocks.iter().map(|block| {
            let (title, text_html, asks) = match &block.body {
                BlockBody::Consent(text) => (
                    Some(text.title.as_str()),
                    Some(text.text_html.as_str()),
                    Asks::Consent(text.step()),
                ),
                BlockBody::Info(text) => (
                    Some(text.title.as_str()),
                    Some(text.text_html.as_str()),
                    Asks::Nothing,
                ),
                BlockBody::Replays(text) => (
                    Some(text.title.as_str()),
                    Some(text.text_html.as_str()),
                    Asks::Replays(&text.replays),
                ),
                BlockBody::Choice(choices) => (
                    choices.start.as_ref().map(|start| start.title.as_str()),
                    choices.start.as_ref().map(|start| start.text_html.as_str()),
                    Asks::Choices {
                        limit_ms: choices.limit_ms,
                        questions: choices
                            .questions
                            .iter()
                            .map(|question| AskedQuestion {
                                id: &question.id,
                                title: &question.title,
                                text_html: &question.text_html,
                                practice: question.role == Role::Practice,
                                actions: &question.actions,
                                label: self.question_label(
                                    &block.id,
                                    &question.id,
                                    question.cell.as_ref().map(super::CellId::as_str),
                                ),
                            })
                            .collect(),
                    },
                ),
                BlockBody::Form(form) => (
                    Some(form.title.as_str()),
                    Some(form.text_html.as_str()),
                    Asks::Fields(&form.fields),
                ),
            };
            let (button, hint_html) = match &block.body {
                BlockBody::Consent(_) => (None, None),
                BlockBody::Info(text) => (Some(text.button.as_str()), None),
                BlockBody::Replays(text) => (Some(text.button.as_str()), None),
                BlockBody::Choice(choices) => {
                    let start = choices.start.as_ref();
                    (start.map(|start| start.button.as_str()), None)
                }
                BlockBody::Form(form) => {
                    let hint = form.check.as_ref().map(|check| check.hint_html.as_str());
                    (Some(form.button.as_str()), hint)
                }
            };
            BlockContents {
                block: &block.id,
                title,
                text_html,
                button,
                hint_html,
                asks,
            }
        })
    }

    fn question_label(
        &self,
        block: &BlockId,
        question: &QuestionId,
        cell: Option<&str>,
    ) -> Option<&str> {
        let cell = cell.and_then(|cell| self.cell(cell));
        let baseline = self
            .baseline
            .iter()
            .find(|baseline| baseline.block == *block && baseline.question == *question);
        cell.map(|cell| cell.label.as_str())
            .or(baseline.map(|baseline| baseline.label.as_str()))
    }
}
