//! What strangers see of a public study, and what they can use up.

use std::collections::BTreeMap;

use reqwest::Method;
use riskaware::store::{ExclusionReason, Population, Role, RunId};
use riskaware::web::access::{ROUTES, Rule};
use serde_json::{Value, json};

use super::lab::{Browser, account, behind_a_proxy, execute};
use crate::app::{App, Page, Participant};

/// The people of the driving study who have finished, and one who has begun.
async fn finish(app: &App, people: usize) {
    for _ in 0..people {
        app.participant("").await.finishes("stop").await;
    }
}

/// All that strangers can read of a study, by address; streams are read by their own test.
async fn everything(stranger: &Browser<'_>) -> BTreeMap<String, String> {
    let mut read = BTreeMap::new();
    let shared = ROUTES.iter().filter(|route| route.rule == Rule::Shared);
    for route in shared.filter(|route| !route.path.ends_with("/events")) {
        let path = route.path.replace("{study}", "driving");
        let request = if path.ends_with("/predict") {
            let problem = json!({ "stable": [[1, 20]], "unstable": [[0.2, 105], [0.8, 0]] });
            let request = json!({ "problem": problem });
            stranger.asks(Method::POST, &path).json(&request)
        } else {
            stranger.asks(Method::GET, &path)
        };
        let answer = request.send().await.unwrap();
        let status = answer.status().as_u16();
        assert!(!matches!(status, 303 | 401), "{path}: {status}");
        // How far a simulated sweep is has nothing to do with anybody's answers, and ids of requests are new each time.
        if !path.contains("sweep") && status < 400 {
            read.insert(path, answer.text().await.unwrap());
        }
    }
    read
}

#[tokio::test]
async fn strangers_see_steps_of_five_people_and_never_one() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    app.store.set_public(&"driving".into(), true).await.unwrap();
    finish(&app, 6).await;
    // Two who do not want to, and one who leaves.
    for _ in 0..2 {
        app.participant("").await.sends("consent", "decline").await;
    }
    app.participant("").await.sends("consent", "agree").await;
    let stranger = Browser::new(&app);
    let released = everything(&stranger).await;
    let summary = "/api/v1/studies/driving/summary";
    assert!(released.len() >= 8, "{:?}", released.keys());
    let numbers: Value = serde_json::from_str(&released[summary]).unwrap();
    // Who is analysed is told exactly, since it moves by five; everything else is rounded down.
    assert_eq!(numbers["people"]["analysed"], 6);
    assert_eq!(numbers["people"]["completed"], 6);
    assert_eq!(numbers["people"]["started"], 6);
    assert_eq!(numbers["people"]["declined"], 0);
    assert_eq!(numbers["cells"][0]["n"], 6);

    // Whoever comes meanwhile moves nothing, and whoever withdraws neither.
    let mut seventh: Participant = app.participant("").await;
    seventh.finishes("stop").await;
    finish(&app, 3).await;
    assert_eq!(everything(&stranger).await, released);
    finish(&app, 1).await;
    let stepped = everything(&stranger).await;
    assert_ne!(stepped[summary], released[summary]);
    let numbers: Value = serde_json::from_str(&stepped[summary]).unwrap();
    assert_eq!(numbers["people"]["completed"], 11);
    assert_eq!(numbers["cells"][0]["n"], 11);
    app.store.withdraw(&seventh.token()).await.unwrap();
    assert_eq!(everything(&stranger).await, stepped);
    let page = Page::of(stranger.gets("/results/driving").await).await;
    assert_eq!(page.status, 200);

    // Looks at the evidence begin at five people, and are five apart.
    let looks: Value =
        serde_json::from_str(&stepped["/api/v1/studies/driving/sequential"]).unwrap();
    let mut last = 0;
    for look in looks["looks"].as_array().unwrap() {
        let n = look["n"].as_u64().unwrap();
        assert!(n >= last + 5, "{looks}");
        last = n;
    }
}

/// What `summary.json` tells of people and of the first cell.
async fn told(stranger: &Browser<'_>) -> (Value, Value) {
    let summary = stranger.gets("/api/v1/studies/driving/summary").await;
    assert_eq!(summary.status(), 200);
    let mut summary: Value = summary.json().await.unwrap();
    (summary["people"].take(), summary["cells"][0].take())
}

#[tokio::test]
async fn strangers_learn_of_nobody_who_is_left_out_alone_and_of_five_at_once() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    app.store.set_public(&"driving".into(), true).await.unwrap();
    finish(&app, 12).await;
    let answers = app.answers().await;
    let mut runs: Vec<RunId> = answers.iter().map(|answer| answer.key.run).collect();
    runs.dedup();
    assert_eq!(runs.len(), 12);
    let exclude = async |runs: &[RunId]| {
        for run in runs {
            let reason = ExclusionReason::new("talked to another").unwrap();
            let (study, actor) = ("driving".into(), "anna".to_owned());
            app.store
                .exclude(&study, Population::People, *run, reason, actor)
                .await
                .unwrap();
        }
    };
    let stranger = Browser::new(&app);

    exclude(&runs[..1]).await;
    let (people, cell) = told(&stranger).await;
    assert_eq!(people["analysed"], 11);
    assert_eq!(people["completed"], 11);
    assert_eq!(people["excluded"], 0);
    assert_eq!(people["exclusions"], json!([]));
    assert_eq!(cell["n"], 11);
    assert_eq!(cell["before_exclusions"], 11);

    // Four more move nothing.
    exclude(&runs[1..5]).await;
    let kept = told(&stranger).await;
    assert_eq!(kept, (people, cell));
    exclude(&runs[5..6]).await;
    let (people, cell) = told(&stranger).await;
    assert_eq!(people["analysed"], 6);
    assert_eq!(people["completed"], 11);
    assert_eq!(people["excluded"], 5);
    assert_eq!(people["exclusions"], json!([{ "flag": null, "n": 5 }]));
    assert_eq!(cell["n"], 6);
    assert_eq!(cell["before_exclusions"], 11);
}

#[tokio::test]
async fn a_strangers_stream_tells_what_is_released_and_eight_are_let_per_address() {
    let app = behind_a_proxy().await;
    account(&app, "anna", Role::Researcher).await;
    app.store.set_public(&"driving".into(), true).await.unwrap();
    finish(&app, 5).await;
    let stranger = Browser::new(&app).at("192.0.2.1");
    let path = "/results/driving/events";
    let mut streams = Vec::new();
    for _ in 0..8 {
        let stream = stranger.gets(path).await;
        assert_eq!(stream.status(), 200);
        streams.push(stream);
    }
    let refused = stranger.gets(path).await;
    assert_eq!(refused.status(), 503);
    assert!(refused.headers().contains_key("retry-after"));
    let other = Browser::new(&app).at("192.0.2.2");
    finish(&app, 1).await;
    let mut stream = other.gets(path).await;
    let told = stream.chunk().await.unwrap().unwrap();
    let told = String::from_utf8(told.to_vec()).unwrap();
    let summary = other.gets("/api/v1/studies/driving/summary").await;
    let summary: Value = summary.json().await.unwrap();
    let version = format!("\"data_version\":{},", summary["data_version"]);
    assert!(told.contains(&version), "{told} is not {version}");
}

#[tokio::test]
async fn pages_of_public_studies_are_limited_as_the_api_is() {
    let app = behind_a_proxy().await;
    account(&app, "anna", Role::Researcher).await;
    execute(&app, "update study set is_public = 1").await;
    let stranger = Browser::new(&app).at("192.0.2.1");
    let page = "/results/driving/data/summary.json";
    // Too few people have finished: they are counted all the same.
    for _ in 0..600 {
        assert_eq!(stranger.gets(page).await.status(), 401);
    }
    assert_eq!(stranger.gets(page).await.status(), 429);
    let other = Browser::new(&app).at("192.0.2.2");
    assert_eq!(other.gets(page).await.status(), 401);
}
