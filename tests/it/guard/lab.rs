//! Accounts, browsers and addresses for the tests of the guard.

use reqwest::{Client, Method, RequestBuilder, Response, header, redirect::Policy};
use riskaware::clock::Clock;
use riskaware::store::{
    AccountId, AuditOutcome, AuditRow, NewAccount, NewApiToken, PasswordHash, Role, Scope, Token,
};
use riskaware::study::Timestamp;
use riskaware::web::Settings;
use sqlx::{Connection, sqlite::SqliteConnection};

use crate::app::{App, START};

pub(super) const PASSWORD: &str = "a long password";

/// A server that believes a proxy on this machine: whoever names an address in a request comes from there.
pub(super) async fn behind_a_proxy() -> App {
    let settings = Settings {
        trusted_proxies: vec!["127.0.0.1".parse().unwrap()],
        ..Settings::default()
    };
    App::configured(Clock::manual(START), App::built_in(), settings).await
}

/// Random enough for a test, and the same each time.
pub(super) fn token(seed: u8) -> Token {
    let text = data_encoding::BASE64URL_NOPAD.encode(&[seed; 32]);
    text.parse().unwrap()
}

pub(super) async fn hash(password: &str) -> PasswordHash {
    PasswordHash::of(password.parse().unwrap(), [7; 16])
        .await
        .unwrap()
}

pub(super) async fn account(app: &App, name: &str, role: Role) -> AccountId {
    let account = NewAccount {
        name: name.parse().unwrap(),
        password: hash(PASSWORD).await,
        role,
        must_change_password: false,
    };
    app.store.make_account(account).await.unwrap()
}

/// A token that lasts a day.
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

/// A browser that keeps its cookie and follows nothing by itself.
#[derive(Clone)]
pub(super) struct Browser<'a> {
    app: &'a App,
    client: Client,
    pub(super) cookie: Option<String>,
    /// The address that the proxy says it is from.
    pub(super) address: Option<&'static str>,
}

impl<'a> Browser<'a> {
    pub(super) fn new(app: &'a App) -> Self {
        Self {
            app,
            client: Client::builder().redirect(Policy::none()).build().unwrap(),
            cookie: None,
            address: None,
        }
    }

    /// One that is logged in, without asking for the password.
    pub(super) async fn of(app: &'a App, account: AccountId, seed: u8) -> Self {
        let session = token(seed);
        let opened = app.store.open_session(account, &session, None).await;
        opened.unwrap();
        Self {
            cookie: Some(format!("riskaware={session}")),
            ..Self::new(app)
        }
    }

    pub(super) fn at(self, address: &'static str) -> Self {
        Self {
            address: Some(address),
            ..self
        }
    }

    pub(super) fn asks(&self, method: Method, path: &str) -> RequestBuilder {
        let mut request = self
            .client
            .request(method, format!("{}{path}", self.app.url));
        if let Some(cookie) = &self.cookie {
            request = request.header(header::COOKIE, cookie);
        }
        if let Some(address) = self.address {
            request = request.header("x-forwarded-for", address);
        }
        request
    }

    pub(super) async fn gets(&self, path: &str) -> Response {
        self.asks(Method::GET, path).send().await.unwrap()
    }

    pub(super) async fn posts(&mut self, path: &str, form: &[(&str, &str)]) -> Response {
        let request = self.asks(Method::POST, path).form(form);
        let response = request.send().await.unwrap();
        if let Some(cookie) = response.headers().get(header::SET_COOKIE) {
            let cookie = cookie.to_str().unwrap().split(';').next().unwrap();
            self.cookie = Some(cookie.to_owned());
        }
        response
    }

    pub(super) async fn logs_in(&mut self, name: &str, password: &str) -> u16 {
        let form = [("name", name), ("password", password)];
        self.posts("/login", &form).await.status().as_u16()
    }
}

pub(super) async fn call(app: &App, path: &str, token: &Token) -> Response {
    let request = app.client.get(format!("{}{path}", app.url));
    request.bearer_auth(token).send().await.unwrap()
}

/// How often the log says that exactly this actor did or tried this.
pub(super) async fn times(app: &App, actor: &str, action: &str, outcome: AuditOutcome) -> usize {
    let is_it = |row: &&AuditRow| {
        row.entry.actor == actor && row.entry.action == action && row.entry.outcome == outcome
    };
    let rows = app.store.audit(None, 10_000).await.unwrap();
    rows.iter().filter(is_it).count()
}

/// Changes the database behind the server's back.
pub(super) async fn execute(app: &App, statement: &'static str) {
    let mut raw = SqliteConnection::connect(app.store.path().to_str().unwrap())
        .await
        .unwrap();
    sqlx::query(statement).execute(&mut raw).await.unwrap();
    raw.close().await.unwrap();
}

pub(super) async fn count(app: &App, question: &'static str) -> i64 {
    let mut raw = SqliteConnection::connect(app.store.path().to_str().unwrap())
        .await
        .unwrap();
    let count = sqlx::query_scalar(question)
        .fetch_one(&mut raw)
        .await
        .unwrap();
    raw.close().await.unwrap();
    count
}
