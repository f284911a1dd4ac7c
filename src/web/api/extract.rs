//! Axum's extractors with our errors: what could not be read is told as problem details.

use axum::{
    extract::{
        FromRequest, FromRequestParts, Request,
        path::ErrorKind,
        rejection::{JsonRejection, PathRejection, QueryRejection},
    },
    http::{StatusCode, request},
};
use serde::de::DeserializeOwned;

use crate::web::{ApiError, Error};

/// The path's parameters.
pub(super) struct Path<T>(pub T);

/// The query's parameters.
pub(in crate::web) struct Query<T>(pub T);

/// A body of JSON.
pub(super) struct Body<T>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for Path<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut request::Parts, state: &S) -> Result<Self, ApiError> {
        let found = axum::extract::Path::<T>::from_request_parts(parts, state).await;
        found
            .map(|path| Self(path.0))
            .map_err(|rejection: PathRejection| {
                ApiError(match &rejection {
                    PathRejection::FailedToDeserializePathParams(failed)
                        if matches!(failed.kind(), ErrorKind::InvalidUtf8InPathParam { .. }) =>
                    {
                        Error::BadRequest(format!("path: {}", detail(&failed.body_text())))
                    }
                    // An id that cannot be read is one that nothing has.
                    _ => Error::NotFound("address of the API"),
                })
            })
    }
}

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut request::Parts, state: &S) -> Result<Self, ApiError> {
        let found = axum::extract::Query::<T>::from_request_parts(parts, state).await;
        found
            .map(|query| Self(query.0))
            .map_err(|rejection: QueryRejection| {
                let detail = detail(&rejection.body_text());
                ApiError(Error::BadRequest(format!("query: {detail}")))
            })
    }
}

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Body<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> Result<Self, ApiError> {
        let found = axum::Json::<T>::from_request(request, state).await;
        found
            .map(|body| Self(body.0))
            .map_err(|rejection: JsonRejection| {
                let detail = detail(&rejection.body_text());
                ApiError(match rejection.status() {
                    StatusCode::UNSUPPORTED_MEDIA_TYPE => Error::UnsupportedMediaType,
                    StatusCode::PAYLOAD_TOO_LARGE => Error::TooLarge {
                        allowed: crate::web::BODY_LIMIT,
                    },
                    StatusCode::UNPROCESSABLE_ENTITY => Error::Unprocessable(detail),
                    _ => Error::BadRequest(format!("the body is not JSON: {detail}")),
                })
            })
    }
}

/// The place and what is wrong there; the words before the first colon only say that something failed.
fn detail(text: &str) -> String {
    text.split_once(": ")
        .map_or(text, |(_, detail)| detail)
        .to_owned()
}
