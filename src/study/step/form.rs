//! The step that asks to fill in fields.

use serde_json::{Map, Value};

use super::{AfterFailure, Assessment, Field, FieldError, Fields, Reply};
use crate::study::Words;

/// A form as the study file words it.
#[derive(Debug, Clone)]
pub(in crate::study) struct FormText {
    pub(in crate::study) title: String,
    pub(in crate::study) text_html: String,
    pub(in crate::study) button: String,
    pub(in crate::study) fields: Vec<Field>,
    pub(in crate::study) check: Option<Check>,
}

/// What makes a form a comprehension check: some of its fields have a right answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// How often it may be answered, the last time included: 1 or more.
    pub attempts: u32,
    /// What is shown after a wrong attempt, as HTML.
    pub hint_html: String,
    /// What follows the last wrong attempt.
    pub then: AfterFailure,
}

impl FormText {
    pub(super) fn step(&self) -> FormStep<'_> {
        FormStep {
            title: &self.title,
            text_html: &self.text_html,
            button: &self.button,
            fields: &self.fields,
            check: self.check.as_ref(),
        }
    }
}

/// Asks to fill in fields. Each form field is named by its id; a choice with own words has a second one, see
/// [`Field::other_name`]; a scale has one for each item.
#[derive(Debug, Clone, Copy)]
pub struct FormStep<'a> {
    /// The heading.
    pub title: &'a str,
    /// The text as HTML.
    pub text_html: &'a str,
    /// The button's text.
    pub button: &'a str,
    /// The fields in order.
    pub fields: &'a [Field],
    /// Set for a comprehension check.
    pub check: Option<&'a Check>,
}

impl FormStep<'_> {
    /// The value of a comprehension check that says whether it was answered rightly. No field can have this id.
    pub const PASSED: &'static str = "_passed";
    /// The value of a comprehension check that says how many attempts were made. No field can have this id.
    pub const ATTEMPTS: &'static str = "_attempts";
    /// How many characters the texts of one form may have together.
    pub const MOST_CHARACTERS: usize = 50_000;

    pub(super) fn read(&self, fields: &Fields, words: &Words) -> Result<Reply, Vec<FieldError>> {
        let mut values = Map::new();
        let errors: Vec<FieldError> = self
            .fields
            .iter()
            .flat_map(|field| {
                field
                    .read(fields, words, &mut values)
                    .err()
                    .unwrap_or_default()
            })
            .collect();
        if !errors.is_empty() {
            return Err(errors);
        }
        if self.check.is_some() {
            let passed = self.fields.iter().all(|field| field.is_right(&values));
            values.insert(Self::PASSED.to_owned(), Value::from(passed));
        }
        Ok(Reply::Filled { values })
    }

    /// Screening comes first: whoever is not looked for need not understand the instructions.
    pub(super) fn assess(&self, values: &Map<String, Value>) -> Assessment {
        if self.fields.iter().any(|field| field.screens_out(values)) {
            return Assessment::ScreensOut;
        }
        match self.check {
            Some(check) if !self.fields.iter().all(|field| field.is_right(values)) => {
                Assessment::Wrong {
                    last_attempt: check.attempts,
                    then: check.then,
                }
            }
            Some(_) | None => Assessment::Passes,
        }
    }
}
