//! The step that shows replays of towers being built.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::{FieldError, Fields, Reply, StepError};
use crate::planning::table::Replay;
use crate::study::definition::Order;
use crate::study::{BlockId, ReplayId, StepPlan, Words};

/// A replays step as the study file words it.
#[derive(Debug, Clone)]
pub(in crate::study) struct ReplaysText {
    pub(in crate::study) title: String,
    pub(in crate::study) text_html: String,
    pub(in crate::study) button: String,
    pub(in crate::study) order: Order,
    pub(in crate::study) replays: Vec<NamedReplay>,
}

/// A replay under the name that answers and links carry.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NamedReplay {
    /// Its name: tower, outcome and seed, such as `unstable-falls-7`.
    pub id: ReplayId,
    /// What is played.
    pub replay: Replay,
}

/// Shows replays, all of which are to be watched to the end. The form's field `viewings` holds [`Viewing`]s as JSON;
/// a page without scripts sends it empty.
#[derive(Debug, Clone)]
pub struct ReplaysStep<'a> {
    /// The heading.
    pub title: &'a str,
    /// The text as HTML.
    pub text_html: &'a str,
    /// The button's text.
    pub button: &'a str,
    /// The replays in the order of this run.
    pub replays: Vec<&'a NamedReplay>,
}

/// How one replay was watched, as the page says. The server checks that all were watched and that time enough has
/// passed; the rest is the page's word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Viewing {
    /// Which one.
    pub replay: ReplayId,
    /// When it was first started, in milliseconds since the page was opened.
    pub started_ms: u64,
    /// When its end was first seen, in milliseconds since the page was opened.
    pub seen_ms: u64,
    /// How often it was played to the end.
    pub plays: u32,
    /// Whether it was shown as still frames, for somebody who asked for less motion.
    pub stills: bool,
}

impl<'a> ReplaysStep<'a> {
    pub(super) fn new(
        block: &BlockId,
        text: &'a ReplaysText,
        plan: &StepPlan,
    ) -> Result<Self, StepError> {
        let replays: Option<Vec<&NamedReplay>> = plan
            .data
            .replays
            .iter()
            .map(|id| text.replays.iter().find(|replay| replay.id == *id))
            .collect();
        let distinct: BTreeSet<&ReplayId> = plan.data.replays.iter().collect();
        let replays = replays
            .filter(|replays| replays.len() == text.replays.len())
            .filter(|replays| replays.len() == distinct.len())
            .ok_or_else(|| StepError::Replays {
                block: block.clone(),
                replays: plan.data.replays.clone(),
            })?;
        Ok(Self {
            title: &text.title,
            text_html: &text.text_html,
            button: &text.button,
            replays,
        })
    }

    pub(super) fn read(&self, fields: &Fields, words: &Words) -> Result<Reply, Vec<FieldError>> {
        let viewings = match fields.get("viewings").map(|text| text.trim()) {
            None | Some("") => Vec::new(),
            Some(text) => self
                .viewings(text, words)
                .map_err(|message| vec![unwatched(message)])?,
        };
        Ok(Reply::Watched { viewings })
    }

    /// One viewing for each replay, in any order.
    fn viewings(&self, text: &str, words: &Words) -> Result<Vec<Viewing>, String> {
        let of = self.replays.len();
        let viewings: Vec<Viewing> =
            serde_json::from_str(text).map_err(|_| words.viewings_unreadable(of))?;
        let watched: BTreeSet<&ReplayId> = viewings
            .iter()
            .filter(|viewing| viewing.plays > 0 && viewing.started_ms < viewing.seen_ms)
            .map(|viewing| &viewing.replay)
            .filter(|id| self.replays.iter().any(|shown| shown.id == **id))
            .collect();
        if watched.len() < of {
            return Err(words.viewings_missing(watched.len(), of));
        }
        if viewings.len() > of {
            return Err(words.viewings_extra(viewings.len(), of));
        }
        Ok(viewings)
    }
}

/// The message about replays that were not watched.
fn unwatched(message: String) -> FieldError {
    FieldError {
        field: "viewings".to_owned(),
        message,
    }
}
