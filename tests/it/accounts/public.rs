//! What is shown without an account: public aggregates, and looks at blind studies.

use riskaware::{
    clock::Clock,
    store::{AuditOutcome, Role},
};

use crate::{
    app::{App, Page, START},
    conditions::BETWEEN,
};

use super::lab::{ANSWERS, Browser, EXPORT, SUMMARY, account, has, log};

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
async fn a_public_study_hides_questions_that_fewer_than_five_people_answered() {
    let files = vec![("between.toml".to_owned(), BETWEEN.to_owned())];
    let app = App::with_starts(Clock::manual(START), files, 1_000).await;
    account(&app, "anna", Role::Researcher).await;
    app.store.set_public(&"between".into(), true).await.unwrap();
    let stranger = Browser::new(&app);
    // Four conditions between people, of which each asks questions of its own.
    for people in 1..=20 {
        let mut person = app.participant_of("/s/between").await;
        person.finishes("safe").await;
        let is_shown = people == 20;
        let page = stranger.gets("/results/between").await.status();
        assert_eq!(page, if is_shown { 200 } else { 303 }, "{people} people");
        let path = "/api/v1/studies/between/summary";
        let summary = stranger.gets(path).await.status();
        assert_eq!(summary, if is_shown { 200 } else { 401 }, "{people} people");
    }
    app.stop().await;
}
