//! The analysis set: people who are left out by the study's rule or by hand, on pages, in fits, in exports and in the log.

use std::sync::Arc;

use reqwest::StatusCode;
use riskaware::{
    clock::Clock,
    jobs::{Catalogue, PartState, Snapshot},
    store::{Population, Role},
    study::StudyId,
};
use serde_json::Value;

use crate::{
    app::{App, Page, Participant, START},
    browser::{Browser, account},
    crowd::{Background, until},
    program::{riskaware, stderr, stdout},
};

const STUDY: &str = r#"
format = 1
open = true
id = "attentive"
title = "Attentive"
summary = "Who reads counts"
minutes = 2
contact = "the team"
reward_unit = { name = "points" }

[[block]]
kind = "choice"
id = "lotteries"
title = "Choose"
[[block.question]]
id = "one"
text = "Which?"
[[block.question.actions]]
id = "safe"
label = "Safe"
outcomes = [{ p = 1, reward = 5 }]
[[block.question.actions]]
id = "risky"
label = "Risky"
outcomes = [{ p = 0.5, reward = 20 }, { p = "rest", reward = -4 }]

[[block]]
kind = "form"
id = "about"
title = "About"
button = "Finish"
[[block.field]]
id = "reads"
kind = "choice"
label = "Please choose Left."
required = true
options = [{ id = "left", label = "Left" }, { id = "right", label = "Right" }]
expected = "left"

[completion]
title = "Done"
text = "Thanks."

[analysis]
exclude = ["failed-check"]

[fit]
models = ["noisy_rational"]
[[fit.plan]]
id = "all"
label = "All"
by = []
"#;

fn attentive() -> StudyId {
    StudyId::from("attentive")
}

async fn app(text: &str) -> App {
    let studies = vec![("attentive.toml".to_owned(), text.to_owned())];
    App::with(Clock::manual(START), studies).await
}

/// Somebody who chooses, and answers the attention check.
async fn takes(app: &App, query: &str, action: &str, reads: &str) -> Participant {
    let mut person = app.participant_of(&format!("/s/attentive{query}")).await;
    person.sends("action", action).await;
    person.sends("reads", reads).await;
    assert_eq!(person.page.text("h1").as_deref(), Some("Done"));
    person
}

async fn post(app: &App, path: &str, form: &[(&str, &str)]) -> Page {
    let request = app.client.post(format!("{}{path}", app.url)).form(form);
    Page::of(request.send().await.unwrap()).await
}

async fn json(app: &App, path: &str) -> Value {
    let page = app.get(path).await;
    assert_eq!(page.status, StatusCode::OK, "{path}");
    serde_json::from_str(&page.html).unwrap()
}

async fn nothing_disagrees(app: &App) {
    assert_eq!(app.store.check_answers().await.unwrap(), []);
    assert_eq!(app.store.check_counters().await.unwrap(), []);
}

/// The cell of a participant in the wide table.
async fn wide(app: &App, participant: &str, column: &str) -> String {
    let csv = app
        .get("/results/attentive/data/wide.csv")
        .await
        .html
        .into_bytes();
    let mut reader = csv::Reader::from_reader(csv.as_slice());
    let headers = reader.headers().unwrap().clone();
    let place = |name: &str| headers.iter().position(|header| header == name).unwrap();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let row = rows
        .iter()
        .find(|row| &row[place("participant")] == participant)
        .unwrap();
    row[place(column)].to_owned()
}

/// What the newest fit was made of, once it is of the answers as they are.
async fn fitted(app: &App, catalogue: &Arc<Catalogue>) -> Vec<Vec<u64>> {
    let (mut counts, study) = (Vec::new(), attentive());
    until(&app.store, async || {
        let snapshot = Snapshot::read(&app.store, catalogue, Population::People, &study);
        let snapshot = snapshot.await.unwrap().unwrap();
        let part = &snapshot.fits[0];
        counts = part
            .report()
            .map(|report| report.counts.clone())
            .unwrap_or_default();
        part.state == PartState::Converged && !part.is_behind
    })
    .await;
    counts
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_fails_the_check_is_left_out_of_counts_fits_and_sources_and_stays_in_exports() {
    let app = app(STUDY).await;
    takes(&app, "?source=pilot", "safe", "left").await;
    takes(&app, "?source=pilot", "risky", "left").await;
    takes(&app, "?source=pilot", "risky", "right").await;
    nothing_disagrees(&app).await;

    let summary = json(&app, "/api/v1/studies/attentive/summary").await;
    let people = &summary["people"];
    assert_eq!(
        (
            &people["completed"],
            &people["analysed"],
            &people["excluded"]
        ),
        (&3.into(), &2.into(), &1.into())
    );
    assert_eq!(
        people["exclusions"],
        serde_json::json!([{ "flag": "failed-check", "n": 1 }])
    );
    let answers = &summary["answers"];
    assert_eq!(
        (&answers["before_exclusions"], &answers["counted"]),
        (&3.into(), &2.into())
    );
    let page = app.get("/results/attentive").await;
    assert_eq!(
        page.text("[data-value='people.exclusions_text']").unwrap(),
        "1 left out: 1 answered a check wrongly"
    );
    // Of everybody, or it would always say that nobody failed.
    assert!(page.html.contains(
        "2 of 3 people who answered it did so. Who finished and did not is left out of the analysis."
    ));
    let sources = app.get("/studies/attentive/sources").await;
    assert!(sources.html.contains("pilot"));
    let chosen = sources.texts("tbody tr:first-child td.numeric");
    assert_eq!(chosen[0], "2", "{chosen:?}");

    assert_eq!(wide(&app, "3", "excluded").await, "failed-check");
    assert_eq!(wide(&app, "3", "lotteries.one.action").await, "risky");
    assert_eq!(wide(&app, "2", "excluded").await, "");
    let lines = app.get("/results/attentive/data/answers.ndjson").await.html;
    let lines: Vec<Value> = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let told: Vec<&Value> = lines.iter().map(|line| &line["excluded"]).collect();
    assert_eq!(told, [&Value::Null, &Value::Null, &"failed-check".into()]);
    let long = app.get("/results/attentive/data/answers.csv").await.html;
    assert_eq!(long.lines().count(), 1 + 3);
    assert!(!long.contains("excluded"), "its header is fixed");

    // Leaving out a second one by hand makes the fit anew.
    let catalogue = Arc::new(Catalogue::stored(&app.store).await.unwrap());
    let _background = Background::start(&app.store, &catalogue);
    assert_eq!(fitted(&app, &catalogue).await, [[1, 1]]);
    let page = post(
        &app,
        "/studies/attentive/participants/1/exclusion",
        &[("action", "exclude"), ("reason", "asked for it")],
    )
    .await;
    assert_eq!(page.status, StatusCode::OK);
    assert_eq!(fitted(&app, &catalogue).await, [[0, 1]]);
    nothing_disagrees(&app).await;
    app.stop().await;
}

#[tokio::test]
async fn leaving_out_by_hand_asks_for_a_reason_and_is_written_down_with_when_and_undone() {
    let blind = STUDY.replace("[analysis]", "[analysis]\nblind_until = 100");
    let app = app(&blind).await;
    takes(&app, "", "safe", "left").await;
    takes(&app, "", "risky", "right").await;
    let path = "/studies/attentive/participants/1/exclusion";
    let list = app.get("/studies/attentive/participants").await;
    assert!(
        list.attributes("td a.target", "href")
            .contains(&path.to_owned())
    );
    let ask = app.get(path).await;
    assert_eq!(
        ask.text("h2").unwrap(),
        "Leave participant 1 out of the analysis?"
    );
    for form in [
        vec![("action", "exclude")],
        vec![("action", "exclude"), ("reason", "  ")],
        vec![("action", "burn"), ("reason", "any")],
    ] {
        let page = post(&app, path, &form).await;
        assert_eq!(page.status, StatusCode::UNPROCESSABLE_ENTITY, "{form:?}");
    }
    let reason = [("action", "exclude"), ("reason", " knew the <answers> ")];
    let list = post(&app, path, &reason).await;
    assert!(
        list.html.contains("by hand: knew the &#60;answers&#62;"),
        "{}",
        list.html
    );
    let only = app
        .get("/studies/attentive/participants?flag=left-out")
        .await;
    assert_eq!(only.texts("tbody th"), ["2", "1"]);
    let results = app.get("/results/attentive").await;
    assert_eq!(
        results
            .text("[data-value='people.exclusions_text']")
            .unwrap(),
        "2 left out: 1 answered a check wrongly, 1 by hand"
    );
    let participants = json(&app, "/api/v1/studies/attentive/participants").await;
    assert_eq!(
        participants["participants"][1]["excluded"],
        "by hand: knew the <answers>"
    );
    let paragraph = app.get("/studies/attentive/data").await.html;
    assert!(
        paragraph.contains("Of these, 2 were left out of the analysis"),
        "{paragraph}"
    );
    nothing_disagrees(&app).await;

    let again = app.get(path).await;
    assert_eq!(again.text("h2").unwrap(), "Take participant 1 in again?");
    assert!(again.html.contains("knew the"));
    post(&app, path, &[("action", "include")]).await;
    assert_eq!(wide(&app, "1", "excluded").await, "");
    // Nobody undoes the rule.
    let other = "/studies/attentive/participants/2/exclusion";
    let refused = post(&app, other, &[("action", "include")]).await;
    assert!(refused.status.is_client_error(), "{}", refused.status);
    assert_eq!(wide(&app, "2", "excluded").await, "failed-check");
    nothing_disagrees(&app).await;

    let log = app.store.audit(None, 100).await.unwrap();
    let told: Vec<(&str, &str)> = log
        .iter()
        .filter(|row| row.entry.outcome.as_str() == "done")
        .filter_map(|row| Some((row.entry.action.as_str(), row.entry.detail.as_deref()?)))
        .filter(|(action, _)| action.contains("participant"))
        .collect();
    assert_eq!(
        told,
        [
            (
                "take a participant in again",
                "participant 1; 2 had finished, 2 of them left out"
            ),
            (
                "leave a participant out",
                "participant 1: knew the <answers>; 2 had finished, 1 of them left out"
            ),
        ]
    );
    app.stop().await;
}

#[tokio::test]
async fn a_viewer_leaves_nobody_out_and_a_researcher_is_named() {
    let app = app(STUDY).await;
    takes(&app, "", "safe", "left").await;
    account(&app, "vera", Role::Viewer).await;
    account(&app, "rita", Role::Researcher).await;
    for (name, status) in [
        ("vera", StatusCode::FORBIDDEN),
        ("rita", StatusCode::SEE_OTHER),
    ] {
        let answer = Browser::logged_in(&app, name)
            .await
            .posts(
                "/studies/attentive/participants/1/exclusion",
                &[("action", "exclude"), ("reason", "any")],
            )
            .await;
        assert_eq!(answer.status(), status, "{name}");
        let people = app
            .store
            .totals(&attentive(), Population::People)
            .await
            .unwrap();
        assert_eq!(people.excluded, u64::from(name == "rita"));
    }
    let exclusion = app.store.exclusion(1.into()).await.unwrap().unwrap();
    assert_eq!(exclusion.by_hand.unwrap().actor, "rita");
    let log = app.store.audit(None, 100).await.unwrap();
    let told: Vec<(&str, &str)> = log
        .iter()
        .filter(|row| row.entry.action.contains("participant"))
        .map(|row| (row.entry.actor.as_str(), row.entry.outcome.as_str()))
        .collect();
    assert_eq!(told, [("rita", "done"), ("vera", "refused")]);
    app.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_command_leaves_out_beside_a_running_server() {
    let app = app(STUDY).await;
    takes(&app, "", "safe", "left").await;
    takes(&app, "", "risky", "left").await;
    let database = app.store.path().to_str().unwrap().to_owned();
    let run = async |arguments: &[&str]| {
        let mut all = vec!["study".to_owned()];
        all.extend(arguments.iter().map(|&argument| argument.to_owned()));
        all.extend(["--database".to_owned(), database.clone()]);
        let run = move || {
            let all: Vec<&str> = all.iter().map(String::as_str).collect();
            riskaware(&all, "")
        };
        tokio::task::spawn_blocking(run).await.unwrap()
    };
    let done = run(&["exclude", "attentive", "2", "--reason", "tried it out"]).await;
    assert!(done.status.success(), "{}", stderr(&done));
    assert_eq!(
        stdout(&done),
        "study attentive: 2 finished, 1 of them left out of the analysis\n"
    );
    assert_eq!(wide(&app, "2", "excluded").await, "by hand: tried it out");
    let summary = json(&app, "/api/v1/studies/attentive/summary").await;
    assert_eq!(summary["cells"][0]["n"], 1);
    let refused = run(&["exclude", "attentive", "9", "--reason", "any"]).await;
    assert!(stderr(&refused).contains("participant not found"));
    let refused = run(&["exclude", "attentive", "1", "--reason", ""]).await;
    assert!(stderr(&refused).contains("one line of 1 to 200 characters"));
    let done = run(&["include", "attentive", "2"]).await;
    assert!(done.status.success(), "{}", stderr(&done));
    nothing_disagrees(&app).await;
    let log = app.store.audit(None, 10).await.unwrap();
    let commands = log.iter().filter(|row| row.entry.actor == "command");
    assert_eq!(commands.count(), 2);
    app.stop().await;
}

#[test]
fn study_check_names_the_rule() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("attentive.toml");
    std::fs::write(&file, STUDY).unwrap();
    let file = file.to_str().unwrap();
    let report = riskaware(&["study", "check", file], "");
    assert!(
        stdout(&report).contains(
            "Analysis: answers of people who finished; left out when their run ends: whoever answered a check wrongly."
        ),
        "{}",
        stdout(&report)
    );
    let report = riskaware(&["study", "check", "--json", file], "");
    let report: Value = serde_json::from_str(&stdout(&report)).unwrap();
    assert_eq!(report["analysis"]["exclude"][0], "failed-check");
}
