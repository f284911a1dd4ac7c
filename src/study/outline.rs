//! What a run of a study consists of, before anybody takes part: for whoever writes the file.

use super::definition::{Block, BlockBody, Choices, Order};
use super::step::{ChoiceQuestion, Field, FieldKind, FormText, Role};
use super::{BlockId, QuestionId, StepKind, Study};

/// How fast people read, in words a minute: silent reading of English prose, 238 on average (Brysbaert 2019).
pub const WORDS_PER_MINUTE: f64 = 238.0;

/// How long it takes to find and press a button, in seconds. (decision)
const PRESS_S: f64 = 2.0;
/// How long a choice takes after its text was read, in seconds. (decision)
const CHOOSE_S: f64 = 4.0;
/// How long a field takes after its text was read, in seconds. (decision)
const FIELD_S: f64 = 3.0;
/// How long a line of text takes to write, in seconds. (decision)
const LINE_S: f64 = 8.0;
/// How long several lines take to write, in seconds. (decision)
const LINES_S: f64 = 45.0;
/// How long a replay takes with the way to the next one, in seconds: replays last 6 to 10. (decision)
const REPLAY_S: f64 = 10.0;

/// The rule by which [`OutlinedStep::seconds`] is reckoned, in words.
pub const DURATION_RULE: &str = "reading at 238 words a minute; 2 s for a button, 4 s for a choice, 3 s for a field or an item of a scale, 8 s for a line of text, 45 s for several lines, 10 s for a replay; a timed question at most its limit";

/// A step that everybody meets, or one of those that a random order or a condition picks from.
#[derive(Debug, Clone, PartialEq)]
pub struct OutlinedStep {
    /// Its block.
    pub block: BlockId,
    /// Its kind.
    pub kind: StepKind,
    /// The question, for choices.
    pub question: Option<QuestionId>,
    /// The heading.
    pub title: String,
    /// The text without markup; empty for choices and forms that have none.
    pub text: String,
    /// The time limit.
    pub limit_ms: Option<u64>,
    /// What the answer is for, where it is a choice: `fitted`, `shown only`, `baseline` or `practice`.
    pub purpose: Option<&'static str>,
    /// Whether its place among its neighbours is drawn for each run.
    pub is_shuffled: bool,
    /// How many words it shows.
    pub words: usize,
    /// How long it takes, in seconds.
    pub seconds: f64,
}

impl Study {
    /// The steps of a run in file order, the last page left out.
    pub fn outline(&self) -> Vec<OutlinedStep> {
        self.blocks.iter().flat_map(outline_block).collect()
    }

    /// Whether some form asks for an instructed response.
    pub fn has_attention_check(&self) -> bool {
        !self.instructed_items().is_empty()
    }
}

fn outline_block(block: &Block) -> Vec<OutlinedStep> {
    let plain = |kind, title: &str, html: &str, work_s: f64| {
        let text = plain_text(html);
        let words = words(title) + words(&text);
        OutlinedStep {
            block: block.id.clone(),
            kind,
            question: None,
            title: title.to_owned(),
            text,
            limit_ms: None,
            purpose: None,
            is_shuffled: false,
            words,
            seconds: reading_s(words) + work_s,
        }
    };
    match &block.body {
        BlockBody::Consent(text) => {
            let clauses: Vec<&str> = text
                .clauses
                .iter()
                .map(|clause| clause.text.as_str())
                .collect();
            let html = format!("{} {}", text.text_html, clauses.join(" "));
            let work_s = PRESS_S * (1 + clauses.len()) as f64;
            vec![plain(StepKind::Consent, &text.title, &html, work_s)]
        }
        BlockBody::Info(text) => {
            vec![plain(StepKind::Info, &text.title, &text.text_html, PRESS_S)]
        }
        BlockBody::Replays(text) => {
            let work_s = PRESS_S + REPLAY_S * text.replays.len() as f64;
            vec![plain(
                StepKind::Replays,
                &text.title,
                &text.text_html,
                work_s,
            )]
        }
        BlockBody::Form(text) => {
            let mut step = plain(StepKind::Form, &text.title, &text.text_html, PRESS_S);
            let (words, work_s) = fields_of(text);
            step.words += words;
            step.seconds += reading_s(words) + work_s;
            vec![step]
        }
        BlockBody::Choice(choices) => {
            let start = choices
                .start
                .iter()
                .map(|text| plain(StepKind::Info, &text.title, &text.text_html, PRESS_S));
            start.chain(outline_questions(block, choices)).collect()
        }
    }
}

fn outline_questions<'a>(
    block: &'a Block,
    choices: &'a Choices,
) -> impl Iterator<Item = OutlinedStep> + 'a {
    choices
        .questions
        .iter()
        .enumerate()
        .map(move |(index, question)| {
            let unit = choices
                .units
                .iter()
                .find(|unit| unit.questions.contains(&index));
            let is_shuffled = choices.order == Order::Random
                || unit.is_some_and(|unit| unit.order == Order::Random && unit.questions.len() > 1);
            let words = question_words(question);
            let seconds = reading_s(words) + CHOOSE_S;
            OutlinedStep {
                block: block.id.clone(),
                kind: StepKind::Choice,
                question: Some(question.id.clone()),
                title: question.title.clone(),
                text: plain_text(&question.text_html),
                limit_ms: choices.limit_ms,
                purpose: Some(match question.role {
                    Role::Fitted => "fitted",
                    Role::ShownOnly => "shown only",
                    Role::Baseline => "baseline",
                    Role::Practice => "practice",
                }),
                is_shuffled,
                words,
                seconds: choices
                    .limit_ms
                    .map_or(seconds, |limit_ms| seconds.min(limit_ms as f64 / 1_000.0)),
            }
        })
}

fn question_words(question: &ChoiceQuestion) -> usize {
    let actions: usize = question
        .actions
        .iter()
        .map(|action| words(&action.label) + words(&action.detail))
        .sum();
    words(&question.title) + words(&plain_text(&question.text_html)) + actions
}

/// How many words the fields of a form show, and how many seconds filling them in takes beside reading.
fn fields_of(form: &FormText) -> (usize, f64) {
    let mut shown = 0;
    let mut work_s = 0.0;
    for field in &form.fields {
        shown += words(&field.label) + field.hint.as_deref().map_or(0, words);
        shown += option_words(field);
        work_s += match &field.kind {
            FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Choice { .. }
            | FieldKind::Choices { .. } => FIELD_S,
            FieldKind::Text { .. } => LINE_S,
            FieldKind::LongText { .. } => LINES_S,
            FieldKind::Likert { items, .. } => FIELD_S * items.len() as f64,
        };
    }
    (shown, work_s)
}

fn option_words(field: &Field) -> usize {
    match &field.kind {
        FieldKind::Likert { points, items } => {
            let points: usize = points.iter().map(|point| words(point)).sum();
            points + items.iter().map(|item| words(&item.text)).sum::<usize>()
        }
        FieldKind::Choice { options, .. } | FieldKind::Choices { options, .. } => {
            options.iter().map(|option| words(&option.label)).sum()
        }
        FieldKind::Integer { .. }
        | FieldKind::Number { .. }
        | FieldKind::Text { .. }
        | FieldKind::LongText { .. } => 0,
    }
}

fn reading_s(words: usize) -> f64 {
    words as f64 * 60.0 / WORDS_PER_MINUTE
}

fn words(text: &str) -> usize {
    text.split_whitespace().count()
}

/// The text of HTML that was made of Markdown.
fn plain_text(html: &str) -> String {
    let mut text = String::new();
    for (index, part) in html.split('<').enumerate() {
        let shown = if index == 0 {
            part
        } else {
            part.split_once('>').map_or("", |(_, shown)| shown)
        };
        text.push_str(shown);
    }
    let text = text
        .replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&quot;", "\"")
        .replace("&amp;", "&");
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::built_in;

    #[test]
    fn markup_is_no_text() {
        let html = "<p>One <strong>two</strong></p>\n<ul><li>5 &lt; 6 &amp; more</li></ul>";
        assert_eq!(plain_text(html), "One two 5 < 6 & more");
    }

    #[test]
    fn the_driving_study_takes_about_as_long_as_it_says() {
        let (name, text) = built_in()[0];
        let study = Study::parse(name, text).unwrap();
        let outline = study.outline();
        let choices: Vec<&OutlinedStep> = outline
            .iter()
            .filter(|step| step.kind == StepKind::Choice)
            .collect();
        assert_eq!(choices.len(), 1 + 5 + 5 + 4);
        assert!(
            choices
                .iter()
                .filter(|step| step.limit_ms.is_some())
                .all(|step| step.seconds <= 8.0)
        );
        let minutes = outline.iter().map(|step| step.seconds).sum::<f64>() / 60.0;
        let said = f64::from(study.minutes());
        assert!((0.5 * said..1.5 * said).contains(&minutes), "{minutes}");
    }
}
