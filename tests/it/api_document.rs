//! The OpenAPI document: it is the committed one, names every path, and describes what is really answered.

use std::{fs, path::Path};

use reqwest::{Method, StatusCode, header};
use riskaware::web;
use scraper::{Html, Selector};
use serde_json::{Value, json};

use crate::{
    api::{catalogue, json_of, request},
    app::App,
    crowd::{Background, drives, until},
};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn document() -> Value {
    serde_json::from_str(&web::document()).unwrap()
}

#[test]
fn the_committed_document_is_the_one_that_the_program_writes() {
    let committed = fs::read_to_string(Path::new(ROOT).join("docs/openapi.json")).unwrap();
    assert!(
        committed == web::document(),
        "docs/openapi.json is out of date; renew it with `cargo run -- openapi > docs/openapi.json`"
    );
}

/// What stands in the document is routed: each path refuses other methods and says which ones it takes.
#[tokio::test]
async fn every_path_of_the_document_is_answered_and_takes_the_methods_that_it_names() {
    let app = App::start().await;
    let document = document();
    let paths = document["paths"].as_object().unwrap();
    assert!(paths.len() > 15, "{}", paths.len());
    for (path, item) in paths {
        let address = path.replace("{study}", "driving").replace("{fit}", "1");
        let response = request(&app, Method::DELETE, &address).await;
        assert_eq!(response.status(), StatusCode::METHOD_NOT_ALLOWED, "{path}");
        let mut allowed: Vec<String> = response.headers()[header::ALLOW]
            .to_str()
            .unwrap()
            .split(',')
            .map(|method| method.trim().to_lowercase())
            .filter(|method| method != "head")
            .collect();
        allowed.sort();
        let mut named: Vec<&String> = item.as_object().unwrap().keys().collect();
        named.sort();
        assert_eq!(
            allowed,
            named.into_iter().cloned().collect::<Vec<_>>(),
            "{path}"
        );
    }
    app.stop().await;
}

/// And what is routed stands in the document: the API's modules add paths only together with their description.
#[test]
fn no_path_of_the_api_is_routed_without_a_description() {
    let mut folders = vec![Path::new(ROOT).join("src/web/api")];
    let mut described = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = fs::read_to_string(&path).unwrap();
            // The same documents for pages are no part of the API.
            let text = text.replace(".route(\"/results/", "");
            for call in [".route(", ".route_service(", ".nest_service("] {
                assert!(
                    !text.contains(call),
                    "{}: {call} adds a path that the document does not know; use .routes(routes!(..))",
                    path.display()
                );
            }
            described += text.matches("#[utoipa::path(").count();
        }
    }
    let document = document();
    let operations = document["paths"].as_object().unwrap().values();
    let operations: usize = operations.map(|item| item.as_object().unwrap().len()).sum();
    assert_eq!(
        operations, described,
        "a handler is described but not routed"
    );
}

#[test]
fn every_operation_tells_what_may_go_wrong_and_what_a_token_needs() {
    let document = document();
    let mut ids = std::collections::HashSet::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let name = format!("{method} {path}");
            assert!(
                ids.insert(operation["operationId"].as_str().unwrap()),
                "{name}"
            );
            assert!(
                operation["summary"]
                    .as_str()
                    .is_some_and(|text| !text.is_empty()),
                "{name}"
            );
            if operation["tags"][0] == "description" {
                continue;
            }
            for status in ["400", "401", "403", "429", "500", "503"] {
                assert!(
                    operation["responses"][status].is_object(),
                    "{name} {status}"
                );
            }
            let is_data = ["/answers", "/export", "/participants"]
                .iter()
                .any(|part| path.contains(part));
            let scope = if is_data { "data" } else { "results" };
            assert_eq!(
                operation["security"],
                json!([{}, { "token": [scope] }]),
                "{name}"
            );
        }
    }
    let text = document.to_string();
    assert!(
        !text.contains("[`") && !text.contains("crate::"),
        "a link of the program's own documentation"
    );
}

/// Every property that is answered is described, and every answer has all that the document requires.
#[tokio::test(flavor = "multi_thread")]
async fn answers_hold_what_the_document_says_and_nothing_else() {
    let app = App::start().await;
    let catalogue = std::sync::Arc::new(catalogue(&app).await);
    drives(&app.store, &catalogue, 0..4, 3).await;
    let _background = Background::start(&app.store, &catalogue);
    until(&app.store, async || {
        let fits = json_of(&app, "/api/v1/studies/driving/fits").await;
        let is_fitted = |fit: &Value| fit["state"] == "converged" && fit["is_behind"] == false;
        fits["fits"].as_array().unwrap().iter().all(is_fitted)
    })
    .await;
    let fit = json_of(&app, "/api/v1/studies/driving/fits").await["fits"][0]["id"].clone();
    let document = document();
    for (path, item) in document["paths"].as_object().unwrap() {
        let content = &item["get"]["responses"]["200"]["content"]["application/json"];
        let is_slow = path.ends_with("sweep");
        if content.is_null() || is_slow {
            continue;
        }
        let address = path
            .replace("{study}", "driving")
            .replace("{fit}", &fit.to_string());
        let answer = json_of(&app, &address).await;
        check(&document, &content["schema"], &answer, path);
    }
    let history = json_of(&app, "/api/v1/studies/driving/fits?history=true&limit=2").await;
    let schema = json!({ "$ref": "#/components/schemas/FitHistory" });
    check(&document, &schema, &history, "history");
    app.stop().await;
}

#[track_caller]
fn check(document: &Value, schema: &Value, answer: &Value, at: &str) {
    let faults = faults(document, schema, answer, at);
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Where an answer and its schema differ.
fn faults(document: &Value, schema: &Value, answer: &Value, at: &str) -> Vec<String> {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    if let Some(path) = schema["$ref"].as_str() {
        let schema = document
            .pointer(&path[1..])
            .unwrap_or_else(|| panic!("{path} is missing"));
        return faults(document, schema, answer, at);
    }
    let choices = [list(&schema["oneOf"]), list(&schema["anyOf"])].concat();
    if !choices.is_empty() {
        let all: Vec<Vec<String>> = choices
            .iter()
            .map(|choice| faults(document, choice, answer, at))
            .collect();
        return all.into_iter().min_by_key(Vec::len).unwrap();
    }
    let kind = match answer {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(number) if number.is_f64() => "number",
        Value::Number(_) => "integer",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    let allowed = match &schema["type"] {
        Value::Array(kinds) => kinds.clone(),
        Value::Null => Vec::new(),
        kind => vec![kind.clone()],
    };
    let fits = |allowed: &Value| allowed == kind || (allowed == "number" && kind == "integer");
    if !allowed.is_empty() && !allowed.iter().any(fits) {
        return vec![format!(
            "{at}: {kind} where the document says {}",
            schema["type"]
        )];
    }
    if schema["enum"].is_array() && !list(&schema["enum"]).contains(answer) {
        return vec![format!("{at}: {answer} is not one of {}", schema["enum"])];
    }
    match answer {
        Value::Array(items) if schema["items"].is_object() => items
            .iter()
            .flat_map(|item| faults(document, &schema["items"], item, at))
            .collect(),
        Value::Object(object) if is_described(schema) => {
            let mut found = Vec::new();
            let (properties, required) = properties(document, schema);
            for name in required.iter().filter(|name| !object.contains_key(*name)) {
                found.push(format!("{at}: {name} is missing"));
            }
            for (name, value) in object {
                let place = format!("{at}.{name}");
                let property = properties.iter().find(|(known, _)| known == name);
                match (property, &schema["additionalProperties"]) {
                    (Some((_, schema)), _) | (None, schema @ Value::Object(_)) => {
                        found.extend(faults(document, schema, value, &place));
                    }
                    (None, _) => found.push(format!("{place} is not described")),
                }
            }
            found
        }
        _ => Vec::new(),
    }
}

fn is_described(schema: &Value) -> bool {
    ["properties", "allOf", "additionalProperties"]
        .iter()
        .any(|part| !schema[*part].is_null())
}

/// The properties of an object and the names that it must have, those of its parts included.
fn properties(document: &Value, schema: &Value) -> (Vec<(String, Value)>, Vec<String>) {
    let mut found: Vec<(String, Value)> = Vec::new();
    let mut required = Vec::new();
    if let Some(path) = schema["$ref"].as_str() {
        return properties(document, document.pointer(&path[1..]).unwrap());
    }
    for part in schema["allOf"].as_array().into_iter().flatten() {
        let (more, names) = properties(document, part);
        found.extend(more);
        required.extend(names);
    }
    let own = schema["properties"].as_object().into_iter().flatten();
    found.extend(own.map(|(name, schema)| (name.clone(), schema.clone())));
    let names = schema["required"].as_array().into_iter().flatten();
    required.extend(names.map(|name| name.as_str().unwrap().to_owned()));
    (found, required)
}

#[tokio::test]
async fn the_page_shows_every_path_and_needs_nothing_from_elsewhere() {
    let app = App::start().await;
    let response = request(&app, Method::GET, "/api/v1/docs").await;
    assert_eq!(
        response.headers()[header::CONTENT_TYPE],
        "text/html; charset=utf-8"
    );
    let page = Html::parse_document(&response.text().await.unwrap());
    let all = |selector: &str| {
        let selector = Selector::parse(selector).unwrap();
        page.select(&selector)
            .map(|element| element.text().collect::<String>())
            .collect::<Vec<_>>()
    };
    let headings = all("article h3");
    let document = document();
    for (path, item) in document["paths"].as_object().unwrap() {
        for method in item.as_object().unwrap().keys() {
            let heading = format!("{} {path}", method.to_uppercase());
            assert!(headings.contains(&heading), "{heading} is missing");
        }
    }
    for name in document["components"]["schemas"]
        .as_object()
        .unwrap()
        .keys()
    {
        assert!(headings.contains(name), "{name} is missing");
    }
    let ids = Selector::parse("[id]").unwrap();
    let ids: Vec<&str> = page
        .select(&ids)
        .filter_map(|element| element.attr("id"))
        .collect();
    let links = Selector::parse("a[href], link[href]").unwrap();
    for link in page
        .select(&links)
        .filter_map(|element| element.attr("href"))
    {
        match link.strip_prefix('#') {
            Some(id) => assert!(ids.contains(&id), "{link} leads nowhere"),
            None => assert!(link.starts_with('/'), "{link} leads elsewhere"),
        }
    }
    let scripts = Selector::parse("script, style, [style]").unwrap();
    assert!(page.select(&scripts).next().is_none());
    app.stop().await;
}
