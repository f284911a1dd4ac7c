//! Whether somebody who was let in may stay: for answers that do not end by themselves.

use std::sync::Arc;

use axum::http::HeaderMap;

use super::{Asked, Caller, Error, Guard, Need, Rule, cookie::session_token, credentials::bearer};
use crate::store::{Store, Token, TokenState};

/// The leave that a request was given, which can be asked again whether it still holds.
#[derive(Clone)]
pub(in crate::web) struct Standing(Arc<Given>);

struct Given {
    guard: Guard,
    asked: Asked,
    headers: HeaderMap,
}

impl Standing {
    pub(super) fn new(guard: &Guard, asked: &Asked, headers: &HeaderMap) -> Self {
        Self(Arc::new(Given {
            guard: guard.clone(),
            asked: asked.clone(),
            headers: headers.clone(),
        }))
    }

    /// Whether the same request would be let now. Asking counts neither as a call nor as a use of session or token, which
    /// an open page would keep alive for ever.
    ///
    /// # Errors
    /// When the database fails.
    pub(in crate::web) async fn holds(&self) -> Result<bool, Error> {
        let Given {
            guard,
            asked,
            headers,
        } = &*self.0;
        let need = match asked.route.rule {
            Rule::Open | Rule::Greets | Rule::SignedIn => return Ok(true),
            Rule::Needs(need) => need,
            Rule::Shared => Need::Results,
        };
        let store = &guard.app.store;
        if !store.has_accounts().await? {
            return Ok(guard.admit_without_accounts(Some(need), headers).is_ok());
        }
        let shown = if asked.is_api() {
            bearer(headers).map(|token| token.parse::<Token>().ok())
        } else {
            session_token(headers, &guard.app.settings).map(Some)
        };
        let caller = match shown {
            None => return Ok(guard.shown_to_all(asked).await?.is_some()),
            Some(None) => return Ok(false),
            Some(Some(token)) if asked.is_api() => token_holder(store, &token).await?,
            Some(Some(token)) => match store.session_unused(&token).await? {
                Some(account) => Caller::Account(account),
                // As for any visitor: a public study stays open after logging out.
                None => return Ok(guard.shown_to_all(asked).await?.is_some()),
            },
        };
        Ok(caller.may(need) && !caller.must_change_password())
    }
}

async fn token_holder(store: &Store, token: &Token) -> Result<Caller, Error> {
    let token = store.api_token_unused(token).await?;
    let now = store.clock().now();
    let usable = token.filter(|token| token.state(now) == TokenState::Usable);
    Ok(usable.map_or(Caller::Nobody, Caller::Token))
}
