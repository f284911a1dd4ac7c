//! Leaving a study with everything that was answered.

use std::sync::Arc;

use axum::{
    extract::{Path, State},
    http::{HeaderMap, StatusCode},
    response::{IntoResponse, Redirect, Response},
};

use super::{
    arrival::{in_language, read_token},
    framed, language,
    pages::{NotePage, WithdrawPage},
};
use crate::{
    jobs::Catalogue,
    store::{self, RunState, Store},
    study::Words,
    web::Error,
};

/// GET `/r/TOKEN/withdraw`: asks whether it is meant.
pub(super) async fn ask(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    Path(token): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = match store.run(&token).await {
        Err(store::Error::NotFound("run")) => return Ok(gone(&headers)),
        found => found?,
    };
    let study = catalogue.version(run.version);
    let study = study.ok_or(Error::NotFound("study"))?;
    let study = in_language(&study, run.language.as_deref());
    let words = study.words().clone();
    let page = match (run.is_owner, run.state) {
        (false, _) => Err(not_the_owner()),
        (true, RunState::Withdrawn) => Ok(withdrawn(&words).into_response()),
        (
            true,
            RunState::Active
            | RunState::Completed
            | RunState::Declined
            | RunState::ScreenedOut
            | RunState::FailedCheck
            | RunState::TimedOut,
        ) => Ok(WithdrawPage { words, token }.into_response()),
    };
    Ok(framed(study, page))
}

/// POST `/r/TOKEN/withdraw`: erases the run.
pub(super) async fn withdraw(
    State(store): State<Store>,
    Path(token): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = match store.run(&token).await {
        Err(store::Error::NotFound("run")) => return Ok(gone(&headers)),
        found => found?,
    };
    if !run.is_owner {
        return Err(not_the_owner());
    }
    store.withdraw(&token).await?;
    Ok(Redirect::to(&format!("/r/{token}")).into_response())
}

/// What is left to show of an erased run.
pub(super) fn withdrawn(words: &Words) -> NotePage {
    NotePage {
        language: words.language.clone(),
        title: words.withdrawn_title.clone(),
        text_html: Words::to_html(&words.withdrawn_text),
    }
}

/// What an unknown link is told, because it may have been a good one once. Which study it was of nobody knows any more.
pub(super) fn gone(headers: &HeaderMap) -> Response {
    let liked = language::liked(headers);
    let words = Words::of_languages(liked.iter().map(String::as_str));
    let page = NotePage {
        text_html: Words::to_html(&words.gone_text),
        title: words.gone_title,
        language: words.language,
    };
    (StatusCode::NOT_FOUND, page).into_response()
}

fn not_the_owner() -> Error {
    Error::Forbidden("withdrawing needs the link with which this study was started".to_owned())
}
