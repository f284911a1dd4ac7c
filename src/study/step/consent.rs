//! The step that asks for consent.

use std::collections::BTreeMap;

use super::{FieldError, Fields, Reply};
use crate::study::Words;

/// A consent step as the study file words it.
#[derive(Debug, Clone)]
pub(in crate::study) struct ConsentText {
    pub(in crate::study) version: String,
    pub(in crate::study) title: String,
    pub(in crate::study) text_html: String,
    pub(in crate::study) agree: String,
    pub(in crate::study) decline: String,
    pub(in crate::study) declined_title: String,
    pub(in crate::study) declined_text_html: String,
    pub(in crate::study) clauses: Vec<Clause>,
}

/// Something that is agreed to apart, by ticking it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Clause {
    /// Its name in the data.
    pub id: String,
    /// What is agreed to.
    pub text: String,
    /// Whether nobody takes part without it.
    pub required: bool,
}

impl ConsentText {
    pub(in crate::study) fn step(&self) -> ConsentStep<'_> {
        ConsentStep {
            version: &self.version,
            title: &self.title,
            text_html: &self.text_html,
            agree: &self.agree,
            decline: &self.decline,
            declined: DeclinedPage {
                title: &self.declined_title,
                text_html: &self.declined_text_html,
            },
            clauses: &self.clauses,
        }
    }
}

/// Asks for consent. The form's field is `consent` with the value `agree` or `decline`; `clause` holds the ids of the
/// clauses that are ticked.
#[derive(Debug, Clone, Copy)]
pub struct ConsentStep<'a> {
    /// The version of the text, stored with the answer.
    pub version: &'a str,
    /// The heading.
    pub title: &'a str,
    /// The text as HTML.
    pub text_html: &'a str,
    /// The button that agrees.
    pub agree: &'a str,
    /// The button that declines.
    pub decline: &'a str,
    /// What a person who declined sees.
    pub declined: DeclinedPage<'a>,
    /// What is agreed to apart; mostly nothing.
    pub clauses: &'a [Clause],
}

/// What a person who declined sees.
#[derive(Debug, Clone, Copy)]
pub struct DeclinedPage<'a> {
    /// The heading.
    pub title: &'a str,
    /// The text as HTML.
    pub text_html: &'a str,
}

impl ConsentStep<'_> {
    /// The form field that carries the decision.
    pub const FIELD: &'static str = "consent";
    /// The value that agrees.
    pub const AGREE: &'static str = "agree";
    /// The value that declines.
    pub const DECLINE: &'static str = "decline";
    /// The form field that carries the ticked clauses.
    pub const CLAUSE: &'static str = "clause";

    pub(super) fn read(&self, fields: &Fields, words: &Words) -> Result<Reply, Vec<FieldError>> {
        match fields.get(Self::FIELD).map(String::as_str) {
            Some(Self::AGREE) if self.clauses.is_empty() => Ok(Reply::Agreed),
            Some(Self::AGREE) => self.agreed_to(fields, words),
            Some(Self::DECLINE) => Ok(Reply::Declined),
            Some(_) | None => Err(vec![FieldError {
                field: Self::FIELD.to_owned(),
                message: words.choose_decision(self.agree, self.decline),
            }]),
        }
    }

    fn agreed_to(&self, fields: &Fields, words: &Words) -> Result<Reply, Vec<FieldError>> {
        let is_ticked = |clause: &Clause| fields.all(Self::CLAUSE).contains(&clause.id);
        let missing: Vec<FieldError> = self
            .clauses
            .iter()
            .filter(|clause| clause.required && !is_ticked(clause))
            .map(|clause| FieldError {
                field: format!("clause-{}", clause.id),
                message: words.clause_missing(&clause.text),
            })
            .collect();
        if !missing.is_empty() {
            return Err(missing);
        }
        let clauses: BTreeMap<String, bool> = self
            .clauses
            .iter()
            .map(|clause| (clause.id.clone(), is_ticked(clause)))
            .collect();
        Ok(Reply::AgreedTo { clauses })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: ConsentStep<'static> = ConsentStep {
        version: "1",
        title: "",
        text_html: "",
        agree: "Yes",
        decline: "No",
        declined: DeclinedPage {
            title: "",
            text_html: "",
        },
        clauses: &[],
    };

    fn read(value: Option<&str>) -> Result<Reply, Vec<FieldError>> {
        STEP.read(
            &value
                .map(|value| ("consent".to_owned(), value.to_owned()))
                .into_iter()
                .collect(),
            &Words::english(),
        )
    }

    fn posts(posted: &[(&str, &str)]) -> Fields {
        posted
            .iter()
            .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()))
            .collect()
    }

    #[test]
    fn agreement_needs_the_required_clauses_and_says_which_were_ticked() {
        let clause = |id: &str, required| Clause {
            id: id.to_owned(),
            text: format!("text of {id}"),
            required,
        };
        let clauses = [clause("adult", true), clause("archive", false)];
        let step = ConsentStep {
            clauses: &clauses,
            ..STEP
        };
        let errors = step
            .read(
                &posts(&[("consent", "agree"), ("clause", "archive")]),
                &Words::english(),
            )
            .unwrap_err();
        assert_eq!(errors.len(), 1);
        assert_eq!(errors[0].field, "clause-adult");
        let agreed = step.read(
            &posts(&[("consent", "agree"), ("clause", "adult")]),
            &Words::english(),
        );
        let expected = [("adult".to_owned(), true), ("archive".to_owned(), false)];
        assert_eq!(
            agreed,
            Ok(Reply::AgreedTo {
                clauses: expected.into()
            })
        );
        let declined = step.read(&posts(&[("consent", "decline")]), &Words::english());
        assert_eq!(declined, Ok(Reply::Declined));
    }

    #[test]
    fn only_a_plain_decision_is_a_reply() {
        assert_eq!(read(Some("agree")), Ok(Reply::Agreed));
        assert_eq!(read(Some("decline")), Ok(Reply::Declined));
        for nonsense in [None, Some(""), Some("Agree"), Some("yes")] {
            let errors = read(nonsense).unwrap_err();
            assert_eq!(errors[0].to_string(), "consent: Choose “Yes” or “No”.");
        }
    }
}
