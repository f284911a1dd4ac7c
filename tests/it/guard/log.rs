//! What the log holds, and that nothing is done which it does not hold.

use std::process::{Command, Stdio};

use riskaware::clock::Clock;
use riskaware::store::{AuditOutcome, Population, Role, RunId, RunState, Scope, StudyState};

use super::lab::{Browser, PASSWORD, account, api_token, call, execute, times};
use crate::app::{App, Page, START};

#[tokio::test]
async fn nothing_is_changed_that_cannot_be_written_to_the_log() {
    let app = App::start().await;
    let ada = account(&app, "ada", Role::Admin).await;
    let anna = account(&app, "anna", Role::Researcher).await;
    let kept = api_token(&app, 1, Some(ada), &[Scope::Results]).await;
    let id = app.store.api_tokens(None).await.unwrap()[0].id;
    app.participant("").await.finishes("stop").await;
    let mut admin = Browser::of(&app, ada, 100).await;
    execute(
        &app,
        "create trigger log_is_full before insert on audit begin select raise(abort, 'full'); end",
    )
    .await;
    let other = "an even longer password";
    let changes = [
        (
            format!("/admin/accounts/{anna}/role"),
            vec![("role", "admin")],
        ),
        (
            format!("/admin/accounts/{anna}/disabled"),
            vec![("disabled", "1")],
        ),
        (format!("/admin/accounts/{anna}/password"), vec![]),
        (
            "/admin/accounts".to_owned(),
            vec![("name", "eva"), ("role", "viewer")],
        ),
        (format!("/admin/tokens/{id}/revoke"), vec![]),
        (format!("/account/tokens/{id}/revoke"), vec![]),
        (
            "/account/tokens".to_owned(),
            vec![("name", "notebook"), ("results", "1"), ("days", "7")],
        ),
        (
            "/account/password".to_owned(),
            vec![("current", PASSWORD), ("new", other), ("again", other)],
        ),
        ("/account/sessions".to_owned(), vec![]),
        ("/results/driving/public".to_owned(), vec![("public", "1")]),
        (
            "/studies/driving/state".to_owned(),
            vec![("state", "closed")],
        ),
        ("/studies/driving/participants/1/erase".to_owned(), vec![]),
        (
            "/login".to_owned(),
            vec![("name", "anna"), ("password", PASSWORD)],
        ),
    ];
    for (path, form) in &changes {
        let refused = admin.clone().posts(path, form).await;
        assert!(
            refused.status().is_server_error(),
            "{path}: {}",
            refused.status()
        );
    }
    let accounts = app.store.accounts().await.unwrap();
    assert_eq!(accounts.len(), 2);
    let anna = app.store.account_named("anna").await.unwrap();
    assert_eq!((anna.role, anna.disabled_at), (Role::Researcher, None));
    for name in ["ada", "anna"] {
        let same = app.store.check_password(name, PASSWORD).await.unwrap();
        assert!(same.is_some(), "{name}");
    }
    assert_eq!(app.store.api_tokens(None).await.unwrap().len(), 1);
    assert_eq!(app.store.sessions_of(ada).await.unwrap().len(), 1);
    assert_eq!(app.store.sessions_of(anna.id).await.unwrap().len(), 0);
    assert_eq!(call(&app, "/api/v1/studies", &kept).await.status(), 200);
    let study = "driving".into();
    assert!(!app.store.is_public(&study).await.unwrap());
    assert_eq!(
        app.store.study(&study).await.unwrap().state,
        StudyState::Open
    );
    let run = app
        .store
        .run_state(&study, Population::People, RunId::from(1))
        .await;
    assert_eq!(run.unwrap(), RunState::Completed);

    execute(&app, "drop trigger log_is_full").await;
    let (path, form) = &changes[0];
    assert_eq!(admin.posts(path, form).await.status(), 303);
    assert_eq!(
        times(&app, "ada", "change a role", AuditOutcome::Done).await,
        1
    );
}

/// A study that hides its results until three people have finished.
async fn with_a_blind_study() -> App {
    let mut studies = App::built_in();
    for (_, text) in &mut studies {
        *text = text.replace("# blind_until = 30 ", "blind_until = 3 #");
    }
    App::with(Clock::manual(START), studies).await
}

#[tokio::test]
async fn what_a_handler_refuses_is_logged_as_refused() {
    let app = with_a_blind_study().await;
    let ada = account(&app, "ada", Role::Admin).await;
    let both = [Scope::Results, Scope::Data];
    let token = api_token(&app, 1, None, &both).await;
    let actor = "token 1 (token 1)";
    for (path, status, action) in [
        ("curves", 403, "look at curves"),
        ("comparison", 403, "look at comparison"),
        ("export/analysis.json", 403, "export analysis.json"),
        ("export/bonus.csv?ids=plain", 409, "export bonus.csv"),
    ] {
        let refused = call(&app, &format!("/api/v1/studies/driving/{path}"), &token).await;
        assert_eq!(refused.status(), status, "{path}");
        let noted = times(&app, actor, action, AuditOutcome::Refused).await;
        assert_eq!(noted, 1, "{path}");
        assert_eq!(times(&app, actor, action, AuditOutcome::Done).await, 0);
    }
    let mut admin = Browser::of(&app, ada, 100).await;
    let path = format!("/admin/accounts/{ada}/role");
    assert_eq!(
        admin.posts(&path, &[("role", "viewer")]).await.status(),
        422
    );
    let refused = times(&app, "ada", "change a role", AuditOutcome::Refused).await;
    assert_eq!(refused, 1);
    // Nothing was seen, so nobody looked.
    let looks = app.store.looks_at(&"driving".into(), 10).await.unwrap();
    assert_eq!(looks, []);
}

#[tokio::test]
async fn nobody_fills_the_log_and_looks_are_found_however_long_it_is() {
    let app = with_a_blind_study().await;
    let viktor = account(&app, "viktor", Role::Viewer).await;
    let anna = account(&app, "anna", Role::Researcher).await;
    let viewer = Browser::of(&app, viktor, 100).await;
    assert_eq!(viewer.gets("/results/driving").await.status(), 200);
    for _ in 0..40 {
        let refused = viewer.gets("/results/driving/data/answers.csv").await;
        assert_eq!(refused.status(), 403);
    }
    let noted = times(&app, "viktor", "export answers.csv", AuditOutcome::Refused).await;
    assert_eq!(noted, 30);
    execute(
        &app,
        r#"
        with recursive number (n) as (select 1 union all select n + 1 from number where n < 3000)
        insert into audit (at_ms, actor, action, study_id, outcome)
        select n, 'nobody', 'export answers.csv', 'driving', 'refused'
        from number
        "#,
    )
    .await;
    let researcher = Browser::of(&app, anna, 101).await;
    let page = Page::of(researcher.gets("/studies/driving").await).await;
    let who = page.texts(".banner tbody td");
    assert_eq!(who[1..], ["viktor", "look at results"]);
}

#[tokio::test]
async fn an_export_that_its_reader_cuts_off_stands_in_the_log() {
    let app = App::start().await;
    app.participant("").await.finishes("stop").await;
    let database = app.store.path().to_owned();
    let written = tokio::task::spawn_blocking(move || {
        let mut child = Command::new(env!("CARGO_BIN_EXE_riskaware"))
            .args(["export", "driving", "--database"])
            .arg(database)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Nobody reads.
        drop(child.stdout.take());
        child.wait_with_output().unwrap().status.success()
    });
    assert!(!written.await.unwrap());
    let noted = times(&app, "command", "export long", AuditOutcome::Done).await;
    assert_eq!(noted, 1);
}
