//! `/api/v1` as HTTP: conditional requests, HEAD, links between pages, and errors that can be looked up in the log.

use reqwest::{Method, RequestBuilder, Response, StatusCode, header};
use serde_json::Value;

use crate::{
    api::{catalogue, request},
    app::App,
    crowd::drives,
};

const TAGGED: [&str; 9] = [
    "studies",
    "studies/driving",
    "studies/driving/summary",
    "studies/driving/curves",
    "studies/driving/curves?plan=risk&part=low",
    "studies/driving/accuracy",
    "studies/driving/comparison",
    "studies/driving/sequential",
    "studies/driving/fits",
];

fn get(app: &App, path: &str) -> RequestBuilder {
    app.client.get(format!("{}/api/v1/{path}", app.url))
}

fn tag(response: &Response) -> String {
    let tag = response.headers().get(header::ETAG);
    tag.unwrap_or_else(|| panic!("{} has no tag", response.url()))
        .to_str()
        .unwrap()
        .to_owned()
}

#[tokio::test]
async fn what_has_not_changed_is_not_sent_again() {
    let app = App::start().await;
    let catalogue = catalogue(&app).await;
    let mut tags = Vec::new();
    for path in TAGGED {
        let first = get(&app, path).send().await.unwrap();
        assert_eq!(first.status(), StatusCode::OK, "{path}");
        assert_eq!(first.headers()[header::CACHE_CONTROL], "private, no-cache");
        let tag = tag(&first);
        assert!(
            tag.starts_with('"') && tag.ends_with('"'),
            "{tag} is not strong"
        );
        for known in [tag.clone(), format!("\"other\", W/{tag}"), "*".to_owned()] {
            let again = get(&app, path)
                .header(header::IF_NONE_MATCH, &known)
                .send()
                .await
                .unwrap();
            assert_eq!(again.status(), StatusCode::NOT_MODIFIED, "{path} {known}");
            assert_eq!(self::tag(&again), tag, "{path}");
            assert!(again.bytes().await.unwrap().is_empty());
        }
        assert!(
            !tags.contains(&tag),
            "{path} has the tag of another address"
        );
        tags.push(tag);
    }
    drives(&app.store, &catalogue, 0..1, 1).await;
    for (path, old) in TAGGED.iter().zip(&tags).skip(2) {
        let after = get(&app, path)
            .header(header::IF_NONE_MATCH, old)
            .send()
            .await
            .unwrap();
        assert_eq!(after.status(), StatusCode::OK, "{path}");
        assert_ne!(tag(&after), *old, "{path}");
    }
    for path in [
        "studies/driving/curves?plan=nothing",
        "studies/nobody/summary",
    ] {
        let wrong = get(&app, path)
            .header(header::IF_NONE_MATCH, "*")
            .send()
            .await
            .unwrap();
        assert!(wrong.status().is_client_error(), "{path}");
    }
    app.stop().await;
}

#[tokio::test]
async fn a_compressed_answer_has_a_weak_tag_that_is_known_all_the_same() {
    let app = App::start().await;
    let path = "studies/driving/summary";
    let plain = get(&app, path).send().await.unwrap();
    let packed = get(&app, path)
        .header(header::ACCEPT_ENCODING, "gzip")
        .send()
        .await
        .unwrap();
    assert_eq!(packed.headers()[header::CONTENT_ENCODING], "gzip");
    assert_eq!(tag(&packed), format!("W/{}", tag(&plain)));
    let again = get(&app, path)
        .header(header::ACCEPT_ENCODING, "gzip")
        .header(header::IF_NONE_MATCH, tag(&packed));
    assert_eq!(
        again.send().await.unwrap().status(),
        StatusCode::NOT_MODIFIED
    );
    app.stop().await;
}

#[tokio::test]
async fn heads_come_without_bodies() {
    let app = App::start().await;
    let others = [
        "studies/driving/answers",
        "studies/driving/answers.csv",
        "studies/driving/events",
        "openapi.json",
        "docs",
    ];
    for path in TAGGED.into_iter().chain(others) {
        let head = request(&app, Method::HEAD, &format!("/api/v1/{path}")).await;
        assert_eq!(head.status(), StatusCode::OK, "{path}");
        let whole = get(&app, path).send().await.unwrap();
        assert_eq!(
            head.headers()[header::CONTENT_TYPE],
            whole.headers()[header::CONTENT_TYPE],
            "{path}"
        );
        assert!(head.bytes().await.unwrap().is_empty(), "{path}");
    }
    app.stop().await;
}

#[tokio::test]
async fn pages_link_to_the_first_and_the_next() {
    let app = App::start().await;
    let catalogue = catalogue(&app).await;
    drives(&app.store, &catalogue, 0..1, 1).await;
    let page = get(&app, "studies/driving/answers?limit=4")
        .send()
        .await
        .unwrap();
    let link = page.headers()[header::LINK].to_str().unwrap().to_owned();
    let answers: Value = page.json().await.unwrap();
    let next = answers["next"].as_str().unwrap();
    let first = "/api/v1/studies/driving/answers?limit=4";
    assert_eq!(
        link,
        format!("<{first}>; rel=\"first\", <{first}&after={next}>; rel=\"next\"")
    );
    let last = get(&app, "studies/driving/answers?limit=1000")
        .send()
        .await
        .unwrap();
    let link = last.headers()[header::LINK].to_str().unwrap();
    assert!(
        link.contains("rel=\"first\"") && !link.contains("rel=\"next\""),
        "{link}"
    );
    assert_eq!(last.json::<Value>().await.unwrap()["next"], Value::Null);

    let fits = get(&app, "studies/driving/fits?history=true&limit=2")
        .send()
        .await
        .unwrap();
    assert_eq!(
        fits.headers()[header::LINK],
        "</api/v1/studies/driving/fits?history=true&limit=2>; rel=\"first\""
    );
    for wrong in [
        "fits?history=true&after=17",
        "fits?after=MTc",
        "fits?history=true&before=17",
    ] {
        let refused = get(&app, &format!("studies/driving/{wrong}"))
            .send()
            .await
            .unwrap();
        assert_eq!(refused.status(), StatusCode::BAD_REQUEST, "{wrong}");
    }
    app.stop().await;
}

#[tokio::test]
async fn every_error_carries_the_id_of_the_request() {
    let app = App::start().await;
    let post = |origin: &str| {
        app.client
            .post(format!("{}/api/v1/studies/driving/predict", app.url))
            .header("sec-fetch-site", origin)
            .body("{}")
    };
    for (asked, status) in [
        (get(&app, "nothing"), StatusCode::NOT_FOUND),
        (
            get(&app, "studies/driving/answers?limit=0"),
            StatusCode::BAD_REQUEST,
        ),
        (
            get(&app, "openapi.json?colour=red"),
            StatusCode::BAD_REQUEST,
        ),
        (
            get(&app, "studies/driving/predict"),
            StatusCode::METHOD_NOT_ALLOWED,
        ),
        (
            app.client.put(format!("{}/api/v1/docs", app.url)),
            StatusCode::METHOD_NOT_ALLOWED,
        ),
        (post("same-origin"), StatusCode::UNSUPPORTED_MEDIA_TYPE),
        // Said by a layer that writes pages.
        (post("cross-site"), StatusCode::FORBIDDEN),
    ] {
        let response = asked.send().await.unwrap();
        let url = response.url().to_string();
        assert_eq!(response.status(), status, "{url}");
        assert_eq!(
            response.headers()[header::CONTENT_TYPE],
            "application/problem+json",
            "{url}"
        );
        let id = response.headers()["x-request-id"]
            .to_str()
            .unwrap()
            .to_owned();
        let allow = response.headers().get(header::ALLOW).cloned();
        assert_eq!(
            allow.is_some(),
            status == StatusCode::METHOD_NOT_ALLOWED,
            "{url}"
        );
        let problem: Value = response.json().await.unwrap();
        assert_eq!(problem["request_id"], id, "{url}");
        assert_eq!(problem["status"], status.as_u16(), "{url}");
        let detail = problem["detail"].as_str().unwrap();
        assert!(
            !detail.is_empty() && !detail.contains('<'),
            "{url}: {detail}"
        );
    }
    // Other addresses answer people.
    let page = app
        .client
        .get(format!("{}/nothing", app.url))
        .send()
        .await
        .unwrap();
    assert_eq!(
        page.headers()[header::CONTENT_TYPE],
        "text/html; charset=utf-8"
    );
    app.stop().await;
}
