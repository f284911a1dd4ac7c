//! Setting up, logging in and out, one's own account, and what admins do with the accounts of others.

mod bar;
mod log;
mod login;
mod own;
mod people;
mod setup;
mod sharing;
mod tokens;

use axum::{
    Extension, Router,
    routing::{get, post},
};

pub(super) use self::bar::{Bar, Who};
use super::{
    AppState, Error, Settings,
    access::{self, Caller},
};
use crate::{
    chance::Chance,
    store::{Account, Password, PasswordHash, Store, Token},
};

pub(super) fn router() -> Router<AppState> {
    Router::new()
        .route("/setup/{token}", get(setup::ask).post(setup::make))
        .route("/login", get(login::ask).post(login::log_in))
        .route("/logout", post(login::log_out))
        .route("/account", get(own::show))
        .route(
            "/account/password",
            get(own::ask_password).post(own::set_password),
        )
        .route("/account/sessions", post(own::close_sessions))
        .route("/account/tokens", post(tokens::make))
        .route("/account/tokens/{token}/revoke", post(tokens::revoke))
        .route("/admin/accounts", get(people::list).post(people::make))
        .route("/admin/accounts/{account}/role", post(people::set_role))
        .route(
            "/admin/accounts/{account}/disabled",
            post(people::set_disabled),
        )
        .route(
            "/admin/accounts/{account}/password",
            post(people::set_password),
        )
        .route("/admin/tokens/{token}/revoke", post(people::revoke_token))
        .route("/admin/audit", get(log::show))
        .route("/results/{study}/public", post(sharing::set))
}

/// The account that is logged in, where the guard let nobody else through.
fn signed_in(Extension(caller): Extension<Caller>) -> Result<Account, Error> {
    match caller {
        Caller::Account(account) => Ok(account),
        Caller::Nobody | Caller::Local | Caller::Token(_) => {
            Err(Error::Forbidden("this takes an account".to_owned()))
        }
    }
}

/// What somebody is told whose two passwords are not the same. Both are typed anew: which one was meant nobody knows.
const DIFFERENT: &str = "the two passwords are not the same; type both once more";

/// A password's hash, with a salt of its own.
async fn hashed(password: Password, chance: &Chance) -> Result<PasswordHash, Error> {
    let mut salt = [0; 16];
    salt.copy_from_slice(&chance.bytes()[..16]);
    Ok(PasswordHash::of(password, salt).await?)
}

/// A password for somebody else, good for choosing another one: 24 letters and digits.
fn one_time_password(chance: &Chance) -> (String, Password) {
    let text = data_encoding::BASE32_NOPAD
        .encode(&chance.bytes()[..15])
        .to_lowercase();
    let password = text.parse().expect("24 characters are allowed");
    (text, password)
}

/// Logs the browser in as `account`, under a new token in place of the one that it had.
async fn open_session(
    store: &Store,
    chance: &Chance,
    settings: &Settings,
    headers: &axum::http::HeaderMap,
    account: crate::store::AccountId,
) -> Result<axum::http::HeaderValue, Error> {
    let token = Token::random(&mut chance.fork());
    let before = access::session_token(headers, settings);
    store.open_session(account, &token, before.as_ref()).await?;
    Ok(access::set_session(settings, &token))
}
