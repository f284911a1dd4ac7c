//! Errors as participants are told of them: in the language of their run where that is known, else in the one that their
//! link or their browser asks for.

use std::{collections::BTreeMap, sync::Arc};

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    extract::{Query, Request},
    http::{StatusCode, header},
    middleware::Next,
    response::{IntoResponse, Response},
};

use super::{language, recruiting::BadLink};
use crate::{
    study::Words,
    web::{Error, assets},
};

/// What a link is that opens nothing, in [`Error::NotFound`].
pub(super) const LINK: &str = "link";

/// The words of the study and language in which a handler speaks to somebody.
#[derive(Clone)]
pub(super) struct Spoken(pub(super) Words);

#[derive(Template, WebTemplate)]
#[template(path = "participant/trouble.html")]
struct TroublePage {
    words: Words,
    told: Told,
}

/// What a participant is told.
struct Told {
    title: String,
    text: String,
    /// What exactly was wrong, for whoever made the request by hand.
    detail: Option<String>,
    /// Whether the page leads to the open studies: where a link led nowhere.
    is_lost: bool,
}

/// The layer around all routes that words the errors of participants' pages, and of addresses where nothing is.
pub(in crate::web) async fn tell(request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let is_participants = path.starts_with("/s/") || path.starts_with("/r/");
    let query = Query::<BTreeMap<String, String>>::try_from_uri(request.uri());
    let link = query.ok().and_then(|Query(mut query)| query.remove("lang"));
    let liked = language::liked(request.headers());
    let mut response = next.run(request).await;
    let status = response.status();
    if !(status.is_client_error() || status.is_server_error()) {
        return response;
    }
    let error = response.extensions_mut().remove::<Arc<Error>>();
    let is_nowhere = matches!(error.as_deref(), Some(Error::NotFound("page")));
    if !(is_participants || is_nowhere) || (error.is_none() && is_worded(&response)) {
        return response;
    }
    let words = match response.extensions_mut().remove::<Spoken>() {
        Some(Spoken(words)) => words,
        None => Words::of_languages(link.iter().chain(&liked).map(String::as_str)),
    };
    let told = match error.as_deref() {
        Some(error) => Told::of(error, &words),
        None => Told::of_status(status, &words),
    };
    let page = TroublePage { words, told }.into_response();
    // Other headers and extensions say when to try again, and who may frame it.
    let headers = response.headers_mut();
    headers.remove(header::CONTENT_LENGTH);
    headers.extend(page.headers().clone());
    *response.body_mut() = page.into_body();
    response
}

/// The page of a link that cannot be used.
pub(super) fn bad_link(refused: &BadLink, words: &Words) -> Response {
    let told = Told {
        title: words.error_link_title.clone(),
        text: refused.text(words),
        detail: None,
        is_lost: false,
    };
    let words = words.clone();
    (StatusCode::BAD_REQUEST, TroublePage { words, told }).into_response()
}

/// Whether an error has a page of its own, or is data for a script; the plain texts of layers and extractors are neither.
fn is_worded(response: &Response) -> bool {
    let kind = response.headers().get(header::CONTENT_TYPE);
    let kind = kind.and_then(|kind| kind.to_str().ok());
    kind.is_some_and(|kind| !kind.starts_with("text/plain"))
}

impl Told {
    fn new(title: &str, text: impl Into<String>) -> Self {
        Self {
            title: title.to_owned(),
            text: text.into(),
            detail: None,
            is_lost: false,
        }
    }

    /// The same on a page that leads to the open studies.
    fn lost(self) -> Self {
        Self {
            is_lost: true,
            ..self
        }
    }

    fn of(error: &Error, words: &Words) -> Self {
        match error {
            Error::NotFound("study") => {
                Self::new(&words.error_no_study_title, &words.error_no_study_text).lost()
            }
            Error::NotFound("arrival") => {
                Self::new(&words.error_expired_title, &words.error_expired_text)
            }
            // A link that may have been a good one once. Which study it was of nobody knows any more.
            Error::NotFound("run" | LINK) => Self::new(&words.gone_title, &words.gone_text),
            Error::NotFound(_) => {
                Self::new(&words.error_no_page_title, &words.error_no_page_text).lost()
            }
            Error::MethodNotAllowed => {
                Self::new(&words.error_method_title, &words.error_method_text)
            }
            Error::BadRequest(detail) | Error::Unprocessable(detail) => Self {
                detail: Some(detail.clone()),
                ..Self::new(&words.error_form_title, &words.error_form_text)
            },
            Error::UnsupportedMediaType => {
                Self::new(&words.error_form_title, &words.error_form_text)
            }
            Error::TooLarge { allowed } => Self::new(
                &words.error_large_title,
                words.error_large_text(allowed / 1024),
            ),
            Error::CrossSite => Self::new(&words.error_foreign_title, &words.error_foreign_text),
            Error::NotTheOwner => Self::new(&words.error_owner_title, &words.error_owner_text),
            Error::Conflict(_) => {
                Self::new(&words.error_conflict_title, &words.error_conflict_text)
            }
            Error::Closed(_) => Self::new(&words.cannot_start, &words.study_paused),
            Error::TooMany { retry_after_s } => Self::new(
                &words.error_often_title,
                words.error_often_text(*retry_after_s),
            ),
            Error::Busy => Self::new(&words.error_busy_title, &words.error_busy_text),
            Error::Internal(_) => Self::new(&words.error_ours_title, &words.error_ours_text),
            // These belong to researchers' pages and the API.
            Error::Unauthorized { .. } | Error::Forbidden(_) | Error::Blind(_) => Self {
                detail: Some(error.to_string()),
                ..Self::new(&words.error_no_page_title, &words.error_no_page_text)
            },
        }
    }

    /// What a layer or an extractor refused before any handler spoke.
    fn of_status(status: StatusCode, words: &Words) -> Self {
        match status {
            StatusCode::NOT_FOUND => {
                Self::new(&words.error_no_page_title, &words.error_no_page_text).lost()
            }
            StatusCode::METHOD_NOT_ALLOWED => {
                Self::new(&words.error_method_title, &words.error_method_text)
            }
            StatusCode::REQUEST_TIMEOUT => {
                Self::new(&words.error_slow_title, &words.error_slow_text)
            }
            StatusCode::SERVICE_UNAVAILABLE => {
                Self::new(&words.error_busy_title, &words.error_busy_text)
            }
            status if status.is_client_error() => {
                Self::new(&words.error_form_title, &words.error_form_text)
            }
            _ => Self::new(&words.error_ours_title, &words.error_ours_text),
        }
    }
}
