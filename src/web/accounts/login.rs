//! Logging in and out.

use std::sync::Arc;

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Form, Query, State},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;

use super::{
    super::{
        Error, Settings,
        access::{self, Caller, ClientAddress, Limits},
        assets,
    },
    bar::{Bar, Who},
};
use crate::{
    chance::Chance,
    store::{self, AuditOutcome, Store, Token},
};

#[derive(Template, WebTemplate)]
#[template(path = "account/login.html")]
struct LoginPage {
    bar: Bar,
    next: String,
    name: String,
    error: Option<&'static str>,
}

impl LoginPage {
    fn new(next: &str, name: String, error: Option<&'static str>) -> Self {
        Self {
            bar: Bar {
                who: Who::NoAccounts,
                sharing: None,
            },
            next: local_path(next).to_owned(),
            name,
            error,
        }
    }
}

#[derive(Deserialize)]
pub(super) struct LoginQuery {
    #[serde(default)]
    next: String,
}

#[derive(Deserialize)]
pub(super) struct LoginForm {
    name: String,
    password: String,
    #[serde(default)]
    next: String,
}

/// GET `/login`.
pub(super) async fn ask(Query(query): Query<LoginQuery>) -> Response {
    LoginPage::new(&query.next, String::new(), None).into_response()
}

/// POST `/login`.
pub(super) async fn log_in(
    State(store): State<Store>,
    State(chance): State<Chance>,
    State(settings): State<Arc<Settings>>,
    State(limits): State<Arc<Limits>>,
    Extension(client): Extension<ClientAddress>,
    headers: HeaderMap,
    Form(form): Form<LoginForm>,
) -> Result<Response, Error> {
    limits.check_login(&form.name, client)?;
    let refused = async |name: String| {
        note_refusal(&store, &name).await?;
        let text = "this name and password open no account";
        let page = LoginPage::new(&form.next, name, Some(text));
        Ok((StatusCode::UNPROCESSABLE_ENTITY, page).into_response())
    };
    let Some(verified) = store.check_password(&form.name, &form.password).await? else {
        return refused(form.name).await;
    };
    let token = Token::random(&mut chance.fork());
    let before = access::session_token(&headers, &settings);
    let caller = Caller::Account(verified.account.clone());
    let recording = store.recording(access::entry(&caller, "log in", None, None));
    match recording.log_in(verified, &token, before.as_ref()).await {
        Ok(()) => {}
        // Disabled or given another password since.
        Err(store::Error::NotFound(_)) => return refused(form.name).await,
        Err(error) => return Err(error.into()),
    }
    limits.note_login(&form.name, client);
    let cookie = access::set_session(&settings, &token);
    let next = Redirect::to(local_path(&form.next));
    Ok(([(header::SET_COOKIE, cookie)], next).into_response())
}

/// Written down under the account's name, or under none: people type passwords where a name belongs.
async fn note_refusal(store: &Store, name: &str) -> Result<(), Error> {
    let (caller, detail) = match store.account_named(name.trim()).await {
        Ok(account) if account.disabled_at.is_some() => {
            (Caller::Account(account), "the account is disabled")
        }
        Ok(account) => (Caller::Account(account), "wrong password"),
        Err(store::Error::NotFound(_)) => (Caller::Nobody, "unknown name"),
        Err(error) => return Err(error.into()),
    };
    let detail = Some(detail.to_owned());
    access::record(
        store,
        &caller,
        "log in",
        None,
        detail,
        AuditOutcome::Refused,
    )
    .await
}

/// POST `/logout`.
pub(super) async fn log_out(
    State(store): State<Store>,
    State(settings): State<Arc<Settings>>,
    headers: HeaderMap,
) -> Result<Response, Error> {
    if let Some(token) = access::session_token(&headers, &settings) {
        store.close_session(&token).await?;
    }
    let forget = access::clear_session(&settings);
    Ok(([(header::SET_COOKIE, forget)], Redirect::to("/")).into_response())
}

/// Where a login leads: a path of this server, or the first page. Browsers read `//` and `/\` as another host.
fn local_path(next: &str) -> &str {
    let is_local = next.starts_with('/')
        && !next.starts_with("//")
        && !next.contains('\\')
        && next.bytes().all(|byte| byte.is_ascii_graphic());
    if is_local { next } else { "/" }
}

#[cfg(test)]
mod tests {
    use super::local_path;

    #[test]
    fn a_login_leads_nowhere_else() {
        for path in ["/", "/results/driving?plan=a", "/admin/audit"] {
            assert_eq!(local_path(path), path);
        }
        for elsewhere in [
            "",
            "https://example.org",
            "//example.org",
            "/\\example.org",
            "/a\r\nset-cookie: x",
            "javascript:alert(1)",
        ] {
            assert_eq!(local_path(elsewhere), "/", "{elsewhere}");
        }
    }
}
