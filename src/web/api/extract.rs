//! Axum's extractors with our errors: what could not be read is told as problem details.

use axum::{
    extract::{
        FromRequest, FromRequestParts, Request,
        rejection::{JsonRejection, PathRejection, QueryRejection},
    },
    http::{StatusCode, request},
};
use serde::de::DeserializeOwned;

use crate::web::{ApiError, Error};

/// The path's parameters.
pub(super) struct Path<T>(pub T);

/// The query's parameters.
pub(super) struct Query<T>(pub T);

/// A body of JSON.
pub(super) struct Body<T>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for Path<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut request::Parts, state: &S) -> Result<Self, ApiError> {
        let found = axum::extract::Path::<T>::from_request_parts(parts, state).await;
        // An id that cannot be read is one that nothing has.
        found
            .map(|path| Self(path.0))
            .map_err(|_: PathRejection| ApiError(Error::NotFound("address of the API")))
    }
}

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut request::Parts, state: &S) -> Result<Self, ApiError> {
        let found = axum::extract::Query::<T>::from_request_parts(parts, state).await;
        found
            .map(|query| Self(query.0))
            .map_err(|rejection: QueryRejection| {
                ApiError(Error::BadRequest(format!(
                    "query: {}",
                    innermost(&rejection)
                )))
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
                let detail = innermost(&rejection);
                ApiError(match rejection.status() {
                    StatusCode::UNSUPPORTED_MEDIA_TYPE => Error::UnsupportedMediaType,
                    StatusCode::PAYLOAD_TOO_LARGE => Error::TooLarge,
                    StatusCode::UNPROCESSABLE_ENTITY => Error::Unprocessable(detail),
                    _ => Error::BadRequest(format!("the body is not JSON: {detail}")),
                })
            })
    }
}

/// The message that names the place and the value; those around it only say that something failed.
fn innermost(error: &dyn std::error::Error) -> String {
    let mut error = error;
    while let Some(source) = error.source() {
        error = source;
    }
    error.to_string()
}
