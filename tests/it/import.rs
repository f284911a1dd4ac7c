//! Answers from elsewhere, by the command: all of a file or none.

use riskaware::{
    clock::Clock,
    jobs::Catalogue,
    store::{AnswerKey, AnswerRow, AnswerStatus, Error, ImportedRun, Options, Population, Store},
    study,
};
use sqlx::{Connection, SqliteConnection, sqlite::SqliteConnectOptions};
use tempfile::TempDir;

use crate::program::{riskaware, stderr, stdout};

struct Place {
    folder: TempDir,
    store: Store,
}

impl Place {
    /// A database that a server holds.
    async fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let store = Store::open(Options::at(folder.path().join("test.db")), Clock::start())
            .await
            .unwrap();
        let files = study::built_in()
            .into_iter()
            .chain([("between.toml", include_str!("../data/between.toml"))])
            .map(|(name, text)| (name.to_owned(), text.to_owned()))
            .collect();
        Catalogue::publish(&store, files).await.unwrap();
        Self { folder, store }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// What the command prints, or its error.
    fn imports(&self, csv: &str, mapping: Option<&str>) -> Result<String, String> {
        self.imports_from("lab-2019", csv, mapping)
    }

    fn imports_from(
        &self,
        source: &str,
        csv: &str,
        mapping: Option<&str>,
    ) -> Result<String, String> {
        self.imports_bytes("driving", source, csv.as_bytes(), mapping)
    }

    fn imports_bytes(
        &self,
        study: &str,
        source: &str,
        csv: &[u8],
        mapping: Option<&str>,
    ) -> Result<String, String> {
        std::fs::write(self.path("answers.csv"), csv).unwrap();
        let (file, database, map) = (
            self.path("answers.csv"),
            self.path("test.db"),
            self.path("map.toml"),
        );
        let mut arguments = vec![
            "import",
            study,
            "--file",
            &file,
            "--source",
            source,
            "--database",
            &database,
        ];
        if let Some(mapping) = mapping {
            std::fs::write(&map, mapping).unwrap();
            arguments.extend(["--map", &map]);
        }
        let output = riskaware(&arguments, "");
        if output.status.success() {
            Ok(stdout(&output))
        } else {
            Err(stderr(&output))
        }
    }

    async fn answers(&self) -> Vec<AnswerRow> {
        self.answers_to("driving").await
    }

    async fn answers_to(&self, study: &str) -> Vec<AnswerRow> {
        self.store
            .answers(&study.into(), Population::People, AnswerKey::START, 1_000)
            .await
            .unwrap()
    }
}

const LONG: &str =
    "participant,problem,action,status,shown_at_ms,answered_at_ms,client_rt_ms,input,run_state
a,explicit/timed/low,accelerate,answered,1000000,1002500,2400,mouse,completed
a,explicit/timed/high,stop,late,1010000,1020500,,,completed
a,implicit/timed/high,,timed_out,1030000,1040000,,,completed
a,explicit/untimed/low,stop,answered,,1050000,1500,keyboard,completed
b,explicit/untimed/low,accelerate,,,,,,active
";

#[tokio::test]
async fn a_file_in_the_long_form_is_stored_counted_and_agrees_with_its_events() {
    let place = Place::new().await;
    let told = place.imports(LONG, None).unwrap();
    assert!(told.starts_with("5 answers of 2 people"), "{told}");
    let answers = place.answers().await;
    let statuses: Vec<AnswerStatus> = answers.iter().map(|answer| answer.status).collect();
    use AnswerStatus::{Answered, Late, TimedOut};
    assert_eq!(statuses, [Answered, Late, TimedOut, Answered, Answered]);
    assert_eq!(answers[0].server_ms, Some(2_500));
    assert_eq!(answers[0].client_rt_ms, Some(2_400));
    assert_eq!(answers[0].source.as_deref(), Some("lab-2019"));
    assert!(answers.iter().all(|answer| answer.is_counted));
    let totals = place
        .store
        .totals(&"driving".into(), Population::People)
        .await
        .unwrap();
    assert_eq!((totals.started, totals.completed), (2, 1));
    assert_eq!(place.store.check_answers().await.unwrap(), []);
    assert_eq!(place.store.check_counters().await.unwrap(), []);

    let again = place.imports(LONG, None).unwrap_err();
    assert!(again.contains("were imported before: a, b"), "{again}");
    assert_eq!(place.answers().await.len(), 5);
    // Another lab's people have the same names.
    place.imports_from("other-lab", LONG, None).unwrap();
    assert_eq!(place.answers().await.len(), 10);
    place.store.close().await;
}

#[tokio::test]
async fn other_words_are_mapped() {
    let place = Place::new().await;
    let csv = "Subject,Info,Limit,Odds,Answer\n1,told,no,5 %,2\n2,told,no,95 %,1\n";
    let mapping = r#"
        [columns]
        participant = "Subject"
        information = "Info"
        time = "Limit"
        risk = "Odds"
        action = "Answer"
        [values.information]
        told = "explicit"
        [values.time]
        no = "untimed"
        [values.risk]
        "5 %" = "low"
        "95 %" = "high"
        [values.action]
        1 = "stop"
        2 = "accelerate"
    "#;
    place.imports(csv, Some(mapping)).unwrap();
    let answers: Vec<(String, String)> = place
        .answers()
        .await
        .into_iter()
        .map(|answer| {
            let action = answer.action.unwrap().to_string();
            (answer.problem.unwrap(), action)
        })
        .collect();
    let expected = [
        ("explicit/untimed/low", "accelerate"),
        ("explicit/untimed/high", "stop"),
    ];
    assert_eq!(
        answers,
        expected.map(|(problem, action)| (problem.to_owned(), action.to_owned()))
    );
    let refused = place
        .imports(csv, Some("[columns]\ncolour = \"Odds\""))
        .unwrap_err();
    assert!(
        refused.contains("column `colour` is none of ours"),
        "{refused}"
    );
    place.store.close().await;
}

#[tokio::test]
async fn one_faulty_row_refuses_the_file_and_all_that_is_wrong_is_told() {
    let place = Place::new().await;
    let csv = "participant,problem,block,action,status,shown_at_ms,answered_at_ms,input
a,explicit/untimed/low,,stop,answered,,,
,explicit/untimed/low,,stop,answered,,,
a,explicit/untimed/medium,,stop,answered,,,
a,explicit/untimed/high,,turn,answered,,,
a,explicit/timed/low,,stop,answered,,,
b,explicit/timed/high,,stop,answered,1000,99000,
a,explicit/untimed/low,,accelerate,answered,,,
c,explicit/untimed/low,timed,stop,skipped,,soon,foot
c,,,stop,answered,9000,8000,
d,implicit/untimed/low,,stop,answered,1000,,
";
    let told = place.imports(csv, None).unwrap_err();
    for expected in [
        "13 cells",
        "line 3, column participant",
        "line 4, column problem: found `explicit/untimed/medium`",
        "line 5, column action: found `turn`; allowed: accelerate, stop",
        "line 6, column server_ms",
        "line 7, column status: found `answered`; allowed: late",
        "line 8, column problem: found `explicit/untimed/low`; allowed: one answer per",
        "line 9, column block: found `timed`; allowed: untimed, which ask explicit/untimed/low",
        "line 9, column status: found `skipped`",
        "line 9, column answered_at_ms: found `soon`; allowed: a moment",
        "line 9, column input: found `foot`; allowed: mouse",
        "line 10, column problem: found ``",
        "line 10, column shown_at_ms: found `9000`; allowed: a moment before",
        "line 11, column answered_at_ms: found ``",
    ] {
        assert!(told.contains(expected), "{expected} in {told}");
    }
    assert_eq!(place.answers().await, []);
    place.store.close().await;
}

#[tokio::test]
async fn of_many_faults_the_first_are_told_and_the_others_counted() {
    let place = Place::new().await;
    let rows: String = (0..250)
        .map(|person| format!("{person},explicit/untimed/low,turn\n"))
        .collect();
    let told = place
        .imports(&format!("participant,problem,action\n{rows}"), None)
        .unwrap_err();
    for expected in ["250 cells", "line 101, column action", "and 150 more"] {
        assert!(told.contains(expected), "{expected} in {told}");
    }
    assert!(!told.contains("line 102,"), "{told}");
    place.store.close().await;
}

#[tokio::test]
async fn times_that_a_file_does_not_tell_are_nowhere_made_up() {
    let place = Place::new().await;
    let csv = "participant,problem,action,status,server_ms,shown_at_ms,answered_at_ms
a,explicit/untimed/low,stop,answered,,,
a,explicit/timed/low,stop,answered,2500,,
b,explicit/untimed/low,stop,answered,,,2019-05-03T10:20:00Z
b,explicit/untimed/high,stop,answered,4000,,1556878600000
";
    place.imports(csv, None).unwrap();
    let times: Vec<_> = place
        .answers()
        .await
        .into_iter()
        .map(|answer| {
            let moments = [answer.shown_at, answer.answered_at];
            (moments.map(|at| at.map(|at| at.0)), answer.server_ms)
        })
        .collect();
    // In the order in which they were given, where that is known.
    assert_eq!(
        times,
        [
            ([None, None], None),
            ([None, None], Some(2_500)),
            (
                [Some(1_556_878_596_000), Some(1_556_878_600_000)],
                Some(4_000)
            ),
            ([None, Some(1_556_878_800_000)], None),
        ]
    );
    let driving = "driving".into();
    let people = Population::People;
    let runs = place
        .store
        .moment()
        .await
        .unwrap()
        .participants(&driving, people, 0.into(), i64::MAX.into(), 10)
        .await
        .unwrap();
    let known: Vec<bool> = runs.iter().map(|run| run.started_at.is_some()).collect();
    assert_eq!(known, [false, true]);
    assert_eq!(runs[0].finished_at, None);
    // Nobody was as fast as the import, and what was measured elsewhere is in no median of this server.
    let median = place.store.median_duration_ms(&driving, people).await;
    assert_eq!(median.unwrap(), None);
    let last = place.store.last_answer(&driving, people).await.unwrap();
    assert_eq!(last.unwrap().0, 1_556_878_800_000);
    assert_eq!(place.store.check_answers().await.unwrap(), []);

    let mixed = "participant,problem,action,answered_at_ms
c,explicit/untimed/low,stop,1556878600000
c,explicit/untimed/high,stop,
";
    let told = place.imports(mixed, None).unwrap_err();
    assert!(
        told.contains("line 3, column answered_at_ms: found ``; allowed: a moment, because"),
        "{told}"
    );
    place.store.close().await;
}

#[tokio::test]
async fn people_get_the_condition_of_their_questions_and_none_has_two() {
    let place = Place::new().await;
    let csv = "participant,problem,action
a,gain/low/small,safe
a,gain/high/small,bold
b,keep/low/large,safe
";
    place
        .imports_bytes("between", "lab-2019", csv.as_bytes(), None)
        .unwrap();
    let runs = place
        .store
        .moment()
        .await
        .unwrap()
        .participants(
            &"between".into(),
            Population::People,
            0.into(),
            i64::MAX.into(),
            10,
        )
        .await
        .unwrap();
    let conditions: Vec<_> = runs
        .iter()
        .map(|run| run.condition.clone().unwrap())
        .collect();
    assert_eq!(conditions, ["gain/small", "keep/large"]);
    let two = "participant,problem,action
c,gain/low/small,safe
c,gain/low/large,safe
";
    let told = place
        .imports_bytes("between", "lab-2019", two.as_bytes(), None)
        .unwrap_err();
    assert!(
        told.contains("line 3, column problem: found `gain/low/large`; allowed: questions of the condition gain/small, in which line 2"),
        "{told}"
    );
    assert_eq!(place.answers_to("between").await.len(), 3);
    place.store.close().await;
}

#[tokio::test]
async fn whoever_was_erased_does_not_come_back_by_the_same_file() {
    let place = Place::new().await;
    place.imports(LONG, None).unwrap();
    let driving = "driving".into();
    for (person, run) in [("a", 1), ("b", 2)] {
        let erased = place.store.erase(&driving, Population::People, run.into());
        erased.await.unwrap();
        // The file without the people that were named before.
        let rest: Vec<&str> = LONG
            .lines()
            .filter(|line| line.starts_with("participant") || line.starts_with(person))
            .collect();
        let told = place.imports(&rest.join("\n"), None).unwrap_err();
        assert!(told.contains("imported before"), "{told}");
    }
    assert_eq!(place.answers().await, []);
    place.store.close().await;
}

#[tokio::test]
async fn files_of_spreadsheets_are_read_and_other_encodings_named() {
    let place = Place::new().await;
    let rows = "participant;problem;action\r\nJörg;explicit/untimed/low;stop\r\n";
    let taken = [
        format!("\u{feff}{rows}").into_bytes(),
        format!("\u{feff}\"participant\";{}", &rows["participant;".len()..]).into_bytes(),
        rows.replace(';', "\t").into_bytes(),
    ];
    for (lab, file) in taken.iter().enumerate() {
        let told = place.imports_bytes("driving", &format!("lab-{lab}"), file, None);
        assert!(told.unwrap().starts_with("1 answers of 1 people"));
    }
    let utf_16: Vec<u8> = format!("\u{feff}{rows}")
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    let latin_1: Vec<u8> = rows.chars().map(|letter| letter as u8).collect();
    let refused = [
        (utf_16, "found `text in UTF-16`"),
        (
            latin_1,
            "line 2, column (the whole file): found `bytes that are no UTF-8`",
        ),
        (Vec::new(), "found `an empty file`"),
        (b"\xef\xbb\xbf\n".to_vec(), "found `an empty file`"),
        (
            rows.replace("stop", "stop;x").into_bytes(),
            "line 2, column (the whole line): found `4 cells`; allowed: 3 cells",
        ),
        (
            rows.replace("action", "action;action").into_bytes(),
            "line 1, column action",
        ),
        (
            rows.replace("stop", "turn").into_bytes(),
            "line 2, column action: found `turn`",
        ),
        (b"<html>".to_vec(), "a header with the column participant"),
    ];
    for (file, expected) in refused {
        let told = place
            .imports_bytes("driving", "lab-9", &file, None)
            .unwrap_err();
        assert!(told.contains(expected), "{expected} in {told}");
    }
    assert_eq!(place.answers().await.len(), 3);
    place.store.close().await;
}

#[tokio::test]
async fn no_row_is_dropped_and_no_end_is_taken_for_another_unless_a_mapping_says_so() {
    let place = Place::new().await;
    let csv = "participant,problem,action,run_state
a,explicit/untimed/low,stop,completed
a,,stop,completed
b,explicit/untimed/low,stop,screened_out
c,explicit/untimed/low,stop,withdrawn
";
    let told = place.imports(csv, None).unwrap_err();
    for expected in [
        "3 cells",
        "line 3, column problem: found ``; allowed: baseline:",
        "line 4, column run_state: found `screened_out`; allowed: completed, active",
        "line 5, column run_state: found `withdrawn`",
    ] {
        assert!(told.contains(expected), "{expected} in {told}");
    }
    let mapping = "[values.run_state]\nscreened_out = \"active\"\nwithdrawn = \"active\"";
    let whole = csv.replace("a,,stop,completed\n", "");
    place.imports(&whole, Some(mapping)).unwrap();
    assert_eq!(place.answers().await.len(), 3);
    place.store.close().await;
}

#[tokio::test]
async fn runs_are_judged_before_the_database_is_held() {
    let place = Place::new().await;
    let driving = "driving".into();
    let version = place.store.study(&driving).await.unwrap().version;
    let file = SqliteConnectOptions::new().filename(place.path("test.db"));
    let mut other = SqliteConnection::connect_with(&file).await.unwrap();
    sqlx::query("begin immediate")
        .execute(&mut other)
        .await
        .unwrap();
    let nobody = ImportedRun {
        participant: "a".to_owned(),
        answers: Vec::new(),
        condition: None,
        has_times: true,
        is_completed: true,
    };
    let imported = place
        .store
        .import(&driving, version, "lab-2019", vec![nobody])
        .await;
    assert!(matches!(imported, Err(Error::Refused(_))), "{imported:?}");
    other.close().await.unwrap();
    place.store.close().await;
}

#[tokio::test]
async fn what_was_exported_is_imported_elsewhere_with_the_same_counts() {
    let here = Place::new().await;
    here.imports(LONG, None).unwrap();
    let (database, out) = (here.path("test.db"), here.path("long.csv"));
    let exported = riskaware(
        &[
            "export",
            "driving",
            "--format",
            "long",
            "--out",
            &out,
            "--database",
            &database,
        ],
        "",
    );
    assert!(exported.status.success(), "{}", stderr(&exported));
    let there = Place::new().await;
    there
        .imports(&std::fs::read_to_string(&out).unwrap(), None)
        .unwrap();
    let driving = "driving".into();
    assert_eq!(
        there
            .store
            .cell_counts(&driving, Population::People)
            .await
            .unwrap(),
        here.store
            .cell_counts(&driving, Population::People)
            .await
            .unwrap()
    );
    // The same name is no way to overwrite a file.
    let again = riskaware(
        &["export", "driving", "--out", &out, "--database", &database],
        "",
    );
    assert!(!again.status.success());
    here.store.close().await;
    there.store.close().await;
}
