//! Bearer tokens of the API (RFC 6750).

use axum::http::{HeaderMap, header};

use super::{Caller, Error, Need, caller::scope};
use crate::store::{Store, Token, TokenState};

/// What stands after `Bearer` in the header `authorization`, if that is what it is for.
pub(super) fn bearer(headers: &HeaderMap) -> Option<&str> {
    let value = headers.get(header::AUTHORIZATION)?;
    // What cannot be read is no token, but was meant as one.
    let (scheme, token) = value.to_str().unwrap_or("bearer ?").split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}

/// Whose token it is, and whether it opens anything.
pub(super) async fn holder(
    store: &Store,
    token: &Token,
) -> Result<(Caller, Result<(), Error>), Error> {
    let Some(token) = store.api_token(token).await? else {
        return Ok((Caller::Nobody, Err(unknown())));
    };
    let state = token.state(store.clock().now());
    let is_valid = match state {
        TokenState::Usable => Ok(()),
        TokenState::Expired => Err(invalid(
            "this token has expired; make a new one at /account",
        )),
        TokenState::Revoked => Err(invalid("this token was revoked")),
        TokenState::Waiting => Err(invalid(
            "the account of this token has to choose a password of its own first, at /account/password",
        )),
    };
    Ok((Caller::Token(token), is_valid))
}

/// No token came.
pub(super) fn missing() -> Error {
    Error::Unauthorized {
        text: "the API needs a token in the header `authorization: Bearer …`; make one at /account"
            .to_owned(),
        challenge: Some("Bearer realm=\"riskaware\"".to_owned()),
    }
}

/// A token came that is none.
pub(super) fn unknown() -> Error {
    invalid("this token is not known")
}

fn invalid(text: &str) -> Error {
    Error::Unauthorized {
        text: text.to_owned(),
        challenge: Some("Bearer realm=\"riskaware\", error=\"invalid_token\"".to_owned()),
    }
}

/// A good token that is not for this.
pub(super) fn insufficient(need: Need) -> Error {
    let text = match scope(need) {
        Some(scope) => {
            format!("this takes a token with the scope {scope}, of an account that may do it")
        }
        None => "this is nothing for tokens".to_owned(),
    };
    Error::Forbidden(text)
}
