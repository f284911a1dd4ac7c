//! Accounts, tokens and browsers for the tests of who may do what.

use reqwest::{Client, Method, RequestBuilder, Response, StatusCode, header, redirect::Policy};
use riskaware::{
    store::{
        AccountId, AuditOutcome, AuditRow, NewAccount, NewApiToken, PasswordHash, Role, Scope,
        Token,
    },
    study::Timestamp,
};

use crate::app::App;

pub(super) const ANSWERS: &str = "/api/v1/studies/driving/answers.csv";
pub(super) const SUMMARY: &str = "/api/v1/studies/driving/summary";
pub(super) const EXPORT: &str = "/results/driving/data/answers.csv";
pub(super) const PASSWORD: &str = "a long password";

/// Random enough for a test, and the same each time.
pub(super) fn token(seed: u8) -> Token {
    let bytes = [seed; 32];
    data_encoding::BASE64URL_NOPAD
        .encode(&bytes)
        .parse()
        .unwrap()
}

pub(super) async fn account(app: &App, name: &str, role: Role) -> AccountId {
    let password = PasswordHash::of(PASSWORD.parse().unwrap(), [7; 16])
        .await
        .unwrap();
    let account = NewAccount {
        name: name.parse().unwrap(),
        password,
        role,
        must_change_password: false,
    };
    app.store.make_account(account).await.unwrap()
}

/// A token of the API that lasts a day.
pub(super) async fn api_token(
    app: &App,
    seed: u8,
    owner: Option<AccountId>,
    scopes: &[Scope],
) -> Token {
    let token = token(seed);
    let new = NewApiToken {
        name: format!("token {seed}").parse().unwrap(),
        scopes: scopes.to_vec(),
        owner,
        expires_at: Timestamp(app.clock.now().0 + 86_400_000),
    };
    app.store.make_api_token(&token, new).await.unwrap();
    token
}

/// A browser: it keeps the cookie that it is given, and follows nothing by itself.
pub(super) struct Browser<'a> {
    pub(super) app: &'a App,
    pub(super) client: Client,
    pub(super) cookie: Option<String>,
}

impl<'a> Browser<'a> {
    pub(super) fn new(app: &'a App) -> Self {
        let client = Client::builder().redirect(Policy::none()).build().unwrap();
        Self {
            app,
            client,
            cookie: None,
        }
    }

    pub(super) async fn logged_in(app: &'a App, name: &str) -> Self {
        let mut browser = Self::new(app);
        let response = browser.logs_in(name, PASSWORD).await;
        assert_eq!(response.status(), StatusCode::SEE_OTHER);
        browser
    }

    pub(super) fn asks(&self, method: Method, path: &str) -> RequestBuilder {
        let request = self
            .client
            .request(method, format!("{}{path}", self.app.url));
        match &self.cookie {
            Some(cookie) => request.header(header::COOKIE, cookie),
            None => request,
        }
    }

    pub(super) async fn gets(&self, path: &str) -> Response {
        self.asks(Method::GET, path).send().await.unwrap()
    }

    pub(super) async fn posts(&mut self, path: &str, form: &[(&str, &str)]) -> Response {
        let response = self
            .asks(Method::POST, path)
            .form(form)
            .send()
            .await
            .unwrap();
        if let Some(cookie) = response.headers().get(header::SET_COOKIE) {
            let cookie = cookie.to_str().unwrap().split(';').next().unwrap();
            self.cookie = Some(cookie.to_owned());
        }
        response
    }

    pub(super) async fn logs_in(&mut self, name: &str, password: &str) -> Response {
        self.posts("/login", &[("name", name), ("password", password)])
            .await
    }
}

pub(super) fn location(response: &Response) -> &str {
    response.headers()[header::LOCATION].to_str().unwrap()
}

pub(super) async fn call(app: &App, path: &str, token: &Token) -> Response {
    let request = app.client.get(format!("{}{path}", app.url));
    request.bearer_auth(token).send().await.unwrap()
}

/// The log, the oldest entry first.
pub(super) async fn log(app: &App) -> Vec<AuditRow> {
    let mut rows = app.store.audit(None, 1000).await.unwrap();
    rows.reverse();
    rows
}

/// Whether the log has an entry: who, what, outcome.
#[track_caller]
pub(super) fn has(rows: &[AuditRow], actor: &str, action: &str, outcome: AuditOutcome) {
    let found = rows.iter().any(|row| {
        row.entry.actor.contains(actor)
            && row.entry.action == action
            && row.entry.outcome == outcome
    });
    assert!(found, "{actor}: {action} ({outcome}) is not in {rows:#?}");
}
