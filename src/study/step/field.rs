//! The fields of forms: what each kind accepts, and what is made of an answer.

use serde_json::{Map, Value};

use super::{FieldError, Fields};
use crate::study::Words;

/// One field of a form.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Its name in the form and in the data. A scale has no value of its own; its items have.
    pub id: String,
    /// The question.
    pub label: String,
    /// A line of help below it.
    pub hint: Option<String>,
    /// Whether it must be filled in; for a scale, whether each item must.
    pub required: bool,
    /// What it accepts.
    pub kind: FieldKind,
    /// The right answer of a comprehension check, in the form in which answers are stored.
    pub correct: Option<Value>,
    /// The answer that an instructed-response item asks for. Another one is accepted and stored.
    pub expected: Option<Value>,
    /// The purpose that browsers fill in by themselves, as in HTML's `autocomplete`.
    pub autocomplete: Option<String>,
}

/// What a field accepts.
#[derive(Debug, Clone, PartialEq)]
pub enum FieldKind {
    /// A whole number.
    Integer {
        /// The smallest one.
        min: i64,
        /// The largest one.
        max: i64,
    },
    /// A decimal number.
    Number {
        /// The smallest one.
        min: f64,
        /// The largest one.
        max: f64,
        /// How many digits may follow the decimal point.
        digits: u32,
    },
    /// A line of text.
    Text {
        /// How many characters it may have.
        max_length: usize,
    },
    /// Several lines of text.
    LongText {
        /// How many characters it may have.
        max_length: usize,
    },
    /// One of several options.
    Choice {
        /// The options in order.
        options: Vec<FieldOption>,
        /// Whether there is also the option `other` with own words.
        other: bool,
    },
    /// Several of several options: stored as a list of their ids, in file order.
    Choices {
        /// The options in order.
        options: Vec<FieldOption>,
        /// How many must be chosen by somebody who answers at all.
        min: usize,
        /// How many may be chosen.
        max: usize,
    },
    /// Items that are answered on one scale. Each item's answer stands under the item's id: the number of the point on
    /// the scale, counted from 1, never reversed.
    Likert {
        /// The texts of the points, from the lowest to the highest.
        points: Vec<String>,
        /// What is asked, in order.
        items: Vec<LikertItem>,
    },
}

/// An option of a field with options.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldOption {
    /// The value that the form sends.
    pub id: String,
    /// Its text.
    pub label: String,
    /// Whether choosing it ends the run, because the study looks for other people.
    pub screens_out: bool,
}

/// An item of a scale.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LikertItem {
    /// Its name in the form and in the data.
    pub id: String,
    /// What is asked.
    pub text: String,
    /// Whether agreeing means less of what the scale measures: see [`Field::score`].
    pub reverse: bool,
    /// The point that an instructed-response item asks for.
    pub expected: Option<i64>,
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

    /// The names under which its answers stand in the values of a form, in order: its id, its items' ids, or its id and
    /// the name for own words.
    pub fn value_names(&self) -> Vec<String> {
        match &self.kind {
            FieldKind::Likert { items, .. } => items.iter().map(|item| item.id.clone()).collect(),
            FieldKind::Choice { other: true, .. } => vec![self.id.clone(), self.other_name()],
            FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Text { .. }
            | FieldKind::LongText { .. }
            | FieldKind::Choice { other: false, .. }
            | FieldKind::Choices { .. } => vec![self.id.clone()],
        }
    }

    /// The answer to the item `item` of a scale with n points as a score: the stored point r, or n + 1 − r where the item
    /// is reversed. `None` where this is no such item, or it was left empty.
    pub fn score(&self, item: &str, values: &Map<String, Value>) -> Option<i64> {
        let FieldKind::Likert { points, items } = &self.kind else {
            return None;
        };
        let item = items.iter().find(|known| known.id == item)?;
        let point = values.get(&item.id)?.as_i64()?;
        let of = i64::try_from(points.len()).ok()?;
        Some(if item.reverse { of + 1 - point } else { point })
    }

    /// How many characters a person can write into it.
    pub(in crate::study) fn max_characters(&self) -> usize {
        match &self.kind {
            FieldKind::Text { max_length } | FieldKind::LongText { max_length } => *max_length,
            FieldKind::Choice { other: true, .. } => Self::OTHER_MAX_LENGTH,
            FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Choice { other: false, .. }
            | FieldKind::Choices { .. }
            | FieldKind::Likert { .. } => 0,
        }
    }

    /// Whether it, or an item of its scale, is an instructed-response item.
    pub fn is_attention_check(&self) -> bool {
        match &self.kind {
            FieldKind::Likert { items, .. } => items.iter().any(|item| item.expected.is_some()),
            FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Text { .. }
            | FieldKind::LongText { .. }
            | FieldKind::Choice { .. }
            | FieldKind::Choices { .. } => self.expected.is_some(),
        }
    }

    /// Whether the answers of a form pass this instructed-response item, or all of them on this scale; `None` if there
    /// is none, or one was left empty.
    pub fn passes(&self, values: &Map<String, Value>) -> Option<bool> {
        if let FieldKind::Likert { items, .. } = &self.kind {
            let passed: Option<Vec<bool>> = items
                .iter()
                .filter_map(|item| Some((item, item.expected?)))
                .map(|(item, expected)| Some(values.get(&item.id)?.as_i64() == Some(expected)))
                .collect();
            return passed
                .filter(|passed| !passed.is_empty())
                .map(|passed| passed.iter().all(|passed| *passed));
        }
        let expected = self.expected.as_ref()?;
        values.get(&self.id).map(|value| value == expected)
    }

    /// Whether the answers of a form hold the right one; true for a field without a right answer.
    pub(super) fn is_right(&self, values: &Map<String, Value>) -> bool {
        self.correct
            .as_ref()
            .is_none_or(|correct| values.get(&self.id) == Some(correct))
    }

    /// Whether an option was chosen that ends the run.
    pub(super) fn screens_out(&self, values: &Map<String, Value>) -> bool {
        let given = values.get(&self.id);
        let is_given = |id: &str| match given {
            Some(Value::Array(ids)) => ids.iter().any(|given| given == id),
            Some(one) => one == id,
            None => false,
        };
        self.options()
            .iter()
            .any(|option| option.screens_out && is_given(&option.id))
    }

    /// The options of a field that has some.
    pub fn options(&self) -> &[FieldOption] {
        match &self.kind {
            FieldKind::Choice { options, .. } | FieldKind::Choices { options, .. } => options,
            FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Text { .. }
            | FieldKind::LongText { .. }
            | FieldKind::Likert { .. } => &[],
        }
    }

    /// Reads this field into `values`; left out where it is empty.
    pub(super) fn read(
        &self,
        fields: &Fields,
        words: &Words,
        values: &mut Map<String, Value>,
    ) -> Result<(), Vec<FieldError>> {
        match &self.kind {
            FieldKind::Likert { points, items } => {
                return self.read_items(points.len(), items, fields, words, values);
            }
            FieldKind::Choices { options, min, max } => {
                return self
                    .read_choices(options, *min..=*max, fields, words, values)
                    .map_err(|error| vec![error]);
            }
            FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Text { .. }
            | FieldKind::LongText { .. }
            | FieldKind::Choice { .. } => {}
        }
        let given = fields.get(&self.id).map_or("", |text| text.trim());
        if given.is_empty() {
            return if self.required {
                Err(vec![self.error(&words.needs_answer)])
            } else {
                Ok(())
            };
        }
        self.read_one(given, fields, words, values)
            .map_err(|error| vec![error])
    }

    fn read_one(
        &self,
        given: &str,
        fields: &Fields,
        words: &Words,
        values: &mut Map<String, Value>,
    ) -> Result<(), FieldError> {
        let value = match &self.kind {
            FieldKind::Integer { min, max } => match given.parse::<i64>() {
                Ok(number) if (*min..=*max).contains(&number) => Value::from(number),
                Ok(_) | Err(_) => {
                    return Err(self.error(words.whole_number(*min, *max)));
                }
            },
            FieldKind::Number { min, max, digits } => decimal(given, *digits)
                .filter(|number| (*min..=*max).contains(number))
                .map(Value::from)
                .ok_or_else(|| self.error(words.number(*min, *max, *digits)))?,
            FieldKind::Text { max_length } | FieldKind::LongText { max_length } => {
                Value::from(self.within(given, *max_length, words)?)
            }
            FieldKind::Choice { options, other } => {
                let is_other = *other && given == Self::OTHER;
                if !is_other && !options.iter().any(|option| option.id == given) {
                    return Err(self.error(&words.choose_one));
                }
                if is_other {
                    let own = fields
                        .get(&self.other_name())
                        .map_or("", |text| text.trim());
                    if !own.is_empty() {
                        let own = self.within(own, Self::OTHER_MAX_LENGTH, words)?;
                        values.insert(self.other_name(), Value::from(own));
                    }
                }
                Value::from(given)
            }
            // Read by functions of their own: they are posted under several names, or several times.
            FieldKind::Choices { .. } | FieldKind::Likert { .. } => return Ok(()),
        };
        values.insert(self.id.clone(), value);
        Ok(())
    }

    fn read_choices(
        &self,
        options: &[FieldOption],
        allowed: std::ops::RangeInclusive<usize>,
        fields: &Fields,
        words: &Words,
        values: &mut Map<String, Value>,
    ) -> Result<(), FieldError> {
        let given: Vec<&str> = fields
            .all(&self.id)
            .iter()
            .map(|text| text.trim())
            .filter(|text| !text.is_empty())
            .collect();
        if given.is_empty() {
            return if self.required {
                Err(self.error(&words.needs_answer))
            } else {
                Ok(())
            };
        }
        if !given
            .iter()
            .all(|given| options.iter().any(|option| option.id == *given))
        {
            return Err(self.error(&words.choose_from));
        }
        let chosen: Vec<&str> = options
            .iter()
            .map(|option| option.id.as_str())
            .filter(|id| given.contains(id))
            .collect();
        if !allowed.contains(&chosen.len()) {
            let (min, max) = (*allowed.start(), *allowed.end());
            return Err(self.error(words.choose_some(min, max, options.len())));
        }
        values.insert(self.id.clone(), Value::from(chosen));
        Ok(())
    }

    fn read_items(
        &self,
        points: usize,
        items: &[LikertItem],
        fields: &Fields,
        words: &Words,
        values: &mut Map<String, Value>,
    ) -> Result<(), Vec<FieldError>> {
        let mut errors = Vec::new();
        for item in items {
            let given = fields.get(&item.id).map_or("", |text| text.trim());
            let fault = |message: &str| FieldError {
                field: item.id.clone(),
                message: format!("{message} ({})", item.text),
            };
            match given.parse::<usize>() {
                Ok(point) if (1..=points).contains(&point) => {
                    values.insert(item.id.clone(), Value::from(point));
                }
                Err(_) if given.is_empty() && !self.required => {}
                Err(_) if given.is_empty() => errors.push(fault(&words.line_needs_answer)),
                Ok(_) | Err(_) => errors.push(fault(&words.choose_point)),
            }
        }
        if errors.is_empty() {
            Ok(())
        } else {
            Err(errors)
        }
    }

    /// The text if it is not too long. A form posts a line's end as two characters; the page's own limit and the data
    /// have one.
    fn within(&self, text: &str, max_length: usize, words: &Words) -> Result<String, FieldError> {
        let text = text.replace("\r\n", "\n");
        let length = text.chars().count();
        if length > max_length {
            return Err(self.error(words.too_long(max_length, length)));
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

/// A number in plain decimal notation with at most `digits` digits after the point; a decimal comma is taken as a point.
fn decimal(text: &str, digits: u32) -> Option<f64> {
    let text = text.replace(',', ".");
    let unsigned = text.strip_prefix(['-', '+', '\u{2212}']).unwrap_or(&text);
    let is_negative = text.starts_with(['-', '\u{2212}']);
    let (whole, fraction) = unsigned.split_once('.').unwrap_or((unsigned, ""));
    let are_digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    let is_plain = are_digits(whole)
        && are_digits(fraction)
        && !(whole.is_empty() && fraction.is_empty())
        && u32::try_from(fraction.len()).is_ok_and(|length| length <= digits);
    if !is_plain {
        return None;
    }
    let number: f64 = format!("0{whole}.{fraction}0").parse().ok()?;
    // So that "-0" is the number that it means.
    Some(if is_negative && number != 0.0 {
        -number
    } else {
        number
    })
}

#[cfg(test)]
mod tests;
