//! Conditions between people, quotas, and places that come back.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use reqwest::{Client, StatusCode, redirect::Policy};
use riskaware::{
    clock::Clock,
    store::{Population, RunState, StudyState},
    study::{ConditionId, StepKind, Study, StudyId},
};
use tokio::task::JoinSet;

use crate::app::{App, Page, START};

pub const BETWEEN: &str = include_str!("../data/between.toml");

fn with_recruiting(keys: &str) -> String {
    format!("{BETWEEN}{keys}\n")
}

async fn serve(keys: &str) -> App {
    let file = ("between.toml".to_owned(), with_recruiting(keys));
    App::with_starts(Clock::manual(START), vec![file], 1_000).await
}

/// How many people have a place, by condition.
async fn places(app: &App) -> BTreeMap<Option<ConditionId>, u64> {
    app.store
        .places_taken(&StudyId::from("between"), Population::People)
        .await
        .unwrap()
}

/// So many people who press the start button at the same moment; what each of them was told.
async fn press_start_together(app: &App, people: usize) -> Vec<StatusCode> {
    let client = Client::builder().redirect(Policy::none()).build().unwrap();
    let mut buttons = Vec::new();
    for _ in 0..people {
        let arrived = client
            .get(format!("{}/s/between", app.url))
            .send()
            .await
            .unwrap();
        buttons.push(arrived.headers()["location"].to_str().unwrap().to_owned());
    }
    let mut starts = JoinSet::new();
    for button in buttons {
        let start = client.post(format!("{}{button}", app.url)).send();
        starts.spawn(async move { start.await.unwrap().status() });
    }
    starts.join_all().await
}

fn count(statuses: &[StatusCode], wanted: StatusCode) -> usize {
    statuses.iter().filter(|status| **status == wanted).count()
}

#[test]
fn a_person_meets_what_belongs_to_their_condition() {
    let study = Study::parse("between.toml", BETWEEN).unwrap();
    let ids: Vec<&str> = study
        .conditions()
        .iter()
        .map(|condition| condition.id.as_str())
        .collect();
    assert_eq!(
        ids,
        ["gain/small", "gain/large", "keep/small", "keep/large"]
    );
    assert_eq!(study.cells().len(), 8, "every cell is known");
    let steps = |condition: usize| -> Vec<String> {
        study
            .draw_steps(
                Some(&study.conditions()[condition]),
                &mut ChaCha8Rng::seed_from_u64(1),
            )
            .iter()
            .map(|step| match &step.question {
                Some(question) => format!("{}:{question}", step.block),
                None => step.block.to_string(),
            })
            .collect()
    };
    assert_eq!(
        steps(0),
        [
            "welcome",
            "about-gains",
            "small",
            "small:gain-low",
            "small:gain-high",
            "thanks"
        ]
    );
    let mut keeps_large = steps(3);
    keeps_large[1..3].sort();
    assert_eq!(
        keeps_large,
        ["welcome", "large:keep-high", "large:keep-low", "thanks"]
    );
    let everything = study.draw_steps(None, &mut ChaCha8Rng::seed_from_u64(1));
    let choices = everything
        .iter()
        .filter(|step| step.kind == StepKind::Choice);
    assert_eq!(choices.count(), 8);
}

#[tokio::test]
async fn two_hundred_simultaneous_starts_fill_four_conditions_evenly() {
    let app = serve("").await;
    let statuses = press_start_together(&app, 200).await;
    assert_eq!(count(&statuses, StatusCode::SEE_OTHER), 200);
    let places = places(&app).await;
    assert_eq!(places.len(), 4);
    assert!(places.values().all(|taken| *taken == 50), "{places:?}");
    app.stop().await;
}

#[tokio::test]
async fn a_quota_of_a_hundred_and_fifty_lets_exactly_so_many_in() {
    let app = serve("quota = 150").await;
    let statuses = press_start_together(&app, 200).await;
    assert_eq!(count(&statuses, StatusCode::SEE_OTHER), 150);
    assert_eq!(count(&statuses, StatusCode::GONE), 50);
    let places = places(&app).await;
    assert_eq!(places.values().sum::<u64>(), 150);
    let (most, least) = (places.values().max(), places.values().min());
    assert_eq!((most, least), (Some(&38), Some(&37)));
    let page = app.get("/s/between").await;
    let refused = app
        .client
        .post(format!(
            "{}{}",
            app.url,
            page.attribute("form", "action").unwrap()
        ))
        .send()
        .await
        .unwrap();
    let refused = Page::of(refused).await;
    assert_eq!(refused.status, StatusCode::GONE);
    assert!(
        refused.html.contains("all places of this study are taken")
            || refused.html.contains("All places of this study are taken")
    );
    let totals = app
        .store
        .totals(&StudyId::from("between"), Population::People)
        .await
        .unwrap();
    assert_eq!(totals.started, 150, "whoever was refused used nothing up");
    app.stop().await;
}

#[tokio::test]
async fn a_run_that_is_not_finished_in_time_gives_its_place_back() {
    let app = serve("quota = 1\ntime_limit_min = 45").await;
    let mut slow = app.participant_of("/s/between").await;
    assert_eq!(slow.page.status, StatusCode::OK);
    app.clock.advance(44 * 60_000);
    assert_eq!(app.store.close_overdue().await.unwrap(), 0);
    let refused = press_start_together(&app, 1).await;
    assert_eq!(refused, [StatusCode::GONE]);
    app.clock.advance(2 * 60_000);
    assert_eq!(app.store.close_overdue().await.unwrap(), 1);
    assert_eq!(app.store.close_overdue().await.unwrap(), 0);
    let run = app.store.run(&slow.token()).await.unwrap();
    assert_eq!(run.state, RunState::TimedOut);
    let late = slow.sends("continue", "1").await;
    assert!(late.html.contains("The time for this study is over"));
    let mut quick = app.participant_of("/s/between").await;
    quick.finishes("bold").await;
    let refused = press_start_together(&app, 1).await;
    assert_eq!(refused, [StatusCode::GONE]);
    let totals = app
        .store
        .totals(&StudyId::from("between"), Population::People)
        .await
        .unwrap();
    assert_eq!((totals.completed, totals.timed_out), (1, 1));
    assert_eq!(totals.under_way(), 0);
    assert_eq!(app.store.check_answers().await.unwrap(), []);
    assert_eq!(app.store.check_counters().await.unwrap(), []);
    app.stop().await;
}

#[tokio::test]
async fn a_withdrawal_gives_the_place_back() {
    let app = serve("quota = 1").await;
    let person = app.participant_of("/s/between").await;
    app.store.withdraw(&person.token()).await.unwrap();
    assert_eq!(press_start_together(&app, 1).await, [StatusCode::SEE_OTHER]);
    app.stop().await;
}

#[tokio::test]
async fn a_draft_takes_nobody_in_until_it_is_opened() {
    let file = (
        "between.toml".to_owned(),
        BETWEEN.replace("open = true\n", ""),
    );
    let app = App::with(Clock::manual(START), vec![file]).await;
    let study = StudyId::from("between");
    assert_eq!(
        app.store.study(&study).await.unwrap().state,
        StudyState::Draft
    );
    let refused = app.get("/s/between").await;
    assert_eq!(refused.status, StatusCode::GONE);
    assert!(refused.html.contains("being prepared"), "{}", refused.html);
    assert!(!app.get("/").await.html.contains("A question of framing"));
    app.store
        .set_study_state(&study, StudyState::Open)
        .await
        .unwrap();
    let mut under_way = app.participant_of("/s/between").await;
    app.store
        .set_study_state(&study, StudyState::Paused)
        .await
        .unwrap();
    assert_eq!(app.get("/s/between").await.status, StatusCode::GONE);
    under_way.finishes("safe").await;
    app.stop().await;
}

#[tokio::test]
async fn dates_and_devices_decide_who_starts() {
    let app =
        serve("opens = 2026-01-01T00:30:00Z\ncloses = 2026-01-01\ndevices = [\"desktop\"]").await;
    let early = app.get("/s/between").await;
    assert_eq!(early.status, StatusCode::GONE);
    assert!(early.html.contains("1 January 2026, 00:30 UTC"));
    app.clock.advance(30 * 60_000);
    let mut under_way = app.participant_of("/s/between").await;
    let phone = app
        .client
        .get(format!("{}/s/between", app.url))
        .header("sec-ch-ua-mobile", "?1")
        .send()
        .await
        .unwrap();
    let phone = Page::of(phone).await;
    assert_eq!(phone.status, StatusCode::GONE);
    assert!(phone.html.contains("a computer with a keyboard"));
    app.clock.advance(24 * 60 * 60_000);
    assert_eq!(app.get("/s/between").await.status, StatusCode::GONE);
    under_way.finishes("safe").await;
    app.stop().await;
}
