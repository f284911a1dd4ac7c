//! Leaving a participant out of the analysis by hand, and taking them in again.

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Form, Path, State},
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;

use super::{
    super::{
        Error,
        access::{self, Caller, Written},
        accounts::Who,
        assets,
    },
    Head, Parts, current, words,
};
use crate::{
    store::{ExclusionReason, RunId, RunState},
    study::{Flag, StudyId},
};

#[derive(Template, WebTemplate)]
#[template(path = "studies/exclusion.html")]
pub(super) struct ExclusionPage {
    head: Head,
    run: i64,
    state: &'static str,
    /// Whether there is anything to leave out.
    has_answers: bool,
    /// What the study's rule leaves them out for.
    flags: Vec<&'static str>,
    by_hand: Option<ByHand>,
    /// The longest reason, in characters.
    longest: usize,
}

struct ByHand {
    reason: String,
    actor: String,
    at: String,
}

#[derive(Deserialize)]
pub(super) struct ExclusionForm {
    action: String,
    #[serde(default)]
    reason: String,
}

/// GET `/studies/STUDY/participants/RUN/exclusion`.
pub(super) async fn ask(
    (State(store), State(catalogue), State(settings)): Parts,
    Extension(caller): Extension<Caller>,
    Path((study, run)): Path<(StudyId, i64)>,
) -> Result<ExclusionPage, Error> {
    let served = current(&catalogue, &study)?;
    let state = store
        .run_state(&study, settings.population, RunId::from(run))
        .await?;
    let exclusion = store.exclusion(RunId::from(run)).await?;
    let (flags, by_hand) = exclusion.map_or((Vec::new(), None), |exclusion| {
        (exclusion.flags, exclusion.by_hand)
    });
    Ok(ExclusionPage {
        head: Head::new(&store, &settings, &caller, &served, "/participants").await?,
        run,
        state: words::run_state(state),
        has_answers: match state {
            RunState::Declined | RunState::Withdrawn => false,
            RunState::Active
            | RunState::Completed
            | RunState::ScreenedOut
            | RunState::FailedCheck
            | RunState::TimedOut => true,
        },
        flags: flags.into_iter().map(Flag::deed).collect(),
        by_hand: by_hand.map(|by_hand| ByHand {
            reason: by_hand.reason,
            actor: by_hand.actor,
            at: words::moment(by_hand.at),
        }),
        longest: ExclusionReason::LONGEST,
    })
}

/// POST `/studies/STUDY/participants/RUN/exclusion`.
pub(super) async fn set(
    (State(store), _, State(settings)): Parts,
    Extension(caller): Extension<Caller>,
    Path((study, run)): Path<(StudyId, i64)>,
    Form(form): Form<ExclusionForm>,
) -> Result<Response, Error> {
    let (population, number) = (settings.population, RunId::from(run));
    let when = store.totals(&study, population).await?.in_words();
    let recording = |action, detail| {
        store.recording(access::entry(&caller, action, Some(&study), Some(detail)))
    };
    match form.action.as_str() {
        "exclude" => {
            let reason = ExclusionReason::new(&form.reason)
                .map_err(|error| Error::Unprocessable(error.to_string()))?;
            let detail = format!("participant {run}: {reason}; {when}");
            recording("leave a participant out", detail)
                .exclude(&study, population, number, reason, caller.name())
                .await?;
        }
        "include" => {
            let detail = format!("participant {run}; {when}");
            recording("take a participant in again", detail)
                .include(&study, population, number)
                .await?;
        }
        other => {
            return Err(Error::Unprocessable(format!(
                "action `{other}` does not exist; allowed: exclude, include"
            )));
        }
    }
    let back = Redirect::to(&format!("/studies/{study}/participants"));
    Ok((Extension(Written), back).into_response())
}
