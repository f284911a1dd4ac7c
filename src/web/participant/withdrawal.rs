//! Leaving a study with everything that was answered.

use axum::{
    extract::{Path, State},
    response::{IntoResponse, Redirect, Response},
};

use super::{
    arrival::read_token,
    pages::{NotePage, WithdrawPage},
};
use crate::{
    store::{RunState, Store},
    web::Error,
};

/// GET `/r/TOKEN/withdraw`: asks whether it is meant.
pub(super) async fn ask(
    State(store): State<Store>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = store.run(&token).await?;
    if !run.is_owner {
        return Err(not_the_owner());
    }
    Ok(match run.state {
        RunState::Withdrawn => withdrawn().into_response(),
        RunState::Active
        | RunState::Completed
        | RunState::Declined
        | RunState::ScreenedOut
        | RunState::FailedCheck
        | RunState::TimedOut => WithdrawPage { token }.into_response(),
    })
}

/// POST `/r/TOKEN/withdraw`: erases the run.
pub(super) async fn withdraw(
    State(store): State<Store>,
    Path(token): Path<String>,
) -> Result<Redirect, Error> {
    let token = read_token(&token)?;
    if !store.run(&token).await?.is_owner {
        return Err(not_the_owner());
    }
    store.withdraw(&token).await?;
    Ok(Redirect::to(&format!("/r/{token}")))
}

/// What is left to show of an erased run.
pub(super) fn withdrawn() -> NotePage {
    NotePage {
        title: "Your answers are erased".to_owned(),
        text_html: "<p>Nothing that you answered is stored any more. You can close this page.</p>"
            .to_owned(),
    }
}

fn not_the_owner() -> Error {
    Error::Forbidden("withdrawing needs the link with which this study was started".to_owned())
}
