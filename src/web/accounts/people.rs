//! What admins do with accounts: make, disable, change. The guard writes each to the log.

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Form, Path, State},
    http::StatusCode,
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;

use super::{
    super::{
        Error,
        access::{Caller, Recorded},
        assets,
        error::sentence,
        results::rfc3339,
    },
    bar::{Bar, Who},
    hashed, one_time_password,
};
use crate::{
    chance::Chance,
    store::{self, Account, AccountId, AccountName, NewAccount, Role, Store},
};

const ROLES: &[Role] = &[Role::Viewer, Role::Researcher, Role::Admin];

#[derive(Template, WebTemplate)]
#[template(path = "account/people.html")]
struct PeoplePage {
    bar: Bar,
    error: Option<String>,
    invited: Option<Invited>,
    accounts: Vec<AccountLine>,
}

/// Somebody who gets a one-time password.
struct Invited {
    name: String,
    password: String,
}

struct AccountLine {
    id: i64,
    name: String,
    role: Role,
    created: String,
    is_disabled: bool,
}

#[derive(Deserialize)]
pub(super) struct NewForm {
    name: String,
    role: String,
}

#[derive(Deserialize)]
pub(super) struct RoleForm {
    role: String,
}

#[derive(Deserialize)]
pub(super) struct DisabledForm {
    disabled: u8,
}

async fn page(
    store: &Store,
    caller: &Caller,
    invited: Option<Invited>,
    error: Option<String>,
) -> Result<PeoplePage, Error> {
    let accounts = store.accounts().await?;
    Ok(PeoplePage {
        bar: Bar::of(store, caller).await?,
        error: error.as_deref().map(sentence),
        invited,
        accounts: accounts
            .into_iter()
            .map(|account| AccountLine {
                id: account.id.get(),
                name: account.name,
                role: account.role,
                created: rfc3339(account.created_at),
                is_disabled: account.disabled_at.is_some(),
            })
            .collect(),
    })
}

/// GET `/admin/accounts`.
pub(super) async fn list(
    State(store): State<Store>,
    Extension(caller): Extension<Caller>,
) -> Result<Response, Error> {
    Ok(page(&store, &caller, None, None).await?.into_response())
}

/// POST `/admin/accounts`: an account with a one-time password, which the page that answers shows.
pub(super) async fn make(
    State(store): State<Store>,
    State(chance): State<Chance>,
    Extension(caller): Extension<Caller>,
    Form(form): Form<NewForm>,
) -> Result<Response, Error> {
    let role = read_role(&form.role)?;
    let name: AccountName = match form.name.parse() {
        Ok(name) => name,
        Err(error) => return again(&store, &caller, format!("{error}")).await,
    };
    let (shown, password) = one_time_password(&chance);
    let account = NewAccount {
        name: name.clone(),
        password: hashed(password, &chance).await?,
        role,
        must_change_password: true,
    };
    match store.make_account(account).await {
        Ok(_) => {}
        Err(store::Error::Conflict(_)) => {
            return again(
                &store,
                &caller,
                format!("there is an account `{name}` already"),
            )
            .await;
        }
        Err(error) => return Err(error.into()),
    }
    let invited = Invited {
        name: name.to_string(),
        password: shown,
    };
    let page = page(&store, &caller, Some(invited), None).await?;
    Ok((recorded("make an account", format!("{name}: {role}")), page).into_response())
}

/// POST `/admin/accounts/ID/role`.
pub(super) async fn set_role(
    State(store): State<Store>,
    Extension(caller): Extension<Caller>,
    Path(account): Path<i64>,
    Form(form): Form<RoleForm>,
) -> Result<Response, Error> {
    let account = account_of(&store, account).await?;
    let role = read_role(&form.role)?;
    match store.set_role(account.id, role).await {
        Ok(()) => Ok(done("change a role", format!("{}: {role}", account.name))),
        Err(store::Error::Refused(text)) => again(&store, &caller, text).await,
        Err(error) => Err(error.into()),
    }
}

/// POST `/admin/accounts/ID/disabled`.
pub(super) async fn set_disabled(
    State(store): State<Store>,
    Extension(caller): Extension<Caller>,
    Path(account): Path<i64>,
    Form(form): Form<DisabledForm>,
) -> Result<Response, Error> {
    let account = account_of(&store, account).await?;
    let is_disabled = form.disabled != 0;
    let action = if is_disabled {
        "disable an account"
    } else {
        "enable an account"
    };
    match store.set_disabled(account.id, is_disabled).await {
        Ok(()) => Ok(done(action, account.name)),
        Err(store::Error::Refused(text)) => again(&store, &caller, text).await,
        Err(error) => Err(error.into()),
    }
}

/// POST `/admin/accounts/ID/password`: a new one-time password, which the page that answers shows.
pub(super) async fn set_password(
    State(store): State<Store>,
    State(chance): State<Chance>,
    Extension(caller): Extension<Caller>,
    Path(account): Path<i64>,
) -> Result<Response, Error> {
    let account = account_of(&store, account).await?;
    let (shown, password) = one_time_password(&chance);
    let password = hashed(password, &chance).await?;
    store.set_password(account.id, password, true).await?;
    let invited = Invited {
        name: account.name.clone(),
        password: shown,
    };
    let page = page(&store, &caller, Some(invited), None).await?;
    Ok((recorded("set a one-time password", account.name), page).into_response())
}

async fn again(store: &Store, caller: &Caller, error: String) -> Result<Response, Error> {
    let page = page(store, caller, None, Some(error)).await?;
    Ok((StatusCode::UNPROCESSABLE_ENTITY, page).into_response())
}

fn done(action: &str, detail: String) -> Response {
    (recorded(action, detail), Redirect::to("/admin/accounts")).into_response()
}

fn recorded(action: &str, detail: String) -> Extension<Recorded> {
    Extension(Recorded {
        action: Some(action.to_owned()),
        detail: Some(detail),
    })
}

async fn account_of(store: &Store, id: i64) -> Result<Account, Error> {
    let accounts = store.accounts().await?;
    accounts
        .into_iter()
        .find(|account| account.id == AccountId::from(id))
        .ok_or(Error::NotFound("account"))
}

fn read_role(text: &str) -> Result<Role, Error> {
    text.parse().map_err(|_| {
        Error::Unprocessable(format!(
            "role `{text}` does not exist; allowed: admin, researcher, viewer"
        ))
    })
}
