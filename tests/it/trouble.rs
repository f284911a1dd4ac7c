//! What participants are told when something does not work: in their language, with the page's `lang` saying so.

use reqwest::{
    Client, Method, StatusCode,
    header::{ACCEPT_LANGUAGE, RETRY_AFTER},
};
use riskaware::clock::Clock;

use crate::{
    app::{App, Page, Participant, START},
    study::languages::RAIN,
};

const DAY_MS: i64 = 24 * 60 * 60 * 1000;

async fn rain() -> App {
    let mut files = App::built_in();
    files.push(("rain.toml".to_owned(), RAIN.to_owned()));
    App::with(Clock::manual(START), files).await
}

/// Asks as a browser that likes a language.
async fn ask(app: &App, method: Method, path: &str, accept: &str) -> Page {
    let request = app.client.request(method, format!("{}{path}", app.url));
    let request = request.header(ACCEPT_LANGUAGE, accept);
    Page::of(request.send().await.unwrap()).await
}

#[track_caller]
fn tells(page: &Page, status: StatusCode, language: &str, title: &str) {
    assert_eq!(page.status, status, "{}", page.html);
    let shown = page.attribute("html", "lang");
    assert_eq!(shown.as_deref(), Some(language), "{}", page.html);
    assert_eq!(page.text("h1").as_deref(), Some(title));
    assert_eq!(page.text("title").as_deref(), Some(title));
}

/// Somebody who takes the study in German with a browser that likes English.
async fn german_run(app: &App) -> Participant {
    app.participant_of("/s/rain?lang=de").await
}

#[tokio::test]
async fn addresses_where_nothing_is_answer_in_the_browsers_language() {
    let app = rain().await;
    let (get, missing) = (Method::GET, StatusCode::NOT_FOUND);
    for (path, english, german) in [
        (
            "/s/nothing",
            "This study is not here",
            "Diese Studie gibt es hier nicht",
        ),
        (
            "/nothing",
            "Nothing is at this address",
            "Unter dieser Adresse ist nichts",
        ),
        (
            "/r/nothing",
            "This link opens nothing",
            "Dieser Link führt zu nichts",
        ),
        (
            "/r/nothing/withdraw",
            "This link opens nothing",
            "Dieser Link führt zu nichts",
        ),
        (
            "/s/rain/a/nothing",
            "This link opens nothing",
            "Dieser Link führt zu nichts",
        ),
    ] {
        let page = ask(&app, get.clone(), path, "de-AT, en;q=0.5").await;
        tells(&page, missing, "de", german);
        let page = ask(&app, get.clone(), path, "fr").await;
        tells(&page, missing, "en", english);
        let page = ask(&app, get.clone(), &format!("{path}?lang=de"), "en").await;
        tells(&page, missing, "de", german);
    }
    // Researchers' pages speak English.
    let page = ask(&app, get, "/results/nothing", "de").await;
    tells(&page, missing, "en", "Not Found");
    app.stop().await;
}

#[tokio::test]
async fn a_link_that_expired_says_so_in_the_studys_language() {
    let app = rain().await;
    let landing = app.get("/s/rain").await;
    let link = landing.attribute("form", "action").unwrap();
    app.clock.advance(DAY_MS + 1);
    let title = "Dieser Link gilt nicht mehr";
    for method in [Method::GET, Method::POST] {
        let page = ask(&app, method, &link, "de").await;
        tells(&page, StatusCode::NOT_FOUND, "de", title);
    }
    app.stop().await;
}

#[tokio::test]
async fn the_errors_of_a_run_are_in_its_language() {
    let app = rain().await;
    let person = german_run(&app).await;
    let post = |body: String| {
        let request = app.client.post(&person.link).header(ACCEPT_LANGUAGE, "en");
        let form = "application/x-www-form-urlencoded";
        request.header("content-type", form).body(body)
    };
    let page = Page::of(post("step=one".to_owned()).send().await.unwrap()).await;
    tells(
        &page,
        StatusCode::BAD_REQUEST,
        "de",
        "Ihre Antwort war nicht lesbar",
    );
    let long = format!("step={}", "x".repeat(9_000_000));
    let page = Page::of(post(long).send().await.unwrap()).await;
    tells(
        &page,
        StatusCode::PAYLOAD_TOO_LARGE,
        "de",
        "Ihre Antwort ist zu lang",
    );
    app.stop().await;
}

#[tokio::test]
async fn what_is_refused_before_a_run_is_known_follows_the_browser() {
    let app = rain().await;
    let person = german_run(&app).await;
    let path = person.link.strip_prefix(&app.url).unwrap();
    let page = ask(&app, Method::PUT, path, "de").await;
    let title = "Diese Adresse ist keine eigene Seite";
    tells(&page, StatusCode::METHOD_NOT_ALLOWED, "de", title);

    let foreign = Client::new()
        .post(&person.link)
        .header(ACCEPT_LANGUAGE, "de")
        .header("sec-fetch-site", "cross-site");
    let page = Page::of(foreign.send().await.unwrap()).await;
    let title = "Das kam von einer Seite woanders";
    tells(&page, StatusCode::FORBIDDEN, "de", title);

    let ahead = Client::new()
        .get(&person.link)
        .header(ACCEPT_LANGUAGE, "de")
        .header("sec-purpose", "prefetch");
    let response = ahead.send().await.unwrap();
    assert_eq!(response.headers()[RETRY_AFTER], "1");
    let page = Page::of(response).await;
    let title = "Der Server ist ausgelastet";
    tells(&page, StatusCode::SERVICE_UNAVAILABLE, "de", title);
    app.stop().await;
}

#[tokio::test]
async fn links_that_cannot_be_used_say_why_in_a_language_of_the_study() {
    let app = rain().await;
    let refused = StatusCode::BAD_REQUEST;
    for (query, why) in [
        ("PROLIFIC_PID={{%25PROLIFIC_PID%25}}", "einen Platzhalter"),
        ("PROLIFIC_PID=a&pid=b", "für prolific und für pid"),
        ("turkSubmitTo=https://evil.example", "https://evil.example"),
    ] {
        let path = format!("/s/rain?{query}");
        let page = ask(&app, Method::GET, &path, "de").await;
        tells(
            &page,
            refused,
            "de",
            "Dieser Link lässt sich nicht verwenden",
        );
        assert!(page.text("main").unwrap().contains(why), "{}", page.html);
    }
    // A study in one language says everything in it.
    let path = "/s/driving?PROLIFIC_PID=a&pid=b";
    let page = ask(&app, Method::GET, path, "de").await;
    tells(&page, refused, "en", "This link cannot be used");
    app.stop().await;
}
