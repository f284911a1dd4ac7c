//! The first account, made with the one-time link that the server printed.

use std::sync::Arc;

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    extract::{Form, Path, State},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;

use super::{
    super::{Error, Settings, assets, error::sentence},
    DIFFERENT,
    bar::{Bar, Who},
    hashed, open_session,
};
use crate::{
    chance::Chance,
    store::{AccountName, AuditEntry, AuditOutcome, NewAccount, Password, Role, Store, Token},
};

#[derive(Template, WebTemplate)]
#[template(path = "account/setup.html")]
struct SetupPage {
    bar: Bar,
    token: Token,
    name: String,
    error: Option<String>,
}

impl SetupPage {
    fn new(token: Token, name: String, error: Option<String>) -> Self {
        let bar = Bar {
            who: Who::NoAccounts,
            sharing: None,
        };
        Self {
            bar,
            token,
            name,
            error,
        }
    }
}

#[derive(Deserialize)]
pub(super) struct NewcomerForm {
    name: String,
    password: String,
    /// The same once more.
    again: String,
}

/// GET `/setup/TOKEN`.
pub(super) async fn ask(
    State(store): State<Store>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = open_link(&store, &token).await?;
    Ok(SetupPage::new(token, String::new(), None).into_response())
}

/// POST `/setup/TOKEN`: makes the account and logs it in.
pub(super) async fn make(
    State(store): State<Store>,
    State(chance): State<Chance>,
    State(settings): State<Arc<Settings>>,
    Path(token): Path<String>,
    headers: HeaderMap,
    Form(form): Form<NewcomerForm>,
) -> Result<Response, Error> {
    let token = open_link(&store, &token).await?;
    let (name, password): (AccountName, Password) = match (form.name.parse(), form.password.parse())
    {
        (Ok(name), Ok(password)) => (name, password),
        (Err(error), _) => return Ok(again(token, form.name, &error)),
        (_, Err(error)) => return Ok(again(token, form.name, &error)),
    };
    if form.again != form.password {
        return Ok(again(token, form.name, &DIFFERENT));
    }
    let account = NewAccount {
        name: name.clone(),
        password: hashed(password, &chance).await?,
        role: Role::Admin,
        must_change_password: false,
    };
    let entry = AuditEntry {
        actor: name.to_string(),
        action: "make the first account".to_owned(),
        study: None,
        detail: None,
        outcome: AuditOutcome::Done,
    };
    let recording = store.recording(entry);
    let account = recording.make_first_account(&token, account).await?;
    let cookie = open_session(&store, &chance, &settings, &headers, account).await?;
    Ok(([(header::SET_COOKIE, cookie)], Redirect::to("/account")).into_response())
}

fn again(token: Token, name: String, error: &dyn std::fmt::Display) -> Response {
    let page = SetupPage::new(token, name, Some(sentence(&error.to_string())));
    (StatusCode::UNPROCESSABLE_ENTITY, page).into_response()
}

/// A link that opens nothing is not there.
async fn open_link(store: &Store, text: &str) -> Result<Token, Error> {
    let gone = Error::NotFound("setup link");
    let Ok(token) = text.parse() else {
        return Err(gone);
    };
    if store.is_setup_link(&token).await? {
        Ok(token)
    } else {
        Err(gone)
    }
}
