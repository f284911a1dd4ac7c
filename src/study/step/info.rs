//! The step that tells something.

use crate::study::{FactorId, LevelId};

/// An info step as the study file words it.
#[derive(Debug, Clone)]
pub(in crate::study) struct InfoText {
    pub(in crate::study) title: String,
    pub(in crate::study) text_html: String,
    pub(in crate::study) scene: Option<String>,
    pub(in crate::study) button: String,
    /// The conditions that meet it; everybody does where it is empty.
    pub(in crate::study) when: Vec<(FactorId, LevelId)>,
}

impl InfoText {
    pub(super) fn step(&self) -> InfoStep<'_> {
        InfoStep {
            title: &self.title,
            text_html: &self.text_html,
            scene: self.scene.as_deref(),
            button: &self.button,
        }
    }
}

/// Tells something; a button goes on. Before a timed block it is the page from which the person starts the clock.
#[derive(Debug, Clone, Copy)]
pub struct InfoStep<'a> {
    /// The heading.
    pub title: &'a str,
    /// The text as HTML.
    pub text_html: &'a str,
    /// The drawn scene beside the text.
    pub scene: Option<&'a str>,
    /// The button's text.
    pub button: &'a str,
}
