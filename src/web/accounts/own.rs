//! One's own account: password, sessions, and the page that shows them with the tokens.

use std::sync::Arc;

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Form, State},
    http::{StatusCode, header},
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
    hashed, signed_in,
};
use crate::{
    chance::Chance,
    store::{self, Account, ApiToken, AuditOutcome, Password, Role, Store, Token, TokenState},
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

/// A token in a list.
pub(super) struct TokenLine {
    pub(super) id: i64,
    pub(super) name: String,
    /// Whose it is; empty if a command made it for nobody.
    pub(super) owner: String,
    pub(super) scopes: String,
    pub(super) expires: String,
    pub(super) last_used: String,
    pub(super) state: &'static str,
    /// Whether it opens something, or will again.
    pub(super) is_usable: bool,
}

impl TokenLine {
    pub(super) fn new(token: ApiToken, now: Timestamp) -> Self {
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
                TokenState::Waiting => "waits for another password",
            },
            is_usable: matches!(state, TokenState::Usable | TokenState::Waiting),
            owner: token.owner.map_or_else(String::new, |(_, name, _)| name),
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
    /// Ticked where the account's tokens are to end too.
    revoke: Option<String>,
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
    Form(form): Form<PasswordForm>,
) -> Result<Response, Error> {
    let account = signed_in(caller)?;
    limits.check_own_password(account.id, client)?;
    let caller = Caller::Account(account.clone());
    let action = "change the own password";
    let verified = store.check_password(&account.name, &form.current).await?;
    let Some(verified) = verified else {
        let detail = Some("wrong password".to_owned());
        access::record(&store, &caller, action, None, detail, AuditOutcome::Refused).await?;
        return again(
            &store,
            &account,
            "the current password is another one".to_owned(),
        )
        .await;
    };
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
    let ends_tokens = form.revoke.is_some();
    let detail = ends_tokens.then(|| "and revoke all tokens".to_owned());
    let session = Token::random(&mut chance.fork());
    let recording = store.recording(access::entry(&caller, action, None, detail));
    let changed = recording
        .change_password(verified, password, ends_tokens, &session)
        .await;
    match changed {
        Ok(()) => {}
        Err(store::Error::Refused(text)) => return again(&store, &account, text).await,
        Err(error) => return Err(error.into()),
    }
    let cookie = access::set_session(&settings, &session);
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
    let id = account.id;
    let entry = access::entry(&Caller::Account(account), "log out everywhere", None, None);
    store.recording(entry).close_sessions(id).await?;
    let forget = access::clear_session(&settings);
    Ok(([(header::SET_COOKIE, forget)], Redirect::to("/login")).into_response())
}
