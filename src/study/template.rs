//! Placeholders in texts, and the values that fill them.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde::de::{self, Deserializer, Visitor};

use super::document::{did_you_mean, list};

/// The longest text in bytes, placeholders filled in. Values within values could grow a short file without end.
const LONGEST: usize = 100_000;

/// How many placeholders a text may hold, those inside values included: even values that add nothing cost time.
const MOST_PLACEHOLDERS: usize = 1_000;

/// A number or a text, as the file gives it.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Scalar {
    Number(f64),
    Text(String),
}

/// Values by name.
pub(super) type Values = BTreeMap<String, Scalar>;

impl fmt::Display for Scalar {
    /// Numbers are as short as they can be: `50`, `0.05`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // Adding 0 turns −0 into 0.
            Self::Number(number) => write!(f, "{}", number + 0.0),
            Self::Text(text) => f.write_str(text),
        }
    }
}

impl<'de> Deserialize<'de> for Scalar {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ScalarVisitor)
    }
}

struct ScalarVisitor;

impl Visitor<'_> for ScalarVisitor {
    type Value = Scalar;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number or a text")
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<Scalar, E> {
        Ok(Scalar::Number(number as f64))
    }

    fn visit_f64<E: de::Error>(self, number: f64) -> Result<Scalar, E> {
        if number.is_finite() {
            Ok(Scalar::Number(number))
        } else {
            Err(E::invalid_value(
                de::Unexpected::Float(number),
                &"a finite number or a text",
            ))
        }
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Scalar, E> {
        Ok(Scalar::Text(text.to_owned()))
    }
}

/// The values that hold at one place of the file. Later layers override earlier ones.
#[derive(Debug, Clone, Default)]
pub(super) struct Scope<'a> {
    layers: Vec<&'a Values>,
}

impl<'a> Scope<'a> {
    /// This scope with one more layer on top.
    pub(super) fn with(&self, layer: &'a Values) -> Self {
        Self {
            layers: self.layers.iter().copied().chain([layer]).collect(),
        }
    }

    /// The value of `name`.
    pub(super) fn get(&self, name: &str) -> Option<&'a Scalar> {
        self.layers.iter().rev().find_map(|layer| layer.get(name))
    }

    /// Fills in all placeholders of `text`, those inside values included.
    pub(super) fn fill(&self, text: &str) -> Result<String, TemplateError> {
        let mut filling = Filling::default();
        self.fill_into(text, &mut filling)?;
        Ok(filling.text)
    }

    fn fill_into(&self, text: &str, filling: &mut Filling) -> Result<(), TemplateError> {
        let mut rest = text;
        while let Some(position) = rest.find(['{', '}']) {
            filling.text.push_str(&rest[..position]);
            rest = &rest[position..];
            if let Some(after) = rest.strip_prefix("{{") {
                filling.text.push('{');
                rest = after;
            } else if let Some(after) = rest.strip_prefix("}}") {
                filling.text.push('}');
                rest = after;
            } else if let Some(after) = rest.strip_prefix('{') {
                let (name, after) = after.split_once('}').ok_or(TemplateError::Unclosed)?;
                self.fill_name(name, filling)?;
                rest = after;
            } else {
                return Err(TemplateError::Unopened);
            }
        }
        filling.text.push_str(rest);
        if filling.text.len() > LONGEST {
            return Err(TemplateError::TooLong);
        }
        Ok(())
    }

    fn fill_name(&self, name: &str, filling: &mut Filling) -> Result<(), TemplateError> {
        filling.placeholders += 1;
        if filling.placeholders > MOST_PLACEHOLDERS {
            return Err(TemplateError::TooLong);
        }
        let Some(value) = self.get(name) else {
            return Err(TemplateError::Unknown {
                name: name.to_owned(),
                known: self.names(),
            });
        };
        if filling.open.iter().any(|outer| outer == name) {
            return Err(TemplateError::Cycle {
                name: name.to_owned(),
            });
        }
        match value {
            Scalar::Number(_) => filling.text.push_str(&value.to_string()),
            Scalar::Text(text) => {
                filling.open.push(name.to_owned());
                self.fill_into(text, filling)?;
                filling.open.pop();
            }
        }
        Ok(())
    }

    fn names(&self) -> Vec<String> {
        let names: std::collections::BTreeSet<&String> =
            self.layers.iter().flat_map(|layer| layer.keys()).collect();
        names.into_iter().cloned().collect()
    }
}

/// A text while its placeholders are filled in.
#[derive(Default)]
struct Filling {
    text: String,
    /// The names whose values are being filled in, outermost first.
    open: Vec<String>,
    placeholders: usize,
}

/// Why a text's placeholders cannot be filled in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum TemplateError {
    Unknown { name: String, known: Vec<String> },
    Cycle { name: String },
    Unclosed,
    Unopened,
    TooLong,
}

impl TemplateError {
    pub(super) fn found(&self) -> String {
        match self {
            Self::Unknown { name, known } => {
                format!(
                    "placeholder `{{{name}}}` has no value here{}",
                    did_you_mean(name, known.iter().map(String::as_str))
                )
            }
            Self::Cycle { name } => format!("placeholder `{{{name}}}` contains itself"),
            Self::Unclosed => "`{` that is never closed".to_owned(),
            Self::Unopened => "`}` without a `{` before it".to_owned(),
            Self::TooLong => {
                "a text that is too long once its placeholders are filled in".to_owned()
            }
        }
    }

    pub(super) fn allowed(&self) -> String {
        match self {
            Self::Unknown { known, .. } => list(known),
            Self::Cycle { .. } => "values that do not refer to themselves".to_owned(),
            Self::TooLong => {
                format!("at most {LONGEST} bytes and {MOST_PLACEHOLDERS} placeholders")
            }
            Self::Unclosed | Self::Unopened => {
                "`{name}` for a value, `{{` and `}}` for the signs themselves".to_owned()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn values(entries: &[(&str, Scalar)]) -> Values {
        entries
            .iter()
            .map(|(name, value)| ((*name).to_owned(), value.clone()))
            .collect()
    }

    fn text(text: &str) -> Scalar {
        Scalar::Text(text.to_owned())
    }

    #[track_caller]
    fn check(template: &str, expected: Result<&str, TemplateError>) {
        let study = values(&[
            ("fine", Scalar::Number(50.0)),
            ("p", Scalar::Number(0.05)),
            ("zero", Scalar::Number(-0.0)),
            ("odds", text("{count} of {all} cars")),
            ("all", Scalar::Number(380.0)),
            ("loop", text("a {again}")),
            ("again", text("b {loop}")),
        ]);
        let level = values(&[
            ("count", Scalar::Number(19.0)),
            ("fine", Scalar::Number(75.5)),
        ]);
        let scope = Scope::default().with(&study).with(&level);
        assert_eq!(
            scope.fill(template),
            expected.map(str::to_owned),
            "{template}"
        );
    }

    #[test]
    fn placeholders_take_the_innermost_value_in_its_shortest_form() {
        check("", Ok(""));
        check("no signs", Ok("no signs"));
        check("${fine}, p = {p}, {zero}", Ok("$75.5, p = 0.05, 0"));
        check("{odds}{odds}", Ok("19 of 380 cars19 of 380 cars"));
        check("{{fine}} {{ }}", Ok("{fine} { }"));
        check("Ü {all} é", Ok("Ü 380 é"));
    }

    #[test]
    fn values_within_values_cannot_grow_without_end() {
        let doubling: Values = (0..60)
            .map(|level| {
                (
                    format!("v{level}"),
                    text(&format!("{{v{0}}}{{v{0}}}", level + 1)),
                )
            })
            .chain([("v60".to_owned(), text(""))])
            .collect();
        assert_eq!(
            Scope::default().with(&doubling).fill("{v0}"),
            Err(TemplateError::TooLong)
        );
    }

    proptest! {
        #[test]
        fn escaped_text_comes_back_as_it_was(text: String) {
            let escaped = text.replace('{', "{{").replace('}', "}}");
            prop_assert_eq!(Scope::default().fill(&escaped), Ok(text));
        }
    }

    #[test]
    fn what_cannot_be_filled_is_refused() {
        check(
            "{loop}",
            Err(TemplateError::Cycle {
                name: "loop".to_owned(),
            }),
        );
        check("a {fine", Err(TemplateError::Unclosed));
        check("a } b", Err(TemplateError::Unopened));
        let scope = Scope::default();
        let unknown = scope.fill("{fin}").unwrap_err();
        assert_eq!(unknown.found(), "placeholder `{fin}` has no value here");
        let study = values(&[("fine", Scalar::Number(50.0))]);
        let unknown = scope.with(&study).fill("{fin}").unwrap_err();
        assert_eq!(
            unknown.found(),
            "placeholder `{fin}` has no value here, did you mean `fine`?"
        );
        assert_eq!(unknown.allowed(), "`fine`");
    }
}
