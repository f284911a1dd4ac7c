//! Accounts and tokens from the command line.

use riskaware::{
    clock::Clock,
    store::{AuditOutcome, Token},
};

use crate::{
    app::App,
    program::{riskaware, stderr, stdout},
};

use super::lab::{ANSWERS, Browser, EXPORT, SUMMARY, call, has, log, token};

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
