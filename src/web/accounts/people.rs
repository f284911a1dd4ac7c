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
        access::{self, Caller, Recorded, Written},
        assets,
        error::sentence,
        results::rfc3339,
    },
    bar::{Bar, Who},
    hashed, one_time_password,
    own::TokenLine,
};
use crate::{
    chance::Chance,
    store::{self, Account, AccountId, AccountName, ApiTokenId, NewAccount, Role, Store},
};

/// What making an account is called in the log.
const MAKE: &str = "make an account";

const ROLES: &[Role] = &[Role::Viewer, Role::Researcher, Role::Admin];

#[derive(Template, WebTemplate)]
#[template(path = "account/people.html")]
struct PeoplePage {
    bar: Bar,
    error: Option<String>,
    invited: Option<Invited>,
    accounts: Vec<AccountLine>,
    /// Those of all accounts, revoked ones too.
    tokens: Vec<TokenLine>,
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
    let tokens = store.api_tokens(None).await?;
    let now = store.clock().now();
    Ok(PeoplePage {
        bar: Bar::of(store, caller).await?,
        error: error.as_deref().map(sentence),
        invited,
        tokens: tokens
            .into_iter()
            .map(|token| TokenLine::new(token, now))
            .collect(),
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
        Err(error) => {
            let action = recorded(MAKE, None);
            return again(&store, &caller, action, format!("{error}")).await;
        }
    };
    let (shown, password) = one_time_password(&chance);
    let account = NewAccount {
        name: name.clone(),
        password: hashed(password, &chance).await?,
        role,
        must_change_password: true,
    };
    let detail = format!("{name}: {role}");
    let recording = store.recording(access::entry(&caller, MAKE, None, Some(detail.clone())));
    match recording.make_account(account).await {
        Ok(_) => {}
        Err(store::Error::Conflict(_)) => {
            let text = format!("there is an account `{name}` already");
            return again(&store, &caller, recorded(MAKE, Some(detail)), text).await;
        }
        Err(error) => return Err(error.into()),
    }
    let invited = Invited {
        name: name.to_string(),
        password: shown,
    };
    let page = page(&store, &caller, Some(invited), None).await?;
    Ok((Extension(Written), page).into_response())
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
    let (action, detail) = ("change a role", format!("{}: {role}", account.name));
    let recording = store.recording(access::entry(&caller, action, None, Some(detail.clone())));
    match recording.set_role(account.id, role).await {
        Ok(()) => Ok(done()),
        Err(store::Error::Refused(text)) => {
            again(&store, &caller, recorded(action, Some(detail)), text).await
        }
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
    let detail = account.name.clone();
    let recording = store.recording(access::entry(&caller, action, None, Some(detail)));
    match recording.set_disabled(account.id, is_disabled).await {
        Ok(()) => Ok(done()),
        Err(store::Error::Refused(text)) => {
            let recorded = recorded(action, Some(account.name));
            again(&store, &caller, recorded, text).await
        }
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
    let detail = Some(account.name.clone());
    let entry = access::entry(&caller, "set a one-time password", None, detail);
    let recording = store.recording(entry);
    recording.set_password(account.id, password, true).await?;
    let invited = Invited {
        name: account.name,
        password: shown,
    };
    let page = page(&store, &caller, Some(invited), None).await?;
    Ok((Extension(Written), page).into_response())
}

/// POST `/admin/tokens/ID/revoke`: anybody's token.
pub(super) async fn revoke_token(
    State(store): State<Store>,
    Extension(caller): Extension<Caller>,
    Path(token): Path<i64>,
) -> Result<Response, Error> {
    let entry = access::entry(
        &caller,
        "revoke a token",
        None,
        Some(format!("token {token}")),
    );
    let recording = store.recording(entry);
    recording
        .revoke_api_token(ApiTokenId::from(token), None)
        .await?;
    Ok(done())
}

/// What was refused, with what the log says of it.
async fn again(
    store: &Store,
    caller: &Caller,
    recorded: Extension<Recorded>,
    error: String,
) -> Result<Response, Error> {
    let page = page(store, caller, None, Some(error)).await?;
    Ok((StatusCode::UNPROCESSABLE_ENTITY, recorded, page).into_response())
}

fn done() -> Response {
    (Extension(Written), Redirect::to("/admin/accounts")).into_response()
}

fn recorded(action: &str, detail: Option<String>) -> Extension<Recorded> {
    Extension(Recorded {
        action: Some(action.to_owned()),
        detail,
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
