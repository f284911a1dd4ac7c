//! The models fitted to people from each source: the page and the API.

use reqwest::StatusCode;
use riskaware::clock::Clock;
use serde_json::Value;

use crate::app::{App, Page, START};

const JSON: &str = "/api/v1/studies/driving/sources";
const PAGE: &str = "/studies/driving/sources";

async fn people(app: &App, source: &str, action: &str, count: usize) {
    let query = if source.is_empty() {
        String::new()
    } else {
        format!("?source={source}")
    };
    for _ in 0..count {
        app.participant(&query).await.finishes(action).await;
    }
}

/// Asks until the fits are there.
async fn ready(app: &App, path: &str) -> Value {
    loop {
        let page = app.get(path).await;
        let body: Value = serde_json::from_str(&page.html).unwrap();
        match page.status {
            StatusCode::ACCEPTED => assert_eq!(body["fits"]["state"], "running", "{body}"),
            StatusCode::OK => return body,
            other => panic!("{other}: {body}"),
        }
    }
}

/// The first cells of the rows of a table.
fn firsts(page: &Page, table: &str) -> Vec<String> {
    page.texts(&format!("[aria-label=\"{table}\"] tbody th"))
}

#[tokio::test]
async fn one_source_has_nothing_to_compare_with() {
    let app = App::start().await;
    let page = app.get(PAGE).await;
    assert_eq!(page.status, StatusCode::OK);
    assert!(
        page.html
            .contains("No choice that the models are fitted to counts yet.")
    );

    people(&app, "lab", "stop", 3).await;
    let page = app.get(PAGE).await;
    assert!(page.html.contains("nothing to compare"), "{}", page.html);
    assert_eq!(firsts(&page, "People and choices of each source"), ["lab"]);
    assert!(firsts(&page, "Parameters by source").is_empty());
    let body: Value = serde_json::from_str(&app.get(JSON).await.html).unwrap();
    assert_eq!(body["fits"]["state"], "nothing_to_compare");
    assert_eq!(body["sources"][0]["n"], 24);

    // A second one that is too small does not change that, and it is said why.
    people(&app, "web", "accelerate", 1).await;
    let body: Value = serde_json::from_str(&app.get(JSON).await.html).unwrap();
    assert_eq!(body["fits"]["state"], "nothing_to_compare");
    assert_eq!(body["sources"][1]["left_out"], "too_few");
    let page = app.get(PAGE).await;
    assert!(page.html.contains("no: fewer than 20 choices"));
    app.stop().await;
}

#[tokio::test]
async fn sources_are_fitted_one_by_one_and_held_against_each_other() {
    let app = App::start().await;
    people(&app, "", "accelerate", 3).await;
    people(&app, "web", "stop", 4).await;
    people(&app, "pilot", "stop", 1).await;
    let body = ready(&app, JSON).await;
    assert_eq!(
        (&body["fits"]["state"], &body["plan"]),
        (&"ready".into(), &"all".into())
    );
    let sources: Vec<(&Value, &Value, &Value)> = body["sources"]
        .as_array()
        .unwrap()
        .iter()
        .map(|source| (&source["source"], &source["people"], &source["left_out"]))
        .collect();
    assert_eq!(
        sources,
        [
            (&Value::Null, &3.into(), &Value::Null),
            (&"pilot".into(), &1.into(), &"too_few".into()),
            (&"web".into(), &4.into(), &Value::Null),
        ]
    );
    let result = &body["fits"]["result"];
    assert_eq!(result["levels"][0]["n"], 24);
    assert_eq!(result["levels"][1]["n"], 32);
    for model in ["noisy_rational", "risk_aware"] {
        let found = &result["models"][model];
        let part = &found["parts"][0];
        for fit in [&part["shared"], &part["levels"][0], &part["levels"][1]] {
            assert_eq!(fit["converged"], true, "{fit}");
        }
        assert_eq!(part["shared"]["n"], 56);
        // Nobody of the one did what everybody of the other did.
        assert_eq!(found["evidence"]["verdict"], "differ", "{found}");
        let larger = &part["contrasts"][0]["differences"]["theta"]["probability_larger"];
        assert!((0.0..=1.0).contains(&larger.as_f64().unwrap()));
    }
    let alpha = &result["models"]["risk_aware"]["parts"][0]["levels"][0]["parameters"]["alpha"];
    assert_eq!(alpha["source"], "prior", "driving asks of losses only");
    let row = &body["choices"][0];
    assert_eq!(
        (&row["source"], &row["n"], &row["chosen"]),
        (&Value::Null, &3.into(), &3.into())
    );
    assert!(row["p_holm"].as_f64().unwrap() >= row["p"].as_f64().unwrap());

    // The same on the page and in the part that follows new answers, now that it is computed.
    let page = app.get(PAGE).await;
    assert_eq!(
        firsts(&page, "Separate parameters against shared ones"),
        ["Noisy Rational", "Risk-Aware"]
    );
    assert!(page.html.contains("Risk-Aware: sources differ."));
    assert!(page.html.contains("the prior: no choice depends on it"));
    let rows = firsts(&page, "Differences between sources");
    assert!(rows.iter().all(|row| row == "(no label) − web") && !rows.is_empty());
    let part = app.get("/studies/driving/data/sources.html?plan=all").await;
    assert_eq!(
        firsts(&part, "Fits by source"),
        firsts(&page, "Fits by source")
    );
    assert_eq!(
        page.attribute("[data-part=progress]", "data-state"),
        page.attribute("main", "data-state")
    );

    // One more answer is another question.
    people(&app, "web", "stop", 1).await;
    let body = ready(&app, JSON).await;
    assert_eq!(body["fits"]["result"]["levels"][1]["n"], 40);
    app.stop().await;
}

#[tokio::test]
async fn more_than_two_are_held_against_the_rest_in_any_plan() {
    let app = App::start().await;
    for source in ["a", "b", "c"] {
        people(&app, source, "stop", 3).await;
    }
    let body = ready(&app, &format!("{JSON}?plan=risk")).await;
    let parts = &body["fits"]["result"]["models"]["risk_aware"]["parts"];
    assert_eq!(parts.as_array().unwrap().len(), 2);
    for contrast in parts[1]["contrasts"].as_array().unwrap() {
        assert_eq!(contrast["against"], "rest");
    }
    let page = app.get(&format!("{PAGE}?plan=risk")).await;
    assert!(page.html.contains("held against all others together"));
    assert_eq!(
        page.attribute("main", "data-progress").as_deref(),
        Some("/studies/driving/data/sources.html?plan=risk")
    );
    for path in [PAGE, JSON] {
        let page = app.get(&format!("{path}?plan=none")).await;
        assert_eq!(page.status, StatusCode::BAD_REQUEST, "{path}");
        assert!(page.html.contains("allowed: "), "{}", page.html);
    }
    app.stop().await;
}

#[tokio::test]
async fn a_blind_study_shows_none_of_it() {
    let mut studies = App::built_in();
    for (_, text) in &mut studies {
        *text = text.replace("# blind_until = 30 ", "blind_until = 3 #");
    }
    let app = App::with(Clock::manual(START), studies).await;
    for path in [PAGE, JSON, "/studies/driving/data/sources.html"] {
        let page = app.get(path).await;
        assert_eq!(page.status, StatusCode::FORBIDDEN, "{path}");
    }
    app.stop().await;
}
