//! Roles and scopes: what each may read, and what the log says of it.

use reqwest::header;
use riskaware::store::{AuditOutcome, Role, Scope, Token};

use crate::app::{App, Page};

use super::lab::{ANSWERS, Browser, EXPORT, SUMMARY, account, api_token, call, has, log, token};

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
