//! Opening, pausing and closing a study.

use axum::{
    Extension,
    extract::{Form, Path, State},
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;

use super::super::{
    Error,
    access::{self, Caller, Written},
};
use crate::{
    store::{Store, StudyState},
    study::StudyId,
};

/// A button that changes the state.
pub(super) struct Button {
    pub(super) value: &'static str,
    pub(super) label: &'static str,
    /// What it does, in a sentence.
    pub(super) hint: &'static str,
    pub(super) is_main: bool,
}

const PAUSE: Button = Button {
    value: "paused",
    label: "Pause",
    hint: "Nobody new starts; people under way finish.",
    is_main: true,
};
const CLOSE: Button = Button {
    value: "closed",
    label: "Close",
    hint: "Says that the study is over; it can be opened again.",
    is_main: false,
};

fn open(label: &'static str, hint: &'static str) -> Button {
    Button {
        value: "open",
        label,
        hint,
        is_main: true,
    }
}

/// What can be done in a state.
pub(super) fn buttons(state: StudyState) -> Vec<Button> {
    let again = "People can start as before.";
    match state {
        StudyState::Draft => vec![open("Open", "People can start from then on.")],
        StudyState::Open => vec![PAUSE, CLOSE],
        StudyState::Paused => vec![open("Open again", again), CLOSE],
        StudyState::Closed => vec![open("Open again", again)],
    }
}

#[derive(Deserialize)]
pub(super) struct StateForm {
    state: String,
}

/// POST `/studies/STUDY/state`.
pub(super) async fn set(
    State(store): State<Store>,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
    Form(form): Form<StateForm>,
) -> Result<Response, Error> {
    let unknown = || {
        Error::Unprocessable(format!(
            "state `{}` cannot be set; allowed: open, paused, closed",
            form.state
        ))
    };
    let state: StudyState = form.state.parse().map_err(|_| unknown())?;
    let action = match state {
        StudyState::Draft => return Err(unknown()),
        StudyState::Open => "open study",
        StudyState::Paused => "pause study",
        StudyState::Closed => "close study",
    };
    let earlier = store.study(&study).await?.state;
    let detail = Some(format!("it was {earlier}"));
    let recording = store.recording(access::entry(&caller, action, Some(&study), detail));
    recording.set_study_state(&study, state).await?;
    let back = Redirect::to(&format!("/studies/{study}"));
    Ok((Extension(Written), back).into_response())
}
