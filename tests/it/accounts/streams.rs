//! Event streams end with the leave to read them.

use std::time::Duration;

use reqwest::Response;
use riskaware::store::{Role, SESSION_IDLE_MS, Scope};

use crate::app::App;

use super::lab::{Browser, account, api_token, call};

const PAGE: &str = "/results/driving/events";
const API: &str = "/api/v1/studies/driving/events";

/// Reads until the next version, and says whether one came before the end.
async fn is_told(stream: &mut Response) -> bool {
    // Only a stream that should have ended and did not waits so long.
    let limit = Duration::from_secs(30);
    loop {
        let chunk = tokio::time::timeout(limit, stream.chunk()).await;
        match chunk.expect("the stream neither goes on nor ends").unwrap() {
            Some(bytes) if String::from_utf8_lossy(&bytes).contains("version") => return true,
            Some(_) => {}
            None => return false,
        }
    }
}

async fn ends(mut stream: Response) {
    while is_told(&mut stream).await {}
}

/// An answer, some time after what happened before.
async fn something_changes(app: &App) {
    app.clock.advance(2_000);
    app.participant("").await.sends("consent", "agree").await;
}

#[tokio::test]
async fn a_stream_ends_with_its_session() {
    let app = App::start().await;
    let anna = account(&app, "anna", Role::Viewer).await;
    let browser = Browser::logged_in(&app, "anna").await;
    let mut stream = browser.gets(PAGE).await;
    assert_eq!(stream.status(), 200);
    assert!(is_told(&mut stream).await);
    something_changes(&app).await;
    assert!(is_told(&mut stream).await, "the session holds");
    app.store.close_sessions(anna).await.unwrap();
    something_changes(&app).await;
    ends(stream).await;
    app.stop().await;
}

#[tokio::test]
async fn an_open_stream_keeps_no_session_alive() {
    let app = App::start().await;
    account(&app, "anna", Role::Viewer).await;
    let browser = Browser::logged_in(&app, "anna").await;
    let mut stream = browser.gets(PAGE).await;
    assert!(is_told(&mut stream).await);
    // Asked in between, which must not count as use.
    app.clock.advance(SESSION_IDLE_MS - 10_000);
    something_changes(&app).await;
    assert!(is_told(&mut stream).await);
    app.clock.advance(10_000);
    something_changes(&app).await;
    ends(stream).await;
    app.stop().await;
}

#[tokio::test]
async fn a_stream_ends_with_its_token() {
    let app = App::start().await;
    let owner = account(&app, "anna", Role::Researcher).await;
    let token = api_token(&app, 1, Some(owner), &[Scope::Results]).await;
    let mut stream = call(&app, API, &token).await;
    assert_eq!(stream.status(), 200);
    assert!(is_told(&mut stream).await);
    something_changes(&app).await;
    assert!(is_told(&mut stream).await, "the token holds");
    let id = app.store.api_tokens(None).await.unwrap()[0].id;
    app.store.revoke_api_token(id, None).await.unwrap();
    something_changes(&app).await;
    ends(stream).await;
    app.stop().await;
}

#[tokio::test]
async fn a_strangers_stream_ends_when_the_study_is_public_no_longer() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    for _ in 0..5 {
        app.participant("").await.finishes("stop").await;
    }
    let study = "driving".into();
    app.store.set_public(&study, true).await.unwrap();
    let mut stream = Browser::new(&app).gets(PAGE).await;
    assert_eq!(stream.status(), 200);
    assert!(is_told(&mut stream).await);
    app.store.set_public(&study, false).await.unwrap();
    something_changes(&app).await;
    ends(stream).await;
    app.stop().await;
}

#[tokio::test]
async fn a_stream_of_this_machine_ends_with_the_first_account() {
    let app = App::start().await;
    let mut stream = Browser::new(&app).gets(PAGE).await;
    assert_eq!(stream.status(), 200);
    assert!(is_told(&mut stream).await);
    account(&app, "anna", Role::Admin).await;
    something_changes(&app).await;
    ends(stream).await;
    app.stop().await;
}
