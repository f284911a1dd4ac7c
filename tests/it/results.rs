//! The results page without scripts.

use reqwest::StatusCode;
use riskaware::{jobs::Catalogue, study};
use scraper::{Html, Selector};

use crate::{app::App, crowd::drives};

fn headings(html: &str) -> Vec<String> {
    let selector = Selector::parse("h2").unwrap();
    Html::parse_document(html)
        .select(&selector)
        .map(|heading| heading.text().collect())
        .collect()
}

fn rows(html: &str, frame: &str) -> Vec<String> {
    let selector = Selector::parse(&format!("{frame} tbody tr")).unwrap();
    let document = Html::parse_document(html);
    document
        .select(&selector)
        .map(|row| row.text().collect::<Vec<_>>().join("|"))
        .collect()
}

#[tokio::test]
async fn the_page_shows_every_count_as_text() {
    let app = App::start().await;
    let files = study::built_in()
        .into_iter()
        .map(|(name, text)| (name.to_owned(), text.to_owned()))
        .collect();
    let catalogue = Catalogue::publish(&app.store, files).await.unwrap();
    let empty = app.get("/results/driving").await;
    assert_eq!(empty.status, StatusCode::OK, "{}", empty.html);

    drives(&app.store, &catalogue, 0..4, 3).await;
    let page = app.get("/results/driving").await;
    assert_eq!(
        headings(&page.html),
        [
            "What did they choose?",
            "How do they see probability?",
            "How do they see value?",
            "What do the answers say about each parameter?",
            "Which model predicts them?",
            "Is there enough evidence yet?",
            "Can I trust these fits?",
            "Where are the data?"
        ]
    );
    assert_eq!(
        page.text("[data-value='people.completed']").as_deref(),
        Some("4")
    );
    assert_eq!(
        page.text("[data-value='answers.counted']").as_deref(),
        Some("40")
    );
    let choices = rows(&page.html, "[data-figure=actions]");
    assert_eq!(
        choices.len(),
        20,
        "two actions in each of ten cells, fitted or not"
    );
    assert!(
        choices
            .iter()
            .filter(|row| row.contains("|Stop|"))
            .all(|row| row.contains("|4|75 %|")),
        "{choices:?}"
    );
    assert_eq!(
        choices
            .iter()
            .filter(|row| row.contains("not fitted"))
            .count(),
        4
    );
    let checks = rows(&page.html, "[data-table=checks]");
    assert!(
        checks.last().unwrap().starts_with("Together|"),
        "{checks:?}"
    );
    assert!(page.html.contains("93 %"));
    assert!(page.html.contains("Draws are not observations"));
    let pooled = rows(&page.html, "[data-table=pooled]");
    assert!(
        pooled
            .iter()
            .any(|row| row.contains("the paper") && row.contains("t(239) = \u{2212}11.50")),
        "{pooled:?}"
    );
    assert!(!page.html.contains("Simulated data"));
    app.stop().await;
}

#[tokio::test]
async fn an_unknown_study_has_no_page_and_no_data() {
    let app = App::start().await;
    for path in [
        "/results/nobody",
        "/results/nobody/data/summary.json",
        "/results/nobody/events",
    ] {
        assert_eq!(app.get(path).await.status, StatusCode::NOT_FOUND, "{path}");
    }
    app.stop().await;
}
