//! Errors for programs: RFC 9457 problem details, each with the id under which the log tells of the request.

use axum::{
    Json,
    extract::Request,
    http::{HeaderValue, StatusCode, header},
    middleware::Next,
    response::{IntoResponse, Response},
};
use serde::Serialize;

use crate::jobs::Blind;

const MEDIA_TYPE: &str = "application/problem+json";

/// What went wrong (RFC 9457); its type is `about:blank`, so `title` says what `status` means.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub(super) struct Problem {
    /// The status in words.
    pub title: &'static str,
    /// The HTTP status.
    pub status: u16,
    /// What was wrong, where, and what is allowed.
    pub detail: String,
    /// The id of the request, as in the header `x-request-id` and in the server's log.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub request_id: Option<String>,
    /// What would show the results.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub blind: Option<Blind>,
}

impl Problem {
    pub(super) fn new(status: StatusCode, detail: String) -> Self {
        Self {
            title: title(status),
            status: status.as_u16(),
            detail,
            request_id: None,
            blind: None,
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = (status, Json(&self)).into_response();
        response
            .headers_mut()
            .insert(header::CONTENT_TYPE, HeaderValue::from_static(MEDIA_TYPE));
        response.extensions_mut().insert(self);
        response
    }
}

/// Writes the request's id into problems, and makes a problem of every other error below `/api`, such as those of layers
/// that know only pages.
pub(super) async fn complete(request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let is_api = path == "/api" || path.starts_with("/api/");
    let id = request
        .headers()
        .get("x-request-id")
        .and_then(|id| id.to_str().ok())
        .map(str::to_owned);
    let mut response = next.run(request).await;
    let status = response.status();
    let told = response.extensions_mut().remove::<Problem>();
    let is_problem = response
        .headers()
        .get(header::CONTENT_TYPE)
        .is_some_and(|kind| kind == MEDIA_TYPE);
    let is_page_of_api = is_api && (status.is_client_error() || status.is_server_error());
    if !(is_problem || is_page_of_api) {
        return response;
    }
    let problem = Problem {
        request_id: id,
        ..told.unwrap_or_else(|| Problem::new(status, title(status).to_lowercase()))
    };
    // Other headers say when to try again, or what is allowed.
    let mut headers = std::mem::take(response.headers_mut());
    headers.remove(header::CONTENT_TYPE);
    headers.remove(header::CONTENT_LENGTH);
    let mut response = problem.into_response();
    response.headers_mut().extend(headers);
    response
}

/// A status in words.
pub(super) fn title(status: StatusCode) -> &'static str {
    status.canonical_reason().unwrap_or("Error")
}
