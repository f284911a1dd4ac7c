//! Exports of people who stop on the way, practise, or have more time: what was shown, what counts, and under which version.

use std::collections::BTreeMap;

use riskaware::clock::Clock;
use serde_json::Value;

use crate::app::{App, Participant, START};

const STUDY: &str = r#"
format = 1
open = true
id = "stops"
title = "Stops"
summary = "A study that people leave"
minutes = 2
contact = "the team"
reward_unit = { name = "points" }

[recruiting]
time_limit_min = 30

[[factor]]
id = "weather"
label = "Weather"
level = [{ id = "wet", label = "Wet" }, { id = "dry", label = "Dry" }]

[[factor]]
id = "pace"
label = "Pace"
level = [{ id = "slow", label = "Slow" }]

[[action]]
id = "sure"
label = "Sure"
outcomes = [{ p = 1, reward = 5 }]
[[action]]
id = "risky"
label = "Risky"
outcomes = [{ p = 0.5, reward = 12 }, { p = "rest", reward = -6 }]

[question]
text = "Which?"

[[block]]
kind = "info"
id = "welcome"
title = "Welcome"
text = "Hello."
button = "Go on"

[[block]]
kind = "choice"
id = "warm-up"
practice = true
title = "Practice"
[[block.question]]
id = "try"
levels = { weather = "dry" }

[[block]]
kind = "choice"
id = "timed"
limit_s = 8
title = "Choose"
levels = { pace = "slow" }
[block.start]
title = "Now with a limit"
text = "Eight seconds."
button = "Go on"

[[block.group]]
cross = { weather = ["wet", "dry"] }

[[block]]
kind = "form"
id = "about"
title = "About"
button = "Finish"
[[block.field]]
id = "mood"
kind = "text"
label = "Your mood?"

[completion]
title = "Done"
text = "Thanks."
"#;

async fn serve() -> App {
    let files = vec![("stops.toml".to_owned(), STUDY.to_owned())];
    App::with(Clock::manual(START), files).await
}

async fn text(app: &App, path: &str) -> String {
    let url = format!("{}/api/v1/studies/stops/{path}", app.url);
    let response = app.client.get(url).send().await.unwrap();
    assert!(response.status().is_success(), "{path}");
    response.text().await.unwrap()
}

async fn table(app: &App, path: &str) -> Vec<BTreeMap<String, String>> {
    csv::Reader::from_reader(text(app, path).await.as_bytes())
        .deserialize()
        .collect::<Result<_, _>>()
        .unwrap()
}

async fn lines(app: &App) -> Vec<Value> {
    let text = text(app, "answers.ndjson").await;
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// Somebody who is at a question of this block.
async fn at(app: &App, block: &str, link: &str) -> Participant {
    let mut person = app.participant_of(&format!("/s/stops{link}")).await;
    person
        .proceeds("sure", |person| person.block().as_deref() == Some(block))
        .await;
    person
}

#[tokio::test]
async fn a_question_that_was_left_has_a_row_when_the_run_is_over() {
    let app = serve().await;
    let leaves = at(&app, "warm-up", "").await;
    // What is on a screen may still be answered.
    assert_eq!(table(&app, "answers.csv").await.len(), 0);
    let wide = table(&app, "export/wide.csv").await;
    assert_eq!(wide[0]["warm-up.try.status"], "open");
    assert_eq!(wide[0]["last_position"], "1");
    app.clock.advance(30 * 60_000 + 1_000);
    assert_eq!(app.store.close_overdue().await.unwrap(), 1);
    let stays = at(&app, "warm-up", "").await;
    let left = table(&app, "answers.csv").await;
    assert_eq!(left.len(), 1);
    for (name, value) in [
        ("run_state", "timed_out"),
        ("question", "try"),
        ("position", "1"),
        ("status", "skipped"),
        ("action", ""),
        ("shown_at_ms", &START.0.to_string()),
        ("answered_at_ms", ""),
        ("server_ms", ""),
    ] {
        assert_eq!(left[0][name], value, "{name}");
    }
    let wide = table(&app, "export/wide.csv").await;
    let told = |row: usize, name: &str| wide[row][name].clone();
    assert_eq!(told(0, "warm-up.try.status"), "skipped");
    assert_eq!(told(0, "timed.wet.status"), "not_shown");
    assert_eq!(told(0, "about.status"), "not_shown");
    assert_eq!(told(0, "last_position"), "1");
    assert_eq!(told(1, "warm-up.try.status"), "open");
    // It is no choice, and nothing that the checks of a database complain about.
    let rows = app
        .store
        .answers(
            &"stops".into(),
            riskaware::store::Population::People,
            riskaware::store::AnswerKey::START,
            10,
        )
        .await
        .unwrap();
    assert!(rows.iter().all(|row| !row.is_counted));
    assert_eq!(app.store.check_answers().await.unwrap(), []);
    assert_eq!(app.store.check_counters().await.unwrap(), []);
    app.store.withdraw(&leaves.token()).await.unwrap();
    app.store.withdraw(&stays.token()).await.unwrap();
    assert_eq!(table(&app, "answers.csv").await.len(), 0);
    let wide = table(&app, "export/wide.csv").await;
    assert_eq!(wide[0]["last_position"], "");
    assert_eq!(wide[0]["warm-up.try.status"], "withdrawn");
    app.stop().await;
}

#[tokio::test]
async fn pages_of_questions_go_on_after_one_that_was_left() {
    let app = serve().await;
    for _ in 0..3 {
        at(&app, "warm-up", "").await;
    }
    app.clock.advance(30 * 60_000 + 1_000);
    app.store.close_overdue().await.unwrap();
    let mut after = riskaware::store::AnswerKey::START;
    for _ in 0..3 {
        let page = app
            .store
            .answers(
                &"stops".into(),
                riskaware::store::Population::People,
                after,
                1,
            )
            .await
            .unwrap();
        assert_eq!(page.len(), 1);
        assert!(page[0].key > after);
        after = page[0].key;
    }
    app.stop().await;
}

#[tokio::test]
async fn practice_and_extra_time_can_be_told_from_what_counts() {
    let app = serve().await;
    at(&app, "timed", "").await.sends("action", "risky").await;
    let usual = lines(&app).await;
    assert_eq!(usual[0]["question"], "try");
    assert_eq!(
        (&usual[0]["practice"], &usual[0]["counted"]),
        (&true.into(), &false.into())
    );
    assert_eq!(
        (&usual[1]["practice"], &usual[1]["counted"]),
        (&false.into(), &true.into())
    );
    assert_eq!(usual[1]["condition"], Value::Null);
    // A question outside the design has the levels that it names.
    assert_eq!(usual[0]["levels"], serde_json::json!({ "weather": "dry" }));
    let long = table(&app, "answers.csv").await;
    assert_eq!(
        (long[0]["weather"].as_str(), long[0]["pace"].as_str()),
        ("dry", "")
    );
    assert_eq!(long[0]["problem"], "warm-up:try");
    assert_eq!(usual[1]["time_factor"], 1.0);
    app.stop().await;
}

#[tokio::test]
async fn every_answer_names_the_study_file_and_the_program() {
    let app = serve().await;
    at(&app, "timed", "").await;
    let study = riskaware::study::Study::parse("stops.toml", STUDY).unwrap();
    let wide = table(&app, "export/wide.csv").await;
    assert_eq!(wide[0]["study_version_hash"], study.hash());
    assert_eq!(wide[0]["program_version"], env!("CARGO_PKG_VERSION"));
    let lines = lines(&app).await;
    assert_eq!(lines.len(), 1);
    assert_eq!(lines[0]["study_version_hash"], study.hash());
    assert_eq!(lines[0]["program_version"], env!("CARGO_PKG_VERSION"));
    // What was answered elsewhere was not asked by this program.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("earlier.csv");
    std::fs::write(
        &file,
        "participant,problem,action,server_ms\na,wet/slow,sure,1500\n",
    )
    .unwrap();
    let output = crate::program::riskaware(
        &[
            "import",
            "stops",
            "--file",
            file.to_str().unwrap(),
            "--source",
            "lab",
            "--database",
            app.store.path().to_str().unwrap(),
        ],
        "",
    );
    assert!(
        output.status.success(),
        "{}",
        crate::program::stderr(&output)
    );
    let wide = table(&app, "export/wide.csv").await;
    assert_eq!(wide[1]["source"], "lab");
    assert_eq!(wide[1]["program_version"], "");
    assert_eq!(wide[1]["study_version_hash"], study.hash());
    app.stop().await;
}

#[tokio::test]
async fn a_condition_is_one_of_the_levels_that_the_codebook_tells() {
    let files = vec![(
        "between.toml".to_owned(),
        crate::conditions::BETWEEN.to_owned(),
    )];
    let app = App::with(Clock::manual(START), files).await;
    app.participant_of("/s/between").await;
    let get = async |path: &str| {
        let url = format!("{}/api/v1/studies/between/export/{path}", app.url);
        app.client
            .get(url)
            .send()
            .await
            .unwrap()
            .text()
            .await
            .unwrap()
    };
    let codebook: Value = serde_json::from_str(&get("codebook.json").await).unwrap();
    let columns = codebook["tables"][1]["columns"].as_array().unwrap();
    let column = columns
        .iter()
        .find(|column| column["name"] == "condition")
        .unwrap();
    assert_eq!(column["type"], "level");
    assert_eq!(
        column["levels"][0],
        serde_json::json!({ "code": "gain/small", "label": "Gain, Small" })
    );
    let levels = column["levels"].as_array().unwrap();
    let wide = get("wide.csv").await;
    let row: BTreeMap<String, String> = csv::Reader::from_reader(wide.as_bytes())
        .deserialize()
        .next()
        .unwrap()
        .unwrap();
    assert!(levels.iter().any(|level| level["code"] == row["condition"]));
    app.stop().await;
}

#[tokio::test]
async fn the_archive_says_which_blocks_are_practice() {
    let app = serve().await;
    let url = format!("{}/api/v1/studies/stops/export/psych-ds.zip", app.url);
    let archive = app
        .client
        .get(url)
        .send()
        .await
        .unwrap()
        .bytes()
        .await
        .unwrap();
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(archive)).unwrap();
    let mut readme = String::new();
    let mut file = archive.by_name("README.md").unwrap();
    std::io::Read::read_to_string(&mut file, &mut readme).unwrap();
    assert!(
        readme.contains("Those of the blocks `warm-up` are for practice"),
        "{readme}"
    );
    drop(file);
    app.stop().await;
}
