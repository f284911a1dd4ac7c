//! What a participant meets: landing, the steps of a run, withdrawal. No cookies: the link is all there is.

mod arrival;
mod device;
mod ending;
pub(super) mod language;
mod pages;
mod recruiting;
mod run;
mod trouble;
mod withdrawal;

use axum::{
    Extension, Router,
    extract::{DefaultBodyLimit, FromRequestParts},
    http::{Method, request::Parts},
    response::{IntoResponse, Response},
    routing::{get, post},
};

use self::trouble::Spoken;
pub(super) use self::trouble::tell;
use super::{AppState, Error, headers::FramedBy};
use crate::study::{Study, step::FormStep};

/// The largest form that a study can ask for. A page counts a text in units of UTF-16, and each may be sent as nine bytes
/// (three of UTF-8, each as `%` with two digits); the rest is for names and values that are no texts.
const FORM_LIMIT: usize = 9 * FormStep::MOST_CHARACTERS + 64 * 1024;

pub(super) fn router() -> Router<AppState> {
    Router::new()
        .route("/s/{study}", get(arrival::arrive))
        .route(
            "/s/{study}/a/{token}",
            get(arrival::landing).post(arrival::start),
        )
        .route(
            "/r/{token}",
            get(run::current)
                .post(run::answer)
                .layer(DefaultBodyLimit::max(FORM_LIMIT)),
        )
        .route("/studies/{study}/preview", post(arrival::preview))
        .route(
            "/r/{token}/withdraw",
            get(withdrawal::ask).post(withdrawal::withdraw),
        )
}

/// What a study answers in the language of whoever asks, which MTurk may show in its frame where the study says so. Errors
/// too: what somebody in a frame is to read has to be seen there, and to be understood.
fn framed(study: &Study, answer: Result<impl IntoResponse, Error>) -> Response {
    let sites = study.recruiting().mturk.framing_sites();
    let sites = FramedBy(sites.into_iter().map(str::to_owned).collect());
    match answer {
        Ok(page) => (Extension(sites), page).into_response(),
        Err(error) => {
            let words = Spoken(study.words().clone());
            (Extension(sites), Extension(words), error).into_response()
        }
    }
}

/// A page that a person is about to look at. Whoever only probes (HEAD) or fetches ahead is sent away, because looking
/// starts clocks and writes arrivals.
struct Looking;

impl<S: Sync> FromRequestParts<S> for Looking {
    type Rejection = Error;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Error> {
        if parts.method == Method::HEAD {
            return Err(Error::MethodNotAllowed);
        }
        let purpose = parts
            .headers
            .get("sec-purpose")
            .and_then(|purpose| purpose.to_str().ok());
        if purpose.is_some_and(|purpose| purpose.contains("prefetch")) {
            return Err(Error::Busy);
        }
        Ok(Self)
    }
}
