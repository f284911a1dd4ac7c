//! Accounts, sessions, tokens: who may do what, with which status, and what the log says of it.

use reqwest::{Client, Method, RequestBuilder, Response, StatusCode, header, redirect::Policy};
use riskaware::clock::Clock;
use riskaware::store::{
    AccountId, AuditOutcome, AuditRow, NewAccount, NewApiToken, PasswordHash, Role,
    SESSION_IDLE_MS, SESSION_LIFE_MS, Scope, Token,
};
use riskaware::study::Timestamp;
use riskaware::web::Settings;
use riskaware::web::access::{Need, ROUTES, Route, Rule};
use sqlx::{Connection, sqlite::SqliteConnection};

use crate::{
    app::{App, Page, START},
    program::{riskaware, stderr, stdout},
};

const PASSWORD: &str = "a long password";

/// Random enough for a test, and the same each time.
fn token(seed: u8) -> Token {
    let bytes = [seed; 32];
    data_encoding::BASE64URL_NOPAD
        .encode(&bytes)
        .parse()
        .unwrap()
}

async fn account(app: &App, name: &str, role: Role) -> AccountId {
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
async fn api_token(app: &App, seed: u8, owner: Option<AccountId>, scopes: &[Scope]) -> Token {
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
struct Browser<'a> {
    app: &'a App,
    client: Client,
    cookie: Option<String>,
}

impl<'a> Browser<'a> {
    fn new(app: &'a App) -> Self {
        let client = Client::builder().redirect(Policy::none()).build().unwrap();
        Self {
            app,
            client,
            cookie: None,
        }
    }

    async fn logged_in(app: &'a App, name: &str) -> Self {
        let mut browser = Self::new(app);
        let response = browser.logs_in(name, PASSWORD).await;
        assert_eq!(response.status(), StatusCode::SEE_OTHER);
        browser
    }

    fn asks(&self, method: Method, path: &str) -> RequestBuilder {
        let request = self
            .client
            .request(method, format!("{}{path}", self.app.url));
        match &self.cookie {
            Some(cookie) => request.header(header::COOKIE, cookie),
            None => request,
        }
    }

    async fn gets(&self, path: &str) -> Response {
        self.asks(Method::GET, path).send().await.unwrap()
    }

    async fn posts(&mut self, path: &str, form: &[(&str, &str)]) -> Response {
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

    async fn logs_in(&mut self, name: &str, password: &str) -> Response {
        self.posts("/login", &[("name", name), ("password", password)])
            .await
    }
}

fn location(response: &Response) -> &str {
    response.headers()[header::LOCATION].to_str().unwrap()
}

async fn call(app: &App, path: &str, token: &Token) -> Response {
    let request = app.client.get(format!("{}{path}", app.url));
    request.bearer_auth(token).send().await.unwrap()
}

/// The log, the oldest entry first.
async fn log(app: &App) -> Vec<AuditRow> {
    let mut rows = app.store.audit(None, 1000).await.unwrap();
    rows.reverse();
    rows
}

/// Whether the log has an entry: who, what, outcome.
#[track_caller]
fn has(rows: &[AuditRow], actor: &str, action: &str, outcome: AuditOutcome) {
    let found = rows.iter().any(|row| {
        row.entry.actor.contains(actor)
            && row.entry.action == action
            && row.entry.outcome == outcome
    });
    assert!(found, "{actor}: {action} ({outcome}) is not in {rows:#?}");
}

const ANSWERS: &str = "/api/v1/studies/driving/answers.csv";
const SUMMARY: &str = "/api/v1/studies/driving/summary";
const EXPORT: &str = "/results/driving/data/answers.csv";

#[tokio::test]
async fn a_viewer_exports_nothing_and_the_log_shows_the_attempt() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    let viewer = account(&app, "viktor", Role::Viewer).await;
    let browser = Browser::logged_in(&app, "viktor").await;
    assert_eq!(browser.gets("/results/driving").await.status(), 200);
    assert_eq!(browser.gets(EXPORT).await.status(), 403);
    let page = Page::of(browser.gets("/results/driving").await).await;
    assert!(
        !page.html.contains("answers.csv"),
        "no link that leads nowhere"
    );
    // A token of theirs may claim what it wants.
    let token = api_token(&app, 1, Some(viewer), &[Scope::Results, Scope::Data]).await;
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 200);
    assert_eq!(call(&app, ANSWERS, &token).await.status(), 403);

    let browser = Browser::logged_in(&app, "anna").await;
    let export = browser.gets(EXPORT).await;
    assert_eq!(export.status(), 200);
    assert!(export.text().await.unwrap().starts_with("study,version,"));
    let rows = log(&app).await;
    has(&rows, "viktor", "export answers.csv", AuditOutcome::Refused);
    has(
        &rows,
        "viktor, token",
        "export answers.csv",
        AuditOutcome::Refused,
    );
    has(&rows, "anna", "export answers.csv", AuditOutcome::Done);
    let export = rows
        .iter()
        .find(|row| row.entry.action == "export answers.csv");
    assert_eq!(export.unwrap().entry.study, Some("driving".into()));
}

#[tokio::test]
async fn a_token_reads_what_its_scopes_say_until_it_expires_or_is_revoked() {
    let app = App::start().await;
    let owner = account(&app, "anna", Role::Researcher).await;
    let narrow = api_token(&app, 1, Some(owner), &[Scope::Results]).await;
    let wide = api_token(&app, 2, None, &[Scope::Results, Scope::Data]).await;

    let refused = call(&app, ANSWERS, &narrow).await;
    assert_eq!(refused.status(), 403);
    assert_eq!(
        refused.headers()[header::CONTENT_TYPE],
        "application/problem+json"
    );
    assert_eq!(call(&app, ANSWERS, &wide).await.status(), 200);
    assert_eq!(
        call(&app, ANSWERS, &token(9)).await.status(),
        401,
        "unknown"
    );

    let id = app.store.api_tokens(None).await.unwrap()[0].id;
    app.store.revoke_api_token(id, None).await.unwrap();
    assert_eq!(call(&app, SUMMARY, &wide).await.status(), 401, "revoked");

    app.clock.advance(86_400_000);
    for path in [SUMMARY, ANSWERS] {
        let expired = call(&app, path, &narrow).await;
        assert_eq!(expired.status(), 401, "{path}");
        let challenge = expired.headers()[header::WWW_AUTHENTICATE]
            .to_str()
            .unwrap();
        assert!(
            challenge.starts_with("Bearer ") && challenge.contains("invalid_token"),
            "{challenge}"
        );
        let problem: serde_json::Value = expired.json().await.unwrap();
        assert_eq!(problem["status"], 401);
    }
    let rows = log(&app).await;
    has(
        &rows,
        "anna, token 1",
        "export answers.csv",
        AuditOutcome::Refused,
    );
    has(&rows, "token 2", "export answers.csv", AuditOutcome::Done);
    has(&rows, "nobody", "export answers.csv", AuditOutcome::Refused);
    let by_narrow = rows
        .iter()
        .filter(|row| row.entry.actor.contains("token 1"));
    assert_eq!(by_narrow.count(), 2, "the wrong scope and the expired one");
}

/// Who asks, in the test of all routes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asker {
    Nobody,
    Viewer,
    Researcher,
    Admin,
    /// A token without any scope that the API's data need.
    ResultsToken,
    FullToken,
    ExpiredToken,
}

/// The status that a route must answer with; none where it is the handler's business, as long as it lets the asker in.
fn expected(route: &Route, asker: Asker) -> Option<u16> {
    let is_api = route.path.starts_with("/api/");
    let is_for_scripts = route.path.contains("/data/") || route.path.ends_with("/events");
    let need = match route.rule {
        Rule::Open | Rule::Greets => return None,
        Rule::SignedIn => None,
        Rule::Needs(need) => Some(need),
        Rule::Shared => Some(Need::Results),
    };
    if is_api {
        return match asker {
            // Cookies are nothing to the API.
            Asker::Nobody | Asker::Viewer | Asker::Researcher | Asker::Admin => Some(401),
            Asker::ExpiredToken => Some(401),
            Asker::ResultsToken => (need != Some(Need::Results)).then_some(403),
            Asker::FullToken => (need == Some(Need::Admin)).then_some(403),
        };
    }
    let is_let = match asker {
        // And tokens are nothing to pages.
        Asker::Nobody | Asker::ResultsToken | Asker::FullToken | Asker::ExpiredToken => {
            return Some(if is_for_scripts { 401 } else { 303 });
        }
        Asker::Viewer => matches!(need, None | Some(Need::Results)),
        Asker::Researcher => need != Some(Need::Admin),
        Asker::Admin => true,
    };
    (!is_let).then_some(403)
}

#[tokio::test]
async fn every_route_answers_each_asker_as_its_need_says() {
    let app = App::start().await;
    account(&app, "viktor", Role::Viewer).await;
    account(&app, "anna", Role::Researcher).await;
    let admin = account(&app, "ada", Role::Admin).await;
    let viewer = Browser::logged_in(&app, "viktor").await;
    let researcher = Browser::logged_in(&app, "anna").await;
    let nobody = Browser::new(&app);
    let expired = api_token(&app, 1, Some(admin), &[Scope::Results]).await;
    app.clock.advance(86_400_000);
    // The half-day without use has ended their sessions.
    assert_eq!(viewer.gets("/account").await.status(), 303);
    drop((viewer, researcher));
    let viewer = Browser::logged_in(&app, "viktor").await;
    let researcher = Browser::logged_in(&app, "anna").await;
    let results = api_token(&app, 2, Some(admin), &[Scope::Results]).await;
    let full = api_token(
        &app,
        3,
        Some(admin),
        &[Scope::Results, Scope::Data, Scope::Manage],
    )
    .await;

    for route in ROUTES {
        let path = route
            .path
            .replace("{study}", "driving")
            .replace("{fit}", "1")
            .replace("{account}", "999")
            .replace("{run}", "999")
            .replace("{token}", "999");
        let is_post = path.ends_with("/predict") || path.ends_with("/public");
        for asker in [
            Asker::Nobody,
            Asker::Viewer,
            Asker::Researcher,
            Asker::Admin,
            Asker::ResultsToken,
            Asker::FullToken,
            Asker::ExpiredToken,
        ] {
            // An admin of its own each time: logging out is one of the routes.
            let admin;
            let browser = match asker {
                Asker::Viewer => &viewer,
                Asker::Researcher => &researcher,
                Asker::Admin => {
                    let mut browser = Browser::new(&app);
                    let session = token(200);
                    let ada = app.store.account_named("ada").await.unwrap();
                    app.store.close_session(&session).await.unwrap();
                    app.store
                        .open_session(ada.id, &session, None)
                        .await
                        .unwrap();
                    browser.cookie = Some(format!("riskaware={session}"));
                    admin = browser;
                    &admin
                }
                Asker::Nobody | Asker::ResultsToken | Asker::FullToken | Asker::ExpiredToken => {
                    &nobody
                }
            };
            let method = if is_post { Method::POST } else { Method::GET };
            let mut request = browser.asks(method, &path);
            request = match asker {
                Asker::ResultsToken => request.bearer_auth(&results),
                Asker::FullToken => request.bearer_auth(&full),
                Asker::ExpiredToken => request.bearer_auth(&expired),
                Asker::Nobody | Asker::Viewer | Asker::Researcher | Asker::Admin => request,
            };
            // Of a stream only the head is waited for.
            let response = request.send().await.unwrap();
            let status = response.status().as_u16();
            match expected(route, asker) {
                Some(expected) => assert_eq!(status, expected, "{asker:?} at {path}"),
                None => assert!(
                    !matches!(status, 401 | 403) && !(300..400).contains(&status)
                        || status == 303 && !location(&response).starts_with("/login")
                        || route.rule == Rule::Open,
                    "{asker:?} at {path}: {status}"
                ),
            }
            let is_problem = response
                .headers()
                .get(header::CONTENT_TYPE)
                .is_some_and(|found| found == "application/problem+json");
            if path.starts_with("/api/") && status >= 400 {
                assert!(is_problem, "{asker:?} at {path}: {status}");
            }
            if status == 401 && path.starts_with("/api/") {
                let challenge = response.headers()[header::WWW_AUTHENTICATE]
                    .to_str()
                    .unwrap();
                assert!(challenge.starts_with("Bearer "), "{challenge}");
            }
            // What has an entity tag may be kept by its reader, who asks each time whether it still holds.
            let kept = &response.headers()[header::CACHE_CONTROL];
            let is_asked_for_anew =
                kept == "private, no-cache" && response.headers().contains_key(header::ETAG);
            assert!(
                kept == "no-store" || is_asked_for_anew,
                "only files with their hash in their path are kept: {path}"
            );
        }
    }
}

#[tokio::test]
async fn the_setup_link_makes_one_admin_and_then_opens_nothing() {
    let app = App::start().await;
    let (old, link) = (token(1), token(2));
    assert!(app.store.renew_setup_link(&old).await.unwrap());
    assert!(app.store.renew_setup_link(&link).await.unwrap());
    let mut browser = Browser::new(&app);
    let form = [("name", "ada"), ("password", PASSWORD)];
    let path = format!("/setup/{link}");
    assert_eq!(browser.gets(&format!("/setup/{old}")).await.status(), 404);
    assert_eq!(browser.gets("/setup/x").await.status(), 404);
    let page = Page::of(browser.gets(&path).await).await;
    assert_eq!(page.status, 200);
    assert_eq!(page.text("h1").unwrap(), "Make the first account");
    // Results are open on this machine until then.
    assert_eq!(browser.gets("/results/driving").await.status(), 200);
    assert_eq!(browser.gets("/admin/accounts").await.status(), 403);

    let short = browser
        .posts(&path, &[("name", "ada"), ("password", "short")])
        .await;
    let page = Page::of(short).await;
    assert_eq!(page.status, 422);
    assert!(page.html.contains("12 to 128 characters"), "{}", page.html);
    assert_eq!(page.field("name"), "ada");

    let made = browser.posts(&path, &form).await;
    assert_eq!(
        (made.status(), location(&made)),
        (StatusCode::SEE_OTHER, "/account")
    );
    let cookie = made.headers()[header::SET_COOKIE].to_str().unwrap();
    assert!(
        cookie.contains("HttpOnly") && cookie.contains("SameSite=Lax"),
        "{cookie}"
    );
    assert_eq!(browser.gets("/admin/accounts").await.status(), 200);
    // Neither again, nor with another link, nor without a session.
    assert_eq!(Browser::new(&app).posts(&path, &form).await.status(), 404);
    assert!(!app.store.renew_setup_link(&token(3)).await.unwrap());
    let stranger = Browser::new(&app);
    let page = stranger.gets("/results/driving?plan=x").await;
    assert_eq!(location(&page), "/login?next=/results/driving%3Fplan%3Dx");
    has(
        &log(&app).await,
        "ada",
        "make the first account",
        AuditOutcome::Done,
    );
}

#[tokio::test]
async fn logins_rotate_the_session_and_say_nothing_of_unknown_names() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    let mut browser = Browser::new(&app);
    let wrong = Page::of(browser.logs_in("anna", "not the password").await).await;
    let unknown = Page::of(browser.logs_in("nobody", "not the password").await).await;
    assert_eq!(
        (wrong.status, unknown.status),
        (
            StatusCode::UNPROCESSABLE_ENTITY,
            StatusCode::UNPROCESSABLE_ENTITY
        )
    );
    assert_eq!(wrong.html.replace("anna", "nobody"), unknown.html);

    let form = [
        ("name", "anna"),
        ("password", PASSWORD),
        ("next", "//example.org"),
    ];
    let response = browser.posts("/login", &form).await;
    assert_eq!(location(&response), "/", "a login leads nowhere else");
    let first = browser.cookie.clone();
    let form = [
        ("name", "anna"),
        ("password", PASSWORD),
        ("next", "/results/driving"),
    ];
    let response = browser.posts("/login", &form).await;
    assert_eq!(location(&response), "/results/driving");
    assert_ne!(browser.cookie, first);
    let before = Browser {
        cookie: first,
        ..Browser::new(&app)
    };
    assert_eq!(
        before.gets("/account").await.status(),
        303,
        "the session before has ended"
    );

    let page = Page::of(browser.gets("/account").await).await;
    assert!(page.html.contains("Signed in as anna"), "{}", page.html);
    let out = browser.posts("/logout", &[]).await;
    assert_eq!(out.status(), 303);
    assert!(
        out.headers()[header::SET_COOKIE]
            .to_str()
            .unwrap()
            .contains("Max-Age=0")
    );
    let rows = log(&app).await;
    has(&rows, "anna", "log in", AuditOutcome::Done);
    has(&rows, "anna", "log in", AuditOutcome::Refused);
    has(&rows, "nobody", "log in", AuditOutcome::Refused);
    let secrets = format!("{rows:?}");
    assert!(
        !secrets.contains(PASSWORD) && !secrets.contains("not the password"),
        "{secrets}"
    );
}

#[tokio::test]
async fn sessions_end_unused_after_half_a_day_and_in_any_case_after_a_week() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    let idle = Browser::logged_in(&app, "anna").await;
    let busy = Browser::logged_in(&app, "anna").await;
    let mut passed = 0;
    while passed + SESSION_IDLE_MS - 1 < SESSION_LIFE_MS {
        app.clock.advance(SESSION_IDLE_MS - 1);
        passed += SESSION_IDLE_MS - 1;
        assert_eq!(
            busy.gets("/account").await.status(),
            200,
            "after {passed} ms"
        );
        // The use is noted with a later commit; this one comes after it.
        let token = token(1);
        app.store.close_session(&token).await.unwrap();
    }
    assert_eq!(idle.gets("/account").await.status(), 303);
    app.clock.advance(SESSION_LIFE_MS - passed);
    assert_eq!(busy.gets("/account").await.status(), 303);
}

#[tokio::test]
async fn an_invited_account_chooses_its_own_password_first() {
    let app = App::start().await;
    account(&app, "ada", Role::Admin).await;
    let mut admin = Browser::logged_in(&app, "ada").await;
    let page = Page::of(
        admin
            .posts(
                "/admin/accounts",
                &[("name", "anna"), ("role", "researcher")],
            )
            .await,
    )
    .await;
    let one_time = page.text(".secret").expect("the password is shown once");
    assert!(
        !Page::of(admin.gets("/admin/accounts").await)
            .await
            .html
            .contains(&one_time)
    );

    let mut anna = Browser::new(&app);
    assert_eq!(anna.logs_in("anna", &one_time).await.status(), 303);
    let away = anna.gets("/results/driving").await;
    assert_eq!(location(&away), "/account/password");
    let form = [
        ("current", one_time.as_str()),
        ("new", "an even longer password"),
    ];
    assert_eq!(
        location(&anna.posts("/account/password", &form).await),
        "/account"
    );
    assert_eq!(anna.gets("/results/driving").await.status(), 200);
    assert_eq!(
        Browser::new(&app).logs_in("anna", &one_time).await.status(),
        422
    );

    // Disabled, an account opens nothing, nor do its tokens.
    let id = app.store.account_named("anna").await.unwrap().id;
    let token = api_token(&app, 1, Some(id), &[Scope::Results]).await;
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 200);
    let path = format!("/admin/accounts/{id}/disabled");
    assert_eq!(admin.posts(&path, &[("disabled", "1")]).await.status(), 303);
    assert_eq!(anna.gets("/results/driving").await.status(), 303);
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 401);
    has(
        &log(&app).await,
        "ada",
        "disable an account",
        AuditOutcome::Done,
    );
}

#[tokio::test]
async fn the_last_admin_stays_one() {
    let app = App::start().await;
    let ada = account(&app, "ada", Role::Admin).await;
    let mut admin = Browser::logged_in(&app, "ada").await;
    for (path, form) in [
        (format!("/admin/accounts/{ada}/role"), ("role", "viewer")),
        (format!("/admin/accounts/{ada}/disabled"), ("disabled", "1")),
    ] {
        let page = Page::of(admin.posts(&path, &[form]).await).await;
        assert_eq!(page.status, 422);
        assert!(page.html.contains("the last admin"), "{}", page.html);
    }
    let berta = account(&app, "berta", Role::Admin).await;
    assert_eq!(
        admin
            .posts(
                &format!("/admin/accounts/{berta}/role"),
                &[("role", "viewer")]
            )
            .await
            .status(),
        303
    );
    assert_eq!(
        app.store.account_named("ada").await.unwrap().role,
        Role::Admin
    );
}

#[tokio::test]
async fn a_token_is_made_on_the_page_shown_once_and_revoked_there() {
    let app = App::start().await;
    account(&app, "viktor", Role::Viewer).await;
    let mut browser = Browser::logged_in(&app, "viktor").await;
    let form = [
        ("name", "notebook"),
        ("results", "1"),
        ("data", "1"),
        ("days", "30"),
    ];
    let page = Page::of(browser.posts("/account/tokens", &form).await).await;
    let token: Token = page.text(".secret").unwrap().parse().unwrap();
    let stored = app.store.api_token(&token).await.unwrap().unwrap();
    assert_eq!(
        stored.scopes,
        [Scope::Results],
        "not more than its owner may"
    );
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 200);
    let page = Page::of(browser.gets("/account").await).await;
    assert!(page.html.contains("notebook") && !page.html.contains(&token.to_string()));
    let path = format!("/account/tokens/{}/revoke", stored.id);
    assert_eq!(browser.posts(&path, &[]).await.status(), 303);
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 401);
}

#[tokio::test]
async fn a_public_study_shows_aggregates_of_five_people_and_never_data() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    let mut researcher = Browser::logged_in(&app, "anna").await;
    assert_eq!(
        researcher
            .posts("/results/driving/public", &[("public", "1")])
            .await
            .status(),
        303
    );
    let stranger = Browser::new(&app);
    for people in 0..5 {
        assert_eq!(
            stranger.gets("/results/driving").await.status(),
            303,
            "{people} people"
        );
        assert_eq!(
            stranger.gets(SUMMARY).await.status(),
            401,
            "{people} people"
        );
        app.participant("").await.finishes("stop").await;
    }
    let page = Page::of(stranger.gets("/results/driving").await).await;
    assert_eq!(page.status, 200);
    assert!(!page.html.contains("answers.csv"));
    assert_eq!(stranger.gets(SUMMARY).await.status(), 200);
    assert_eq!(
        stranger
            .gets("/results/driving/data/curves.json")
            .await
            .status(),
        200
    );
    assert_eq!(stranger.gets(EXPORT).await.status(), 401);
    assert_eq!(stranger.gets(ANSWERS).await.status(), 401);
    assert_eq!(
        stranger.gets("/api/v1/studies/driving").await.status(),
        401,
        "the study file holds its codes"
    );
    assert_eq!(
        stranger.gets("/results/cups").await.status(),
        303,
        "another study"
    );
    researcher
        .posts("/results/driving/public", &[("public", "0")])
        .await;
    assert_eq!(stranger.gets("/results/driving").await.status(), 303);
    has(
        &log(&app).await,
        "anna",
        "make results public",
        AuditOutcome::Done,
    );
}

#[tokio::test]
async fn the_eleventh_login_within_five_minutes_has_to_wait() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    let mut browser = Browser::new(&app);
    for _ in 0..10 {
        assert_eq!(
            browser.logs_in("anna", "not the password").await.status(),
            422
        );
    }
    let response = browser.logs_in("anna", PASSWORD).await;
    assert_eq!(response.status(), 429);
    let wait: i64 = response.headers()[header::RETRY_AFTER]
        .to_str()
        .unwrap()
        .parse()
        .unwrap();
    app.clock.advance(wait * 1000);
    assert_eq!(browser.logs_in("anna", PASSWORD).await.status(), 303);
}

/// `riskaware` with these arguments on the app's database, and what it printed.
async fn command(app: &App, arguments: &[&str], input: &'static str) -> (bool, String, String) {
    let path = app.store.path().to_str().unwrap().to_owned();
    let mut arguments: Vec<String> = arguments.iter().map(|part| (*part).to_owned()).collect();
    arguments.extend([
        "--database".to_owned(),
        path,
        "--log".to_owned(),
        "warn".to_owned(),
    ]);
    let run = move || {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        riskaware(&arguments, input)
    };
    let output = tokio::task::spawn_blocking(run).await.unwrap();
    (output.status.success(), stdout(&output), stderr(&output))
}

#[tokio::test]
async fn commands_make_accounts_and_tokens_while_the_server_runs() {
    let app = App::with(Clock::start(), App::built_in()).await;
    let link = token(1);
    app.store.renew_setup_link(&link).await.unwrap();
    let (done, _, told) = command(&app, &["user", "add", "anna"], "a long password\n").await;
    assert!(!done && told.contains("--role admin"), "{told}");
    assert!(app.store.accounts().await.unwrap().is_empty());
    let first = ["user", "add", "olga", "--role", "admin"];
    assert!(command(&app, &first, "a long password\n").await.0);
    let (done, _, told) = command(&app, &["user", "add", "anna"], "short\n").await;
    assert!(!done && told.contains("12 to 128 characters"), "{told}");
    let (done, _, told) = command(&app, &["user", "add", "anna"], "a long password\n").await;
    assert!(done, "{told}");
    let browser = Browser::logged_in(&app, "anna").await;
    assert_eq!(browser.gets("/results/driving").await.status(), 200);
    assert_eq!(browser.gets(&format!("/setup/{link}")).await.status(), 404);

    let add = [
        "token",
        "add",
        "notebook",
        "--scope",
        "results",
        "--days",
        "7",
        "--account",
        "anna",
    ];
    let (done, printed, told) = command(&app, &add, "").await;
    assert!(done, "{told}");
    let token: Token = printed.trim().parse().unwrap();
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 200);
    assert_eq!(call(&app, ANSWERS, &token).await.status(), 403);
    let (_, listed, _) = command(&app, &["token", "list"], "").await;
    assert!(
        listed.starts_with("1\tnotebook\tanna\tresults\tuntil "),
        "{listed}"
    );
    assert!(!listed.contains(printed.trim()), "{listed}");
    assert!(command(&app, &["token", "revoke", "1"], "").await.0);
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 401);
    let (done, _, told) = command(
        &app,
        &["token", "add", "x", "--scope", "all", "--days", "7"],
        "",
    )
    .await;
    assert!(
        !done && told.contains("unknown scope `all`; allowed: results, data, manage"),
        "{told}"
    );
    let (done, _, told) = command(&app, &["user", "add", "x", "--role", "boss"], "").await;
    assert!(
        !done && told.contains("unknown role `boss`; allowed: admin, researcher, viewer"),
        "{told}"
    );

    assert!(
        command(&app, &["user", "role", "anna", "viewer"], "")
            .await
            .0
    );
    assert_eq!(browser.gets(EXPORT).await.status(), 403);
    let beyond = [
        "token",
        "add",
        "x",
        "--scope",
        "results,data",
        "--days",
        "7",
        "--account",
        "anna",
    ];
    let (done, printed, told) = command(&app, &beyond, "").await;
    assert!(
        !done
            && told.contains(
                "anna is a viewer, whose tokens may not be used for data; allowed: results"
            ),
        "{told}"
    );
    assert_eq!(printed, "");
    assert!(
        command(&app, &["user", "password", "anna"], "another password\n")
            .await
            .0
    );
    assert_eq!(
        browser.gets("/results/driving").await.status(),
        303,
        "its sessions end"
    );
    assert!(command(&app, &["user", "disable", "anna"], "").await.0);
    assert_eq!(
        Browser::new(&app)
            .logs_in("anna", "another password")
            .await
            .status(),
        422
    );
    let (_, listed, _) = command(&app, &["user", "list"], "").await;
    assert!(listed.starts_with("anna\tviewer\tdisabled "), "{listed}");
    let rows = log(&app).await;
    for action in [
        "make an account",
        "make a token",
        "revoke a token",
        "change a role",
        "set a password",
        "disable an account",
    ] {
        has(&rows, "command", action, AuditOutcome::Done);
    }
}

#[tokio::test]
async fn a_look_at_a_blind_study_is_written_down() {
    let mut studies = App::built_in();
    for (_, text) in &mut studies {
        *text = text.replace("# blind_until = 30 ", "blind_until = 3 #");
    }
    let app = App::with(Clock::manual(START), studies).await;
    account(&app, "viktor", Role::Viewer).await;
    let browser = Browser::logged_in(&app, "viktor").await;
    assert_eq!(browser.gets("/results/driving").await.status(), 200);
    let rows = log(&app).await;
    has(&rows, "viktor", "look at results", AuditOutcome::Done);
    let look = rows.last().unwrap();
    assert_eq!(look.at, app.clock.now());
    assert_eq!(look.entry.study, Some("driving".into()));
}

#[tokio::test]
async fn the_log_is_only_appended_to() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    Browser::logged_in(&app, "anna").await;
    let mut raw = SqliteConnection::connect(app.store.path().to_str().unwrap())
        .await
        .unwrap();
    for change in ["update audit set actor = 'nobody'", "delete from audit"] {
        let refused = sqlx::query(change).execute(&mut raw).await.unwrap_err();
        assert!(
            refused.to_string().contains("only appended to"),
            "{refused}"
        );
    }
    assert_eq!(log(&app).await.len(), 1);
}

#[tokio::test]
async fn https_is_demanded_where_the_public_url_says_so() {
    let settings = Settings {
        public_url: Some("https://study.example".parse().unwrap()),
        ..Settings::default()
    };
    let app = App::configured(Clock::manual(START), App::built_in(), settings).await;
    account(&app, "anna", Role::Researcher).await;
    let browser = Browser::logged_in(&app, "anna").await;
    assert!(
        browser
            .cookie
            .as_ref()
            .unwrap()
            .starts_with("__Host-riskaware=")
    );
    let response = browser.gets("/account").await;
    assert_eq!(response.status(), 200);
    assert_eq!(
        response.headers()[header::STRICT_TRANSPORT_SECURITY],
        "max-age=31536000"
    );

    let plain = App::start().await;
    let response = Browser::new(&plain).gets("/").await;
    assert!(
        !response
            .headers()
            .contains_key(header::STRICT_TRANSPORT_SECURITY)
    );
}

#[tokio::test]
async fn starts_from_one_address_are_limited_and_answers_of_one_run() {
    let settings = Settings {
        trusted_proxies: vec!["127.0.0.1".parse().unwrap()],
        ..Settings::default()
    };
    let app = App::configured(Clock::manual(START), App::built_in(), settings).await;
    let starts = async |address: &str| {
        let path = format!("{}/s/driving/a/{}", app.url, token(1));
        let request = app.client.post(path).header("x-forwarded-for", address);
        request.send().await.unwrap()
    };
    for _ in 0..60 {
        assert_eq!(starts("192.0.2.1").await.status(), 404);
    }
    let refused = starts("192.0.2.1").await;
    assert_eq!(refused.status(), 429);
    assert!(refused.headers().contains_key(header::RETRY_AFTER));
    assert_eq!(starts("192.0.2.2").await.status(), 404, "another address");
    app.clock.advance(1_000);
    assert_eq!(starts("192.0.2.1").await.status(), 404);

    let answers = async |seed| {
        let path = format!("{}/r/{}", app.url, token(seed));
        let form = [("step", "0"), ("key", "k")];
        let request = app.client.post(path).form(&form);
        request.send().await.unwrap().status().as_u16()
    };
    for _ in 0..120 {
        assert_eq!(answers(1).await, 404);
    }
    assert_eq!(answers(1).await, 429);
    assert_eq!(answers(2).await, 404, "another run");
}
