//! A study in two languages over HTTP, without scripts.

use reqwest::{
    Client, StatusCode,
    header::{ACCEPT_LANGUAGE, HeaderMap, HeaderValue},
};
use riskaware::{clock::Clock, store::StudyState};

use crate::{
    app::{App, Page, Participant, START},
    study::languages::RAIN,
};

async fn rain() -> App {
    let files = vec![("rain.toml".to_owned(), RAIN.to_owned())];
    App::with(Clock::manual(START), files).await
}

/// A browser that asks for these languages.
fn browser(accept: &'static str) -> Client {
    let mut headers = HeaderMap::new();
    headers.insert(ACCEPT_LANGUAGE, HeaderValue::from_static(accept));
    Client::builder().default_headers(headers).build().unwrap()
}

async fn get(client: &Client, url: &str) -> Page {
    Page::of(client.get(url).send().await.unwrap()).await
}

/// Follows a link and presses the button.
async fn start(app: &App, client: Client, link: &str) -> Participant {
    let landing = get(&client, &format!("{}{link}", app.url)).await;
    press(app, client, &landing).await
}

async fn press(app: &App, client: Client, landing: &Page) -> Participant {
    let action = landing.attribute("form", "action").expect("a button");
    let response = client
        .post(format!("{}{action}", app.url))
        .send()
        .await
        .unwrap();
    Participant {
        client,
        link: response.url().to_string(),
        page: Page::of(response).await,
    }
}

/// Sends the form of the page with these fields.
async fn send(person: &mut Participant, fields: &[(&str, &str)]) -> StatusCode {
    let (step, key) = (person.page.field("step"), person.page.field("key"));
    let own = [("step", step.as_str()), ("key", key.as_str())];
    let response = person
        .client
        .post(&person.link)
        .form(&[&own, fields].concat())
        .send()
        .await
        .unwrap();
    person.page = Page::of(response).await;
    person.page.status
}

#[track_caller]
fn says(page: &Page, language: &str, texts: &[&str]) {
    assert_eq!(page.attribute("html", "lang").as_deref(), Some(language));
    // What a person reads, without the signs of HTML.
    let seen = page.text("html").unwrap();
    for text in texts {
        assert!(seen.contains(text), "{text:?} is not in {}", page.html);
    }
}

/// What a whole run says in one language.
struct Words {
    language: &'static str,
    landing: [&'static str; 3],
    consent: [&'static str; 5],
    unticked: [&'static str; 2],
    form: [&'static str; 3],
    faults: [&'static str; 4],
    hint: &'static str,
    clock: [&'static str; 2],
    question: [&'static str; 4],
    left: &'static str,
    end: [&'static str; 5],
    withdrawal: [&'static str; 2],
    gone: &'static str,
}

const ENGLISH: Words = Words {
    language: "en",
    landing: ["Rain", "about 2 min.", "Start"],
    consent: [
        "Do you agree?",
        "withdraw from Rain",
        "I am an adult.",
        "(needed to take part)",
        "Stop and withdraw",
    ],
    unticked: ["Please look at this again", "Nobody can take part without"],
    form: [
        "Do you have an umbrella?",
        "A guess is enough.",
        "1 not at all",
    ],
    faults: [
        "This question needs an answer.",
        "Enter a number from 0.1 to 2.5",
        "Enter a whole number from 0 to 100.",
        "Error: You",
    ],
    hint: "At least one of your answers is not right.",
    clock: ["You have 20 seconds.", "Start the clock"],
    question: ["Question 1 of 2", "The sky is grey.", "Take it", "umbrella"],
    left: "{seconds} seconds left",
    end: [
        "Thank you",
        "That was all.",
        "Your completion code",
        "You can still withdraw. Keep this link for it:",
        "All 6 pages that you answered are stored.",
    ],
    withdrawal: ["Stop and withdraw?", "Go back to the study"],
    gone: "Your answers are erased",
};

const GERMAN: Words = Words {
    language: "de",
    landing: ["Regen", "etwa 2 Min.", "Beginnen"],
    consent: [
        "Sind Sie einverstanden?",
        "aus Regen zurückziehen",
        "Ich bin volljährig.",
        "(für die Teilnahme nötig)",
        "Abbrechen und zurückziehen",
    ],
    unticked: [
        "Bitte sehen Sie sich das noch einmal an",
        "Ohne diese Zustimmung",
    ],
    form: [
        "Haben Sie einen Schirm?",
        "Geschätzt reicht.",
        "1 gar nicht",
    ],
    faults: [
        "Diese Frage braucht eine Antwort.",
        "eine Zahl von 0,1 bis 2,5 ein, mit höchstens 2 Stellen nach dem Komma",
        "eine ganze Zahl von 0 bis 100",
        "Fehler: Sie",
    ],
    hint: "Mindestens eine Ihrer Antworten stimmt nicht.",
    clock: ["Sie haben 20 Sekunden.", "Uhr starten"],
    question: [
        "Frage 1 von 2",
        "Der Himmel ist grau.",
        "Mitnehmen",
        "Regenschirm",
    ],
    left: "Noch {seconds} Sekunden",
    end: [
        "Danke",
        "Das war alles.",
        "Ihr Abschlusscode",
        "Sie können Ihre Teilnahme weiterhin zurückziehen.",
        "Alle 6 Seiten, die Sie beantwortet haben, sind gespeichert.",
    ],
    withdrawal: ["Abbrechen und zurückziehen?", "Zurück zur Studie"],
    gone: "Ihre Antworten sind gelöscht",
};

async fn takes_part(words: &Words) {
    let app = rain().await;
    let client = browser(words.language);
    let landing = get(&client, &format!("{}/s/rain", app.url)).await;
    says(&landing, words.language, &words.landing);
    let mut person = press(&app, client, &landing).await;
    says(&person.page, words.language, &words.consent);
    let status = send(&mut person, &[("consent", "agree")]).await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY);
    says(&person.page, words.language, &words.unticked);
    send(&mut person, &[("consent", "agree"), ("clause", "adult")]).await;
    send(&mut person, &[("continue", "1")]).await;
    says(&person.page, words.language, &words.form);
    let nonsense = [("weight", "heavy"), ("cost", "much")];
    let status = send(&mut person, &nonsense).await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY);
    says(&person.page, words.language, &words.faults);
    let answers = |cost| [("owns", "yes"), ("weight", "0,4"), ("cost", cost)];
    send(&mut person, &answers("3")).await;
    says(&person.page, words.language, &[words.hint]);
    send(&mut person, &answers("10")).await;
    says(&person.page, words.language, &words.clock);
    send(&mut person, &[("continue", "1")]).await;
    says(&person.page, words.language, &words.question);
    let left = person.page.attribute(".countdown", "data-seconds-left");
    assert_eq!(left.as_deref(), Some(words.left));
    person.finishes("take").await;
    says(&person.page, words.language, &words.end);
    let withdraw = format!("{}/withdraw", person.link);
    let asked = get(&person.client, &withdraw).await;
    says(&asked, words.language, &words.withdrawal);
    let gone = person.client.post(&withdraw).form(&[("withdraw", "1")]);
    let gone = Page::of(gone.send().await.unwrap()).await;
    says(&gone, words.language, &[words.gone]);
}

#[tokio::test]
async fn a_whole_run_in_english() {
    takes_part(&ENGLISH).await;
}

#[tokio::test]
async fn a_whole_run_in_german() {
    takes_part(&GERMAN).await;
}

#[tokio::test]
async fn the_link_comes_before_the_browser_and_the_first_language_after_it() {
    let app = rain().await;
    for (accept, link, language) in [
        ("de-AT, en;q=0.5", "/s/rain", "de"),
        ("fr, en;q=0.1, de;q=0.5", "/s/rain", "de"),
        ("fr", "/s/rain", "en"),
        ("en", "/s/rain?lang=de", "de"),
        ("de", "/s/rain?lang=en", "en"),
        ("de", "/s/rain?lang=tlh", "de"),
    ] {
        let landing = get(&browser(accept), &format!("{}{link}", app.url)).await;
        says(&landing, language, &[]);
    }
}

#[tokio::test]
async fn the_landing_page_leads_to_the_other_language_and_the_run_keeps_it() {
    let app = rain().await;
    let english = browser("en");
    let landing = get(&english, &format!("{}/s/rain", app.url)).await;
    assert_eq!(landing.texts(".languages a"), ["Deutsch"]);
    let link = landing.attribute(".languages a", "href").unwrap();
    let landing = get(&english, &format!("{}{link}", app.url)).await;
    says(&landing, "de", &["Regen"]);
    assert_eq!(landing.texts(".languages a"), ["English"]);
    let person = press(&app, english, &landing).await;
    says(&person.page, "de", &["Sind Sie einverstanden?"]);
    // Another browser resumes the same run.
    let resumed = get(&browser("en"), &person.link).await;
    says(&resumed, "de", &["Sind Sie einverstanden?"]);
    let run = app.store.run(&person.token()).await.unwrap();
    assert_eq!(run.language.as_deref(), Some("de"));
}

#[tokio::test]
async fn whoever_comes_back_from_the_platform_goes_on_in_the_language_of_their_run() {
    let app = rain().await;
    let link = "/s/rain?PROLIFIC_PID=someone";
    let first = start(&app, browser("de"), link).await;
    says(&first.page, "de", &[]);
    let again = start(&app, browser("en"), link).await;
    says(&again.page, "de", &["Sind Sie einverstanden?"]);
}

#[tokio::test]
async fn who_is_screened_out_or_too_late_is_told_so_in_their_language() {
    let app = rain().await;
    let mut person = start(&app, browser("de"), "/s/rain").await;
    send(&mut person, &[("consent", "agree"), ("clause", "adult")]).await;
    send(&mut person, &[("continue", "1")]).await;
    send(&mut person, &[("owns", "no"), ("cost", "10")]).await;
    says(&person.page, "de", &["Diese Studie richtet sich an andere"]);

    let german = browser("de");
    let landing = get(&german, &format!("{}/s/rain", app.url)).await;
    let study = "rain".into();
    app.store
        .set_study_state(&study, StudyState::Closed)
        .await
        .unwrap();
    let late = press(&app, german.clone(), &landing).await;
    assert_eq!(late.page.status, StatusCode::GONE);
    says(
        &late.page,
        "de",
        &["Sie können diese Studie jetzt nicht beginnen", "beendet"],
    );
    let later = get(&german, &format!("{}/s/rain", app.url)).await;
    assert_eq!(later.status, StatusCode::GONE);
    says(&later, "de", &["beendet"]);
    let unknown = get(&german, &format!("{}/r/{}", app.url, "A".repeat(43))).await;
    assert_eq!(unknown.status, StatusCode::NOT_FOUND);
    says(&unknown, "de", &["Dieser Link führt zu nichts"]);
}

#[tokio::test]
async fn a_study_in_one_language_stores_none_and_offers_none() {
    let app = App::start().await;
    let landing = get(&browser("de"), &format!("{}/s/driving?lang=de", app.url)).await;
    says(&landing, "en", &["Start"]);
    assert_eq!(landing.texts(".languages a"), [""; 0]);
    let person = press(&app, browser("de"), &landing).await;
    let run = app.store.run(&person.token()).await.unwrap();
    assert_eq!(run.language, None);
}
