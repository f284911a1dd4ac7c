//! Conditional requests: a client that names the tag of what it has is answered 304 while that is still current.
//!
//! A tag is made of what decides an answer (address, program, study file, versions of data and fits), so a question
//! whose answer is known costs no computation. Such answers carry `private, no-cache` and not the `no-store` of pages:
//! a client may keep them, but must ask each time, and no cache in between keeps any. What `no-store` protects, pages and
//! data of single people, is not answered through this.

use std::{convert::Infallible, fmt::Display};

use axum::{
    Json,
    extract::FromRequestParts,
    http::{HeaderValue, StatusCode, header, request},
    response::{IntoResponse, Response},
};
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::{jobs::Snapshot, web::ApiError};

/// What was asked for, and which answers to it the client has.
pub(super) struct Asked {
    address: String,
    known: Vec<String>,
}

impl<S: Send + Sync> FromRequestParts<S> for Asked {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut request::Parts, _: &S) -> Result<Self, Infallible> {
        let known = parts.headers.get_all(header::IF_NONE_MATCH);
        Ok(Self {
            address: parts.uri.to_string(),
            known: known
                .iter()
                .filter_map(|tags| tags.to_str().ok())
                .flat_map(|tags| tags.split(','))
                .map(|tag| tag.trim().to_owned())
                .collect(),
        })
    }
}

impl Asked {
    /// The answer, which nothing but the study file and the versions of data and fits decides.
    pub(super) fn of<T: Serialize>(
        &self,
        snapshot: &Snapshot,
        answer: impl FnOnce() -> Result<T, ApiError>,
    ) -> Result<Response, ApiError> {
        let version = snapshot.version;
        let of = format!(
            "{} {} {} {:?} {}",
            snapshot.study.hash(),
            version.data_version,
            version.fit_version,
            snapshot.population,
            snapshot.is_of_many,
        );
        self.decided_by(of, answer)
    }

    /// The answer, or 304 where the client has it.
    ///
    /// `of` is everything that the answer depends on beside address and program.
    pub(super) fn decided_by<T: Serialize>(
        &self,
        of: impl Display,
        answer: impl FnOnce() -> Result<T, ApiError>,
    ) -> Result<Response, ApiError> {
        let tag = tag(&self.address, &of.to_string());
        let mut response = if self.has(&tag) {
            StatusCode::NOT_MODIFIED.into_response()
        } else {
            let answer = answer()?;
            // `*` is met by any answer there is, so it has to be made first.
            if self.known.iter().any(|known| known == "*") {
                StatusCode::NOT_MODIFIED.into_response()
            } else {
                Json(answer).into_response()
            }
        };
        let headers = response.headers_mut();
        headers.insert(
            header::CACHE_CONTROL,
            HeaderValue::from_static("private, no-cache"),
        );
        if let Ok(tag) = HeaderValue::from_str(&tag) {
            headers.insert(header::ETAG, tag);
        }
        Ok(response)
    }

    /// By weak comparison (RFC 9110, section 13.1.2): a compressed answer carries the tag as a weak one.
    fn has(&self, tag: &str) -> bool {
        self.known
            .iter()
            .any(|known| known.strip_prefix("W/").unwrap_or(known) == tag)
    }
}

fn tag(address: &str, of: &str) -> String {
    let mut hash = Sha256::new();
    for part in [env!("CARGO_PKG_VERSION"), address, of] {
        hash.update(part);
        hash.update([0]);
    }
    format!(
        "\"{}\"",
        data_encoding::HEXLOWER.encode(&hash.finalize()[..16])
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(known: &[&str]) -> Asked {
        Asked {
            address: "/studies".to_owned(),
            known: known.iter().map(|tag| (*tag).to_owned()).collect(),
        }
    }

    fn status(known: &[&str]) -> StatusCode {
        let answer = asked(known).decided_by(1, || Ok("answer"));
        answer.expect("an answer").status()
    }

    #[test]
    fn what_is_known_is_not_sent_again() {
        let tag = tag("/studies", "1");
        assert_eq!(status(&[]), StatusCode::OK);
        assert_eq!(status(&["\"other\""]), StatusCode::OK);
        assert_eq!(status(&["\"other\"", &tag]), StatusCode::NOT_MODIFIED);
        assert_eq!(status(&[&format!("W/{tag}")]), StatusCode::NOT_MODIFIED);
        assert_eq!(status(&["*"]), StatusCode::NOT_MODIFIED);
    }

    #[test]
    fn any_answer_does_not_stand_for_one_that_fails() {
        let answer = asked(&["*"]).decided_by(1, || {
            Err::<(), _>(crate::web::Error::NotFound("plan").into())
        });
        assert!(answer.is_err());
    }

    #[test]
    fn tags_differ_with_address_and_version() {
        assert_ne!(tag("/a", "1"), tag("/a", "2"));
        assert_ne!(tag("/a", "1"), tag("/b", "1"));
        assert_ne!(tag("/a1", ""), tag("/a", "1"));
    }
}
