//! `/api/v1`: paths, forms, errors.

use reqwest::{Method, Response, StatusCode, header};
use riskaware::jobs::Catalogue;
use riskaware::study;
use serde_json::{Value, json};

use crate::{
    app::App,
    crowd::{Background, completes, drives, until},
};

pub async fn catalogue(app: &App) -> Catalogue {
    let files = study::built_in()
        .into_iter()
        .map(|(name, text)| (name.to_owned(), text.to_owned()))
        .collect();
    Catalogue::publish(&app.store, files).await.unwrap()
}

pub async fn request(app: &App, method: Method, path: &str) -> Response {
    app.client
        .request(method, format!("{}{path}", app.url))
        .send()
        .await
        .unwrap()
}

pub async fn json_of(app: &App, path: &str) -> Value {
    let response = request(app, Method::GET, path).await;
    assert_eq!(response.status(), StatusCode::OK, "{path}");
    response.json().await.unwrap()
}

async fn predict(app: &App, body: &Value) -> (StatusCode, Value) {
    let url = format!("{}/api/v1/studies/driving/predict", app.url);
    let response = app.client.post(url).json(body).send().await.unwrap();
    (response.status(), response.json().await.unwrap())
}

#[tokio::test]
async fn every_error_is_a_problem_document() {
    let app = App::start().await;
    let driving = "/api/v1/studies/driving";
    for (method, path, status) in [
        (Method::GET, "/api".to_owned(), 404),
        (Method::GET, "/api/v2/studies".to_owned(), 404),
        (Method::GET, "/api/v1/nothing".to_owned(), 404),
        (
            Method::GET,
            "/api/v1/studies/nobody/summary".to_owned(),
            404,
        ),
        (
            Method::GET,
            "/api/v1/studies/nobody/answers.csv".to_owned(),
            404,
        ),
        (Method::GET, "/api/v1/studies/nobody/events".to_owned(), 404),
        (Method::GET, format!("{driving}/fits/1"), 404),
        (Method::GET, format!("{driving}/fits/one"), 404),
        (Method::DELETE, format!("{driving}/summary"), 405),
        (Method::GET, format!("{driving}/predict"), 405),
        (Method::GET, format!("{driving}/summary?colour=red"), 400),
        (Method::GET, format!("{driving}/curves?plan=nothing"), 400),
        (Method::GET, format!("{driving}/accuracy?plan=nothing"), 400),
        (Method::GET, format!("{driving}/answers?limit=0"), 400),
        (Method::GET, format!("{driving}/answers?limit=x"), 400),
        (Method::GET, format!("{driving}/answers?after=x"), 400),
        (Method::GET, format!("{driving}/fits?before=3"), 400),
        (Method::POST, format!("{driving}/predict"), 415),
    ] {
        let response = request(&app, method.clone(), &path).await;
        assert_eq!(response.status().as_u16(), status, "{method} {path}");
        assert_eq!(
            response.headers()[header::CONTENT_TYPE],
            "application/problem+json",
            "{method} {path}"
        );
        let problem: Value = response.json().await.unwrap();
        assert_eq!(problem["status"], status, "{problem}");
        assert!(
            problem["detail"]
                .as_str()
                .is_some_and(|detail| !detail.is_empty()),
            "{problem}"
        );
    }
    // No name of ours is written with an escape; what the rules and the handler read is one and the same.
    let escaped = request(&app, Method::GET, "/api/v1/studies/driv%69ng/summary").await;
    assert_eq!(escaped.status(), StatusCode::NOT_FOUND);
    for (path, named) in [
        ("driving/answers?limit=x", "limit"),
        ("driving/answers?cursor=%FF", "`after`"),
        ("driving/answers?after=%FF", "after"),
        ("driving/fits?history=perhaps", "history"),
    ] {
        let response = request(&app, Method::GET, &format!("/api/v1/studies/{path}")).await;
        assert_eq!(response.status(), StatusCode::BAD_REQUEST, "{path}");
        let problem: Value = response.json().await.unwrap();
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(named), "{path}: {detail}");
    }
    let url = format!("{}{driving}/predict", app.url);
    for (body, status) in [
        ("{", 400),
        (r#"{"problem":{"a":[[1,2]]}}"#, 422),
        (r#"{"colour":1}"#, 422),
    ] {
        let post = app
            .client
            .post(&url)
            .header(header::CONTENT_TYPE, "application/json")
            .body(body);
        assert_eq!(
            post.send().await.unwrap().status().as_u16(),
            status,
            "{body}"
        );
    }
    let huge = app
        .client
        .post(&url)
        .header(header::CONTENT_TYPE, "application/json")
        .body(" ".repeat(100_000));
    assert_eq!(
        huge.send().await.unwrap().status(),
        StatusCode::PAYLOAD_TOO_LARGE
    );
    app.stop().await;
}

#[tokio::test]
async fn answers_page_by_cursor_and_the_exports_hold_the_same_rows() {
    let app = App::start().await;
    let catalogue = catalogue(&app).await;
    drives(&app.store, &catalogue, 0..2, 1).await;
    completes(
        &app.store,
        &catalogue,
        &"driving".into(),
        99,
        Some("=cmd"),
        |_, actions| actions[0].clone(),
    )
    .await;

    let mut paged = Vec::new();
    let mut path = Some("/api/v1/studies/driving/answers?limit=7".to_owned());
    while let Some(next) = path {
        let response = request(&app, Method::GET, &next).await;
        let link = response
            .headers()
            .get(header::LINK)
            .map(|link| link.to_str().unwrap().to_owned());
        let next = |link: String| {
            let next = link
                .split(", ")
                .find(|link| link.contains("rel=\"next\""))?;
            Some(next.split(['<', '>']).nth(1)?.to_owned())
        };
        path = link.and_then(next);
        let page: Value = response.json().await.unwrap();
        paged.extend(page["answers"].as_array().unwrap().clone());
    }
    let lines = request(&app, Method::GET, "/api/v1/studies/driving/answers.ndjson")
        .await
        .text()
        .await
        .unwrap();
    let streamed: Vec<Value> = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(streamed, paged);
    assert_eq!(
        paged.len(),
        3 * (1 + 5 + 5 + 4),
        "practice, two blocks, baseline"
    );

    let response = request(&app, Method::GET, "/api/v1/studies/driving/answers.csv").await;
    assert_eq!(
        response.headers()[header::CONTENT_TYPE],
        "text/csv; charset=utf-8"
    );
    let text = response.text().await.unwrap();
    assert_eq!(
        text.lines().next().unwrap(),
        "study,version,participant,run_state,block,position,question,problem,information,time,risk,action,status,shown_at_ms,answered_at_ms,server_ms,client_rt_ms,limit_ms,input,hidden_ms,source,simulated"
    );
    assert_eq!(text.lines().count(), 1 + paged.len());
    let timed = text
        .lines()
        .find(|line| line.contains("explicit/timed/low"))
        .unwrap();
    assert!(
        timed.contains(",explicit/timed/low,explicit,timed,low,stop,answered,"),
        "{timed}"
    );
    assert!(
        text.contains(",'=cmd,") && !text.contains(",=cmd"),
        "a formula stands in the export"
    );
    app.stop().await;
}

#[tokio::test]
async fn prediction_from_parameters_needs_no_fit() {
    let app = App::start().await;
    let body = json!({
        "model": "risk_aware",
        "parameters": { "alpha": 0.88, "beta": 0.88, "lambda": 2.25, "gamma": 0.61, "delta": 0.69, "theta": 0.2 },
        "problem": { "stable": [[1.0, 20.0]], "unstable": [[0.2, 105.0], [0.8, 0.0]] },
    });
    let (status, answer) = predict(&app, &body).await;
    assert_eq!(status, StatusCode::OK, "{answer}");
    // product.md, "Fixed forms".
    assert!(
        (answer["probabilities"]["stable"].as_f64().unwrap() - 0.4156651).abs() < 1e-7,
        "{answer}"
    );
    assert_eq!(answer["most_likely"], "unstable");
    assert_eq!(
        answer["options"],
        json!({ "normalise": true, "zero": "gain", "weighting_function": "tversky_kahneman" })
    );

    let many_actions: serde_json::Map<String, Value> = (0..21)
        .map(|action| (format!("action {action}"), json!([[1.0, action]])))
        .collect();
    let many_outcomes: Vec<Value> = (0..128)
        .map(|reward| json!([1.0 / 128.0, reward]))
        .collect();
    for (problem, limit) in [
        (Value::Object(many_actions), "at most 20"),
        (
            json!({ "stay": [[1.0, 0.0]], "go": many_outcomes }),
            "at most 100",
        ),
    ] {
        let body = json!({ "problem": problem, "parameters": body["parameters"] });
        let (status, answer) = predict(&app, &body).await;
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{answer}");
        assert!(
            answer["detail"].as_str().unwrap().contains(limit),
            "{answer}"
        );
    }

    let (status, answer) = predict(&app, &json!({ "problem": body["problem"] })).await;
    assert_eq!(status, StatusCode::CONFLICT, "{answer}");
    for wrong in [
        json!({ "problem": body["problem"], "model": "bayes" }),
        json!({ "problem": body["problem"], "plan": "cell" }),
        json!({ "problem": body["problem"], "plan": "cell", "part": "x" }),
        json!({ "problem": body["problem"], "parameters": { "theta": 1 } }),
    ] {
        assert_eq!(
            predict(&app, &wrong).await.0,
            StatusCode::UNPROCESSABLE_ENTITY,
            "{wrong}"
        );
    }
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn events_tell_of_fits_and_a_fit_then_predicts() {
    let app = App::start().await;
    let catalogue = std::sync::Arc::new(catalogue(&app).await);
    let mut events = request(&app, Method::GET, "/api/v1/studies/driving/events").await;
    let first = events.chunk().await.unwrap().unwrap();
    let first = String::from_utf8(first.to_vec()).unwrap();
    assert!(
        first.contains("event: version") && first.contains(r#""data_version":0"#),
        "{first}"
    );

    drives(&app.store, &catalogue, 0..4, 3).await;
    let _background = Background::start(&app.store, &catalogue);
    let is_fitted = async || {
        let fits = json_of(&app, "/api/v1/studies/driving/fits").await;
        fits["fits"]
            .as_array()
            .unwrap()
            .iter()
            .all(|fit| fit["state"] == "converged" && fit["is_behind"] == false)
    };
    until(&app.store, is_fitted).await;
    let later = events.chunk().await.unwrap().unwrap();
    assert!(
        String::from_utf8(later.to_vec())
            .unwrap()
            .contains("event: version")
    );

    let problem = json!({ "stop": [[1, -50]], "accelerate": [[0.05, -500], [0.95, 0]] });
    let (status, whole) = predict(&app, &json!({ "problem": problem })).await;
    assert_eq!(status, StatusCode::OK, "{whole}");
    assert_eq!(
        (whole["plan"].as_str(), whole["part"].as_str()),
        (Some("all"), Some("all"))
    );
    let stop = &whole["probabilities"]["stop"];
    assert!(
        stop["q5"].as_f64() < stop["mean"].as_f64() && stop["mean"].as_f64() < stop["q95"].as_f64(),
        "{stop}"
    );
    let (_, part) =
        predict(&app, &json!({ "problem": problem, "plan": "cell", "cell": "explicit/timed/low", "model": "noisy_rational" })).await;
    assert_eq!(
        (part["part"].as_str(), part["model"].as_str()),
        (Some("explicit/timed/low"), Some("noisy_rational"))
    );

    let fit = json_of(
        &app,
        &format!("/api/v1/studies/driving/fits/{}", whole["fit"]),
    )
    .await;
    assert_eq!(fit["result"]["summary"]["converged"], true);
    let address = format!("/api/v1/studies/driving/fits/{}/draws", whole["fit"]);
    let draws = json_of(&app, &address).await;
    let alpha = &draws["posterior"]["alpha"];
    assert_eq!(
        (
            alpha.as_array().unwrap().len(),
            alpha[7].as_array().unwrap().len()
        ),
        (8, 500)
    );
    assert_eq!(draws["attrs"]["seed"], fit["seed"]);
    let chain = request(&app, Method::GET, &format!("{address}.csv?chain=8")).await;
    assert_eq!(chain.status(), StatusCode::OK);
    assert_eq!(chain.headers()["content-type"], "text/csv; charset=utf-8");
    let chain = chain.text().await.unwrap();
    let first = chain.lines().find(|line| line.starts_with('-')).unwrap();
    let numbers: Vec<f64> = first.split(',').map(|text| text.parse().unwrap()).collect();
    assert_eq!(Some(numbers[0]), draws["sample_stats"]["lp"][7][0].as_f64());
    assert_eq!(Some(numbers[1]), alpha[7][0].as_f64());
    let none = request(&app, Method::GET, &format!("{address}.csv?chain=9")).await;
    assert_eq!(none.status(), StatusCode::BAD_REQUEST);
    let problem: Value = none.json().await.unwrap();
    assert_eq!(problem["detail"], "chain is 9; allowed: 1 to 8");
    let history = json_of(&app, "/api/v1/studies/driving/fits?history=true&limit=3").await;
    assert_eq!(history["fits"].as_array().unwrap().len(), 3);
    let curves = json_of(&app, "/api/v1/studies/driving/curves?plan=risk").await;
    let weight = &curves["plans"][0]["models"]["risk_aware"]["decision_weight"];
    assert_eq!(
        weight["x"].as_array().map(Vec::len),
        weight["mean"].as_array().map(Vec::len)
    );
    assert_eq!(weight["note"], "γ enters through the normalisation only");
    app.stop().await;
}
