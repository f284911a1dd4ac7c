//! What each participant page shows.

use std::collections::BTreeMap;

use crate::{
    store::{StepView, Token},
    study::{
        Completion, ReplayId, StepPlan, Timestamp,
        step::{
            ChoiceStep, ConsentStep, Field, FieldError, FieldKind, FieldOption, Fields, FormStep,
            InfoStep, ReplaysStep,
        },
    },
    web::assets,
};
use askama::Template;
use askama_web::WebTemplate;

/// What every step's page needs to know of its run.
pub(super) struct RunLink<'a> {
    pub token: &'a Token,
    pub is_owner: bool,
    /// Nothing that is done here counts.
    pub is_preview: bool,
    pub position: u32,
    /// The idempotency key of this rendering's form.
    pub key: String,
    pub plan: &'a StepPlan,
}

/// The clock of a timed question as it stands when the page is made.
#[derive(Clone, Copy)]
pub(super) struct PageClock {
    pub remaining_ms: u64,
    pub limit_ms: u64,
    /// Until the server closes the question by itself.
    pub closes_in_ms: u64,
}

impl PageClock {
    /// The clock of a step at `now`; none for one without a limit.
    pub(super) fn of(step: &StepView, now: Timestamp) -> Option<Self> {
        let (limit_ms, shown_at, deadline) = (step.limit_ms?, step.shown_at?, step.deadline?);
        Some(Self {
            remaining_ms: limit_ms.saturating_sub(now.millis_since(shown_at)),
            limit_ms,
            closes_in_ms: deadline.millis_since(now),
        })
    }

    fn remaining_s(self) -> u64 {
        self.remaining_ms.div_ceil(1000)
    }

    /// When a page without scripts asks for the next question: just after the server closed this one.
    fn refresh_s(self) -> u64 {
        self.closes_in_ms.div_ceil(1000) + 1
    }
}

/// A form that was sent back with messages.
#[derive(Default)]
pub(super) struct Rejected {
    pub fields: Fields,
    pub errors: Vec<FieldError>,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/landing.html")]
pub(super) struct LandingPage {
    pub title: String,
    pub summary: String,
    pub minutes: u32,
    pub study: String,
    pub token: Token,
    pub is_preview: bool,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/consent.html")]
pub(super) struct ConsentPage<'a> {
    pub run: RunLink<'a>,
    pub text: ConsentStep<'a>,
    pub errors: Vec<FieldError>,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/info.html")]
pub(super) struct InfoPage<'a> {
    pub run: RunLink<'a>,
    pub text: InfoStep<'a>,
    pub scene: Option<&'static str>,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/replays.html")]
pub(super) struct ReplaysPage<'a> {
    pub run: RunLink<'a>,
    pub text: ReplaysStep<'a>,
    /// In the order of this run.
    pub replays: Vec<ReplayView>,
    /// How long they last together: nobody goes on before.
    pub seconds: u64,
    pub errors: Vec<FieldError>,
}

/// A replay as its page lists it.
pub(super) struct ReplayView {
    pub id: ReplayId,
    pub url: String,
    /// What happens in it, for a page without scripts and for the transcript.
    pub description: String,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/choice.html")]
pub(super) struct ChoicePage<'a> {
    pub run: RunLink<'a>,
    pub question: ChoiceStep<'a>,
    pub scene: Option<&'static str>,
    pub clock: Option<PageClock>,
    pub errors: Vec<FieldError>,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/form.html")]
pub(super) struct FormPage<'a> {
    run: RunLink<'a>,
    text: FormStep<'a>,
    fields: Vec<FieldView<'a>>,
    errors: &'a [FieldError],
}

impl<'a> FormPage<'a> {
    pub(super) fn new(run: RunLink<'a>, text: FormStep<'a>, rejected: &'a Rejected) -> Self {
        let fields = text
            .fields
            .iter()
            .map(|field| view(field, &rejected.fields, &rejected.errors))
            .collect();
        Self {
            run,
            text,
            fields,
            errors: &rejected.errors,
        }
    }
}

/// A form field with what was typed into it before.
struct FieldView<'a> {
    field: &'a Field,
    value: &'a str,
    other: &'a str,
    error: Option<&'a str>,
}

impl FieldView<'_> {
    fn options(&self) -> &[FieldOption] {
        match &self.field.kind {
            FieldKind::Choice { options, .. } => options,
            FieldKind::Integer { .. } | FieldKind::Text { .. } => &[],
        }
    }

    fn takes_other(&self) -> bool {
        match self.field.kind {
            FieldKind::Choice { other, .. } => other,
            FieldKind::Integer { .. } | FieldKind::Text { .. } => false,
        }
    }

    /// Phones show their number keys for it.
    fn is_number(&self) -> bool {
        matches!(self.field.kind, FieldKind::Integer { .. })
    }

    fn max_length(&self) -> usize {
        match self.field.kind {
            FieldKind::Integer { .. } => 20,
            FieldKind::Text { max_length } => max_length,
            FieldKind::Choice { .. } => Field::OTHER_MAX_LENGTH,
        }
    }
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/thanks.html")]
pub(super) struct ThanksPage<'a> {
    pub token: &'a Token,
    pub completion: &'a Completion,
    pub outcome: Outcome,
    pub is_preview: bool,
    /// How to withdraw later, for the link that may.
    pub withdrawal: Option<LaterWithdrawal>,
}

/// Where and until when somebody who has finished can withdraw.
pub(super) struct LaterWithdrawal {
    /// The address to keep.
    pub address: String,
    /// The last day, where the study names one.
    pub until: Option<String>,
}

/// What the last page tells about the run.
pub(super) enum Outcome {
    /// To the link that finished it.
    Finished {
        code: String,
        redirect: Option<String>,
        stored: u32,
    },
    /// To another link of the same person.
    AlreadyTaken,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/note.html")]
pub(super) struct NotePage {
    pub title: String,
    pub text_html: String,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/withdraw.html")]
pub(super) struct WithdrawPage {
    pub token: Token,
}

fn view<'a>(
    field: &'a Field,
    typed: &'a BTreeMap<String, String>,
    errors: &'a [FieldError],
) -> FieldView<'a> {
    let typed = |name: &str| typed.get(name).map_or("", String::as_str);
    FieldView {
        value: typed(&field.id),
        other: typed(&field.other_name()),
        error: errors
            .iter()
            .find(|error| error.field == field.id)
            .map(|error| error.message.as_str()),
        field,
    }
}

/// A drawn scene, to stand inside the page.
pub(super) fn scene(id: Option<&str>) -> Option<&'static str> {
    assets::text(&format!("scenes/{}.svg", id?))
}
