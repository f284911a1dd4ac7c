//! What the results page says beside its figures: what a design cannot tell, how the models compare, what is hidden.

use std::sync::Arc;

use reqwest::StatusCode;
use riskaware::{
    clock::Clock,
    inference::comparison::{ComparisonSettings, PlanData, Unit, compare_models},
    inference::{ChoiceData, FitSettings, FittedProblem, Group},
    jobs::{Catalogue, PlanComparison, Snapshot},
    model::{EXPECTED_UTILITY, NOISY_RATIONAL, RISK_AWARE},
    store::{NewComparison, Population},
    study::{self, StudyId},
};
use scraper::{Html, Selector};
use serde_json::{Value, json};

use crate::{
    app::{App, START},
    crowd::{Background, drives, until},
};

const GAMBLES: &str = include_str!("../data/gambles.toml");

fn driving() -> String {
    let files = study::built_in();
    let (_, text) = files
        .iter()
        .find(|(name, _)| *name == "driving.toml")
        .unwrap();
    (*text).to_owned()
}

/// The server with one study, and its catalogue for work behind its back.
async fn serving(text: String) -> (App, Arc<Catalogue>) {
    let files = vec![("study.toml".to_owned(), text)];
    let app = App::with(Clock::manual(START), files.clone()).await;
    let catalogue = Catalogue::publish(&app.store, files).await.unwrap();
    (app, Arc::new(catalogue))
}

fn texts(html: &str, selector: &str) -> Vec<String> {
    let selector = Selector::parse(selector).unwrap();
    let document = Html::parse_document(html);
    document
        .select(&selector)
        .map(|element| element.text().collect::<Vec<_>>().join("|"))
        .collect()
}

fn is_hidden(html: &str, selector: &str) -> bool {
    texts(html, &format!("{selector}:not([hidden])")).is_empty()
        && !texts(html, selector).is_empty()
}

async fn fetched(app: &App, path: &str) -> Value {
    serde_json::from_str(&app.get(path).await.html).unwrap()
}

#[tokio::test]
async fn a_design_of_losses_only_says_what_cannot_be_learned() {
    let (app, _) = serving(driving()).await;
    let page = app.get("/results/driving").await.html;
    let design = texts(&page, "[data-list=design] li");
    assert_eq!(design.len(), 1, "{design:?}");
    for expected in [
        "Risk-Aware: All rewards here are losses or nothing.",
        "α (curvature of gains) cannot be learned at all",
        "only as their product λ·θ",
        "only through the normalisation of decision weights",
    ] {
        assert!(design[0].contains(expected), "{expected}: {design:?}");
    }
    for absent in [
        "[data-list=verdicts]",
        "[data-text=provisional]",
        "[data-shown=left_out]",
    ] {
        assert!(is_hidden(&page, absent), "{absent}");
    }
    assert!(texts(&page, "[data-text=compared]")[0].starts_with("Not compared yet"));
    app.stop().await;
}

#[tokio::test]
async fn a_design_of_gains_only_says_what_cannot_be_learned() {
    let gains = GAMBLES
        .replace("\"-loss\"", "\"loss\"")
        .replace("reward = -2", "reward = 2");
    let (app, _) = serving(gains).await;
    let design = texts(
        &app.get("/results/three-gambles").await.html,
        "[data-list=design] li",
    );
    assert_eq!(
        design,
        [
            "Risk-Aware: All rewards here are gains or nothing. So β (curvature of losses), δ (weighting of losses) and \
             λ (loss aversion) cannot be learned at all: what stands there is the prior, not a finding."
        ]
    );
    app.stop().await;

    let (app, _) = serving(GAMBLES.to_owned()).await;
    let page = app.get("/results/three-gambles").await.html;
    assert_eq!(texts(&page, "[data-list=design] li"), [""; 0]);
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn parameters_come_with_their_notes() {
    let (app, catalogue) = serving(driving()).await;
    drives(&app.store, &catalogue, 0..30, 25).await;
    let _background = Background::start(&app.store, &catalogue);
    until(&app.store, async || {
        let rows = &fetched(&app, "/results/driving/data/summary.json").await["fits"];
        let rows = rows.as_array().unwrap();
        rows.iter().all(|fit| fit["state"] == "converged")
    })
    .await;
    let page = app.get("/results/driving").await.html;
    let rows = texts(&page, "[data-table=parameters] tbody tr");
    let contraction = |symbol: &str| -> String {
        let row = rows
            .iter()
            .find(|row| row.starts_with("All") && row.contains(&format!("|Risk-Aware|{symbol}|")));
        let row = row.unwrap_or_else(|| panic!("{symbol}: {rows:?}"));
        row.split('|').nth(6).unwrap().to_owned()
    };
    assert_eq!(contraction("α"), "the prior: no choice depends on it");
    for symbol in ["λ", "θ"] {
        assert!(contraction(symbol).parse::<f64>().is_err(), "{symbol}");
    }
    assert!(contraction("λ·θ").parse::<f64>().unwrap() > 0.1);
    // What the page shows and what replaces it while it is open are one.
    let reading = fetched(&app, "/results/driving/data/reading.json").await;
    assert_eq!(
        reading["tables"]["parameters"]["rows"]
            .as_array()
            .unwrap()
            .len(),
        rows.len()
    );
    let notes = reading["lists"]["notes"].as_array().unwrap();
    assert_eq!(notes.len(), texts(&page, "[data-list=notes] li").len());
    app.stop().await;
}

/// Thirty people answer each of two of the driving cells; all of them stop where the risk is high.
fn two_cells() -> PlanData {
    let study = study::Study::parse("driving.toml", &driving()).unwrap();
    let problems: Vec<FittedProblem> = ["explicit/timed/low", "explicit/timed/high"]
        .map(|id| FittedProblem {
            id: id.to_owned(),
            problem: study.cell(id).unwrap().problem.clone().unwrap(),
        })
        .into();
    let stop = problems[0].problem.position("stop").unwrap();
    let choice = |stops: bool| {
        let mut row = vec![0; 2];
        row[if stops { stop } else { 1 - stop }] = 1;
        row
    };
    let group = |weight, low| Group {
        weight,
        counts: vec![choice(low), choice(true)],
    };
    let data = ChoiceData::new(problems, vec![group(28, true), group(7, false)]).unwrap();
    PlanData::whole(&data, Unit::Participant)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_comparison_decides_headline_verdict_and_ladder() {
    let (app, catalogue) = serving(driving()).await;
    let id = StudyId::from("driving");
    let (version, study) = catalogue.current(&id).unwrap();
    let plan = study
        .plans()
        .iter()
        .find(|plan| plan.id.as_str() == "all")
        .unwrap();
    let settings_hash = PlanComparison::settings_hash(&study, plan);
    let settings = FitSettings {
        reference_reward: Some(-500.0),
        draws: 250,
        ..FitSettings::default()
    };
    let comparison = compare_models(
        &two_cells(),
        &[&NOISY_RATIONAL, &RISK_AWARE],
        &settings,
        &[],
        &ComparisonSettings::full(1),
        &mut |_| std::ops::ControlFlow::Continue(()),
    )
    .unwrap();
    let plain = json!({ "cells": [], "pairs": [{
        "factor": "risk", "first": "explicit/timed/high", "second": "explicit/timed/low", "action": "stop",
        "both": 28, "first_only": 7, "second_only": 0, "neither": 0, "n": 35,
        "risk_difference": 0.2, "low": 0.086, "high": 0.343, "p": 0.015_625, "p_holm": 0.015_625,
    }], "resamples": 2000, "seed": 1 });
    let (pair, _) = comparison.pair("risk_aware", "noisy_rational").unwrap();
    let difference = pair.leave_one_out.unwrap();
    assert!(
        difference.distinguishable && difference.difference.beyond_two_se,
        "{difference:?}"
    );
    let new = NewComparison {
        study: id,
        population: Population::People,
        plan: "all".into(),
        input_hash: format!("{settings_hash}-of other answers"),
        data_version: 0,
        version,
        seed: 1,
        outcome: Ok(json!({ "comparison": comparison, "tests": plain }).to_string()),
        cpu_ms: 1,
    };
    app.store.save_comparison(new.clone()).await.unwrap();
    // Without anybody's answers, or of other problems, it says nothing of this study.
    let page = app.get("/results/driving").await.html;
    assert_eq!(
        texts(&page, "[data-value='verdict.model']"),
        ["Not known yet"]
    );
    drives(&app.store, &catalogue, 0..1, 1).await;
    let foreign = NewComparison {
        input_hash: "of other problems".to_owned(),
        ..new.clone()
    };
    app.store.save_comparison(foreign).await.unwrap();
    let page = app.get("/results/driving").await.html;
    assert_eq!(
        texts(&page, "[data-value='verdict.model']"),
        ["Not known yet"]
    );
    app.store.save_comparison(new).await.unwrap();

    let page = app.get("/results/driving").await.html;
    assert_eq!(texts(&page, "[data-value='verdict.model']"), ["Risk-Aware"]);
    let verdict = &fetched(&app, "/results/driving/data/summary.json").await["verdict"];
    assert_eq!(verdict["model"], "Risk-Aware");
    let lines = texts(&page, "[data-list=verdicts] li");
    assert!(lines[0].starts_with("H1: A risk-aware model"), "{lines:?}");
    assert!(
        lines.last().unwrap().starts_with("Criterion: "),
        "{lines:?}"
    );
    let left_out = texts(&page, "[data-table=left_out] tbody tr");
    assert!(
        left_out[0].contains("|Risk-Aware against Noisy Rational|"),
        "{left_out:?}"
    );
    assert!(
        left_out[0].ends_with("|35 people|Risk-Aware predicts better"),
        "{left_out:?}"
    );
    let rungs = texts(&page, "[data-figure=ladder] tbody tr");
    let names: Vec<&str> = rungs
        .iter()
        .filter_map(|row| row.split('|').next())
        .collect();
    assert_eq!(names, ["Random", "Noisy Rational", "Risk-Aware"]);
    assert!(texts(&page, "[data-text=compared]")[0].contains("35 people, 70 answers"));
    let held_out = texts(&page, "[data-table=held_out] tbody tr");
    // Two cells and their sum, each by chance, by the other cell's share, and by both models.
    assert_eq!(held_out.len(), 12, "{held_out:?}");
    let changes = texts(&page, "[data-table=changes] tbody tr");
    assert!(
        changes[0].ends_with("|35|7|0|+20 % (+9 % to +34 %)|.016|.016"),
        "{changes:?}"
    );
    let sensitivity = texts(&page, "[data-table=sensitivity] tbody tr");
    assert!(
        sensitivity
            .iter()
            .any(|row| row.contains("floor of γ and δ 0.05")),
        "{sensitivity:?}"
    );
    app.stop().await;
}

#[tokio::test]
async fn a_blind_study_shows_who_took_part_and_nothing_else() {
    let blind = driving().replace("# blind_until = 30 ", "blind_until = 3 #");
    let (app, catalogue) = serving(blind).await;
    drives(&app.store, &catalogue, 0..2, 1).await;
    let page = app.get("/results/driving").await.html;
    assert_eq!(texts(&page, "[data-value='people.completed']")[0], "2");
    assert!(page.contains("Hidden until 3 people have finished"));
    assert_eq!(texts(&page, "figure, table, h2"), [""; 0]);
    let reading = app.get("/results/driving/data/reading.json").await;
    assert_eq!(reading.status, StatusCode::FORBIDDEN);

    drives(&app.store, &catalogue, 2..3, 1).await;
    let page = app.get("/results/driving").await.html;
    assert!(!page.contains("Hidden until"));
    assert!(!texts(&page, "figure").is_empty());
    let reading = app.get("/results/driving/data/reading.json").await;
    assert_eq!(reading.status, StatusCode::OK);
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn tables_hold_every_model_that_the_study_fits() {
    let text = driving().replace(
        "models = [\"noisy_rational\", \"risk_aware\"]",
        "models = [\"noisy_rational\", \"expected_utility\", \"risk_aware\"]",
    );
    let (before, plans) = text.split_once("[[fit.plan]]").unwrap();
    let (_, all) = plans.split_once("id = \"all\"").unwrap();
    let (app, catalogue) = serving(format!("{before}[[fit.plan]]\nid = \"all\"{all}")).await;
    drives(&app.store, &catalogue, 0..3, 2).await;
    let _background = Background::start(&app.store, &catalogue);
    until(&app.store, async || {
        let id = StudyId::from("driving");
        let read = Snapshot::read(&app.store, &catalogue, Population::People, &id);
        let snapshot = read.await.unwrap().unwrap();
        snapshot.fits.iter().all(|part| part.converged().is_some())
    })
    .await;

    let page = app.get("/results/driving").await.html;
    let models = [&NOISY_RATIONAL, &EXPECTED_UTILITY, &RISK_AWARE];
    for figure in ["value", "value_shape", "predictive_check"] {
        let rows = texts(&page, &format!("[data-figure={figure}] tbody tr"));
        for model in models {
            assert!(
                rows.iter().any(|row| row.contains(model.label)),
                "{figure}, {}: {rows:?}",
                model.label
            );
        }
    }
    let accuracy = fetched(&app, "/results/driving/data/accuracy.json").await;
    for check in accuracy["checks"].as_array().unwrap() {
        for model in models {
            assert_eq!(check["models"][model.id]["n"], 3, "{check}");
        }
    }
    app.stop().await;
}
