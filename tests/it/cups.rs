//! The cup study over HTTP: replays that are watched, and fits beside those of another study.

use std::sync::Arc;

use reqwest::StatusCode;
use riskaware::{
    jobs::{Catalogue, PartFit, PartState, Snapshot},
    store::{Population, Verdict},
    study::{self, Study},
};
use serde_json::{Value, json};

use crate::{
    app::{App, Page, Participant},
    crowd::{Background, completes, drives, until},
};

/// Longer than all replays together.
const LONG_ENOUGH_MS: i64 = 120_000;

fn cups() -> Study {
    let (name, text) = study::built_in()
        .into_iter()
        .find(|(name, _)| *name == "cups.toml")
        .unwrap();
    Study::parse(name, text).unwrap()
}

/// A person in front of the replays.
async fn watching(app: &App) -> Participant {
    let mut person = app.participant_of("/s/cups").await;
    person
        .proceeds("", |person| !replays(&person.page).is_empty())
        .await;
    person
}

/// Name and address of each replay on the page, in order.
fn replays(page: &Page) -> Vec<(String, String)> {
    let names = page.attributes("[data-url]", "data-replay");
    let addresses = page.attributes("[data-url]", "data-url");
    names.into_iter().zip(addresses).collect()
}

fn viewings(of: &[(String, String)]) -> String {
    let list: Vec<Value> = of
        .iter()
        .map(|(replay, _)| {
            json!({ "replay": replay, "started_ms": 1_000, "seen_ms": 9_000, "plays": 2, "stills": false })
        })
        .collect();
    Value::from(list).to_string()
}

#[tokio::test]
async fn the_questions_come_when_all_replays_were_watched() {
    let app = App::start().await;
    let mut person = watching(&app).await;
    let shown = replays(&person.page);
    assert_eq!(shown.len(), 10);

    let too_early = person.sends("viewings", &viewings(&shown)).await;
    assert_eq!(too_early.status, StatusCode::UNPROCESSABLE_ENTITY);
    let message = too_early.text(".error-summary").unwrap();
    assert!(message.contains("seconds"), "{message}");
    assert_eq!(replays(too_early), shown, "the order stays");

    app.clock.advance(LONG_ENOUGH_MS);
    let one_missing = person.sends("viewings", &viewings(&shown[1..])).await;
    assert_eq!(one_missing.status, StatusCode::UNPROCESSABLE_ENTITY);
    let message = one_missing.text(".error-summary").unwrap();
    assert!(message.contains("9 of 10"), "{message}");

    // A form that is sent twice counts once.
    let form = person.page.clone();
    let next = person.sends("viewings", &viewings(&shown)).await;
    assert_eq!(next.status, StatusCode::OK);
    assert!(
        next.text("h1").unwrap().contains("time limit"),
        "{}",
        next.html
    );
    let again = person.posts(&form, "viewings", &viewings(&shown)).await;
    assert_eq!(again.url().as_str(), person.link);
    let run = app.store.run(&person.token()).await.unwrap().run;
    let forms: Vec<Option<Verdict>> = app
        .store
        .events(run)
        .await
        .unwrap()
        .into_iter()
        .filter(|event| event.position.to_string() == form.field("step"))
        .map(|event| event.verdict)
        .filter(Option::is_some)
        .collect();
    assert_eq!(forms, [Some(Verdict::Answered), Some(Verdict::Retry)]);
    app.stop().await;
}

#[tokio::test]
async fn order_and_times_of_the_replays_are_stored() {
    let app = App::start().await;
    let mut person = watching(&app).await;
    let shown = replays(&person.page);
    app.clock.advance(LONG_ENOUGH_MS);
    person.sends("viewings", &viewings(&shown)).await;

    let run = app.store.run(&person.token()).await.unwrap().run;
    let position: u32 = person.page.field("step").parse::<u32>().unwrap() - 1;
    let drawn = app.store.step(run, position).await.unwrap().data.replays;
    let on_page: Vec<&str> = shown.iter().map(|(id, _)| id.as_str()).collect();
    assert_eq!(drawn, on_page);
    let events = app.store.events(run).await.unwrap();
    let sent = events
        .iter()
        .filter(|event| event.position == position)
        .find_map(|event| event.body.as_deref())
        .unwrap();
    let sent: Value = serde_json::from_str(sent).unwrap();
    let expected: Value = serde_json::from_str(&viewings(&shown)).unwrap();
    assert_eq!(sent["viewings"], expected);
    app.stop().await;
}

/// Without scripts the page tells in words what happens in each replay, and a form without viewings leads on.
#[tokio::test]
async fn a_page_without_scripts_tells_each_replay_and_takes_as_long() {
    let app = App::start().await;
    let mut person = watching(&app).await;
    let texts = person.page.texts("li[data-replay]");
    assert_eq!(texts.len(), 10);
    assert_eq!(
        texts.iter().filter(|text| text.contains("falls")).count(),
        4
    );
    let too_early = person.sends("continue", "1").await;
    assert_eq!(too_early.status, StatusCode::UNPROCESSABLE_ENTITY);
    app.clock.advance(LONG_ENOUGH_MS);
    person.sends("continue", "1").await;
    assert_eq!(person.page.status, StatusCode::OK);
    person.finishes("stable").await;
    app.stop().await;
}

/// What is served is what the engine computes, and nothing is computed that no study names.
#[tokio::test]
async fn documents_hold_the_frames_of_the_engine() {
    let app = App::start().await;
    let person = watching(&app).await;
    for (id, address) in replays(&person.page) {
        let document = app.get(&address).await;
        let document: Value = serde_json::from_str(&document.html).unwrap();
        let study = cups();
        let named = study
            .replays()
            .find(|named| named.id.as_str() == id)
            .unwrap();
        let timeline = named.replay.timeline().unwrap();
        let tracks = serde_json::to_value(timeline.tracks()).unwrap();
        assert_eq!(document["tracks"], tracks, "{id}");
        let frames = tracks["hand"]["x"].as_array().unwrap().len() as u64;
        let (duration, step) = (&document["duration_ms"], &document["frame_ms"]);
        assert_eq!(
            duration.as_u64(),
            Some((frames - 1) * step.as_u64().unwrap())
        );
        assert_eq!(
            document["still_ms"].as_array().unwrap().last(),
            Some(duration)
        );
    }
    for unknown in ["unstable-falls-999", "unstable", "..%2f", "stable-falls-1"] {
        let page = app.get(&format!("/replays/{unknown}")).await;
        assert_eq!(page.status, StatusCode::NOT_FOUND, "{unknown}");
    }
    app.stop().await;
}

async fn catalogue(app: &App) -> Arc<Catalogue> {
    let files = study::built_in()
        .into_iter()
        .map(|(name, text)| (name.to_owned(), text.to_owned()))
        .collect();
    Arc::new(Catalogue::publish(&app.store, files).await.unwrap())
}

async fn snapshot(app: &App, catalogue: &Catalogue, study: &str) -> Arc<Snapshot> {
    Snapshot::read(&app.store, catalogue, Population::People, &study.into())
        .await
        .unwrap()
        .unwrap()
}

/// 42 of 50 people build the stable tower (models.md, section 7), while others take the driving study.
#[tokio::test(flavor = "multi_thread")]
async fn both_studies_are_fitted_in_one_server() {
    let app = App::start().await;
    let catalogue = catalogue(&app).await;
    let _background = Background::start(&app.store, &catalogue);
    for person in 0..50 {
        let action = if person < 42 { "stable" } else { "unstable" };
        completes(
            &app.store,
            &catalogue,
            &"cups".into(),
            person,
            None,
            |_, _| action.into(),
        )
        .await;
        if person % 10 == 0 {
            drives(&app.store, &catalogue, 100 + person..101 + person, 130).await;
        }
    }
    until(&app.store, async || {
        for study in ["cups", "driving"] {
            let snapshot = snapshot(&app, &catalogue, study).await;
            let is_fitted = |part: &PartFit| part.fit.is_some() && !part.is_behind;
            if !snapshot.fits.iter().all(is_fitted) {
                return false;
            }
        }
        true
    })
    .await;
    for study in ["cups", "driving"] {
        let snapshot = snapshot(&app, &catalogue, study).await;
        for part in &snapshot.fits {
            let id = (study, &part.plan, &part.part, &part.model.id);
            assert_eq!(part.state, PartState::Converged, "{id:?}");
        }
    }
    let accuracy = app.get("/results/cups/data/accuracy.json").await;
    let accuracy: Value = serde_json::from_str(&accuracy.html).unwrap();
    assert_eq!(accuracy["cells"].as_array().unwrap().len(), 2);
    for cell in accuracy["cells"].as_array().unwrap() {
        let mean = |model: &str| cell["models"][model]["mean"].as_f64().unwrap();
        assert!((mean("noisy_rational") - -1.34).abs() < 0.04, "{cell}");
        // Thirty samples with a standard deviation of 2.2.
        assert!((mean("risk_aware") - -5.8).abs() < 1.6, "{cell}");
        let reference = cell["reference"].as_f64().unwrap();
        assert!((reference - -5.88).abs() < 0.01, "{cell}");
    }
    let page = app.get("/results/cups").await.html;
    let published = "Untimed in the source study: Build the stable tower: 42 of 50 (84 %)";
    assert!(page.contains(published), "{page}");
    let reading = app.get("/results/cups/data/reading.json").await.html;
    assert!(
        reading.contains("All rewards here are gains or nothing"),
        "{reading}"
    );
    app.stop().await;
}
