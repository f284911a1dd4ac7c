//! One's own tokens of the API.

use axum::{
    Extension,
    extract::{Form, Path, State},
    response::{Redirect, Response},
};
use serde::Deserialize;

use super::{
    super::{
        Error,
        access::{self, Caller, Need},
    },
    own::page,
    signed_in,
};
use crate::{
    chance::Chance,
    store::{AccountName, ApiTokenId, NewApiToken, Scope, Store, Token},
    study::Timestamp,
};

const DAY_MS: i64 = 24 * 60 * 60 * 1000;

#[derive(Deserialize)]
pub(super) struct TokenForm {
    name: String,
    results: Option<String>,
    data: Option<String>,
    manage: Option<String>,
    days: i64,
}

/// POST `/account/tokens`: the page that answers shows the token, this once.
pub(super) async fn make(
    State(store): State<Store>,
    State(chance): State<Chance>,
    caller: Extension<Caller>,
    Form(form): Form<TokenForm>,
) -> Result<Response, Error> {
    let account = signed_in(caller)?;
    let caller = Caller::Account(account.clone());
    let scopes: Vec<Scope> = [
        (Scope::Results, Need::Results, &form.results),
        (Scope::Data, Need::Data, &form.data),
        (Scope::Manage, Need::Manage, &form.manage),
    ]
    .into_iter()
    .filter(|(_, need, ticked)| ticked.is_some() && caller.may(*need))
    .map(|(scope, _, _)| scope)
    .collect();
    let name: AccountName = match form.name.parse() {
        Ok(name) => name,
        Err(error) => return page(&store, account, None, Some(format!("{error}"))).await,
    };
    if scopes.is_empty() || !(1..=365).contains(&form.days) {
        let text = "a token needs something that it may do, and 1 to 365 days".to_owned();
        return page(&store, account, None, Some(text)).await;
    }
    let token = Token::random(&mut chance.fork());
    let names: Vec<&str> = scopes.iter().map(|scope| scope.as_str()).collect();
    let detail = format!("{name}: {}, {} days", names.join(" "), form.days);
    let new = NewApiToken {
        name,
        scopes,
        owner: Some(account.id),
        expires_at: Timestamp(store.clock().now().0 + form.days * DAY_MS),
    };
    let entry = access::entry(&caller, "make a token", None, Some(detail));
    store.recording(entry).make_api_token(&token, new).await?;
    page(&store, account, Some(token.to_string()), None).await
}

/// POST `/account/tokens/ID/revoke`.
pub(super) async fn revoke(
    State(store): State<Store>,
    caller: Extension<Caller>,
    Path(token): Path<i64>,
) -> Result<Redirect, Error> {
    let account = signed_in(caller)?;
    let owner = Some(account.id);
    let detail = Some(format!("token {token}"));
    let entry = access::entry(&Caller::Account(account), "revoke a token", None, detail);
    let recording = store.recording(entry);
    recording
        .revoke_api_token(ApiTokenId::from(token), owner)
        .await?;
    Ok(Redirect::to("/account"))
}
