//! `riskaware study`: a file to start from, its check, and the document that describes its keys.

use std::fs;

use riskaware::study::Study;

use crate::program::{riskaware, stderr, stdout};

fn check(name: &str, text: &str, arguments: &[&str]) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    fs::write(&file, text).unwrap();
    let all = [&["study", "check", file.to_str().unwrap()], arguments].concat();
    let output = riskaware(&all, "");
    (output.status.code(), stdout(&output).to_owned())
}

fn new(arguments: &[&str]) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("my-lights.toml");
    let all = [&["study", "new"], arguments, &[file.to_str().unwrap()]].concat();
    let output = riskaware(&all, "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = fs::read_to_string(&file).unwrap();
    (folder, text)
}

#[test]
fn what_study_new_writes_passes_study_check_under_its_own_id() {
    for arguments in [&[][..], &["--from", "driving"], &["--from", "cups"]] {
        let (_folder, text) = new(arguments);
        assert!(text.contains("id = \"my-lights\""), "{arguments:?}");
        let (status, report) = check("my-lights.toml", &text, &[]);
        assert_eq!(status, Some(0), "{report}");
        assert!(report.contains("Expected duration"), "{report}");
    }
}

#[test]
fn a_file_that_exists_is_kept() {
    let (folder, text) = new(&[]);
    let file = folder.path().join("my-lights.toml");
    let again = riskaware(
        &["study", "new", "--from", "cups", file.to_str().unwrap()],
        "",
    );
    assert_eq!(again.status.code(), Some(1));
    assert_eq!(fs::read_to_string(&file).unwrap(), text);
}

#[test]
fn three_mistakes_are_named_at_once_each_with_its_line() {
    let (_folder, text) = new(&["--from", "driving"]);
    let faulty = text
        .replacen("minutes = 5", "minutes = 0", 1)
        .replacen("expected = \"rarely\"", "expected = \"rarley\"", 1)
        .replacen("limit_s = 8", "limit_s = -8", 1);
    let (status, report) = check("my-lights.toml", &faulty, &[]);
    assert_eq!(status, Some(1));
    for (wrong, key) in [
        ("minutes = 0", "minutes"),
        ("limit_s = -8", "block[timed].limit_s"),
        ("expected = \"rarley\"", "field[attention].expected"),
    ] {
        let line = 1 + faulty
            .lines()
            .position(|line| line.starts_with(wrong))
            .unwrap();
        let named = report
            .lines()
            .find(|told| told.contains(key))
            .unwrap_or_else(|| panic!("{key} is not named in {report}"));
        assert!(named.contains(&format!(", line {line}, ")), "{named}");
        assert!(named.contains("allowed: "), "{named}");
    }
    assert!(report.contains("did you mean `rarely`?"), "{report}");
    let (status, json) = check("my-lights.toml", &faulty, &["--json"]);
    assert_eq!(status, Some(1));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["errors"].as_array().unwrap().len(), 3);
    assert!(json["errors"][0]["line"].is_u64());
}

#[test]
fn dates_that_are_past_are_warned_of_with_their_line() {
    let (_folder, text) = new(&[]);
    let over = format!(
        "{text}\n[recruiting]\nopens = 2019-01-01\ncloses = 2020-01-31\nretention = 2021-01-31T12:00:00Z\n"
    );
    let last = over.lines().count();
    let (status, report) = check("my-lights.toml", &over, &[]);
    assert_eq!(status, Some(0), "{report}");
    for expected in [
        format!(
            "line {}, recruiting.closes: 2020-02-01T00:00:00Z is past",
            last - 1
        ),
        format!("line {last}, recruiting.retention: 2021-01-31T12:00:00Z is past"),
    ] {
        assert!(report.contains(&expected), "{expected} in {report}");
    }
    let ahead = over.replace("2020-", "2920-").replace("2021-", "2921-");
    let (_, report) = check("my-lights.toml", &ahead, &[]);
    assert!(!report.contains("is past"), "{report}");
    let never = over
        .replace("closes = 2020-01-31\n", "")
        .replace("2019-", "2029-");
    let (status, report) = check("my-lights.toml", &never, &[]);
    assert_eq!(status, Some(1));
    assert!(
        report.contains(
            "recruiting.retention: found 2021-01-31T12:00:00Z; allowed: a date after `opens`"
        ),
        "{report}"
    );
}

#[test]
fn several_files_and_folders_are_checked_each_under_its_name() {
    let (folder, text) = new(&[]);
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::write(
        path("other.toml"),
        text.replace("id = \"my-lights\"", "id = \"other\""),
    )
    .unwrap();
    fs::write(path("notes.txt"), "no study").unwrap();
    let files = folder.path().to_str().unwrap();
    let checks = |arguments: &[&str]| {
        let output = riskaware(&[&["study", "check"], arguments].concat(), "");
        (output.status.code(), stdout(&output).to_owned())
    };
    let (status, report) = checks(&[files]);
    assert_eq!(status, Some(0), "{report}");
    for part in [
        format!("== {}\n", path("my-lights.toml")),
        format!("== {}\n", path("other.toml")),
        "2 files, none is refused".to_owned(),
    ] {
        assert!(report.contains(&part), "{part} in {report}");
    }
    assert!(!report.contains("notes.txt"), "{report}");

    fs::write(path("twice.toml"), &text).unwrap();
    let (status, report) = checks(&[
        &path("my-lights.toml"),
        &path("twice.toml"),
        &path("gone.toml"),
    ]);
    assert_eq!(status, Some(1));
    for part in [
        format!(
            "twice.toml, id: found `my-lights`, which {} has",
            path("my-lights.toml")
        ),
        "gone.toml: found No such file".to_owned(),
        "3 files, 2 refused".to_owned(),
    ] {
        assert!(report.contains(&part), "{part} in {report}");
    }
    let (status, json) = checks(&[files, "--json"]);
    assert_eq!(status, Some(1));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let mistakes: Vec<usize> = json
        .as_array()
        .unwrap()
        .iter()
        .map(|file| file["errors"].as_array().unwrap().len())
        .collect();
    assert_eq!(mistakes, [0, 0, 1]);

    let empty = tempfile::tempdir().unwrap();
    let output = riskaware(&["study", "check", empty.path().to_str().unwrap()], "");
    assert!(
        stderr(&output).contains("holds no study file"),
        "{output:?}"
    );
}

#[test]
fn an_unknown_key_at_the_top_does_not_hide_one_in_a_block() {
    let (_folder, text) = new(&[]);
    let faulty = text
        .replacen("minutes = 4", "minuts = 4", 1)
        .replacen("agree = ", "agre = ", 1);
    let (_, report) = check("my-lights.toml", &faulty, &[]);
    assert!(
        report.contains("minuts") && report.contains("agre"),
        "{report}"
    );
    assert!(report.contains("2 mistakes"), "{report}");
}

#[test]
fn the_check_warns_of_what_the_design_cannot_tell() {
    let (_folder, text) = new(&["--from", "driving"]);
    let equal = text.replacen("\nfine = 50", "\nfine = 25", 1);
    let (_, json) = check("my-lights.toml", &equal, &["--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let warnings: Vec<&str> = json["warnings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|warning| warning.as_str().unwrap())
        .collect();
    let warns = |parts: &[&str]| {
        let found = warnings
            .iter()
            .any(|warning| parts.iter().all(|part| warning.contains(part)));
        assert!(found, "{parts:?} in {warnings:#?}");
    };
    warns(&["cell explicit/timed/low", "equal"]);
    warns(&["risk_aware", "\u{3b1}"]);
    warns(&["contact"]);
    // Its losses have two probabilities.
    assert!(!warnings.iter().any(|warning| warning.contains("one point")));
    let high = json["cells"]
        .as_array()
        .unwrap()
        .iter()
        .find(|cell| cell["id"] == "explicit/timed/high")
        .unwrap();
    assert_eq!(high["expected_rewards"]["accelerate"], -475.0);
    assert_eq!(high["expected_rewards"]["stop"], -25.0);
}

#[test]
fn a_study_without_consent_or_attention_check_is_warned_of() {
    let (_folder, text) = new(&[]);
    let start = text.find("[[block]]\nkind = \"consent\"").unwrap();
    let end = text.find("[[block]]\nkind = \"info\"").unwrap();
    let bare = format!("{}{}", &text[..start], &text[end..]).replace(", expected = 4", "");
    let (status, report) = check("my-lights.toml", &bare, &[]);
    assert_eq!(status, Some(0), "{report}");
    assert!(report.contains("no block of kind `consent`"), "{report}");
    assert!(report.contains("no attention check"), "{report}");
}

#[test]
fn the_check_lists_what_is_not_translated() {
    let rain = include_str!("../data/languages.toml");
    let (status, report) = check("rain.toml", rain, &[]);
    assert_eq!(status, Some(0), "{report}");
    assert!(!report.contains("language de"), "{report}");
    let partly = rain
        .replacen("\"block[about].title\" = \"Worum es geht\"\n", "", 1)
        .replacen("[\"en\", \"de\"]", "[\"en\", \"de\", \"nl\"]", 1);
    let (status, report) = check("rain.toml", &partly, &[]);
    assert_eq!(status, Some(0), "{report}");
    for warning in [
        "language de: 1 text is shown in `en`, since [text.de] lacks block[about].title",
        "texts are shown in `en`, since [text.nl] lacks title, summary, values.object,",
        "language nl: the program has no words of its own for it",
    ] {
        assert!(report.contains(warning), "{warning} is not in {report}");
    }
}

const DOCUMENT: &str = include_str!("../../docs/STUDY-FORMAT.md");
const PARSER: &str = include_str!("../../src/study/file.rs");

#[test]
fn every_key_that_the_parser_knows_is_in_the_document() {
    let mut keys = 0;
    for line in PARSER.lines() {
        let Some(rest) = line.trim().strip_prefix("pub(super) ") else {
            continue;
        };
        let Some((key, _)) = rest.split_once(": ") else {
            continue;
        };
        keys += 1;
        let is_named = DOCUMENT.contains(&format!("`{key}`"))
            || DOCUMENT.contains(&format!("`[{key}]`"))
            || DOCUMENT.contains(&format!("`[[{key}]]`"));
        assert!(is_named, "the document does not name `{key}`");
    }
    assert!(keys > 100, "{keys} keys were found in the parser");
}

/// An example is a whole file, or stands for a part of the one at the top of the document: its tables are put in place of
/// those with the same first header.
#[test]
fn every_example_in_the_document_parses() {
    let examples: Vec<&str> = DOCUMENT
        .split("```toml\n")
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap())
        .collect();
    assert!(examples.len() > 8, "{} examples", examples.len());
    let whole = examples[0];
    for (index, example) in examples.iter().enumerate() {
        let text = if index == 0 {
            whole.to_owned()
        } else {
            with(whole, example)
        };
        if let Err(error) = Study::check("example.toml", &text) {
            panic!("example {index}: {error:?}\n{example}");
        }
    }
}

/// The whole file with an example's blocks added before the last ones, or its other tables in place of the whole file's.
fn with(whole: &str, example: &str) -> String {
    let header = example.lines().find(|line| line.starts_with('[')).unwrap();
    if header == "[[block]]" {
        return whole.replacen("[completion]", &format!("{example}\n[completion]"), 1);
    }
    let mut text = String::new();
    let mut is_replaced = false;
    for line in whole.lines() {
        if line.starts_with('[') {
            let table = line.trim_matches(['[', ']']);
            let ours = header.trim_matches(['[', ']']);
            // A design brings its own blocks along.
            is_replaced = match ours {
                "factor" => table.starts_with("block"),
                ours => table == ours,
            };
        }
        if !is_replaced {
            text.push_str(line);
            text.push('\n');
        }
    }
    format!("{text}\n{example}")
}
