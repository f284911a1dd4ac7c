//! The step that asks to fill in fields.

use serde_json::{Map, Value};

use super::{FieldError, Fields, Reply};

/// A form as the study file words it.
#[derive(Debug, Clone)]
pub(in crate::study) struct FormText {
    pub(in crate::study) title: String,
    pub(in crate::study) text_html: String,
    pub(in crate::study) button: String,
    pub(in crate::study) fields: Vec<Field>,
}

impl FormText {
    pub(super) fn step(&self) -> FormStep<'_> {
        FormStep {
            title: &self.title,
            text_html: &self.text_html,
            button: &self.button,
            fields: &self.fields,
        }
    }
}

/// Asks to fill in fields. Each form field is named by its id; a choice with own words has a second one, see
/// [`Field::other_name`].
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
}

/// One field of a form.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Its name in the form and in the data.
    pub id: String,
    /// The question.
    pub label: String,
    /// A line of help below it.
    pub hint: Option<String>,
    /// Whether it must be filled in.
    pub required: bool,
    /// What it accepts.
    pub kind: FieldKind,
    /// The purpose that browsers fill in by themselves, as in HTML's `autocomplete`.
    pub autocomplete: Option<String>,
}

/// What a field accepts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FieldKind {
    /// A whole number.
    Integer {
        /// The smallest one.
        min: i64,
        /// The largest one.
        max: i64,
    },
    /// A line of text.
    Text {
        /// How many characters it may have.
        max_length: usize,
    },
    /// One of several options.
    Choice {
        /// The options in order.
        options: Vec<FieldOption>,
        /// Whether there is also the option `other` with own words.
        other: bool,
        /// The option that an instructed-response item asks to choose. Choosing another one is accepted and stored.
        expected: Option<String>,
    },
}

/// An option of a choice field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldOption {
    /// The value that the form sends.
    pub id: String,
    /// Its text.
    pub label: String,
}

impl Field {
    /// The id of the option with own words.
    pub const OTHER: &'static str = "other";
    /// How many characters own words may have.
    pub const OTHER_MAX_LENGTH: usize = 200;

    /// The name of the form field that holds own words.
    pub fn other_name(&self) -> String {
        format!("{}-other", self.id)
    }

    /// Whether the answers of a form pass this instructed-response item; `None` if it is none, or was left empty.
    pub fn passes(&self, values: &Map<String, Value>) -> Option<bool> {
        match &self.kind {
            FieldKind::Choice {
                expected: Some(expected),
                ..
            } => values
                .get(&self.id)
                .map(|value| value.as_str() == Some(expected)),
            FieldKind::Choice { expected: None, .. }
            | FieldKind::Integer { .. }
            | FieldKind::Text { .. } => None,
        }
    }

    /// Reads this field into `values`; left out where it is empty.
    fn read(&self, fields: &Fields, values: &mut Map<String, Value>) -> Result<(), FieldError> {
        let given = fields.get(&self.id).map_or("", |text| text.trim());
        if given.is_empty() {
            return if self.required {
                Err(self.error("This question needs an answer."))
            } else {
                Ok(())
            };
        }
        let value = match &self.kind {
            FieldKind::Integer { min, max } => match given.parse::<i64>() {
                Ok(number) if (*min..=*max).contains(&number) => Value::from(number),
                Ok(_) | Err(_) => {
                    return Err(self.error(format!("Enter a whole number from {min} to {max}.")));
                }
            },
            FieldKind::Text { max_length } => Value::from(self.check_length(given, *max_length)?),
            FieldKind::Choice { options, other, .. } => {
                let is_other = *other && given == Self::OTHER;
                if !is_other && !options.iter().any(|option| option.id == given) {
                    return Err(self.error("Choose one of the options."));
                }
                if is_other {
                    let words = fields
                        .get(&self.other_name())
                        .map_or("", |text| text.trim());
                    if !words.is_empty() {
                        let words = self.check_length(words, Self::OTHER_MAX_LENGTH)?;
                        values.insert(self.other_name(), Value::from(words));
                    }
                }
                Value::from(given)
            }
        };
        values.insert(self.id.clone(), value);
        Ok(())
    }

    fn check_length<'a>(&self, text: &'a str, max_length: usize) -> Result<&'a str, FieldError> {
        let length = text.chars().count();
        if length > max_length {
            return Err(self.error(format!(
                "Use at most {max_length} characters; these are {length}."
            )));
        }
        Ok(text)
    }

    fn error(&self, message: impl Into<String>) -> FieldError {
        FieldError {
            field: self.id.clone(),
            message: message.into(),
        }
    }
}

impl FormStep<'_> {
    pub(super) fn read(&self, fields: &Fields) -> Result<Reply, Vec<FieldError>> {
        let mut values = Map::new();
        let errors: Vec<FieldError> = self
            .fields
            .iter()
            .filter_map(|field| field.read(fields, &mut values).err())
            .collect();
        if errors.is_empty() {
            Ok(Reply::Filled { values })
        } else {
            Err(errors)
        }
    }
}
