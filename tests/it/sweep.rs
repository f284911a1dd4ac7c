//! Simulated sweeps by API, on the page and from the command line.

use std::process::Command;

use reqwest::StatusCode;
use scraper::{Html, Selector};
use serde_json::Value;

use crate::app::App;

const SHARE: &str = "/api/v1/studies/driving/sweep?cell=explicit/timed/high&n=3&seeds=1";
const GAP: &str = "/api/v1/studies/driving/gap-sweep?steps=2&seeds=1";

fn riskaware() -> Command {
    Command::new(env!("CARGO_BIN_EXE_riskaware"))
}

/// Asks until the sweep is computed.
async fn ready(app: &App, path: &str) -> Value {
    loop {
        let page = app.get(path).await;
        let body: Value = serde_json::from_str(&page.html).unwrap();
        match page.status {
            StatusCode::ACCEPTED => assert_eq!(body["state"], "running", "{body}"),
            StatusCode::OK => return body,
            other => panic!("{other}: {body}"),
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sweep_is_on_its_way_until_it_is_ready_and_the_page_shows_it() {
    let app = App::start().await;
    let first = app
        .client
        .get(format!("{}{SHARE}", app.url))
        .send()
        .await
        .unwrap();
    assert_eq!(first.status(), StatusCode::ACCEPTED);
    assert_eq!(first.headers()["retry-after"], "2");
    let body: Value = first.json().await.unwrap();
    assert_eq!(
        (&body["done"], &body["of"], &body["ahead"]),
        (&0.into(), &8.into(), &0.into())
    );

    let body = ready(&app, SHARE).await;
    let result = &body["result"];
    assert_eq!(result["action"], "accelerate");
    assert_eq!(result["reference_reward"], -500.0);
    let points = result["points"].as_array().unwrap();
    assert_eq!(points.len(), 4);
    let hollow: Vec<bool> = points
        .iter()
        .map(|point| point["unanimous"].as_bool().unwrap())
        .collect();
    assert_eq!(hollow, [true, false, false, true]);
    for point in points {
        for model in ["noisy_rational", "risk_aware"] {
            assert!(point["models"][model]["ln_kl"]["mean"].is_f64(), "{point}");
        }
    }
    let command = body["command"].as_str().unwrap();
    assert_eq!(
        command,
        "riskaware sweep --study driving --cell explicit/timed/high --n 3 --seeds 1 --seed 1"
    );

    let gap = ready(&app, GAP).await;
    assert_eq!(gap["result"]["vary"], "stop:-50=-26..-474");
    assert_eq!(gap["result"]["series"].as_array().unwrap().len(), 2);
    assert_eq!(gap["labels"]["implicit/timed/low"], "Risk: low");
    // Eight fitted cells and four baseline questions have known outcomes; nobody has answered.
    let observed = gap["observed"].as_array().unwrap();
    assert_eq!(observed.len(), 12);
    assert!(observed.iter().all(|row| row["share"].is_null()));
    assert_eq!(
        observed
            .iter()
            .filter(|row| row["baseline"] == true)
            .count(),
        4
    );

    let page = app
        .get("/results/driving/sweep?cell=explicit/timed/high&n=3&seeds=1&steps=2")
        .await;
    assert_eq!(page.status, StatusCode::OK, "{}", page.html);
    let rows = |figure: &str| {
        let selector = Selector::parse(&format!("[data-figure={figure}] tbody tr")).unwrap();
        Html::parse_document(&page.html).select(&selector).count()
    };
    assert_eq!(
        (rows("sweep"), rows("gap_sweep"), rows("optimal")),
        (4, 4, 12)
    );
    let results = app.get("/results/driving").await;
    assert!(results.html.contains("/results/driving/sweep"));
    app.stop().await;
}

#[tokio::test]
async fn what_cannot_be_swept_is_told() {
    let app = App::start().await;
    for (query, status, text) in [
        ("sweep?cell=nowhere", 422, "is not fitted or does not exist"),
        ("sweep?cell=none/timed/unknown", 422, "is not fitted"),
        ("sweep?n=1", 422, "n is 1; allowed: 2 to 200"),
        ("sweep?n=201", 422, "n is 201"),
        ("sweep?seeds=0", 422, "seeds is 0; allowed: 1 to 50"),
        ("sweep?n=200&seeds=50", 422, "takes 20100 fits"),
        ("sweep?action=wait", 422, "is no action"),
        ("sweep?models=bayes", 422, "unknown model"),
        ("sweep?x=1", 400, "unknown field"),
        ("gap-sweep?vary=fine", 422, "does not say what varies"),
        ("gap-sweep?steps=1", 422, "steps is 1"),
        ("gap-sweep?count=31", 422, "31 of 30"),
        ("gap-sweep?pattern=observed", 422, "at least one"),
    ] {
        let page = app.get(&format!("/api/v1/studies/driving/{query}")).await;
        assert_eq!(page.status.as_u16(), status, "{query}: {}", page.html);
        assert!(page.html.contains(text), "{query}: {}", page.html);
    }
    for path in ["/api/v1/studies/nobody/sweep", "/results/nobody/sweep"] {
        assert_eq!(app.get(path).await.status, StatusCode::NOT_FOUND, "{path}");
    }
    app.stop().await;
}

/// The same numbers whatever the number of threads, and the same as the command says beside the page.
#[test]
fn the_command_does_not_depend_on_threads() {
    let run = |threads: &str| {
        let output = riskaware()
            .args([
                "sweep",
                "--cell",
                "explicit/timed/high",
                "--n",
                "2",
                "--seeds",
                "2",
                "--json",
                "--threads",
                threads,
            ])
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
        output.stdout
    };
    let one = run("1");
    assert_eq!(one, run("3"));
    let report: Value = serde_json::from_slice(&one).unwrap();
    assert_eq!(report["points"].as_array().unwrap().len(), 3);
}

#[test]
fn a_file_of_problems_is_swept_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let problems = folder.path().join("problems.json");
    std::fs::write(
        &problems,
        r#"{"cups":{"stable":[[1,20]],"unstable":[[0.2,105],[0.8,0]]}}"#,
    )
    .unwrap();
    let drawing = folder.path().join("gap.svg");
    let output = riskaware()
        .args([
            "sweep",
            "--gap",
            "stable:20=10..30",
            "--steps",
            "2",
            "--seeds",
            "1",
            "--csv",
        ])
        .arg("--problems")
        .arg(&problems)
        .arg("--svg")
        .arg(&drawing)
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    // A head, and two models at two values.
    assert_eq!(text.lines().count(), 5, "{text}");
    assert!(text.contains("cups,stable,10,-11,25:5,"), "{text}");
    assert!(
        std::fs::read_to_string(drawing)
            .unwrap()
            .starts_with("<svg")
    );
}
