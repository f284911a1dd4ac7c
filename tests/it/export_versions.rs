//! Exports of a study that was changed after people had answered, with ids that meet names of the program's own.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};

use riskaware::{
    clock::Clock,
    export::{Export, Form, Ids},
    jobs::Catalogue,
    store::{Population, Store, StudyState, Token},
    study::Study,
};
use serde_json::Value;
use tokio::runtime::Handle;

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
    answers(app, &format!("export/{path}")).await
}

async fn answers(app: &App, path: &str) -> Vec<u8> {
    let url = format!("{}/api/v1/studies/moods/{path}", app.url);
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
    answered().await.0
}

/// The same with the link of that person.
async fn answered() -> (App, Token) {
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
    (app, person.token())
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
    // The scale of seven points is the column of that name now, and the one of five points another one.
    let after = only_row(&bytes(&app, "wide.csv").await);
    assert_eq!(after["about.fears"], "");
    assert_eq!(after["about.fears_2"], "2");
    assert_eq!(after["about.fears.score"], "");
    assert_eq!(after["about.fears.score_2"], "4");
    assert_eq!(after["about.agree.passed"], "true");
    let columns = described(&app).await;
    assert_eq!(
        codes(&columns, "about.fears"),
        ["1", "2", "3", "4", "5", "6", "7"]
    );
    assert_eq!(codes(&columns, "about.fears_2"), ["1", "2", "3", "4", "5"]);
    app.stop().await;
}

/// The columns of the wide table as the codebook describes them.
async fn described(app: &App) -> Vec<Value> {
    let codebook: Value = serde_json::from_slice(&bytes(app, "codebook.json").await).unwrap();
    codebook["tables"][1]["columns"].as_array().unwrap().clone()
}

fn codes(columns: &[Value], name: &str) -> Vec<String> {
    levels(columns, name, "code")
}

fn levels(columns: &[Value], name: &str, what: &str) -> Vec<String> {
    let column = columns.iter().find(|column| column["name"] == name);
    let levels = column.unwrap_or_else(|| panic!("no column {name}"))["levels"].as_array();
    levels
        .unwrap()
        .iter()
        .map(|level| level[what].as_str().unwrap().to_owned())
        .collect()
}

#[tokio::test]
async fn a_column_knows_the_levels_of_all_versions() {
    let app = with_an_answer().await;
    // The action that was chosen is gone, the other one has another name, and a field has become another kind.
    let changed = STUDY
        .replace(
            "id = \"sure\"\nlabel = \"Sure\"",
            "id = \"safe\"\nlabel = \"Safe\"",
        )
        .replace("label = \"Risky\"", "label = \"Bold\"")
        .replace("kind = \"text\"", "kind = \"integer\"\nmin = 1\nmax = 3");
    let files = vec![("moods.toml".to_owned(), changed)];
    Catalogue::publish(&app.store, files).await.unwrap();
    let row = only_row(&bytes(&app, "wide.csv").await);
    assert_eq!(row["lotteries.one.action"], "sure");
    let columns = described(&app).await;
    let name = "lotteries.one.action";
    assert_eq!(codes(&columns, name), ["safe", "risky", "sure"]);
    let labels = levels(&columns, name, "label");
    assert!(
        labels[1].starts_with("Bold (in version ") && labels[1].ends_with(": Risky)"),
        "{labels:?}"
    );
    // `about.status` is the status of the form.
    let kinds: Vec<(&str, &str)> = columns
        .iter()
        .filter_map(|column| {
            let name = column["name"].as_str().unwrap();
            name.starts_with("about.status")
                .then(|| (name, column["type"].as_str().unwrap()))
        })
        .collect();
    assert_eq!(
        kinds,
        [
            ("about.status", "level"),
            ("about.status_2", "integer"),
            ("about.status_3", "text")
        ]
    );
    assert_eq!(
        (
            row["about.status_2"].as_str(),
            row["about.status_3"].as_str()
        ),
        ("", "fine")
    );
    app.stop().await;
}

#[tokio::test]
async fn a_bonus_has_the_digits_of_its_currency() {
    let app = with_an_answer().await;
    assert_eq!(only_row(&bytes(&app, "wide.csv").await)["bonus"], "5");
    assert_eq!(only_row(&bytes(&app, "bonus.csv").await)["amount"], "5");
    let columns = described(&app).await;
    let bonus = columns.iter().find(|column| column["name"] == "bonus");
    assert_eq!(bonus.unwrap()["unit"], "JPY");
    app.stop().await;
}

/// Factors that no file may have any more.
fn with_old_factors(factors: &[&str]) -> String {
    let tables: String = factors
        .iter()
        .map(|factor| {
            format!(
                "[[factor]]\nid = \"{factor}\"\nlabel = \"F\"\nlevel = [{{ id = \"one\", label = \"One\" }}]\n\n"
            )
        })
        .collect();
    let levels: Vec<String> = factors
        .iter()
        .map(|factor| format!("{factor} = \"one\""))
        .collect();
    STUDY
        .replacen("[[action]]", &format!("{tables}[[action]]"), 1)
        .replace(
            "id = \"one\"\ntext",
            &format!("id = \"one\"\nlevels = {{ {} }}\ntext", levels.join(", ")),
        )
}

#[tokio::test]
async fn a_stored_factor_with_the_name_of_another_column_is_numbered() {
    let app = with_an_answer().await;
    let text = with_old_factors(&["status", "source", "mood"]);
    assert!(Study::parse("moods.toml", &text).is_err());
    let study = Study::parse_stored("moods.toml", &text).unwrap();
    app.store
        .publish(study.id(), study.hash(), &text, StudyState::Open, None)
        .await
        .unwrap();
    // The server that starts with such a study serves it as it is stored.
    let catalogue = Catalogue::publish(&app.store, Vec::new()).await.unwrap();
    assert_eq!(catalogue.studies().len(), 1);
    let long = only_row(&answers(&app, "answers.csv").await);
    assert_eq!(long["status"], "answered");
    assert_eq!(long["source"], "");
    for name in ["status_2", "source_2", "mood"] {
        assert!(long.contains_key(name), "{name} in {long:?}");
    }
    let text = String::from_utf8(answers(&app, "answers.csv").await).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let distinct: std::collections::BTreeSet<&str> = header.iter().copied().collect();
    assert_eq!(distinct.len(), header.len());
    app.stop().await;
}

/// Every name that is one word could be a factor's id.
#[tokio::test]
async fn no_file_may_have_a_factor_with_the_name_of_a_fixed_column() {
    let app = with_an_answer().await;
    let tables = [
        answers(&app, "answers.csv").await,
        bytes(&app, "wide.csv?ids=hashed").await,
        bytes(&app, "bonus.csv").await,
    ];
    let mut tried = 0;
    for table in tables {
        let names = csv::Reader::from_reader(table.as_slice())
            .headers()
            .unwrap()
            .clone();
        for name in names.iter().filter(|name| !name.contains(['_', '.'])) {
            let parsed = Study::parse("moods.toml", &with_old_factors(&[name]));
            // Of the bonuses no column stands beside a factor.
            assert!(parsed.is_err() || name == "amount", "{name}");
            tried += 1;
        }
    }
    assert!(tried > 15, "{tried}");
    assert!(Study::parse("moods.toml", &with_old_factors(&["mood"])).is_ok());
    app.stop().await;
}

/// The archive's files by name.
fn files(archive: Vec<u8>) -> BTreeMap<String, String> {
    let mut archive = zip::ZipArchive::new(Cursor::new(archive)).unwrap();
    (0..archive.len())
        .map(|index| {
            let mut file = archive.by_index(index).unwrap();
            let mut contents = String::new();
            file.read_to_string(&mut contents).unwrap();
            (file.name().unwrap().into_owned(), contents)
        })
        .collect()
}

#[tokio::test]
async fn the_archive_holds_all_that_people_read_in_each_language() {
    let consent = r#"
[[block]]
kind = "consent"
id = "consent"
version = "1"
title = "Consent"
text = "Please read."
agree = "I agree"
decline = "I do not"
declined_title = "Goodbye"
declined_text = "Nothing is stored."
clause = [{ id = "archive", text = "My answers may be archived.", required = false }]

[[block]]
kind = "choice""#;
    let text = STUDY
        .replacen(
            "minutes = 1",
            "minutes = 1\nlanguages = [\"en\", \"de\"]",
            1,
        )
        .replacen("\n[[block]]\nkind = \"choice\"", consent, 1)
        + "\n[text.de]\ntitle = \"Stimmungen\"\n\"block[about].field[agree].low\" = \"Nein\"\n\"completion.title\" = \"Fertig\"\n";
    let app = App::with(Clock::manual(START), vec![("moods.toml".to_owned(), text)]).await;
    let files = files(bytes(&app, "psych-ds.zip").await);
    let of = |language: &str| {
        let end = format!("-{language}.html");
        let found = files
            .iter()
            .find(|(path, _)| path.starts_with("materials/texts-") && path.ends_with(&end));
        found.unwrap_or_else(|| panic!("{:?}", files.keys())).1
    };
    let (english, german) = (of("en"), of("de"));
    assert!(english.contains("<html lang=\"en\">") && german.contains("<html lang=\"de\">"));
    for read in [
        "<h1>Moods</h1>",
        "A scale and a gamble",
        "My answers may be archived.",
        "I do not",
        "Nothing is stored.",
        "Which?",
        "Sure",
        "Your status?",
        "<li>1 No</li>",
        "I fear.",
        "Finish",
        "<h2>Done</h2>",
    ] {
        assert!(english.contains(read), "{read} in {english}");
    }
    for read in [
        "<h1>Stimmungen</h1>",
        "<li>1 Nein</li>",
        "<h2>Fertig</h2>",
        "I fear.",
    ] {
        assert!(german.contains(read), "{read} in {german}");
    }
    app.stop().await;
}

/// Somebody who takes the archive, during which somebody withdraws: as soon as the second table begins.
struct Slowly {
    taken: Vec<u8>,
    store: Store,
    withdraws: Option<Token>,
}

impl std::io::Write for Slowly {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.taken.extend_from_slice(bytes);
        let second = b"description-participants_data.csv";
        let has_begun = self
            .taken
            .windows(second.len())
            .any(|found| found == second);
        if has_begun && let Some(link) = self.withdraws.take() {
            Handle::current()
                .block_on(self.store.withdraw(&link))
                .unwrap();
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn both_tables_of_the_archive_tell_of_the_same_people() {
    let (app, link) = answered().await;
    let study = "moods".into();
    let export = Export::open(&app.store, &study, Population::People, Ids::LeftOut).await;
    let export = export.unwrap();
    // Whoever begins after the export was opened is not in it.
    app.participant_of("/s/moods").await;
    let mut out = Slowly {
        taken: Vec::new(),
        store: app.store.clone(),
        withdraws: Some(link),
    };
    let out = tokio::task::spawn_blocking(move || {
        export.write(Form::PsychDs, &mut out).unwrap();
        out
    });
    let out = out.await.unwrap();
    assert!(
        out.withdraws.is_none(),
        "nobody withdrew while it was taken"
    );
    let files = files(out.taken);
    let long = only_row(files["data/study-moods_data.csv"].as_bytes());
    let wide = only_row(files["data/study-moods_description-participants_data.csv"].as_bytes());
    assert_eq!(wide["participant"], long["participant"]);
    assert_eq!(wide["run_state"], long["run_state"]);
    assert_eq!(wide["lotteries.one.action"], long["action"]);
    // The next one knows nothing of the person any more.
    let next = bytes(&app, "psych-ds.zip").await;
    let next = self::files(next);
    assert!(!next["data/study-moods_data.csv"].contains("sure"));
    assert!(next["data/study-moods_description-participants_data.csv"].contains("withdrawn"));
    app.stop().await;
}
