//! Refits in the background: what is fitted, when, and with which numbers.

use std::sync::Arc;

use riskaware::{
    jobs::{Catalogue, PartState, Snapshot},
    store::Population,
    study,
};
use serde_json::Value;

use crate::{
    app::App,
    crowd::{Background, drives, until},
};

async fn catalogue(app: &App) -> Arc<Catalogue> {
    let files = study::built_in()
        .into_iter()
        .map(|(name, text)| (name.to_owned(), text.to_owned()))
        .collect();
    Arc::new(Catalogue::publish(&app.store, files).await.unwrap())
}

async fn snapshot(app: &App, catalogue: &Catalogue) -> Arc<Snapshot> {
    Snapshot::read(&app.store, catalogue, Population::People, &"driving".into())
        .await
        .unwrap()
        .unwrap()
}

async fn all_fitted(app: &App, catalogue: &Catalogue) {
    until(&app.store, async || {
        let snapshot = snapshot(app, catalogue).await;
        snapshot
            .fits
            .iter()
            .all(|part| part.fit.is_some() && !part.is_behind)
    })
    .await;
}

fn row<'a>(rows: &'a Value, label: &str) -> &'a Value {
    rows.as_array()
        .unwrap()
        .iter()
        .find(|row| row["label"] == label)
        .unwrap_or_else(|| panic!("no row {label} in {rows}"))
}

#[track_caller]
fn near(value: &Value, expected: f64, tolerance: f64) {
    let value = value
        .as_f64()
        .unwrap_or_else(|| panic!("{value} is no number"));
    assert!(
        (value - expected).abs() <= tolerance,
        "{value} is not {expected} ± {tolerance}"
    );
}

/// models.md, section 7: 25 of 30 stop in every cell. 120 or 240 samples with sd 2.2 have a standard error of 0.2 or less.
#[tokio::test(flavor = "multi_thread")]
async fn thirty_people_of_whom_25_stop_give_the_expected_ln_kl() {
    let app = App::start().await;
    let catalogue = catalogue(&app).await;
    drives(&app.store, &catalogue, 0..30, 25).await;
    let _background = Background::start(&app.store, &catalogue);
    all_fitted(&app, &catalogue).await;

    let snapshot = snapshot(&app, &catalogue).await;
    for part in &snapshot.fits {
        assert_eq!(
            part.state,
            PartState::Converged,
            "{} {} {}",
            part.plan,
            part.part,
            part.model.id
        );
    }
    let accuracy: Value =
        serde_json::from_str(&app.get("/results/driving/data/accuracy.json").await.html).unwrap();
    assert_eq!(accuracy["plan"], "cell");
    assert_eq!(accuracy["cells"].as_array().unwrap().len(), 8);
    let pooled = &accuracy["pooled"];

    let low = row(pooled, "Risk: low");
    near(&low["models"]["noisy_rational"]["mean"], -1.33, 0.05);
    near(&low["models"]["noisy_rational"]["sd"], 0.08, 0.06);
    near(&low["models"]["risk_aware"]["mean"], -5.0, 0.7);
    near(&low["models"]["risk_aware"]["sd"], 2.2, 0.7);
    assert_eq!(low["paired_t"]["df"], 119.0);
    let high = row(pooled, "Risk: high");
    near(&high["models"]["noisy_rational"]["mean"], -5.3, 0.7);
    near(&high["models"]["risk_aware"]["mean"], -5.3, 0.7);
    let together = row(pooled, "Together");
    near(&together["models"]["noisy_rational"]["mean"], -3.3, 0.4);
    near(&together["models"]["risk_aware"]["mean"], -5.2, 0.5);
    assert_eq!(together["paired_t"]["df"], 239.0);
    assert!(together["paired_t"]["t"].as_f64().unwrap() < -5.0);
    near(
        &accuracy["cells"][0]["reference"],
        -1.27 - 60_f64.ln(),
        0.01,
    );
    near(&row(&accuracy["paper"], "Together")["t"], -11.5, 0.0);
    app.stop().await;
}

#[tokio::test]
async fn a_snapshot_is_read_again_only_when_the_version_moved() {
    let app = App::start().await;
    let catalogue = catalogue(&app).await;
    let first = snapshot(&app, &catalogue).await;
    assert!(Arc::ptr_eq(&first, &snapshot(&app, &catalogue).await));

    drives(&app.store, &catalogue, 0..1, 1).await;
    let second = snapshot(&app, &catalogue).await;
    assert_eq!((first.people.completed, second.people.completed), (0, 1));
    assert!(Arc::ptr_eq(&second, &snapshot(&app, &catalogue).await));
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn parts_without_answers_wait_and_a_restart_fits_nothing_again() {
    let app = App::start().await;
    let catalogue = catalogue(&app).await;
    let before = snapshot(&app, &catalogue).await;
    assert!(
        before
            .fits
            .iter()
            .all(|part| part.state == PartState::Waiting)
    );

    drives(&app.store, &catalogue, 0..3, 2).await;
    let background = Background::start(&app.store, &catalogue);
    all_fitted(&app, &catalogue).await;
    drop(background);
    let first = snapshot(&app, &catalogue).await;

    // A second worker finds nothing behind until somebody answers.
    let _again = Background::start(&app.store, &catalogue);
    drives(&app.store, &catalogue, 3..4, 4).await;
    all_fitted(&app, &catalogue).await;
    let second = snapshot(&app, &catalogue).await;
    let history = app
        .store
        .fit_history(&"driving".into(), Population::People, None, 500)
        .await
        .unwrap();
    let of_first_answers = history.iter().filter(|fit| {
        first.fits.iter().any(|part| {
            part.fit
                .as_ref()
                .is_some_and(|stored| stored.input_hash == fit.input_hash)
        })
    });
    assert_eq!(
        of_first_answers.count(),
        first.fits.len(),
        "each input was fitted once"
    );
    assert!(second.version.fit_version > first.version.fit_version);
    app.stop().await;
}
