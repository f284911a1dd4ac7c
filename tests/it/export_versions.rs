//! Exports of a study that was changed after people had answered, with ids that meet names of the program's own.

use std::collections::BTreeMap;

use riskaware::{clock::Clock, jobs::Catalogue};
use serde_json::Value;

use crate::app::{App, Page, START};

const STUDY: &str = r#"
format = 1
open = true
id = "moods"
title = "Moods"
summary = "A scale and a gamble"
minutes = 1
contact = "the team"
reward_unit = { name = "points" }

[[action]]
id = "sure"
label = "Sure"
outcomes = [{ p = 1, reward = 5 }]
[[action]]
id = "risky"
label = "Risky"
outcomes = [{ p = 0.5, reward = 12 }, { p = "rest", reward = -6 }]

[[block]]
kind = "choice"
id = "lotteries"
title = "Choose"
[[block.question]]
id = "one"
text = "Which?"

[[block]]
kind = "form"
id = "about"
title = "About"
button = "Finish"
[[block.field]]
id = "status"
kind = "text"
label = "Your status?"
[[block.field]]
id = "agree"
kind = "likert"
label = "Agree?"
required = true
points = 5
low = "No"
high = "Yes"
items = [{ id = "fears", text = "I fear.", reverse = true }, { id = "reads", text = "Choose 2.", expected = 2 }]

[completion]
title = "Done"
text = "Thanks."

[bonus]
currency = "JPY"
rate = 1
endowment = 0
"#;

async fn bytes(app: &App, path: &str) -> Vec<u8> {
    let url = format!("{}/api/v1/studies/moods/export/{path}", app.url);
    let response = app.client.get(url).send().await.unwrap();
    assert!(response.status().is_success(), "{path}");
    response.bytes().await.unwrap().to_vec()
}

fn only_row(csv: &[u8]) -> BTreeMap<String, String> {
    let mut rows: Vec<BTreeMap<String, String>> = csv::Reader::from_reader(csv)
        .deserialize()
        .collect::<Result<_, _>>()
        .unwrap();
    assert_eq!(rows.len(), 1);
    rows.remove(0)
}

/// Somebody who chose the sure 5 and then answered the form.
async fn with_an_answer() -> App {
    let studies = vec![("moods.toml".to_owned(), STUDY.to_owned())];
    let app = App::with(Clock::manual(START), studies).await;
    let mut person = app.participant_of("/s/moods").await;
    for answers in [
        [("action", "sure")].as_slice(),
        &[("status", "fine"), ("fears", "2"), ("reads", "2")],
    ] {
        let mut form = vec![
            ("step", person.page.field("step")),
            ("key", person.page.field("key")),
        ];
        form.extend(
            answers
                .iter()
                .map(|(name, value)| (*name, (*value).to_owned())),
        );
        let sent = person.client.post(&person.link).form(&form).send();
        person.page = Page::of(sent.await.unwrap()).await;
    }
    assert_eq!(person.page.text("h1").as_deref(), Some("Done"));
    app
}

#[tokio::test]
async fn an_id_that_meets_a_name_of_the_programs_own_costs_no_answer() {
    let app = with_an_answer().await;
    let row = only_row(&bytes(&app, "wide.csv").await);
    assert_eq!(row["about.status"], "answered");
    assert_eq!(row["about.status_2"], "fine");
    let codebook: Value = serde_json::from_slice(&bytes(&app, "codebook.json").await).unwrap();
    let columns = codebook["tables"][1]["columns"].as_array().unwrap();
    let column = columns
        .iter()
        .find(|column| column["name"] == "about.status_2");
    assert_eq!(column.unwrap()["label"], "Your status?");
    app.stop().await;
}

#[tokio::test]
async fn a_scale_that_was_changed_scores_nobody_who_answered_before() {
    let app = with_an_answer().await;
    let before = only_row(&bytes(&app, "wide.csv").await);
    assert_eq!(before["about.fears.score"], "4");
    assert_eq!(before["about.agree.passed"], "true");
    let changed = STUDY
        .replace("points = 5", "points = 7")
        .replace("Choose 2.\", expected = 2", "Choose 3.\", expected = 3");
    let files = vec![("moods.toml".to_owned(), changed)];
    Catalogue::publish(&app.store, files).await.unwrap();
    let after = only_row(&bytes(&app, "wide.csv").await);
    assert_eq!(after, before);
    app.stop().await;
}

#[tokio::test]
async fn a_bonus_has_the_digits_of_its_currency() {
    let app = with_an_answer().await;
    assert_eq!(only_row(&bytes(&app, "wide.csv").await)["bonus"], "5");
    assert_eq!(only_row(&bytes(&app, "bonus.csv").await)["amount"], "5");
    app.stop().await;
}
