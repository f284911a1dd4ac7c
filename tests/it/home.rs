//! The first page: what participants need first, and researchers' things for those who may.

use reqwest::header::ACCEPT_LANGUAGE;
use riskaware::{
    clock::Clock,
    store::{NewAccount, PasswordHash, Role, StudyState},
    web::Settings,
};

use crate::{
    app::{App, Page, START},
    study::languages::RAIN,
};

async fn serve() -> App {
    let mut files = App::built_in();
    files.push(("rain.toml".to_owned(), RAIN.to_owned()));
    App::configured(Clock::manual(START), files, Settings::default()).await
}

/// The first page as a stranger's browser gets it, which comes from elsewhere.
async fn visits(app: &App, path: &str, language: &str) -> Page {
    let request = app.client.get(format!("{}{path}", app.url));
    let request = request
        .header("x-forwarded-for", "192.0.2.1")
        .header(ACCEPT_LANGUAGE, language);
    Page::of(request.send().await.unwrap()).await
}

async fn makes_account(app: &App) {
    let password = "a long password".parse().unwrap();
    let account = NewAccount {
        name: "anna".parse().unwrap(),
        password: PasswordHash::of(password, [7; 16]).await.unwrap(),
        role: Role::Admin,
        must_change_password: false,
    };
    app.store.make_account(account).await.unwrap();
}

#[tokio::test]
async fn a_visitor_meets_the_open_studies_in_their_language_and_nothing_of_researchers() {
    let app = serve().await;
    let paused = "cups".into();
    let change = app.store.set_study_state(&paused, StudyState::Paused);
    change.await.unwrap();
    let page = visits(&app, "/", "de").await;
    assert_eq!(page.attribute("html", "lang").as_deref(), Some("de"));
    assert_eq!(page.text("h1").as_deref(), Some("Offene Studien"));
    let links = page.attributes(".study-list a", "href");
    assert_eq!(links, ["/s/driving", "/s/rain"]);
    // Each study in the language in which it is met.
    let languages = page.attributes(".study-list li", "lang");
    assert_eq!(languages, ["en", "de"]);
    let texts = page.texts(".study-list li");
    assert!(texts[0].contains("Take part"), "{texts:?}");
    assert!(texts[1].contains("Teilnehmen") && texts[1].contains("Regen"));
    assert!(page.text("main").unwrap().contains("Prolific"));
    let links = page.attributes("a", "href");
    assert!(
        !links
            .iter()
            .any(|link| link.starts_with("/results") || link.starts_with("/studies")),
        "{links:?}"
    );
    let page = visits(&app, "/?lang=de", "en").await;
    assert_eq!(page.attribute("html", "lang").as_deref(), Some("de"));
    let links = page.attributes(".study-list a", "href");
    assert_eq!(links, ["/s/driving?lang=de", "/s/rain?lang=de"]);
    app.stop().await;
}

#[tokio::test]
async fn the_first_page_says_who_may_see_results_and_leads_those_there() {
    let app = serve().await;
    let here = app.get("/").await;
    let links = here.attributes(".for-researchers a", "href");
    for link in ["/studies", "/results/driving", "/results/cups"] {
        assert!(links.iter().any(|known| known == link), "{link}: {links:?}");
    }
    let told = |page: &Page| page.text(".for-researchers").unwrap();
    assert!(told(&here).contains("listens on this machine alone"));
    let visitor = visits(&app, "/", "en").await;
    assert!(told(&visitor).contains("listens on this machine alone"));

    makes_account(&app).await;
    let here = app.get("/").await;
    assert_eq!(here.attributes(".for-researchers a", "href"), ["/login"]);
    assert!(told(&here).contains("Results need an account"));
    let study = "driving".into();
    app.store.set_public(&study, true).await.unwrap();
    let here = app.get("/").await;
    let links = here.attributes(".for-researchers a", "href");
    assert_eq!(links, ["/results/driving", "/login"]);
    app.stop().await;
}
