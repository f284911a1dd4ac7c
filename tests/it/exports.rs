//! Exports over HTTP: all forms, the same bytes twice, and the rules of the Psych-DS standard.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Cursor, Read};
use std::sync::Arc;

use reqwest::{StatusCode, header};
use riskaware::{
    clock::Clock,
    jobs::{Catalogue, Snapshot},
    store::{Population, StudyState},
};
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::{
    app::{App, START},
    crowd::{Background, drives, until},
    evidence::driving,
    program::{riskaware, stderr},
};

/// Three people: one finished with words that look like a formula, one is under way, one withdrew.
async fn with_people() -> App {
    let app = App::start().await;
    let mut first = app.participant("?PROLIFIC_PID=5f3&source=@pilot").await;
    first
        .proceeds("stop", |person| {
            person.page.attribute("[name=country]", "name").is_some()
        })
        .await;
    first.sends("country", "=1+1").await;
    assert!(first.page.text(".completion__code").is_some());
    let mut second = app.participant("").await;
    second
        .proceeds("accelerate", |person| {
            person.block().as_deref() == Some("untimed")
        })
        .await;
    let mut third = app.participant("").await;
    third
        .proceeds("stop", |person| person.block().as_deref() == Some("timed"))
        .await;
    app.store.withdraw(&third.token()).await.unwrap();
    app
}

async fn bytes(app: &App, path: &str) -> Vec<u8> {
    let url = format!("{}/api/v1/studies/driving/{path}", app.url);
    let response = app.client.get(url).send().await.unwrap();
    assert_eq!(response.status(), StatusCode::OK, "{path}");
    response.bytes().await.unwrap().to_vec()
}

struct Table {
    header: Vec<String>,
    rows: Vec<BTreeMap<String, String>>,
}

fn table(bytes: &[u8]) -> Table {
    // Rows of other lengths than the header's are errors.
    let mut reader = csv::Reader::from_reader(bytes);
    let header: Vec<String> = reader
        .headers()
        .unwrap()
        .iter()
        .map(str::to_owned)
        .collect();
    let rows = reader
        .records()
        .map(|record| {
            let record = record.unwrap();
            header
                .iter()
                .cloned()
                .zip(record.iter().map(str::to_owned))
                .collect()
        })
        .collect();
    Table { header, rows }
}

fn files(archive: Vec<u8>) -> BTreeMap<String, Vec<u8>> {
    let mut archive = zip::ZipArchive::new(Cursor::new(archive)).unwrap();
    (0..archive.len())
        .map(|index| {
            let mut file = archive.by_index(index).unwrap();
            let mut contents = Vec::new();
            file.read_to_end(&mut contents).unwrap();
            (file.name().unwrap().into_owned(), contents)
        })
        .collect()
}

const FORMS: [&str; 8] = [
    "answers.csv",
    "export/wide.csv",
    "answers.ndjson",
    "export/codebook.csv",
    "export/codebook.json",
    "export/bonus.csv",
    "export/psych-ds.zip",
    "export/analysis.json",
];

#[tokio::test]
async fn the_same_data_are_the_same_bytes() {
    let app = with_people().await;
    for form in FORMS {
        let first = bytes(&app, form).await;
        assert!(!first.is_empty(), "{form}");
        app.clock.advance(3_600_000);
        assert!(first == bytes(&app, form).await, "{form}");
    }
    app.stop().await;
}

#[tokio::test]
async fn the_log_tells_who_took_what_with_which_ids() {
    let app = with_people().await;
    bytes(&app, "export/wide.csv").await;
    bytes(&app, "export/wide.csv?ids=hashed").await;
    let out = tempfile::tempdir().unwrap();
    let (copy, file) = (out.path().join("copy.db"), out.path().join("wide.csv"));
    let database = app.store.path().to_str().unwrap();
    for arguments in [
        [
            "export",
            "driving",
            "--format",
            "wide",
            "--ids",
            "hashed",
            "--out",
            file.to_str().unwrap(),
        ]
        .as_slice(),
        &["backup", copy.to_str().unwrap()],
    ] {
        let output = riskaware(&[arguments, &["--database", database]].concat(), "");
        assert!(output.status.success(), "{}", stderr(&output));
    }
    let rows = app.store.audit(None, 100).await.unwrap();
    let told: Vec<_> = rows
        .iter()
        .rev()
        .map(|row| {
            (
                row.entry.actor.as_str(),
                row.entry.action.as_str(),
                row.entry.detail.as_deref(),
            )
        })
        .collect();
    let expected = [
        ("nobody", "export wide.csv", None),
        ("nobody", "export wide.csv", Some("ids hashed")),
        ("command", "export wide", Some("ids hashed")),
        ("command", "back up the database", copy.to_str()),
    ];
    assert_eq!(told, expected);
    app.stop().await;
}

#[tokio::test]
async fn the_wide_table_has_everybody_once_and_says_why_a_cell_is_empty() {
    let app = with_people().await;
    let wide = table(&bytes(&app, "export/wide.csv").await);
    let long = table(&bytes(&app, "answers.csv").await);
    let states: Vec<&str> = wide
        .rows
        .iter()
        .map(|row| row["run_state"].as_str())
        .collect();
    assert_eq!(states, ["completed", "active", "withdrawn"]);
    assert_eq!(wide.rows[0]["about-you.country"], "'=1+1");
    assert_eq!(wide.rows[0]["source"], "'@pilot");
    assert_eq!(wide.rows[0]["about-you.status"], "answered");
    assert_eq!(wide.rows[1]["about-you.status"], "not_shown");
    assert_eq!(wide.rows[2]["about-you.status"], "withdrawn");
    assert_eq!(wide.rows[0]["consent.agreed"], "true");
    assert_eq!(wide.rows[2]["consent.agreed"], "");
    // Both tables tell the same choices.
    assert!(long.rows.len() > 12);
    for row in &long.rows {
        let participant = wide
            .rows
            .iter()
            .find(|wide| wide["participant"] == row["participant"])
            .unwrap();
        let cell =
            |what: &str| &participant[&format!("{}.{}.{what}", row["block"], row["question"])];
        assert_eq!(cell("action"), &row["action"]);
        assert_eq!(cell("status"), &row["status"]);
        assert_eq!(cell("server_ms"), &row["server_ms"]);
    }
    let told = wide.rows.iter().flat_map(|row| {
        row.iter()
            .filter(|(name, status)| name.ends_with(".status") && *status == "answered")
    });
    assert_eq!(
        told.filter(|(name, _)| name.matches('.').count() == 2)
            .count(),
        long.rows.len()
    );
    app.stop().await;
}

#[tokio::test]
async fn ids_are_left_out_unless_asked_for_and_plain_ones_only_where_they_are_stored() {
    let app = with_people().await;
    let wide = bytes(&app, "export/wide.csv").await;
    assert!(!String::from_utf8(wide).unwrap().contains("5f3"));
    let hashed = table(&bytes(&app, "export/wide.csv?ids=hashed").await);
    assert_eq!(hashed.rows[0]["platform"], "prolific");
    assert_eq!(hashed.rows[0]["platform_key"].len(), 64);
    assert_eq!(hashed.rows[1]["platform_key"], "");
    for (ids, status) in [("plain", 409), ("all", 400)] {
        let url = format!(
            "{}/api/v1/studies/driving/export/wide.csv?ids={ids}",
            app.url
        );
        let response = app.client.get(url).send().await.unwrap();
        assert_eq!(response.status().as_u16(), status);
    }
    app.stop().await;

    let plain = riskaware::study::built_in()
        .into_iter()
        .map(|(name, text)| {
            assert!(text.contains("ids = \"hashed\"") || name != "driving.toml");
            let text = text.replace("ids = \"hashed\"", "ids = \"plain\"");
            (name.to_owned(), text)
        })
        .collect();
    let app = App::with(Clock::manual(START), plain).await;
    app.participant("?PROLIFIC_PID=5f3").await;
    let wide = table(&bytes(&app, "export/wide.csv?ids=plain").await);
    assert_eq!(wide.rows[0]["platform_id"], "5f3");
    app.stop().await;
}

#[tokio::test]
async fn the_codebook_describes_every_column_on_a_page_too() {
    let app = with_people().await;
    let codebook: Value =
        serde_json::from_slice(&bytes(&app, "export/codebook.json").await).unwrap();
    let page = app.get("/results/driving/codebook").await;
    assert_eq!(page.status, StatusCode::OK);
    let shown = page.texts("tbody th");
    let mut described = Vec::new();
    for (name, form) in [
        ("answers", "answers.csv"),
        ("participants", "export/wide.csv"),
    ] {
        let header = table(&bytes(&app, form).await).header;
        let tables = codebook["tables"].as_array().unwrap();
        let columns = tables.iter().find(|table| table["name"] == name).unwrap()["columns"]
            .as_array()
            .unwrap();
        let names: Vec<&str> = columns
            .iter()
            .map(|column| column["name"].as_str().unwrap())
            .collect();
        assert_eq!(names, header);
        for column in columns {
            for text in ["label", "description", "type"] {
                assert!(!column[text].as_str().unwrap().is_empty(), "{column}");
            }
            if column["type"] == "level" {
                assert!(!column["levels"].as_array().unwrap().is_empty(), "{column}");
            }
        }
        described.extend(header);
    }
    assert_eq!(shown, described);
    // Every level that occurs is described.
    let wide = table(&bytes(&app, "export/wide.csv").await);
    for column in codebook["tables"][1]["columns"].as_array().unwrap() {
        if column["type"] != "level" {
            continue;
        }
        let levels: BTreeSet<&str> = column["levels"]
            .as_array()
            .unwrap()
            .iter()
            .map(|level| level["code"].as_str().unwrap())
            .collect();
        for row in &wide.rows {
            let value = &row[column["name"].as_str().unwrap()];
            assert!(
                value.is_empty() || levels.contains(value.as_str()),
                "{column}: {value}"
            );
        }
    }
    app.stop().await;
}

/// The rules whose breach the standard's schema (1.5.1, github.com/psych-ds/psych-DS, schema_model/versions) calls an
/// error, and its recommendations for file names and objects.
#[tokio::test]
async fn the_archive_follows_the_psych_ds_schema() {
    let app = with_people().await;
    let response = app
        .client
        .get(format!(
            "{}/api/v1/studies/driving/export/psych-ds.zip",
            app.url
        ))
        .send()
        .await
        .unwrap();
    assert_eq!(response.headers()[header::CONTENT_TYPE], "application/zip");
    let files = files(response.bytes().await.unwrap().to_vec());

    // MISSING_DATASET_DESCRIPTION, JSON_INVALID, JSON_KEY_REQUIRED, INCORRECT_DATASET_TYPE
    let description: Value = serde_json::from_slice(&files["dataset_description.json"]).unwrap();
    assert_eq!(description["@context"], "https://schema.org/");
    assert_eq!(description["@type"], "Dataset");
    for required in ["name", "description"] {
        assert!(!description[required].as_str().unwrap().is_empty());
    }
    // WRONG_METADATA_LOCATION, MISSING_README_DOC, MISSING_CHANGES_DOC, FILE_EMPTY
    for file in ["README.md", "CHANGES.md"] {
        assert!(files.contains_key(file));
    }
    for (path, contents) in &files {
        assert!(!contents.is_empty(), "{path} is empty");
        let is_metadata = path.ends_with("dataset_description.json");
        assert!(!is_metadata || path == "dataset_description.json");
    }
    // MISSING_DATA_DIRECTORY, MISSING_DATAFILE, FILENAME_KEYWORD_FORMATTING_ERROR
    let official = [
        "study",
        "site",
        "subject",
        "session",
        "task",
        "condition",
        "trial",
        "stimulus",
        "description",
    ];
    let data: Vec<&String> = files
        .keys()
        .filter(|path| path.starts_with("data/"))
        .collect();
    assert_eq!(data.len(), 2);
    let mut columns = BTreeSet::new();
    for path in data {
        let name = path.strip_prefix("data/").unwrap();
        let pairs = name.strip_suffix("_data.csv").unwrap();
        for pair in pairs.split('_') {
            let (keyword, value) = pair.split_once('-').unwrap();
            assert!(official.contains(&keyword), "{path}");
            assert!(
                !value.is_empty() && value.chars().all(|letter| letter.is_ascii_alphanumeric()),
                "{path}"
            );
        }
        // CSV_HEADER_MISSING, CSV_FORMATTING_ERROR, CSV_HEADER_LENGTH_MISMATCH
        let table = table(&files[path]);
        let distinct: BTreeSet<&String> = table.header.iter().collect();
        assert_eq!(distinct.len(), table.header.len());
        // ROWID_VALUES_NOT_UNIQUE, and the keys that the README names
        assert!(!table.header.iter().any(|name| name == "row_id"));
        let keys: BTreeSet<(&str, &str)> = table
            .rows
            .iter()
            .map(|row| {
                let position = row.get("position").map_or("", String::as_str);
                (row["participant"].as_str(), position)
            })
            .collect();
        assert_eq!(keys.len(), table.rows.len());
        columns.extend(table.header);
    }
    // CSV_COLUMN_MISSING_FROM_METADATA, VARIABLE_MISSING_FROM_CSV_COLUMNS, OBJECT_TYPE_MISSING
    let variables = description["variableMeasured"].as_array().unwrap();
    let described: BTreeSet<String> = variables
        .iter()
        .map(|variable| variable["name"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(described.len(), variables.len(), "a name stands once");
    assert_eq!(described, columns);
    for variable in variables {
        assert_eq!(variable["@type"], "PropertyValue");
        assert!(!variable["description"].as_str().unwrap().is_empty());
    }

    // Our own promise: the manifest tells rows and hash of every other file.
    let manifest: Value = serde_json::from_slice(&files["documentation/manifest.json"]).unwrap();
    let listed = manifest["files"].as_array().unwrap();
    assert_eq!(listed.len(), files.len() - 1);
    for entry in listed {
        let path = entry["path"].as_str().unwrap();
        let contents = &files[path];
        assert_eq!(entry["bytes"], contents.len());
        let hash = data_encoding::HEXLOWER.encode(&Sha256::digest(contents));
        assert_eq!(entry["sha256"], hash, "{path}");
        if path.ends_with(".csv") {
            assert_eq!(entry["rows"], table(contents).rows.len(), "{path}");
        }
    }
    let (_, study) = riskaware::study::built_in()
        .into_iter()
        .find(|(name, _)| *name == "driving.toml")
        .unwrap();
    // It is the first version of its study, whatever other studies the database holds.
    assert_eq!(files["materials/study-version-1.toml"], study.as_bytes());
    app.stop().await;
}

#[tokio::test]
async fn the_analysis_counts_final_fits_alone_and_carries_its_hash() {
    let app = with_people().await;
    let text = String::from_utf8(bytes(&app, "export/analysis.json").await).unwrap();
    let value: Value = serde_json::from_str(&text).unwrap();
    let body = text.lines().nth(1).unwrap();
    let hash = data_encoding::HEXLOWER.encode(&Sha256::digest(body));
    assert_eq!(value["sha256"], hash);
    // Nothing is fitted on this server.
    let analysis = &value["analysis"];
    assert_eq!(analysis["is_complete"], false);
    assert_eq!(analysis["fits"].as_array().unwrap().len(), 0);
    let left_out = analysis["left_out"].as_array().unwrap();
    assert!(left_out.iter().all(|part| part["reason"] == "missing"));
    assert!(!left_out.is_empty());
    assert_eq!(analysis["study"]["hash"].as_str().unwrap().len(), 64);
    app.stop().await;
}

/// What a paper cites: two servers with the same answers, one of which fitted on the way, freeze the same bytes.
#[tokio::test(flavor = "multi_thread")]
async fn the_same_answers_are_the_same_analysis() {
    let mut analyses = Vec::new();
    for is_live in [true, false] {
        let app = App::with(Clock::manual(START), driving("")).await;
        let catalogue = Catalogue::publish(&app.store, driving("")).await.unwrap();
        let catalogue = Arc::new(catalogue);
        let id = "driving".into();
        let mut background = None;
        for people in [0..3, 3..5] {
            if is_live {
                background.get_or_insert_with(|| Background::start(&app.store, &catalogue));
            }
            drives(&app.store, &catalogue, people, 2).await;
        }
        app.store
            .set_study_state(&id, StudyState::Closed)
            .await
            .unwrap();
        let _background = background.unwrap_or_else(|| Background::start(&app.store, &catalogue));
        until(&app.store, async || {
            let snapshot = Snapshot::read(&app.store, &catalogue, Population::People, &id)
                .await
                .unwrap()
                .unwrap();
            snapshot.is_final()
                && snapshot.comparison(&"all".into()).is_some()
                && snapshot.sequential().is_none_or(|looks| !looks.is_behind)
        })
        .await;
        let text = bytes(&app, "export/analysis.json").await;
        let value: Value = serde_json::from_slice(&text).unwrap();
        assert_eq!(
            value["analysis"]["is_complete"], true,
            "{}",
            value["analysis"]["left_out"]
        );
        for fit in value["analysis"]["fits"].as_array().unwrap() {
            assert_eq!(fit["summary"]["provisional"], false);
            assert_eq!(fit["draws_sha256"].as_str().unwrap().len(), 64);
        }
        analyses.push(text);
        app.stop().await;
    }
    let [live, cold] = analyses.as_slice() else {
        panic!("two servers");
    };
    let values = [live, cold].map(|text| serde_json::from_slice::<Value>(text).unwrap());
    assert_eq!(
        differences("", &values[0]["analysis"], &values[1]["analysis"]),
        Vec::<String>::new()
    );
    assert!(live == cold);
}

/// Where two values differ.
fn differences(path: &str, one: &Value, other: &Value) -> Vec<String> {
    match (one, other) {
        (Value::Object(one), Value::Object(other)) if one.keys().eq(other.keys()) => one
            .iter()
            .flat_map(|(name, value)| differences(&format!("{path}/{name}"), value, &other[name]))
            .collect(),
        (Value::Array(one), Value::Array(other)) if one.len() == other.len() => one
            .iter()
            .zip(other)
            .enumerate()
            .flat_map(|(index, (one, other))| differences(&format!("{path}/{index}"), one, other))
            .collect(),
        _ if one == other => Vec::new(),
        _ => vec![
            format!("{path}: {one} and {other}")
                .chars()
                .take(300)
                .collect(),
        ],
    }
}
