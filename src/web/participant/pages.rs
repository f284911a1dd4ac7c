//! What each participant page shows.

use crate::{
    store::{StepView, Token},
    study::{
        EndingPage, ReplayId, StepPlan, Study, Timestamp, Words,
        step::{
            ChoiceStep, Clause, ConsentStep, Field, FieldError, FieldKind, FieldOption, Fields,
            FormStep, InfoStep, LikertItem, ReplaysStep,
        },
    },
    web::assets,
};
use askama::{
    Template,
    filters::{Html, escape},
};
use askama_web::WebTemplate;

/// What every step's page needs to know of its run.
pub(super) struct RunLink<'a> {
    pub words: &'a Words,
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
    words: Words,
    others: Vec<OtherLanguage>,
    title: String,
    summary: String,
    minutes: u32,
    study: String,
    door: Door,
}

/// Another language in which the study can be taken.
struct OtherLanguage {
    tag: String,
    /// Its name in itself.
    name: String,
}

/// How a landing page leads into its study.
pub(super) enum Door {
    /// By the button that starts it.
    Start {
        token: Token,
        is_preview: bool,
        /// The language to start in, where it is another one than that of the link that was followed.
        language: Option<String>,
    },
    /// Not yet: the task on MTurk has to be accepted first.
    AcceptFirst,
}

impl LandingPage {
    /// The page in `language`, or in that of the study's file.
    pub(super) fn of(study: &Study, language: Option<&str>, door: Door) -> Self {
        let shown = language.map_or(study, |language| study.in_language(language));
        let others = study.languages().iter();
        let others = others
            .filter(|tag| *tag != shown.language())
            .map(|tag| OtherLanguage {
                tag: tag.clone(),
                name: study.in_language(tag).words().language_name.clone(),
            })
            .collect();
        let study = shown;
        Self {
            words: study.words().clone(),
            others,
            title: study.title().to_owned(),
            summary: study.summary().to_owned(),
            minutes: study.minutes(),
            study: study.id().to_string(),
            door,
        }
    }
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/consent.html")]
pub(super) struct ConsentPage<'a> {
    pub run: RunLink<'a>,
    pub text: ConsentStep<'a>,
    pub rejected: Rejected,
}

impl ConsentPage<'_> {
    fn errors(&self) -> &[FieldError] {
        &self.rejected.errors
    }

    fn is_ticked(&self, clause: &Clause) -> bool {
        self.rejected
            .fields
            .all(ConsentStep::CLAUSE)
            .contains(&clause.id)
    }

    fn error_of(&self, clause: &Clause) -> bool {
        let field = format!("clause-{}", clause.id);
        self.rejected
            .errors
            .iter()
            .any(|error| error.field == field)
    }
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/info.html")]
pub(super) struct InfoPage<'a> {
    pub run: RunLink<'a>,
    pub text: InfoStep<'a>,
    pub scene: Option<String>,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/replays.html")]
pub(super) struct ReplaysPage<'a> {
    pub run: RunLink<'a>,
    pub text: ReplaysStep<'a>,
    /// In the order of this run.
    pub replays: Vec<ReplayView>,
    pub scene: Option<String>,
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
    /// The lines under the picture, as JSON.
    pub captions: String,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/choice.html")]
pub(super) struct ChoicePage<'a> {
    pub run: RunLink<'a>,
    pub question: ChoiceStep<'a>,
    pub scene: Option<String>,
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
    /// What is said after a wrong attempt at a comprehension check, as HTML.
    hint_html: Option<&'a str>,
}

impl<'a> FormPage<'a> {
    /// `attempts` were made before, all of them wrong.
    pub(super) fn new(
        run: RunLink<'a>,
        text: FormStep<'a>,
        attempts: u32,
        rejected: &'a Rejected,
    ) -> Self {
        let fields = text
            .fields
            .iter()
            .map(|field| FieldView { field, rejected })
            .collect();
        let check = text.check.filter(|_| attempts > 0);
        Self {
            run,
            text,
            fields,
            errors: &rejected.errors,
            hint_html: check.map(|check| check.hint_html.as_str()),
        }
    }
}

/// A form field with what was typed into it before.
struct FieldView<'a> {
    field: &'a Field,
    rejected: &'a Rejected,
}

impl FieldView<'_> {
    fn options(&self) -> &[FieldOption] {
        self.field.options()
    }

    fn has_options(&self) -> bool {
        matches!(
            self.field.kind,
            FieldKind::Choice { .. } | FieldKind::Choices { .. }
        )
    }

    /// The kind of button beside each option.
    fn button(&self) -> &'static str {
        match self.field.kind {
            FieldKind::Choices { .. } => "checkbox",
            FieldKind::Choice { .. }
            | FieldKind::Likert { .. }
            | FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Text { .. }
            | FieldKind::LongText { .. } => "radio",
        }
    }

    fn is_chosen(&self, option: &str) -> bool {
        let posted = self.rejected.fields.all(&self.field.id);
        posted.iter().any(|posted| posted == option)
    }

    fn takes_other(&self) -> bool {
        matches!(self.field.kind, FieldKind::Choice { other: true, .. })
    }

    fn value(&self) -> &str {
        typed(self.rejected, &self.field.id)
    }

    fn other(&self) -> &str {
        typed(self.rejected, &self.field.other_name())
    }

    fn error(&self) -> Option<&str> {
        error_of(self.rejected, &self.field.id)
    }

    /// The keys that phones show for it.
    fn keys(&self) -> Option<&'static str> {
        match self.field.kind {
            FieldKind::Integer { .. } => Some("numeric"),
            FieldKind::Number { .. } => Some("decimal"),
            FieldKind::Text { .. }
            | FieldKind::LongText { .. }
            | FieldKind::Choice { .. }
            | FieldKind::Choices { .. }
            | FieldKind::Likert { .. } => None,
        }
    }

    fn is_long(&self) -> bool {
        matches!(self.field.kind, FieldKind::LongText { .. })
    }

    fn max_length(&self) -> usize {
        match self.field.kind {
            FieldKind::Integer { .. } | FieldKind::Number { .. } => 20,
            FieldKind::Text { max_length } | FieldKind::LongText { max_length } => max_length,
            FieldKind::Choice { .. } | FieldKind::Choices { .. } | FieldKind::Likert { .. } => {
                Field::OTHER_MAX_LENGTH
            }
        }
    }

    fn points(&self) -> &[String] {
        match &self.field.kind {
            FieldKind::Likert { points, .. } => points,
            FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Text { .. }
            | FieldKind::LongText { .. }
            | FieldKind::Choice { .. }
            | FieldKind::Choices { .. } => &[],
        }
    }

    fn items(&self) -> &[LikertItem] {
        match &self.field.kind {
            FieldKind::Likert { items, .. } => items,
            FieldKind::Integer { .. }
            | FieldKind::Number { .. }
            | FieldKind::Text { .. }
            | FieldKind::LongText { .. }
            | FieldKind::Choice { .. }
            | FieldKind::Choices { .. } => &[],
        }
    }

    fn error_of(&self, item: &LikertItem) -> Option<&str> {
        error_of(self.rejected, &item.id)
    }

    fn is_point(&self, item: &LikertItem, point: &usize) -> bool {
        typed(self.rejected, &item.id) == point.to_string()
    }
}

fn typed<'a>(rejected: &'a Rejected, name: &str) -> &'a str {
    rejected.fields.get(name).map_or("", String::as_str)
}

fn error_of<'a>(rejected: &'a Rejected, field: &str) -> Option<&'a str> {
    let mut errors = rejected.errors.iter();
    errors
        .find(|error| error.field == field)
        .map(|error| error.message.as_str())
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/thanks.html")]
pub(super) struct ThanksPage<'a> {
    pub words: &'a Words,
    pub token: &'a Token,
    pub ending: &'a EndingPage,
    pub outcome: Outcome,
    pub is_preview: bool,
    /// What the code is called.
    pub code_label: &'a str,
    /// Whom to ask for what this link may not do.
    pub contact: &'a str,
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
        code: Option<String>,
        way_back: Option<WayBack>,
        stored: u32,
        bonus: Option<Box<BonusText>>,
    },
    /// To another link of the same person.
    AlreadyTaken,
}

impl Outcome {
    /// Whether the page has a form that is sent to MTurk.
    pub(super) fn is_submitted(&self) -> bool {
        match self {
            Self::Finished { way_back, .. } => matches!(way_back, Some(WayBack::Submit(_))),
            Self::AlreadyTaken => false,
        }
    }
}

/// How a person gets back to the site that sent them.
pub(super) enum WayBack {
    /// By a link.
    Link(String),
    /// By a form that hands the finished assignment to MTurk.
    Submit(ExternalSubmit),
}

/// What MTurk is told of a finished assignment.
pub(super) struct ExternalSubmit {
    /// The site that takes it.
    pub site: String,
    pub assignment: String,
    pub ending: &'static str,
}

/// The bonus in words.
pub(super) struct BonusText {
    /// With its currency.
    pub amount: String,
    /// The choice that it comes from; none where there was none to draw.
    pub choice: Option<PaidChoiceText>,
}

/// The choice that a bonus comes from, in words.
pub(super) struct PaidChoiceText {
    /// The heading of the question.
    pub question: String,
    /// Which question of its block it was, such as `question 2 of 5`.
    pub place: String,
    /// What was chosen.
    pub action: String,
    /// The reward that came out, with its unit.
    pub reward: String,
    /// How the amount follows from it.
    pub sum: String,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/note.html")]
pub(super) struct NotePage {
    pub language: String,
    pub title: String,
    pub text_html: String,
}

#[derive(Template, WebTemplate)]
#[template(path = "participant/withdraw.html")]
pub(super) struct WithdrawPage {
    pub words: Words,
    pub token: Token,
    /// Whether the run is over, so that its person cannot begin again.
    pub has_ended: bool,
}

/// A drawn scene, to stand inside the page, told in the page's language to whoever does not see it.
pub(super) fn scene(id: Option<&str>, words: &Words) -> Option<String> {
    let id = id?;
    let drawing = assets::text(&format!("scenes/{id}.svg"))?;
    let (title, description) = words.of_scene(id).unwrap_or_default();
    let escaped = |text: &str| match escape(text, Html) {
        Ok(text) => text.to_string(),
        Err(never) => match never {},
    };
    let drawing = drawing.replace("{title}", &escaped(title));
    Some(drawing.replace("{description}", &escaped(description)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_told_in_words() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/static/scenes");
        for file in std::fs::read_dir(folder).unwrap() {
            let path = file.unwrap().path();
            let id = path.file_stem().unwrap().to_str().unwrap();
            let words = Words::of_languages(["de"]);
            let (title, description) = words.of_scene(id).expect(id);
            let drawn = scene(Some(id), &words).expect(id);
            assert!(drawn.contains(&format!(">{title}</title>")), "{id}");
            assert!(drawn.contains(&format!(">{description}</desc>")), "{id}");
        }
    }
}
