//! The step that asks for consent.

use super::{FieldError, Fields, Reply};

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
        }
    }
}

/// Asks for consent. The form's field is `consent` with the value `agree` or `decline`.
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

    pub(super) fn read(&self, fields: &Fields) -> Result<Reply, Vec<FieldError>> {
        match fields.get(Self::FIELD).map(String::as_str) {
            Some(Self::AGREE) => Ok(Reply::Agreed),
            Some(Self::DECLINE) => Ok(Reply::Declined),
            Some(_) | None => Err(vec![FieldError {
                field: Self::FIELD.to_owned(),
                message: format!(
                    "Choose \u{201c}{}\u{201d} or \u{201c}{}\u{201d}.",
                    self.agree, self.decline
                ),
            }]),
        }
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
    };

    fn read(value: Option<&str>) -> Result<Reply, Vec<FieldError>> {
        STEP.read(
            &value
                .map(|value| ("consent".to_owned(), value.to_owned()))
                .into_iter()
                .collect(),
        )
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
