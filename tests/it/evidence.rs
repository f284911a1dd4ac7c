//! What belongs beside the fits: provisional and final fits, comparisons, looks at the first people, blind studies.

use std::sync::Arc;

use reqwest::StatusCode;
use riskaware::{
    clock::Clock,
    jobs::{Catalogue, Snapshot},
    store::{Population, StudyState},
    study,
};
use serde_json::Value;

use crate::{
    app::{App, START},
    crowd::{Background, drives, until},
};

/// The driving study with its cells fitted together alone, so that little has to be computed, and with more keys before
/// its table `[fit]`: they belong to `[analysis]` until another table begins.
pub fn driving(tables: &str) -> Vec<(String, String)> {
    let (name, text) = study::built_in()[0];
    let (before, rest) = text.split_once("[[fit.plan]]").unwrap();
    let (_, all) = rest.split_once("id = \"all\"").unwrap();
    let before = before.replacen("[fit]\n", &format!("{tables}\n[fit]\n"), 1);
    let text = format!("{before}[[fit.plan]]\nid = \"all\"{all}");
    vec![(name.to_owned(), text)]
}

async fn start(tables: &str) -> (App, Arc<Catalogue>) {
    let app = App::with(Clock::manual(START), driving(tables)).await;
    let catalogue = Catalogue::publish(&app.store, driving(tables))
        .await
        .unwrap();
    (app, Arc::new(catalogue))
}

async fn snapshot(app: &App, catalogue: &Catalogue) -> Arc<Snapshot> {
    Snapshot::read(&app.store, catalogue, Population::People, &"driving".into())
        .await
        .unwrap()
        .unwrap()
}

async fn json(app: &App, path: &str) -> (StatusCode, Value) {
    let page = app.get(path).await;
    let value = serde_json::from_str(&page.html).unwrap_or_else(|_| panic!("{}", page.html));
    (page.status, value)
}

#[tokio::test(flavor = "multi_thread")]
async fn refits_are_provisional_and_closing_the_study_makes_them_final() {
    let (app, catalogue) = start("").await;
    let background = Background::start(&app.store, &catalogue);
    drives(&app.store, &catalogue, 0..3, 2).await;
    let all_fitted = async || {
        until(&app.store, async || {
            let snapshot = snapshot(&app, &catalogue).await;
            snapshot
                .fits
                .iter()
                .all(|part| part.fit.is_some() && !part.is_behind)
        })
        .await;
    };
    all_fitted().await;
    // From here on every part has a fit to start from.
    drives(&app.store, &catalogue, 3..5, 5).await;
    all_fitted().await;
    let live = snapshot(&app, &catalogue).await;
    for part in &live.fits {
        let stored = part.fit.as_ref().unwrap();
        let summary = &part.converged().unwrap().summary;
        assert!(
            part.is_provisional() && summary.provisional,
            "{}",
            part.model
        );
        assert!(part.draws().is_some());
        // Whatever asks for draws by the fit's number gets only what can be repeated.
        assert!(app.store.fit_draws(stored.id).await.is_err());
    }
    assert!(!live.is_final());

    let driving = "driving".into();
    app.store
        .set_study_state(&driving, StudyState::Closed)
        .await
        .unwrap();
    until(&app.store, async || {
        snapshot(&app, &catalogue).await.is_final()
    })
    .await;
    let last = snapshot(&app, &catalogue).await;
    let mut drawn = Vec::new();
    for part in &last.fits {
        let stored = part.fit.as_ref().unwrap();
        assert!(!stored.is_provisional && !part.converged().unwrap().summary.provisional);
        drawn.push((
            stored.input_hash.clone(),
            app.store.fit_draws(stored.id).await.unwrap(),
        ));
    }
    drop(background);

    // A server that knows nothing of the way there makes the same fits.
    let (other, catalogue) = start("").await;
    drives(&other.store, &catalogue, 0..3, 2).await;
    drives(&other.store, &catalogue, 3..5, 5).await;
    let _background = Background::start(&other.store, &catalogue);
    until(&other.store, async || {
        snapshot(&other, &catalogue).await.is_final()
    })
    .await;
    let cold = snapshot(&other, &catalogue).await;
    for (part, (hash, draws)) in cold.fits.iter().zip(drawn) {
        let stored = part.fit.as_ref().unwrap();
        assert_eq!(stored.input_hash, hash);
        assert!(
            other.store.fit_draws(stored.id).await.unwrap() == draws,
            "{}",
            part.model
        );
    }
    app.stop().await;
    other.stop().await;
}

const RULE: &str = "[stopping]\ncheck_every = 3\nminimum = 2\nbayes_factor = 10";

/// Everybody stops, whatever the risk: at 5 % a model of expected rewards says the opposite.
#[tokio::test(flavor = "multi_thread")]
async fn a_rule_is_announced_at_the_first_look_that_reaches_it() {
    let (app, catalogue) = start(RULE).await;
    let background = Background::start(&app.store, &catalogue);
    drives(&app.store, &catalogue, 0..12, 12).await;
    until(&app.store, async || {
        snapshot(&app, &catalogue)
            .await
            .sequential()
            .is_some_and(|evidence| !evidence.is_behind)
    })
    .await;
    drop(background);
    let (status, sequential) = json(&app, "/api/v1/studies/driving/sequential").await;
    assert_eq!(status, StatusCode::OK, "{sequential}");
    let looks = sequential["looks"].as_array().unwrap();
    let people: Vec<u64> = looks
        .iter()
        .map(|look| look["n"].as_u64().unwrap())
        .collect();
    assert_eq!(people, [2, 5, 8, 11]);
    let answers: Vec<u64> = looks
        .iter()
        .map(|look| look["answers"].as_u64().unwrap())
        .collect();
    assert_eq!(answers, [16, 40, 64, 88], "eight fitted cells each");
    let ln = |look: &Value| look["ln_bayes_factor"]["value"].as_f64().unwrap();
    assert!(looks.is_sorted_by_key(ln), "{looks:?}");
    assert!(
        looks
            .iter()
            .all(|look| look["width"].as_f64().unwrap() > 0.0)
    );

    let stopping = &sequential["stopping"];
    let first = looks
        .iter()
        .find(|look| ln(look).abs() >= 10_f64.ln())
        .unwrap();
    assert_eq!(stopping["reached_at"], first["n"]);
    let value = stopping["value"].as_f64().unwrap();
    assert!((value.ln() - ln(first)).abs() < 1e-9);
    assert_eq!(stopping["rule"]["bayes_factor"], 10.0);
    let (_, summary) = json(&app, "/api/v1/studies/driving/summary").await;
    let said = summary["stopping"].as_str().unwrap();
    assert!(
        said.contains(&format!("when {} people", first["n"])),
        "{said}"
    );
    let page = app.get("/results/driving").await;
    assert!(
        page.text("[data-part=announcement]")
            .unwrap()
            .contains(said)
    );

    // Another fine, time limit or prior makes it another study: the rule has not been reached in that one.
    let changed = |from: &str, to: &str| {
        let mut files = driving(RULE);
        assert!(files[0].1.contains(from));
        files[0].1 = files[0].1.replace(from, to);
        files
    };
    for files in [
        changed("\nfine = 50 ", "\nfine = 60 "),
        changed("limit_s = 8 ", "limit_s = 4 "),
        changed("weighting = \"monotone\"", "weighting = \"paper-range\""),
    ] {
        let other = Catalogue::publish(&app.store, files).await.unwrap();
        let other = snapshot(&app, &other).await;
        assert_eq!(other.sequential().unwrap().reached, None);
    }
    let same = Catalogue::publish(&app.store, driving(RULE)).await.unwrap();
    let same = snapshot(&app, &same).await;
    assert!(same.sequential().unwrap().reached.is_some());
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn models_are_compared_once_their_fits_are_final() {
    let (app, catalogue) = start("").await;
    let path = "/api/v1/studies/driving/comparison";
    let (_, before) = json(&app, path).await;
    assert_eq!(before["compared"], Value::Null);
    assert_eq!(before["live"][0]["ln_bayes_factor"], Value::Null);

    drives(&app.store, &catalogue, 0..6, 5).await;
    let _background = Background::start(&app.store, &catalogue);
    let plan = "all".into();
    until(&app.store, async || {
        let snapshot = snapshot(&app, &catalogue).await;
        snapshot
            .comparison(&plan)
            .is_some_and(|compared| !compared.is_behind)
    })
    .await;
    let (status, after) = json(&app, path).await;
    assert_eq!(
        (status, &after["plan"]),
        (StatusCode::OK, &Value::from("all"))
    );
    let compared = &after["compared"];
    assert_eq!(compared["message"], Value::Null);
    let report = &compared["report"];
    assert_eq!(
        (&report["unit"], &report["units"]),
        (&"participant".into(), &6.into())
    );
    assert_eq!(report["n"], 48);
    let live = after["live"][0]["ln_bayes_factor"]["value"]
        .as_f64()
        .unwrap();
    let stored = report["pairs"][0]["bayes_factor"]["ln"]["value"]
        .as_f64()
        .unwrap();
    assert!(
        (live - stored).abs() < 1e-9,
        "of the same fits: {live}, {stored}"
    );
    assert_eq!(compared["verdicts"][0]["hypothesis"], "H1");
    assert_eq!(compared["tests"]["cells"].as_array().unwrap().len(), 10);

    drives(&app.store, &catalogue, 6..7, 7).await;
    assert!(
        snapshot(&app, &catalogue)
            .await
            .comparison(&plan)
            .unwrap()
            .is_behind
    );
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_blind_study_shows_who_took_part_and_nothing_else() {
    let (app, catalogue) = start("blind_until = 3").await;
    drives(&app.store, &catalogue, 0..2, 1).await;
    let _background = Background::start(&app.store, &catalogue);
    until(&app.store, async || {
        snapshot(&app, &catalogue).await.is_final()
    })
    .await;
    let fit = snapshot(&app, &catalogue).await.fits[0]
        .fit
        .as_ref()
        .unwrap()
        .id;

    let api = "/api/v1/studies/driving";
    let hidden = [
        format!("{api}/curves"),
        format!("{api}/accuracy"),
        format!("{api}/comparison"),
        format!("{api}/sequential"),
        format!("{api}/fits"),
        format!("{api}/fits?history=true"),
        format!("{api}/fits/{fit}"),
        format!("{api}/fits/{fit}/draws"),
        format!("{api}/fits/{fit}/draws.csv?chain=1"),
        format!("{api}/gap-sweep"),
        format!("{api}/gap-sweep?pattern=observed"),
        "/results/driving/data/reading.json".to_owned(),
        "/results/driving/data/curves.json".to_owned(),
        "/results/driving/data/accuracy.json".to_owned(),
        "/results/driving/data/comparison.json".to_owned(),
        "/results/driving/data/sequential.json".to_owned(),
    ];
    for path in &hidden {
        let (status, problem) = json(&app, path).await;
        assert_eq!(status, StatusCode::FORBIDDEN, "{path}: {problem}");
        assert_eq!(problem["blind"]["until"], 3, "{path}");
        assert_eq!(problem["blind"]["completed"], 2, "{path}");
    }
    let (_, summary) = json(&app, &format!("{api}/summary")).await;
    assert_eq!(summary["people"]["completed"], 2);
    assert_eq!(summary["fits"], Value::Array(Vec::new()));
    assert_eq!(summary["checks"]["baseline"], Value::Null);
    for cell in summary["cells"].as_array().unwrap() {
        assert_eq!(
            (&cell["n"], &cell["actions"]),
            (&2.into(), &Value::Array(Vec::new()))
        );
    }
    // It draws what people chose beside what was made up.
    let page = app.get("/results/driving/sweep").await;
    assert_eq!(page.status, StatusCode::FORBIDDEN);
    let page = app.get("/results/driving").await;
    assert_eq!(page.status, StatusCode::OK);
    assert!(
        page.text("[data-part=blind]")
            .unwrap()
            .contains("until 3 people")
    );
    assert_eq!(
        page.text("[data-value='people.completed']").as_deref(),
        Some("2")
    );
    assert!(!page.html.contains("<table"), "no table of results");

    drives(&app.store, &catalogue, 2..3, 3).await;
    until(&app.store, async || {
        snapshot(&app, &catalogue).await.is_final()
    })
    .await;
    for path in &hidden[..4] {
        let (status, shown) = json(&app, path).await;
        assert_eq!(status, StatusCode::OK, "{path}: {shown}");
    }
    assert!(app.get("/results/driving").await.html.contains("<table"));
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn another_version_of_the_study_is_compared_and_looked_at_anew_without_new_answers() {
    let (app, catalogue) = start(RULE).await;
    drives(&app.store, &catalogue, 0..6, 5).await;
    let _background = Background::start(&app.store, &catalogue);
    let is_there = async || {
        until(&app.store, async || {
            let snapshot = snapshot(&app, &catalogue).await;
            let looks = snapshot.sequential();
            snapshot
                .comparison(&"all".into())
                .is_some_and(|compared| !compared.is_behind)
                && looks.is_some_and(|evidence| !evidence.is_behind)
        })
        .await;
    };
    is_there().await;
    let (name, text) = driving(RULE).remove(0);
    let text = text.replace("weighting = \"monotone\"", "weighting = \"paper-range\"");
    let study = study::Study::parse(&name, &text).unwrap();
    catalogue.renew(&app.store, study).await.unwrap();
    let changed = snapshot(&app, &catalogue).await;
    assert!(changed.comparison(&"all".into()).is_none());
    is_there().await;
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_withdrawal_no_fit_starts_from_one_with_the_person() {
    let (app, catalogue) = start("").await;
    let _background = Background::start(&app.store, &catalogue);
    let all_fitted = async || {
        until(&app.store, async || {
            let snapshot = snapshot(&app, &catalogue).await;
            let mut parts = snapshot.fits.iter();
            parts.all(|part| part.fit.is_some() && !part.is_behind)
        })
        .await;
    };
    drives(&app.store, &catalogue, 0..3, 2).await;
    all_fitted().await;
    drives(&app.store, &catalogue, 3..5, 5).await;
    all_fitted().await;
    let from_before = snapshot(&app, &catalogue).await;
    assert!(from_before.fits.iter().all(|part| part.is_provisional()));
    app.store
        .erase(&"driving".into(), Population::People, 1.into())
        .await
        .unwrap();
    all_fitted().await;
    let without = snapshot(&app, &catalogue).await;
    assert!(without.fits.iter().all(|part| !part.is_provisional()));
    app.stop().await;
}
