//! Who is counted as whom, and how often they may try.

use reqwest::{Method, StatusCode, header::HeaderValue};
use riskaware::{clock::Clock, web::Settings};

use super::lab::{Browser, behind_a_proxy, count, execute, token};
use crate::app::{App, START};

#[tokio::test]
async fn looks_at_links_are_limited_by_address_before_they_write() {
    let app = behind_a_proxy().await;
    let here = Browser::new(&app).at("192.0.2.1");
    // A probe is counted and writes nothing.
    for _ in 0..299 {
        let probe = here.asks(Method::HEAD, "/s/driving").send().await.unwrap();
        assert_eq!(probe.status(), StatusCode::METHOD_NOT_ALLOWED);
    }
    assert_eq!(
        here.gets("/s/driving").await.status(),
        StatusCode::SEE_OTHER
    );
    assert_eq!(
        here.gets("/s/driving").await.status(),
        StatusCode::TOO_MANY_REQUESTS
    );
    assert_eq!(count(&app, "select count(*) from arrival").await, 1);
    let there = Browser::new(&app).at("192.0.2.2");
    assert_eq!(
        there.gets("/s/driving").await.status(),
        StatusCode::SEE_OTHER
    );
}

#[tokio::test]
async fn whoever_only_looks_leaves_a_limited_number_of_arrivals_behind() {
    let app = App::start().await;
    execute(
        &app,
        r#"
        with recursive number (n) as (select 1 union all select n + 1 from number where n < 20000)
        insert into arrival (token_hash, study_id, created_at_ms)
        select unhex(printf('%064x', n)), 'driving', n
        from number
        "#,
    )
    .await;
    // A person who is in already, and another study, lose nothing.
    let mut person = app.participant("").await;
    let browser = Browser::new(&app);
    assert_eq!(
        browser.gets("/s/cups").await.status(),
        StatusCode::SEE_OTHER
    );
    let landing = app.get("/s/driving").await;
    assert_eq!(landing.status, 200);
    let unused = "select count(*) from arrival where study_id = 'driving' and run_id is null";
    assert_eq!(count(&app, unused).await, 20_000);
    let oldest = "select min(created_at_ms) from arrival where run_id is null";
    assert_eq!(count(&app, oldest).await, 2);
    assert_eq!(person.reloads().await.status, 200);
}

#[tokio::test]
async fn no_header_makes_somebody_behind_a_proxy_a_visitor_of_this_machine() {
    for odd in [&b"\xff"[..], b"unknown", b"127.0.0.1"] {
        let app = behind_a_proxy().await;
        let path = format!("/s/driving/a/{}", token(1));
        let starts = async || {
            let request = Browser::new(&app).asks(Method::POST, &path);
            let header = HeaderValue::from_bytes(odd).unwrap();
            let request = request.header("x-forwarded-for", header);
            request.send().await.unwrap().status().as_u16()
        };
        for _ in 0..60 {
            assert_eq!(starts().await, 404);
        }
        assert_eq!(starts().await, 429, "{odd:?}");
    }
}

#[tokio::test]
async fn a_plain_proxy_makes_nobody_sit_at_this_machine() {
    // It passes on the name that it knows the server by, and says nothing of whom it speaks for.
    for settings in [
        Settings {
            public_url: Some("https://study.example".parse().unwrap()),
            ..Settings::default()
        },
        Settings {
            trusted_proxies: vec!["10.0.0.1".parse().unwrap()],
            ..Settings::default()
        },
    ] {
        let app = App::configured(Clock::manual(START), App::built_in(), settings).await;
        for path in ["/results/driving", "/api/v1/studies/driving/answers.csv"] {
            assert_eq!(app.get(path).await.status, 403, "{path}");
        }
    }
    assert_eq!(App::start().await.get("/results/driving").await.status, 200);
}
