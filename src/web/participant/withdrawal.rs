//! Leaving a study with everything that was answered.

use axum::{
    extract::{Path, State},
    http::{HeaderMap, StatusCode},
    response::{IntoResponse, Redirect, Response},
};

use super::{
    arrival::{in_language, read_token},
    language,
    pages::{NotePage, WithdrawPage},
};
use crate::{
    jobs::Catalogue,
    store::{self, RunState, RunView, Store},
    study::Words,
    web::Error,
};
use std::sync::Arc;

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
    if !run.is_owner {
        return Err(not_the_owner());
    }
    let words = words(&catalogue, &run);
    Ok(match run.state {
        RunState::Withdrawn => withdrawn(&words).into_response(),
        RunState::Active
        | RunState::Completed
        | RunState::Declined
        | RunState::ScreenedOut
        | RunState::FailedCheck
        | RunState::TimedOut => WithdrawPage { words, token }.into_response(),
    })
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

/// The words of a run's pages; English for a version that is served no more.
fn words(catalogue: &Catalogue, run: &RunView) -> Words {
    catalogue
        .version(run.version)
        .map_or_else(Words::english, |study| {
            in_language(&study, run.language.as_deref()).words().clone()
        })
}

/// What is left to show of an erased run.
pub(super) fn withdrawn(words: &Words) -> NotePage {
    NotePage {
        language: words.language.clone(),
        title: words.withdrawn_title.clone(),
        text_html: words.withdrawn_html(),
    }
}

/// What an unknown link is told, because it may have been a good one once. Which study it was of nobody knows any more.
pub(super) fn gone(headers: &HeaderMap) -> Response {
    let liked = language::liked(headers);
    let words = Words::of_languages(liked.iter().map(String::as_str));
    let page = NotePage {
        text_html: words.gone_html(),
        title: words.gone_title,
        language: words.language,
    };
    (StatusCode::NOT_FOUND, page).into_response()
}

fn not_the_owner() -> Error {
    Error::Forbidden("withdrawing needs the link with which this study was started".to_owned())
}
