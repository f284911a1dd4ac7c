//! Leaving a study with everything that was answered.

use std::sync::Arc;

use axum::{
    extract::{Path, State},
    response::{IntoResponse, Redirect, Response},
};

use super::{
    arrival::{in_language, read_token},
    framed,
    pages::{NotePage, WithdrawPage},
};
use crate::{
    jobs::Catalogue,
    store::{RunState, Store},
    study::Words,
    web::Error,
};

/// GET `/r/TOKEN/withdraw`: asks whether it is meant.
pub(super) async fn ask(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = store.run(&token).await?;
    let study = catalogue.version(run.version);
    let study = study.ok_or(Error::NotFound("study"))?;
    let study = in_language(&study, run.language.as_deref());
    let words = study.words().clone();
    let page = match (run.is_owner, run.state) {
        (false, _) => Err(Error::NotTheOwner),
        (true, RunState::Withdrawn) => Ok(withdrawn(&words).into_response()),
        (true, RunState::Active) => Ok(WithdrawPage {
            words,
            token,
            has_ended: false,
        }
        .into_response()),
        (
            true,
            RunState::Completed
            | RunState::Declined
            | RunState::ScreenedOut
            | RunState::FailedCheck
            | RunState::TimedOut,
        ) => Ok(WithdrawPage {
            words,
            token,
            has_ended: true,
        }
        .into_response()),
    };
    Ok(framed(study, page))
}

/// POST `/r/TOKEN/withdraw`: erases the run.
pub(super) async fn withdraw(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = store.run(&token).await?;
    let study = catalogue.version(run.version);
    let study = study.ok_or(Error::NotFound("study"))?;
    let answer = if run.is_owner {
        let withdrawn = store.withdraw(&token).await.map_err(Error::from);
        withdrawn.map(|_| Redirect::to(&format!("/r/{token}")))
    } else {
        Err(Error::NotTheOwner)
    };
    Ok(framed(in_language(&study, run.language.as_deref()), answer))
}

/// What is left to show of an erased run.
pub(super) fn withdrawn(words: &Words) -> NotePage {
    NotePage {
        language: words.language.clone(),
        title: words.withdrawn_title.clone(),
        text_html: Words::to_html(&words.withdrawn_text),
    }
}
