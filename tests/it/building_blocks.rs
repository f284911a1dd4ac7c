//! Building blocks beyond the built-in studies', over HTTP and without scripts: clauses, screening, comprehension checks,
//! scales, several options, more actions and outcomes than two, endings with codes, and the bonus.

use std::sync::Arc;

use reqwest::StatusCode;
use riskaware::{
    clock::Clock,
    jobs::{Catalogue, PartState, Snapshot},
    store::{AnalysisSet, BonusRow, Population, RunId, RunState},
};

use crate::{
    app::{App, Page, Participant, START},
    crowd::{Background, until},
};

const STUDY: &str = include_str!("../data/blocks.toml");

async fn app() -> App {
    let studies = vec![("blocks.toml".to_owned(), STUDY.to_owned())];
    App::with(Clock::manual(START), studies).await
}

/// Sends the form of the page with more than one field.
async fn fills(person: &mut Participant, fields: &[(&str, &str)]) -> Page {
    let mut form = vec![
        ("step", person.page.field("step")),
        ("key", person.page.field("key")),
    ];
    form.extend(
        fields
            .iter()
            .map(|(name, value)| (*name, (*value).to_owned())),
    );
    let response = person
        .client
        .post(&person.link)
        .form(&form)
        .send()
        .await
        .unwrap();
    person.page = Page::of(response).await;
    person.page.clone()
}

async fn at_check(app: &App) -> Participant {
    let mut person = app.participant_of("/s/blocks").await;
    fills(&mut person, &[("consent", "agree"), ("clause", "adult")]).await;
    fills(&mut person, &[("drives", "yes")]).await;
    assert_eq!(person.page.text("h1").as_deref(), Some("Check"));
    person
}

const RIGHT: [(&str, &str); 3] = [("light", "red"), ("cars", "z"), ("cars", "x")];
const WRONG: [(&str, &str); 2] = [("light", "red"), ("cars", "y")];

async fn completes(app: &App, action: &str) -> Participant {
    let mut person = at_check(app).await;
    fills(&mut person, &RIGHT).await;
    fills(&mut person, &[("action", action)]).await;
    let last = [
        ("height", "1,75"),
        ("dares", "5"),
        ("fears", "2"),
        ("words", "one\ntwo"),
    ];
    fills(&mut person, &last).await;
    assert_eq!(
        person.page.text("h1").as_deref(),
        Some("Done"),
        "{}",
        person.page.html
    );
    person
}

async fn state(app: &App, person: &Participant) -> RunState {
    app.store.run(&person.token()).await.unwrap().state
}

/// The bonuses of the first runs.
async fn bonuses(app: &App) -> Vec<BonusRow> {
    let mut found = Vec::new();
    for run in 1..=4 {
        found.extend(app.store.bonus(RunId::from(run)).await.unwrap());
    }
    found
}

async fn nothing_disagrees(app: App) {
    assert_eq!(app.store.check_answers().await.unwrap(), []);
    assert_eq!(app.store.check_counters().await.unwrap(), []);
    app.stop().await;
}

#[tokio::test]
async fn agreement_without_a_required_clause_is_sent_back_with_the_ticks_kept() {
    let app = app().await;
    let mut person = app.participant_of("/s/blocks").await;
    let page = fills(&mut person, &[("consent", "agree"), ("clause", "archive")]).await;
    assert_eq!(page.status, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(
        page.text(".error-summary")
            .unwrap()
            .contains("I am an adult.")
    );
    assert!(page.attribute("input[value=archive]", "checked").is_some());
    assert!(page.attribute("input[value=adult]", "checked").is_none());
    let page = fills(&mut person, &[("consent", "agree"), ("clause", "adult")]).await;
    assert_eq!(page.text("h1").as_deref(), Some("You"));
    nothing_disagrees(app).await;
}

#[tokio::test]
async fn an_answer_that_screens_out_ends_the_run_with_its_own_code() {
    let app = app().await;
    let mut person = app.participant_of("/s/blocks?PROLIFIC_PID=p1").await;
    fills(&mut person, &[("consent", "agree"), ("clause", "adult")]).await;
    let page = fills(&mut person, &[("drives", "no")]).await;
    assert_eq!(page.text("h1").as_deref(), Some("Not you"));
    assert_eq!(page.text(".completion__code").as_deref(), Some("OUT1"));
    assert_eq!(
        page.attribute(".actions a", "href").as_deref(),
        Some("https://site.example/complete?cc=OUT1")
    );
    assert_eq!(state(&app, &person).await, RunState::ScreenedOut);
    // The page stays, and another link of the same person shows no code.
    person.reloads().await;
    assert_eq!(
        person.page.text(".completion__code").as_deref(),
        Some("OUT1")
    );
    let again = app.participant_of("/s/blocks?PROLIFIC_PID=p1").await;
    assert_eq!(again.page.text(".completion__code"), None);
    assert_eq!(bonuses(&app).await, []);
    nothing_disagrees(app).await;
}

#[tokio::test]
async fn a_wrong_attempt_shows_the_hint_and_the_last_one_ends_the_run() {
    let app = app().await;
    let mut person = at_check(&app).await;
    let page = fills(&mut person, &WRONG).await;
    assert_eq!(page.status, StatusCode::OK);
    assert_eq!(page.text("h1").as_deref(), Some("Check"));
    assert_eq!(page.text(".error-summary").as_deref(), Some("Read again."));
    // An empty answer is no attempt.
    let page = fills(&mut person, &[("light", "red")]).await;
    assert_eq!(page.status, StatusCode::UNPROCESSABLE_ENTITY);
    assert_eq!(state(&app, &person).await, RunState::Active);
    let page = fills(&mut person, &WRONG).await;
    assert_eq!(state(&app, &person).await, RunState::FailedCheck);
    assert_eq!(page.text(".completion__code").as_deref(), Some("FAIL1"));
    nothing_disagrees(app).await;
}

#[tokio::test]
async fn sending_the_same_wrong_form_twice_is_one_attempt() {
    let app = app().await;
    let mut person = at_check(&app).await;
    let page = person.page.clone();
    fills(&mut person, &WRONG).await;
    person.page = page;
    fills(&mut person, &WRONG).await;
    assert_eq!(state(&app, &person).await, RunState::Active);
    fills(&mut person, &RIGHT).await;
    assert_eq!(person.page.text("h1").as_deref(), Some("Choose"));
    nothing_disagrees(app).await;
}

#[tokio::test]
async fn a_wrong_attempt_keeps_what_was_answered_and_tells_no_answer_apart() {
    let app = app().await;
    let mut person = at_check(&app).await;
    fills(&mut person, &WRONG).await;
    for _ in 0..2 {
        let page = &person.page;
        assert!(page.text(".error-summary").unwrap().contains("again"));
        let ticked = page.attributes("input[checked]", "value");
        assert_eq!(ticked, ["red", "y"], "right ones and wrong ones alike");
        assert_eq!(page.texts(".field__error"), Vec::<String>::new());
        person.reloads().await;
    }
    fills(&mut person, &RIGHT).await;
    assert_eq!(person.page.text("h1").as_deref(), Some("Choose"));
    nothing_disagrees(app).await;
}

#[tokio::test]
async fn a_form_that_is_sent_back_keeps_what_was_typed() {
    let app = app().await;
    let mut person = at_check(&app).await;
    fills(&mut person, &RIGHT).await;
    fills(&mut person, &[("action", "d")]).await;
    let typed = [("height", "9"), ("dares", "4"), ("words", "two\nlines <b>")];
    let page = fills(&mut person, &typed).await;
    assert_eq!(page.status, StatusCode::UNPROCESSABLE_ENTITY);
    assert_eq!(page.field("height"), "9");
    assert_eq!(page.text("textarea").as_deref(), Some("two\nlines <b>"));
    assert!(
        page.attribute("input[name=dares][value='4']", "checked")
            .is_some()
    );
    let messages = page.texts(".error-summary a");
    assert_eq!(messages.len(), 2, "{messages:?}");
    assert!(page.attribute("#field-fears", "aria-describedby").is_some());
    assert_eq!(
        page.attribute("#field-height", "inputmode").as_deref(),
        Some("decimal")
    );
    nothing_disagrees(app).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn four_actions_with_five_outcomes_are_counted_fitted_and_exported() {
    let app = app().await;
    for action in ["a", "b", "c", "d"] {
        completes(&app, action).await;
    }
    let catalogue = Arc::new(Catalogue::stored(&app.store).await.unwrap());
    let study = "blocks".into();
    let _background = Background::start(&app.store, &catalogue);
    until(&app.store, async || {
        let snapshot = Snapshot::read(&app.store, &catalogue, Population::People, &study);
        let snapshot = snapshot.await.unwrap().unwrap();
        let mut fits = snapshot.fits.iter();
        fits.all(|part| part.state == PartState::Converged && !part.is_behind)
    })
    .await;
    let summary = app.get("/api/v1/studies/blocks/summary").await;
    let summary: serde_json::Value = serde_json::from_str(&summary.html).unwrap();
    let cell = &summary["cells"][0];
    assert_eq!(cell["n"], 4);
    assert_eq!(cell["actions"].as_array().unwrap().len(), 4);
    for model in ["noisy_rational", "risk_aware"] {
        let predicted = cell["predicted"][model].as_object().unwrap();
        assert_eq!(predicted.len(), 4, "{model}");
        let total: f64 = predicted
            .values()
            .map(|share| share["mean"].as_f64().unwrap())
            .sum();
        assert!((total - 1.0).abs() < 1e-9, "{model}: {total}");
    }
    let results = app.get("/results/blocks").await;
    assert_eq!(results.status, StatusCode::OK);
    let csv = app.get("/api/v1/studies/blocks/answers.csv").await;
    for action in ["a", "b", "c", "d"] {
        assert!(
            csv.html.contains(&format!(",{action},answered,")),
            "{}",
            csv.html
        );
    }
    nothing_disagrees(app).await;
}

#[tokio::test]
async fn a_completed_run_has_one_bonus_from_its_choice_and_withdrawal_erases_it() {
    let app = app().await;
    let sure = completes(&app, "b").await;
    let risky = completes(&app, "c").await;
    assert_eq!(
        sure.page.text(".completion__code").as_deref(),
        Some("DONE1")
    );
    // The one choice was the sure one: 1 + 0.01 · 5.
    assert_eq!(
        sure.page.text(".bonus__amount").as_deref(),
        Some("GBP 1.05")
    );
    let told = sure.page.text(".bonus").unwrap().replace('\u{a0}', " ");
    assert!(told.contains("Choose"), "{told}");
    assert!(
        told.contains("GBP 1.00 + GBP 0.01 × 5 = GBP 1.05"),
        "{told}"
    );
    let drawn_then = bonuses(&app).await;
    assert_eq!(drawn_then.len(), 2);
    let drawn = drawn_then[1].choice.clone().unwrap();
    assert_eq!(
        (drawn.block.as_str(), drawn.action.as_str()),
        ("lotteries", "c")
    );
    assert!([12.0, -6.0].contains(&drawn.reward), "{drawn:?}");
    assert_eq!(
        (drawn_then[0].amount, drawn_then[0].currency.as_str()),
        (1.05, "GBP")
    );
    // Sending the last form again draws nothing anew.
    let mut again = risky.clone();
    again.reloads().await;
    fills(&mut again, &[("dares", "1"), ("fears", "1")]).await;
    assert_eq!(bonuses(&app).await, drawn_then);
    app.store.withdraw(&risky.token()).await.unwrap();
    assert_eq!(bonuses(&app).await, drawn_then[..1]);
    nothing_disagrees(app).await;
}

#[tokio::test]
async fn forms_are_stored_raw_with_what_became_of_the_check() {
    let app = app().await;
    let mut person = at_check(&app).await;
    fills(&mut person, &WRONG).await;
    fills(&mut person, &RIGHT).await;
    fills(&mut person, &[("action", "b")]).await;
    fills(
        &mut person,
        &[("height", "1.5"), ("dares", "5"), ("fears", "2")],
    )
    .await;
    let expected = [
        ("light", "red", 1),
        ("cars", r#"["x","z"]"#, 1),
        ("_passed", "1", 1),
        ("_attempts", "2", 1),
    ];
    for (field, value, n) in expected {
        let given = form_answer(&app, "check", field).await;
        assert_eq!(given, [(Some(value.to_owned()), n)], "{field}");
    }
    assert_eq!(
        form_answer(&app, "about", "height").await,
        [(Some("1.5".to_owned()), 1)]
    );
    assert_eq!(
        form_answer(&app, "about", "fears").await,
        [(Some("2".to_owned()), 1)]
    );
    nothing_disagrees(app).await;
}

#[tokio::test]
async fn the_wide_table_has_a_column_per_option_and_item_and_scores_reversed_ones() {
    let app = app().await;
    let mut person = at_check(&app).await;
    fills(&mut person, &WRONG).await;
    fills(&mut person, &RIGHT).await;
    fills(&mut person, &[("action", "b")]).await;
    fills(&mut person, &[("dares", "5"), ("fears", "2")]).await;
    app.participant_of("/s/blocks").await;

    let csv = app.get("/api/v1/studies/blocks/export/wide.csv").await.html;
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let header = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let cells = |name: &str| {
        let column = header.iter().position(|column| column == name);
        let column = column.unwrap_or_else(|| panic!("no column {name} in {header:?}"));
        [&rows[0][column], &rows[1][column]]
    };
    for (name, expected) in [
        ("consent.adult", ["true", ""]),
        ("consent.archive", ["false", ""]),
        ("check.passed", ["true", ""]),
        ("check.attempts", ["2", ""]),
        ("check.light", ["red", ""]),
        ("check.cars.x", ["true", ""]),
        ("check.cars.y", ["false", ""]),
        ("check.cars.z", ["true", ""]),
        ("about.dares", ["5", ""]),
        ("about.fears", ["2", ""]),
        ("about.fears.score", ["4", ""]),
        ("about.height", ["", ""]),
        ("about.status", ["answered", "not_shown"]),
    ] {
        assert_eq!(cells(name), expected, "{name}");
    }
    assert!(!header.iter().any(|name| name == "about.dares.score"));
    nothing_disagrees(app).await;
}

async fn form_answer(app: &App, block: &str, field: &str) -> Vec<(Option<String>, u64)> {
    app.store
        .form_answers(
            &"blocks".into(),
            Population::People,
            AnalysisSet::All,
            &block.into(),
            field,
            false,
        )
        .await
        .unwrap()
        .into_iter()
        .map(|answer| (answer.value, answer.n))
        .collect()
}
