//! Logging in, sessions, and how often somebody may try.

use reqwest::{StatusCode, header};
use riskaware::{
    clock::Clock,
    store::{AuditOutcome, Role, SESSION_IDLE_MS, SESSION_LIFE_MS},
    web::Settings,
};

use crate::app::{App, Page, START};

use super::lab::{Browser, PASSWORD, account, has, location, log, token};

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
