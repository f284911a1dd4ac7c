//! Leaving a study with everything that was answered.

use std::sync::Arc;

use axum::{
    extract::{Path, State},
    http::StatusCode,
    response::{IntoResponse, Redirect, Response},
};

use super::{
    arrival::read_token,
    framed,
    pages::{NotePage, WithdrawPage},
};
use crate::{
    jobs::Catalogue,
    store::{self, RunState, Store},
    web::Error,
};

/// GET `/r/TOKEN/withdraw`: asks whether it is meant.
pub(super) async fn ask(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = match store.run(&token).await {
        Err(store::Error::NotFound("run")) => return Ok(gone()),
        found => found?,
    };
    let page = match (run.is_owner, run.state) {
        (false, _) => Err(not_the_owner()),
        (true, RunState::Withdrawn) => Ok(withdrawn().into_response()),
        (true, RunState::Active) => Ok(WithdrawPage {
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
            token,
            has_ended: true,
        }
        .into_response()),
    };
    let study = catalogue.version(run.version);
    let study = study.ok_or(Error::NotFound("study"))?;
    Ok(framed(&study, page))
}

/// POST `/r/TOKEN/withdraw`: erases the run.
pub(super) async fn withdraw(
    State(store): State<Store>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = match store.run(&token).await {
        Err(store::Error::NotFound("run")) => return Ok(gone()),
        found => found?,
    };
    if !run.is_owner {
        return Err(not_the_owner());
    }
    store.withdraw(&token).await?;
    Ok(Redirect::to(&format!("/r/{token}")).into_response())
}

/// What is left to show of an erased run.
pub(super) fn withdrawn() -> NotePage {
    NotePage {
        title: "Your answers are erased".to_owned(),
        text_html: "<p>Nothing that you answered is stored any more. You can close this page.</p>"
            .to_owned(),
    }
}

/// What an unknown link is told, because it may have been a good one once.
pub(super) fn gone() -> Response {
    let page = NotePage {
        title: "This link opens nothing".to_owned(),
        text_html: "<p>Perhaps a part of the link is missing. Or the time in which this study could be withdrawn is \
            over: then its links and the ids of recruiting platforms are erased, so that nobody can tell any more which \
            answers were whose, and they can no longer be taken out.</p>"
            .to_owned(),
    };
    (StatusCode::NOT_FOUND, page).into_response()
}

fn not_the_owner() -> Error {
    Error::Forbidden("withdrawing needs the link with which this study was started".to_owned())
}
