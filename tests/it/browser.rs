//! Accounts, tokens and browsers for the tests of who may do what.

use reqwest::{Client, Method, RequestBuilder, Response, StatusCode, header, redirect::Policy};
use riskaware::{
    store::{AccountId, NewAccount, NewApiToken, PasswordHash, Role, Scope, Token},
    study::Timestamp,
};

use crate::app::App;

pub const PASSWORD: &str = "a long password";

/// Random enough for a test, and the same each time.
pub fn token(seed: u8) -> Token {
    let bytes = [seed; 32];
    data_encoding::BASE64URL_NOPAD
        .encode(&bytes)
        .parse()
        .unwrap()
}

pub async fn hash(password: &str) -> PasswordHash {
    PasswordHash::of(password.parse().unwrap(), [7; 16])
        .await
        .unwrap()
}

pub async fn account(app: &App, name: &str, role: Role) -> AccountId {
    let account = NewAccount {
        name: name.parse().unwrap(),
        password: hash(PASSWORD).await,
        role,
        must_change_password: false,
    };
    app.store.make_account(account).await.unwrap()
}

/// A token of the API that lasts a day.
pub async fn api_token(app: &App, seed: u8, owner: Option<AccountId>, scopes: &[Scope]) -> Token {
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
#[derive(Clone)]
pub struct Browser<'a> {
    pub app: &'a App,
    pub client: Client,
    pub cookie: Option<String>,
    /// The address that a proxy says it is from.
    pub address: Option<&'static str>,
}

impl<'a> Browser<'a> {
    pub fn new(app: &'a App) -> Self {
        let client = Client::builder().redirect(Policy::none()).build().unwrap();
        Self {
            app,
            client,
            cookie: None,
            address: None,
        }
    }

    pub async fn logged_in(app: &'a App, name: &str) -> Self {
        let mut browser = Self::new(app);
        let response = browser.logs_in(name, PASSWORD).await;
        assert_eq!(response.status(), StatusCode::SEE_OTHER);
        browser
    }

    /// One that is logged in, without asking for the password.
    pub async fn of(app: &'a App, account: AccountId, seed: u8) -> Self {
        let session = token(seed);
        let opened = app.store.open_session(account, &session, None).await;
        opened.unwrap();
        Self {
            cookie: Some(format!("riskaware={session}")),
            ..Self::new(app)
        }
    }

    pub fn at(self, address: &'static str) -> Self {
        Self {
            address: Some(address),
            ..self
        }
    }

    pub fn asks(&self, method: Method, path: &str) -> RequestBuilder {
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

    pub async fn gets(&self, path: &str) -> Response {
        self.asks(Method::GET, path).send().await.unwrap()
    }

    pub async fn posts(&mut self, path: &str, form: &[(&str, &str)]) -> Response {
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

    pub async fn logs_in(&mut self, name: &str, password: &str) -> Response {
        self.posts("/login", &[("name", name), ("password", password)])
            .await
    }
}

pub async fn call(app: &App, path: &str, token: &Token) -> Response {
    let request = app.client.get(format!("{}{path}", app.url));
    request.bearer_auth(token).send().await.unwrap()
}
