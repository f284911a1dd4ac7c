//! One's own account: password, sessions, and the page that shows them with the tokens.

use std::sync::Arc;

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Form, State},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;

use super::{
    super::{
        Error, Settings,
        access::{self, Caller, ClientAddress, Limits, Need},
        assets,
        error::sentence,
        results::rfc3339,
    },
    DIFFERENT,
    bar::{Bar, Who},
    hashed, open_session, signed_in,
};
use crate::{
    chance::Chance,
    store::{Account, ApiToken, AuditOutcome, Password, Role, Store, TokenState},
    study::Timestamp,
};

#[derive(Template, WebTemplate)]
#[template(path = "account/own.html")]
struct OwnPage {
    bar: Bar,
    error: Option<String>,
    name: String,
    role: Role,
    may_data: bool,
    new_token: Option<String>,
    /// Since when, last used, when it ends.
    sessions: Vec<[String; 3]>,
    tokens: Vec<TokenLine>,
}

struct TokenLine {
    id: i64,
    name: String,
    scopes: String,
    expires: String,
    last_used: String,
    state: &'static str,
    is_usable: bool,
}

impl TokenLine {
    fn new(token: ApiToken, now: Timestamp) -> Self {
        let state = token.state(now);
        let scopes: Vec<&str> = token.scopes.iter().map(|scope| scope.as_str()).collect();
        Self {
            id: token.id.get(),
            scopes: scopes.join(", "),
            expires: rfc3339(token.expires_at),
            last_used: token
                .last_used_at
                .map_or_else(|| "never".to_owned(), rfc3339),
            state: match state {
                TokenState::Usable => "in use",
                TokenState::Expired => "expired",
                TokenState::Revoked => "revoked",
            },
            is_usable: state == TokenState::Usable,
            name: token.name,
        }
    }
}

#[derive(Template, WebTemplate)]
#[template(path = "account/password.html")]
struct PasswordPage {
    bar: Bar,
    must_change: bool,
    error: Option<String>,
}

#[derive(Deserialize)]
pub(super) struct PasswordForm {
    current: String,
    new: String,
    /// The new one once more.
    again: String,
}

/// The page of an account, with a token that was just made, or with what was wrong.
pub(super) async fn page(
    store: &Store,
    account: Account,
    new_token: Option<String>,
    error: Option<String>,
) -> Result<Response, Error> {
    let now = store.clock().now();
    let sessions = store.sessions_of(account.id).await?;
    let tokens = store.api_tokens(Some(account.id)).await?;
    let caller = Caller::Account(account.clone());
    Ok(OwnPage {
        bar: Bar::of(store, &caller).await?,
        error,
        name: account.name,
        role: account.role,
        may_data: caller.may(Need::Data),
        new_token,
        sessions: sessions
            .iter()
            .map(|session| {
                [session.created_at, session.last_used_at, session.expires_at].map(rfc3339)
            })
            .collect(),
        tokens: tokens
            .into_iter()
            .map(|token| TokenLine::new(token, now))
            .collect(),
    }
    .into_response())
}

/// GET `/account`.
pub(super) async fn show(
    State(store): State<Store>,
    caller: Extension<Caller>,
) -> Result<Response, Error> {
    page(&store, signed_in(caller)?, None, None).await
}

/// GET `/account/password`.
pub(super) async fn ask_password(
    State(store): State<Store>,
    caller: Extension<Caller>,
) -> Result<Response, Error> {
    Ok(password_page(&store, &signed_in(caller)?, None)
        .await?
        .into_response())
}

async fn password_page(
    store: &Store,
    account: &Account,
    error: Option<String>,
) -> Result<PasswordPage, Error> {
    Ok(PasswordPage {
        bar: Bar::of(store, &Caller::Account(account.clone())).await?,
        must_change: account.must_change_password,
        error,
    })
}

/// POST `/account/password`: all sessions end but a new one of this browser.
pub(super) async fn set_password(
    (State(store), State(chance), State(settings)): (
        State<Store>,
        State<Chance>,
        State<Arc<Settings>>,
    ),
    (State(limits), Extension(client)): (State<Arc<Limits>>, Extension<ClientAddress>),
    caller: Extension<Caller>,
    headers: HeaderMap,
    Form(form): Form<PasswordForm>,
) -> Result<Response, Error> {
    let account = signed_in(caller)?;
    limits.check_login(&account.name, client)?;
    let caller = Caller::Account(account.clone());
    let action = "change the own password";
    if store
        .check_password(&account.name, &form.current)
        .await?
        .is_none()
    {
        let detail = Some("wrong password".to_owned());
        access::record(&store, &caller, action, None, detail, AuditOutcome::Refused).await?;
        return again(
            &store,
            &account,
            "the current password is another one".to_owned(),
        )
        .await;
    }
    let password: Password = match form.new.parse() {
        Ok(password) => password,
        Err(error) => return again(&store, &account, format!("{error}")).await,
    };
    if form.again != form.new {
        return again(&store, &account, DIFFERENT.to_owned()).await;
    }
    if form.new == form.current {
        return again(
            &store,
            &account,
            "the new password is the current one".to_owned(),
        )
        .await;
    }
    let password = hashed(password, &chance).await?;
    store.set_password(account.id, password, false).await?;
    access::record(&store, &caller, action, None, None, AuditOutcome::Done).await?;
    let cookie = open_session(&store, &chance, &settings, &headers, account.id).await?;
    Ok(([(header::SET_COOKIE, cookie)], Redirect::to("/account")).into_response())
}

async fn again(store: &Store, account: &Account, error: String) -> Result<Response, Error> {
    let page = password_page(store, account, Some(sentence(&error))).await?;
    Ok((StatusCode::UNPROCESSABLE_ENTITY, page).into_response())
}

/// POST `/account/sessions`: logs out everywhere.
pub(super) async fn close_sessions(
    State(store): State<Store>,
    State(settings): State<Arc<Settings>>,
    caller: Extension<Caller>,
) -> Result<Response, Error> {
    let account = signed_in(caller)?;
    store.close_sessions(account.id).await?;
    let caller = Caller::Account(account);
    access::record(
        &store,
        &caller,
        "log out everywhere",
        None,
        None,
        AuditOutcome::Done,
    )
    .await?;
    let forget = access::clear_session(&settings);
    Ok(([(header::SET_COOKIE, forget)], Redirect::to("/login")).into_response())
}
