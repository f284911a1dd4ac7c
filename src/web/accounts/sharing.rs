//! The switch that shows a study's aggregates to everybody.

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
use crate::{store::Store, study::StudyId};

#[derive(Deserialize)]
pub(super) struct PublicForm {
    public: u8,
    /// Present where the study's own page asks, and not that of its results.
    studies: Option<u8>,
}

/// POST `/results/STUDY/public`.
pub(super) async fn set(
    State(store): State<Store>,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
    Form(form): Form<PublicForm>,
) -> Result<Response, Error> {
    let is_public = form.public != 0;
    let action = if is_public {
        "make results public"
    } else {
        "make results not public"
    };
    let recording = store.recording(access::entry(&caller, action, Some(&study), None));
    recording.set_public(&study, is_public).await?;
    let page = if form.studies.is_some() {
        "studies"
    } else {
        "results"
    };
    let back = Redirect::to(&format!("/{page}/{study}"));
    Ok((Extension(Written), back).into_response())
}
