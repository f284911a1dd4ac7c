//! Passwords, sessions and tokens that are over open nothing, and nobody ends those of others.

use riskaware::store::{AuditOutcome, Error, Role, Scope};

use super::lab::{Browser, PASSWORD, account, api_token, behind_a_proxy, call, hash, times, token};
use crate::app::{App, Page};

const ONE: &str = "/api/v1/studies/driving";
const SUMMARY: &str = "/api/v1/studies/driving/summary";

#[tokio::test]
async fn whoever_knows_a_name_cannot_keep_its_owner_out() {
    let app = behind_a_proxy().await;
    account(&app, "anna", Role::Researcher).await;
    let mut office = Browser::new(&app).at("192.0.2.1");
    assert_eq!(office.logs_in("anna", PASSWORD).await.status(), 303);
    for address in [
        "198.51.100.1",
        "198.51.100.2",
        "198.51.100.3",
        "198.51.100.4",
        "198.51.100.5",
        "198.51.100.6",
        "198.51.100.7",
        "198.51.100.8",
        "198.51.100.9",
    ] {
        let mut stranger = Browser::new(&app).at(address);
        assert_eq!(
            stranger.logs_in("anna", "not the password").await.status(),
            422
        );
    }
    let mut stranger = Browser::new(&app).at("198.51.100.10");
    assert_eq!(
        stranger.logs_in("anna", "not the password").await.status(),
        429
    );
    let mut again = Browser::new(&app).at("192.0.2.1");
    assert_eq!(again.logs_in("anna", PASSWORD).await.status(), 303);
}

#[tokio::test]
async fn a_login_under_way_does_not_outlive_the_password() {
    let app = App::start().await;
    let anna = account(&app, "anna", Role::Researcher).await;
    let verified = app.store.check_password("anna", PASSWORD).await.unwrap();
    let verified = verified.expect("the password is right");
    let own = hash("another long password").await;
    app.store
        .set_password(anna, own.clone(), false)
        .await
        .unwrap();
    let late = app.store.log_in(verified.clone(), &token(1), None).await;
    assert!(matches!(late, Err(Error::NotFound(_))), "{late:?}");
    assert!(app.store.session(&token(1)).await.unwrap().is_none());
    // Nor does a change of the own password that was under way undo what an admin set.
    let theirs = hash("what somebody else chose").await;
    let late = app
        .store
        .change_password(verified, theirs, false, &token(2))
        .await;
    assert!(matches!(late, Err(Error::Refused(_))), "{late:?}");
    let kept = app
        .store
        .check_password("anna", "another long password")
        .await;
    assert!(kept.unwrap().is_some());
}

#[tokio::test]
async fn tokens_end_with_the_password_that_others_know() {
    let app = App::start().await;
    let ada = account(&app, "ada", Role::Admin).await;
    let anna = account(&app, "anna", Role::Researcher).await;
    let mut admin = Browser::of(&app, ada, 100).await;
    let token = api_token(&app, 1, Some(anna), &[Scope::Results]).await;
    let of_nobody = api_token(&app, 2, None, &[Scope::Results]).await;
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 200);
    let path = format!("/admin/accounts/{anna}/password");
    let page = Page::of(admin.posts(&path, &[]).await).await;
    let one_time = page.text(".secret").unwrap();
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 401, "revoked");
    assert_eq!(call(&app, SUMMARY, &of_nobody).await.status(), 200);
    // A token from before the first own password opens nothing until there is one.
    let early = api_token(&app, 3, Some(anna), &[Scope::Results]).await;
    let refused = call(&app, SUMMARY, &early).await;
    assert_eq!(refused.status(), 401);
    assert!(refused.text().await.unwrap().contains("/account/password"));

    let mut browser = Browser::new(&app);
    assert_eq!(browser.logs_in("anna", &one_time).await.status(), 303);
    let new = "an even longer password";
    let form = [("current", one_time.as_str()), ("new", new), ("again", new)];
    let changed = browser.posts("/account/password", &form).await;
    assert_eq!(changed.status(), 303);
    assert_eq!(call(&app, SUMMARY, &early).await.status(), 200);
    // Later changes offer it.
    let page = Page::of(browser.gets("/account/password").await).await;
    assert_eq!(
        page.attribute("input[name=revoke]", "checked").as_deref(),
        Some("")
    );
    let third = "a third and last password";
    let form = [
        ("current", new),
        ("new", third),
        ("again", third),
        ("revoke", "1"),
    ];
    assert_eq!(
        browser.posts("/account/password", &form).await.status(),
        303
    );
    assert_eq!(call(&app, SUMMARY, &early).await.status(), 401);
    assert_eq!(
        browser.gets("/account").await.status(),
        200,
        "its own session"
    );
}

#[tokio::test]
async fn an_admin_sees_and_revokes_the_tokens_of_others() {
    let app = App::start().await;
    let ada = account(&app, "ada", Role::Admin).await;
    let anna = account(&app, "anna", Role::Researcher).await;
    let token = api_token(&app, 1, Some(anna), &[Scope::Results, Scope::Data]).await;
    let mut admin = Browser::of(&app, ada, 100).await;
    let page = Page::of(admin.gets("/admin/accounts").await).await;
    let cells = page.texts("[aria-label=Tokens] tbody td");
    assert_eq!(cells[..3], ["token 1", "anna", "results, data"]);
    let action = page
        .attribute("[aria-label=Tokens] form", "action")
        .unwrap();
    assert!(!page.html.contains(&token.to_string()));
    let mut researcher = Browser::of(&app, anna, 101).await;
    assert_eq!(researcher.posts(&action, &[]).await.status(), 403);
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 200);
    assert_eq!(admin.posts(&action, &[]).await.status(), 303);
    assert_eq!(call(&app, SUMMARY, &token).await.status(), 401);
    let done = times(&app, "ada", "revoke a token", AuditOutcome::Done).await;
    assert_eq!(done, 1);
}

#[tokio::test]
async fn logging_out_ends_the_session_on_the_server() {
    let app = App::start().await;
    let anna = account(&app, "anna", Role::Researcher).await;
    let mut one = Browser::of(&app, anna, 100).await;
    let two = Browser::of(&app, anna, 101).await;
    let kept = one.clone();
    assert_eq!(one.posts("/logout", &[]).await.status(), 303);
    assert_eq!(
        kept.gets("/account").await.status(),
        303,
        "its cookie is dead"
    );
    assert_eq!(two.gets("/account").await.status(), 200);

    let page = Page::of(two.gets("/account").await).await;
    assert_eq!(page.texts("[aria-label=Sessions] tbody tr").len(), 1);
    let kept = two.clone();
    let mut three = Browser::of(&app, anna, 102).await;
    let everywhere = three.posts("/account/sessions", &[]).await;
    assert_eq!(everywhere.headers()["location"], "/login");
    for browser in [&kept, &two] {
        assert_eq!(browser.gets("/account").await.status(), 303);
    }
    let done = times(&app, "anna", "log out everywhere", AuditOutcome::Done).await;
    assert_eq!(done, 1);
}

#[tokio::test]
async fn a_wrong_login_is_logged_under_the_account_or_under_no_name() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    let mut browser = Browser::new(&app);
    assert_eq!(
        browser.logs_in("anna", "not the password").await.status(),
        422
    );
    // People type passwords where the name belongs.
    assert_eq!(
        browser.logs_in("hunter2 and more", "anna").await.status(),
        422
    );
    for actor in ["anna", "nobody"] {
        let refused = times(&app, actor, "log in", AuditOutcome::Refused).await;
        assert_eq!(refused, 1, "{actor}");
    }
    let rows = app.store.audit(None, 10).await.unwrap();
    let details: Vec<_> = rows.iter().map(|row| row.entry.detail.as_deref()).collect();
    assert_eq!(details, [Some("unknown name"), Some("wrong password")]);
    assert!(!format!("{rows:?}").contains("hunter2"));
}

#[tokio::test]
async fn a_study_file_with_its_codes_is_for_those_who_may_see_data() {
    let app = App::start().await;
    let viewer = account(&app, "viktor", Role::Viewer).await;
    let both = [Scope::Results, Scope::Data];
    for (seed, owner, scopes, is_shown) in [
        (1, None, both.as_slice(), true),
        (2, None, &[Scope::Results], false),
        (3, Some(viewer), &both, false),
    ] {
        let token = api_token(&app, seed, owner, scopes).await;
        let answer = call(&app, ONE, &token).await;
        assert_eq!(answer.status(), 200);
        let tag = answer.headers()["etag"].clone();
        let study: serde_json::Value = answer.json().await.unwrap();
        assert_eq!(study["file"].is_string(), is_shown, "token {seed}");
        assert!(study.get("file").is_some(), "null and not missing");
        // What one may see is no answer to what the other has.
        let other = api_token(&app, seed + 10, None, &both).await;
        let request = app
            .client
            .get(format!("{}{ONE}", app.url))
            .bearer_auth(other);
        let again = request.header("if-none-match", tag).send().await.unwrap();
        assert_eq!(again.status() == 304, is_shown, "token {seed}");
    }
}
