//! What a visitor is told when something does not work, as a page or as `application/problem+json`.

use std::sync::Arc;

use askama::Template;
use axum::{
    http::{HeaderValue, StatusCode, header},
    response::{Html, IntoResponse, Response},
};

use super::{assets, problem::Problem};
use crate::{export::ExportError, jobs::Blind, store, study::StepError};

/// Everything a handler can fail with. The visitor's text and the log's text differ: inner errors only reach the log.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Nothing has this address or name.
    #[error("this {0} does not exist")]
    NotFound(&'static str),
    /// The address exists, the method does not.
    #[error("this address does not take this kind of request")]
    MethodNotAllowed,
    /// Nobody is logged in, or the token opens nothing.
    #[error("{text}")]
    Unauthorized {
        /// What would help.
        text: String,
        /// What the API's `WWW-Authenticate` says.
        challenge: Option<String>,
    },
    /// Too many tries.
    #[error("too many tries; the next one is let in {retry_after_s} s")]
    TooMany {
        /// How long to wait.
        retry_after_s: u64,
    },
    /// The visitor may not see this; the text says what would allow it.
    #[error("{0}")]
    Forbidden(String),
    /// The study hides its results until enough people have finished.
    #[error("the results of this study are hidden until {} people have finished it; now {} have", .0.until, .0.completed)]
    Blind(Blind),
    /// The request could not be understood; the text names what, and what is allowed.
    #[error("{0}")]
    BadRequest(String),
    /// The body is in another form than the address takes.
    #[error("the body must be JSON, sent with the header `content-type: application/json`")]
    UnsupportedMediaType,
    /// More than any form or call needs.
    #[error("the body is too large; allowed: {} KiB", allowed / 1024)]
    TooLarge {
        /// How many bytes the address takes.
        allowed: usize,
    },
    /// Understood, but a value is not allowed.
    #[error("{0}")]
    Unprocessable(String),
    /// A form came from a page of another site.
    #[error(
        "this was sent from a page of another site; open the study's own link and answer there"
    )]
    CrossSite,
    /// A participant's link is another person's, or another of the same person, than the one that may do this.
    #[error("withdrawing needs the link with which this study was started")]
    NotTheOwner,
    /// Already answered, or the same key with another body.
    #[error("{0}")]
    Conflict(String),
    /// The study takes no answers now.
    #[error("{0}")]
    Closed(String),
    /// More waits than can be worked off, or the disk does not answer.
    #[error("the server is busy; nothing was lost, try again in a moment")]
    Busy,
    /// A fault of ours.
    #[error("something went wrong on our side; nothing that was acknowledged is lost")]
    Internal(#[source] anyhow::Error),
}

impl Error {
    fn status(&self) -> StatusCode {
        match self {
            Self::NotFound(_) => StatusCode::NOT_FOUND,
            Self::MethodNotAllowed => StatusCode::METHOD_NOT_ALLOWED,
            Self::Unauthorized { .. } => StatusCode::UNAUTHORIZED,
            Self::TooMany { .. } => StatusCode::TOO_MANY_REQUESTS,
            Self::Forbidden(_) | Self::Blind(_) | Self::CrossSite | Self::NotTheOwner => {
                StatusCode::FORBIDDEN
            }
            Self::BadRequest(_) => StatusCode::BAD_REQUEST,
            Self::UnsupportedMediaType => StatusCode::UNSUPPORTED_MEDIA_TYPE,
            Self::TooLarge { .. } => StatusCode::PAYLOAD_TOO_LARGE,
            Self::Unprocessable(_) => StatusCode::UNPROCESSABLE_ENTITY,
            Self::Conflict(_) => StatusCode::CONFLICT,
            Self::Closed(_) => StatusCode::GONE,
            Self::Busy => StatusCode::SERVICE_UNAVAILABLE,
            Self::Internal(_) => StatusCode::INTERNAL_SERVER_ERROR,
        }
    }

    /// The error as programs are told of it.
    fn problem(&self) -> Problem {
        Problem {
            blind: match self {
                Self::Blind(blind) => Some(*blind),
                Self::NotFound(_)
                | Self::MethodNotAllowed
                | Self::Unauthorized { .. }
                | Self::TooMany { .. }
                | Self::Forbidden(_)
                | Self::CrossSite
                | Self::NotTheOwner
                | Self::BadRequest(_)
                | Self::UnsupportedMediaType
                | Self::TooLarge { .. }
                | Self::Unprocessable(_)
                | Self::Conflict(_)
                | Self::Closed(_)
                | Self::Busy
                | Self::Internal(_) => None,
            },
            ..Problem::new(self.status(), self.to_string())
        }
    }

    /// Adds what tells a program when to come back, or with what.
    fn hint(&self, mut response: Response) -> Response {
        let headers = response.headers_mut();
        match self {
            Self::Busy => {
                headers.insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
            }
            Self::TooMany { retry_after_s } => {
                headers.insert(header::RETRY_AFTER, HeaderValue::from(*retry_after_s));
            }
            Self::Unauthorized {
                challenge: Some(challenge),
                ..
            } => {
                if let Ok(challenge) = HeaderValue::try_from(challenge) {
                    headers.insert(header::WWW_AUTHENTICATE, challenge);
                }
            }
            Self::Unauthorized {
                challenge: None, ..
            }
            | Self::NotFound(_)
            | Self::MethodNotAllowed
            | Self::Forbidden(_)
            | Self::CrossSite
            | Self::NotTheOwner
            | Self::Blind(_)
            | Self::BadRequest(_)
            | Self::UnsupportedMediaType
            | Self::TooLarge { .. }
            | Self::Unprocessable(_)
            | Self::Conflict(_)
            | Self::Closed(_)
            | Self::Internal(_) => {}
        }
        response
    }

    /// Logs a fault once, here where it is handled; everything else is the visitor's business.
    fn log(&self) {
        if let Self::Internal(source) = self {
            tracing::error!(error = format!("{source:#}"), "request failed");
        }
    }
}

impl From<store::Error> for Error {
    fn from(error: store::Error) -> Self {
        match error {
            store::Error::NotFound(what) => Self::NotFound(what),
            store::Error::Conflict(_) | store::Error::Refused(_) => {
                Self::Conflict(error.to_string())
            }
            store::Error::Closed { .. } | store::Error::NotAdmitted(_) => {
                Self::Closed(error.to_string())
            }
            store::Error::Busy | store::Error::Unavailable(_) => Self::Busy,
            store::Error::Database(_) => Self::Internal(error.into()),
        }
    }
}

impl From<ExportError> for Error {
    fn from(error: ExportError) -> Self {
        match error {
            ExportError::Store(error) => error.into(),
            ExportError::NoPlainIds(_) => Self::Conflict(error.to_string()),
            ExportError::Study(_)
            | ExportError::Write(_)
            | ExportError::Csv(_)
            | ExportError::Json(_)
            | ExportError::Archive(_) => Self::Internal(error.into()),
        }
    }
}

impl From<StepError> for Error {
    fn from(error: StepError) -> Self {
        Self::Internal(error.into())
    }
}

#[derive(Template)]
#[template(path = "error.html")]
struct ErrorPage {
    title: &'static str,
    message: String,
}

impl IntoResponse for Error {
    fn into_response(self) -> Response {
        self.log();
        let problem = self.problem();
        let page = ErrorPage {
            title: problem.title,
            message: sentence(&problem.detail),
        };
        let body = page.render().unwrap_or_else(|_| page.message.clone());
        let mut response = self.hint((self.status(), Html(body)).into_response());
        // A layer that knows only pages may speak for the API.
        response.extensions_mut().insert(problem);
        // So may one that knows in which language to speak to a participant.
        response.extensions_mut().insert(Arc::new(self));
        response
    }
}

/// The same errors for programs: RFC 9457 problem details.
#[derive(Debug)]
pub struct ApiError(pub Error);

impl<E: Into<Error>> From<E> for ApiError {
    fn from(error: E) -> Self {
        Self(error.into())
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        self.0.log();
        self.0.hint(self.0.problem().into_response())
    }
}

/// Messages are written lower case and without a full stop; a page shows a sentence.
pub(super) fn sentence(message: &str) -> String {
    let mut letters = message.chars();
    letters.next().map_or_else(String::new, |first| {
        format!("{}{}.", first.to_uppercase(), letters.as_str())
    })
}
