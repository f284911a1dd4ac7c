//! How accounts come to be, and who changes them.

use reqwest::{StatusCode, header};
use riskaware::store::{AuditOutcome, Role, Scope};

use crate::app::{App, Page};

use super::lab::{Browser, PASSWORD, SUMMARY, account, api_token, call, has, location, log, token};

#[tokio::test]
async fn the_setup_link_makes_one_admin_and_then_opens_nothing() {
    let app = App::start().await;
    let (old, link) = (token(1), token(2));
    assert!(app.store.renew_setup_link(&old).await.unwrap());
    assert!(app.store.renew_setup_link(&link).await.unwrap());
    let mut browser = Browser::new(&app);
    let form = [("name", "ada"), ("password", PASSWORD), ("again", PASSWORD)];
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
        .posts(
            &path,
            &[("name", "ada"), ("password", "short"), ("again", "short")],
        )
        .await;
    let page = Page::of(short).await;
    assert_eq!(page.status, 422);
    assert!(page.html.contains("12 to 128 characters"), "{}", page.html);
    assert_eq!(page.field("name"), "ada");

    let other = [("again", "another password"), form[0], form[1]];
    let page = Page::of(browser.posts(&path, &other).await).await;
    assert_eq!(page.status, 422);
    let told = page.text(".error-summary").unwrap();
    assert!(
        told.contains("The two passwords are not the same"),
        "{told}"
    );
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
        ("again", "an even longer password"),
    ];
    let other = [form[0], form[1], ("again", "a slip of the hand")];
    let page = Page::of(anna.posts("/account/password", &other).await).await;
    assert_eq!(page.status, 422);
    let told = page.text(".error-summary").unwrap();
    assert!(
        told.contains("The two passwords are not the same"),
        "{told}"
    );
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
