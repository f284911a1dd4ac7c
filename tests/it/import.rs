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
        std::fs::write(self.path("answers.csv"), csv).unwrap();
        let (file, database, map) = (
            self.path("answers.csv"),
            self.path("test.db"),
            self.path("map.toml"),
        );
        let mut arguments = vec![
            "import",
            "driving",
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
        self.store
            .answers(
                &"driving".into(),
                Population::People,
                AnswerKey::START,
                1_000,
            )
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
async fn a_column_that_stands_twice_is_refused() {
    let place = Place::new().await;
    let csv =
        "participant,problem,action,status,status\na,explicit/untimed/low,stop,answered,low\n";
    let told = place.imports(csv, None).unwrap_err();
    assert!(
        told.contains("line 1, column status")
            && told.contains("a header that names the column status once"),
        "{told}"
    );
    assert_eq!(place.answers().await, []);
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
async fn one_faulty_row_refuses_the_file_and_all_are_told() {
    let place = Place::new().await;
    let csv = "participant,problem,action,status,shown_at_ms,answered_at_ms
a,explicit/untimed/low,stop,answered,,
,explicit/untimed/low,stop,answered,,
a,explicit/untimed/medium,stop,answered,,
a,explicit/untimed/high,turn,answered,,
a,explicit/timed/low,stop,answered,,
a,explicit/timed/high,stop,answered,1000,99000
a,explicit/untimed/low,accelerate,answered,,
b,explicit/untimed/low,stop,skipped,,
b,explicit/untimed/high,stop,answered,,soon
";
    let told = place.imports(csv, None).unwrap_err();
    for expected in [
        "8 cells",
        "line 3, column participant",
        "line 4, column problem: found `explicit/untimed/medium`",
        "line 5, column action: found `turn`; allowed: accelerate, stop",
        "line 6, column server_ms",
        "line 7, column status: found `answered`; allowed: late",
        "line 8, column problem: found `explicit/untimed/low`; allowed: one answer per",
        "line 9, column action: found `stop`",
        "line 10, column answered_at_ms: found `soon`",
    ] {
        assert!(told.contains(expected), "{expected} in {told}");
    }
    assert_eq!(place.answers().await, []);
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
