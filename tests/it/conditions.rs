//! Conditions between people, quotas, and places that come back.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use reqwest::{Client, StatusCode, redirect::Policy};
use riskaware::{
    clock::Clock,
    jobs::{Catalogue, closing},
    store::{AnswerKey, NewArrival, NewRun, Population, RunState, StudyState, Token, draw_run},
    study::{self, ConditionId, Device, StepKind, Study, StudyId, TimeFactor, Timestamp},
};
use tokio::task::JoinSet;

use crate::app::{App, Page, Participant, START};

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
    assert!(refused.html.contains("All places of this study are taken"));
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

#[tokio::test]
async fn a_preview_starts_in_every_state_and_never_counts() {
    let file = (
        "between.toml".to_owned(),
        with_recruiting("quota = 1").replace("open = true\n", ""),
    );
    let app = App::with(Clock::manual(START), vec![file]).await;
    let landing = app
        .client
        .post(format!("{}/studies/between/preview", app.url))
        .send()
        .await
        .unwrap();
    let landing = Page::of(landing).await;
    assert!(landing.html.contains("Preview: nothing you do here counts"));
    let action = landing.attribute("form", "action").unwrap();
    let response = app
        .client
        .post(format!("{}{action}", app.url))
        .send()
        .await
        .unwrap();
    let mut researcher = Participant {
        client: app.client.clone(),
        link: response.url().to_string(),
        page: Page::of(response).await,
    };
    assert!(
        researcher
            .page
            .html
            .contains("Preview: nothing you do here counts")
    );
    researcher.finishes("bold").await;
    assert!(
        researcher
            .page
            .html
            .contains("Preview: nothing you do here counts")
    );
    let study = StudyId::from("between");
    let totals = app.store.totals(&study, Population::People).await.unwrap();
    assert_eq!((totals.started, totals.completed), (0, 0));
    assert!(places(&app).await.is_empty());
    let counts = app.store.cell_counts(&study, Population::People);
    assert_eq!(counts.await.unwrap(), []);
    app.stop().await;
}

#[tokio::test]
async fn whoever_finished_can_withdraw_until_the_retention_date() {
    let app = serve("retention = 2026-01-31").await;
    let mut early = app.participant_of("/s/between?PROLIFIC_PID=5f3").await;
    early.finishes("bold").await;
    let link = early
        .page
        .attribute("main a[href$=withdraw]", "href")
        .unwrap();
    assert!(early.page.html.contains("until 31 January 2026"));
    let mut late = app.participant_of("/s/between?PROLIFIC_PID=8c1").await;
    late.finishes("safe").await;

    app.clock.advance(30 * 24 * 60 * 60_000);
    closing::forget_people(&app.store).await;
    let withdrawn = app
        .client
        .post(format!("{}{link}", app.url))
        .send()
        .await
        .unwrap();
    let withdrawn = Page::of(withdrawn).await;
    assert!(withdrawn.html.contains("Your answers are erased"));

    app.clock.advance(2 * 24 * 60 * 60_000);
    closing::forget_people(&app.store).await;
    assert_eq!(late.reloads().await.status, StatusCode::NOT_FOUND);
    let path = format!("/r/{}/withdraw", late.token());
    let gone = app.get(&path).await;
    assert_eq!(gone.status, StatusCode::NOT_FOUND);
    assert!(gone.html.contains("can no longer be taken out"));
    let study = StudyId::from("between");
    let totals = app.store.totals(&study, Population::People).await.unwrap();
    assert_eq!((totals.completed, totals.withdrawn), (1, 1));
    let answers = app
        .store
        .answers(&study, Population::People, AnswerKey::START, 100)
        .await
        .unwrap();
    assert_eq!(answers.len(), 2, "what was answered stays, anonymous");
    let again = app.get("/s/between?PROLIFIC_PID=8c1").await;
    assert!(again.html.contains("ended on 1 February 2026"));
    assert_eq!(app.store.check_answers().await.unwrap(), []);
    assert_eq!(app.store.check_counters().await.unwrap(), []);
    app.stop().await;
}

#[track_caller]
fn refused(keys: &str, key: &str, allowed: &str) {
    let text = with_recruiting(keys);
    let error = Study::parse("between.toml", &text).unwrap_err();
    assert_eq!(error.key(), key, "{error}");
    assert!(error.allowed().contains(allowed), "{error}");
    let position = text.lines().position(|line| line == keys).unwrap();
    assert_eq!(error.line(), Some(position + 1), "{error}");
}

#[test]
fn recruiting_keys_are_refused_by_line_and_name() {
    refused("quota = 0", "recruiting.quota", "1 to 1000000");
    refused("quota = \"many\"", "recruiting.quota", "a whole number");
    refused(
        "opens = 2026-12-01T09:00:00",
        "recruiting.opens",
        "with its offset",
    );
    refused("devices = []", "recruiting.devices", "`tablet`");
    refused(
        "devices = [\"phone\", \"phone\"]",
        "recruiting.devices[#2]",
        "each device once",
    );
    refused("time_limit_min = 1", "recruiting.time_limit_min", "from 2");
    refused(
        "mturk = { fram = true }",
        "recruiting.mturk.fram",
        "`frame`",
    );
    let both = "opens = 2026-12-02\ncloses = 2026-12-01";
    let error = Study::parse("between.toml", &with_recruiting(both)).unwrap_err();
    assert_eq!(error.key(), "recruiting.closes", "{error}");
}

#[test]
fn recruiting_keys_are_read() {
    let keys = r#"
quota = 120
opens = 2026-12-01T10:00:00+01:00
closes = 2026-12-31
devices = ["phone", "desktop"]
retention = 2027-12-31
filters = ["Lives in the United States"]
mturk = { frame = true }
"#;
    let study = Study::parse("between.toml", &with_recruiting(keys)).unwrap();
    let recruiting = study.recruiting();
    let at = |text: &str| {
        let moment: jiff::Timestamp = text.parse().unwrap();
        Some(Timestamp(moment.as_millisecond()))
    };
    assert_eq!(recruiting.quota, Some(120));
    assert_eq!(recruiting.opens, at("2026-12-01T09:00:00Z"));
    assert_eq!(recruiting.closes, at("2027-01-01T00:00:00Z"));
    assert_eq!(recruiting.retention, at("2028-01-01T00:00:00Z"));
    assert_eq!(recruiting.devices, [Device::Phone, Device::Desktop]);
    assert_eq!(recruiting.filters, ["Lives in the United States"]);
    assert_eq!(recruiting.time_limit_ms, Some(30 * 60_000));
    assert!(recruiting.mturk.frame);
}

const GAMBLES: &str = include_str!("../data/gambles.toml");

#[tokio::test]
async fn who_began_before_there_was_a_quota_holds_a_place_in_it() {
    let file = ("gambles.toml".to_owned(), GAMBLES.to_owned());
    let app = App::with(Clock::manual(START), vec![file]).await;
    for _ in 0..2 {
        app.participant_of("/s/three-gambles").await;
    }
    let study = StudyId::from("three-gambles");
    let taken = async || {
        let places = app.store.places_taken(&study, Population::People).await;
        places.unwrap().values().sum::<u64>()
    };
    assert_eq!(taken().await, 0);
    let with_quota = GAMBLES.replacen("[recruiting]\n", "[recruiting]\nquota = 2\n", 1);
    let file = ("gambles.toml".to_owned(), with_quota);
    let catalogue = Catalogue::publish(&app.store, vec![file]).await.unwrap();
    assert_eq!(taken().await, 2);
    // They have the whole time of a run from then on, and give their places back after it.
    let (_, served) = catalogue.current(&study).unwrap();
    let limit_ms = served.recruiting().time_limit_ms.unwrap();
    app.clock.advance(limit_ms - 1_000);
    assert_eq!(app.store.close_overdue().await.unwrap(), 0);
    app.clock.advance(2_000);
    assert_eq!(app.store.close_overdue().await.unwrap(), 2);
    assert_eq!(taken().await, 0);
    app.stop().await;
}

#[tokio::test]
async fn a_later_version_does_not_prolong_what_people_agreed_to() {
    let app = serve("retention = 2026-01-31").await;
    let mut person = app.participant_of("/s/between?PROLIFIC_PID=5f3").await;
    person.finishes("bold").await;
    for keys in ["retention = 2030-01-31", ""] {
        let file = ("between.toml".to_owned(), with_recruiting(keys));
        Catalogue::publish(&app.store, vec![file]).await.unwrap();
    }
    closing::forget_people(&app.store).await;
    assert_eq!(person.reloads().await.status, StatusCode::OK);
    app.clock.advance(32 * 24 * 60 * 60_000);
    closing::forget_people(&app.store).await;
    assert_eq!(person.reloads().await.status, StatusCode::NOT_FOUND);
    app.stop().await;
}

#[tokio::test]
async fn what_this_program_does_not_read_any_more_can_be_withdrawn_and_is_forgotten() {
    let app = serve("").await;
    let study = StudyId::from("of-old");
    let text = "format = 0\n[recruiting]\nretention = 2026-01-31\n";
    let version = app
        .store
        .publish(&study, "hash", text, StudyState::Open, None)
        .await
        .unwrap();
    let between = Study::parse("between.toml", BETWEEN).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut links = Vec::new();
    for _ in 0..2 {
        let arrival = Token::random(&mut rng);
        let from = NewArrival::default();
        app.store.arrive(&arrival, &study, from).await.unwrap();
        let run = NewRun {
            study: study.clone(),
            version,
            candidates: draw_run(&between, &mut rng).unwrap(),
            quota: None,
            time_limit_ms: None,
            refusal: None,
            factor: TimeFactor::ONE,
            language: None,
            population: Population::People,
        };
        links.push(app.store.start(&arrival, run).await.unwrap().link);
    }
    let path = format!("/r/{}", links[0]);
    let page = app.get(&path).await;
    assert_eq!(page.status, StatusCode::SERVICE_UNAVAILABLE);
    let withdraw = page.attribute("main a[href$=withdraw]", "href").unwrap();
    let asked = app.get(&withdraw).await;
    assert_eq!(asked.status, StatusCode::OK);
    assert!(asked.html.contains("Stop and withdraw?"));
    let posted = app.client.post(format!("{}{withdraw}", app.url));
    let erased = Page::of(posted.send().await.unwrap()).await;
    assert_eq!(erased.status, StatusCode::OK);
    assert!(erased.html.contains("Your answers are erased"));

    app.clock.advance(32 * 24 * 60 * 60_000);
    closing::forget_people(&app.store).await;
    let gone = app.get(&format!("/r/{}", links[1])).await;
    assert_eq!(gone.status, StatusCode::NOT_FOUND);
    app.stop().await;
}

#[tokio::test]
async fn more_time_is_asked_for_at_the_start_and_its_timed_answers_are_no_counts() {
    let (name, text) = study::built_in()[0];
    let offers = text.replacen("[recruiting]\n", "[recruiting]\nmore_time = true\n", 1);
    let offers = if offers == text {
        format!("{text}\n[recruiting]\nmore_time = true\n")
    } else {
        offers
    };
    for (text, is_offered) in [(offers.as_str(), true), (text, false)] {
        let file = (name.to_owned(), text.to_owned());
        let app = App::with(Clock::manual(START), vec![file]).await;
        let landing = app.get("/s/driving").await;
        assert_eq!(
            landing.attribute("select[name=time]", "id").is_some(),
            is_offered
        );
        let action = landing.attribute("main form", "action").unwrap();
        let press = |time: &'static str| {
            let button = app.client.post(format!("{}{action}", app.url));
            button.form(&[("time", time)]).send()
        };
        let refused = press("9").await.unwrap().status();
        if is_offered {
            assert_eq!(refused, StatusCode::BAD_REQUEST);
            assert_eq!(press("1.5").await.unwrap().status(), StatusCode::OK);
        }
        let runs = app
            .store
            .moment()
            .await
            .unwrap()
            .participants(
                &"driving".into(),
                Population::People,
                0.into(),
                i64::MAX.into(),
                10,
            )
            .await
            .unwrap();
        let expected = if is_offered { 1.5 } else { 1.0 };
        assert_eq!(runs[0].time_factor, expected);
        let longer = app
            .store
            .runs_with_more_time(&"driving".into(), Population::People)
            .await
            .unwrap();
        assert_eq!(longer.is_empty(), !is_offered);
        let overview = app.get("/studies/driving").await;
        assert_eq!(overview.html.contains("1.5 times as long"), is_offered);
        app.stop().await;
    }
}
