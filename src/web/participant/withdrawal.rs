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
    pages::{NotePage, UnreadablePage, WithdrawPage},
};
use crate::{
    jobs::Catalogue,
    store::{RunState, RunView, Store, Token},
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
    let run = store.run(&token).await?;
    match catalogue.version(run.version) {
        Some(study) => {
            let study = in_language(&study, run.language.as_deref());
            let page = question(&run, token, study.words().clone());
            Ok(framed(study, page))
        }
        // Nobody may lose the right to withdraw because a later program does not read the study any more.
        None => question(&run, token, words_without_study(&run, &headers)),
    }
}

fn question(run: &RunView, token: Token, words: Words) -> Result<Response, Error> {
    let has_ended = match (run.is_owner, run.state) {
        (false, _) => return Err(Error::NotTheOwner),
        (true, RunState::Withdrawn) => return Ok(withdrawn(&words).into_response()),
        (true, RunState::Active) => false,
        (
            true,
            RunState::Completed
            | RunState::Declined
            | RunState::ScreenedOut
            | RunState::FailedCheck
            | RunState::TimedOut,
        ) => true,
    };
    Ok(WithdrawPage {
        words,
        token,
        has_ended,
    }
    .into_response())
}

/// The page of a run whose study's text this program does not read: all that can be done there is to withdraw.
pub(super) fn unreadable(run: &RunView, token: Token, headers: &HeaderMap) -> Response {
    let words = words_without_study(run, headers);
    if run.state == RunState::Withdrawn {
        return withdrawn(&words).into_response();
    }
    let page = UnreadablePage {
        words,
        token,
        is_owner: run.is_owner,
    };
    (StatusCode::SERVICE_UNAVAILABLE, page).into_response()
}

/// The words that a run is told without its study: in its own language, else in one that the browser likes.
fn words_without_study(run: &RunView, headers: &HeaderMap) -> Words {
    let liked = language::liked(headers);
    let own = run.language.as_deref();
    Words::of_languages(own.into_iter().chain(liked.iter().map(String::as_str)))
}

/// POST `/r/TOKEN/withdraw`: erases the run.
pub(super) async fn withdraw(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = store.run(&token).await?;
    let answer = if run.is_owner {
        let withdrawn = store.withdraw(&token).await.map_err(Error::from);
        withdrawn.map(|_| Redirect::to(&format!("/r/{token}")))
    } else {
        Err(Error::NotTheOwner)
    };
    match catalogue.version(run.version) {
        Some(study) => Ok(framed(in_language(&study, run.language.as_deref()), answer)),
        None => answer.map(IntoResponse::into_response),
    }
}

/// What is left to show of an erased run.
pub(super) fn withdrawn(words: &Words) -> NotePage {
    NotePage {
        language: words.language.clone(),
        title: words.withdrawn_title.clone(),
        text_html: Words::to_html(&words.withdrawn_text),
    }
}
