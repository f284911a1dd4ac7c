//! Backup, restore and the doctor.

use riskaware::clock::Clock;
use riskaware::store::{AnswerKey, Health, Options, Population, Store, back_up, examine, restore};
use riskaware::study::StudyId;
use sqlx::Connection;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use tempfile::TempDir;

use super::lab::Lab;

async fn answers(store: &Store) -> usize {
    let study = StudyId::from("driving");
    store
        .answers(&study, Population::People, AnswerKey::START, 1_000)
        .await
        .unwrap()
        .len()
}

async fn change(path: &std::path::Path, statement: &'static str) {
    let options = SqliteConnectOptions::new()
        .filename(path)
        .foreign_keys(false);
    let mut raw = SqliteConnection::connect_with(&options).await.unwrap();
    let changed = sqlx::query(statement).execute(&mut raw).await.unwrap();
    assert!(changed.rows_affected() > 0, "{statement}");
    raw.close().await.unwrap();
}

#[tokio::test]
async fn a_copy_of_a_live_database_has_every_answer_and_is_restored_to_one_that_serves() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    person.finishes(&lab, "stop").await;
    let folder = TempDir::new().unwrap();
    let (copy, restored) = (folder.path().join("copy.db"), folder.path().join("new.db"));
    lab.store.back_up(&copy).await.unwrap();
    // The server goes on meanwhile.
    lab.start_and_reach_timed("driving").await;
    let told = back_up(&lab.path(), &copy).await.unwrap_err().to_string();
    assert!(told.contains("exists already"), "{told}");

    restore(&copy, &restored).await.unwrap();
    let told = restore(&copy, &restored).await.unwrap_err().to_string();
    assert!(told.contains("exists already"), "{told}");
    let store = Store::open(Options::at(&restored), lab.clock.clone())
        .await
        .unwrap();
    assert_eq!(answers(&store).await, answers(&lab.store).await);
    assert_eq!(
        store.completion_code(person.run),
        lab.store.completion_code(person.run)
    );
    assert_eq!(store.check_answers().await.unwrap(), []);
    // Another server holds it now.
    let told = restore(&copy, &restored).await.unwrap_err().to_string();
    assert!(
        told.contains("in use by another riskaware server"),
        "{told}"
    );
    store.close().await;
}

#[tokio::test]
async fn an_unsound_copy_is_not_restored() {
    let mut lab = Lab::open().await;
    lab.start_and_reach_timed("driving").await;
    let folder = TempDir::new().unwrap();
    let copy = folder.path().join("copy.db");
    lab.store.back_up(&copy).await.unwrap();
    change(&copy, "delete from run").await;
    let target = folder.path().join("new.db");
    let told = restore(&copy, &target).await.unwrap_err().to_string();
    assert!(told.contains("refer to rows that do not exist"), "{told}");
    assert!(!target.exists());

    let no_database = folder.path().join("notes.txt");
    std::fs::write(
        &no_database,
        "not a database, but long enough to look at".repeat(40),
    )
    .unwrap();
    restore(&no_database, &target).await.unwrap_err();
    let missing = folder.path().join("missing.db");
    let told = restore(&missing, &target).await.unwrap_err().to_string();
    assert!(told.contains("does not exist"), "{told}");
    assert!(!target.exists());
    let empty = folder.path().join("empty.db");
    std::fs::write(&empty, "").unwrap();
    let told = back_up(&empty, &target).await.unwrap_err().to_string();
    assert!(told.contains("is not a riskaware database"), "{told}");
    assert!(!target.exists());
    // Nothing is refused with a file left beside it, nor beside what is no database.
    restore(&lab.path(), &no_database).await.unwrap_err();
    let left: Vec<_> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".lock"))
        .collect();
    assert_eq!(left, [""; 0]);
}

#[tokio::test]
async fn the_doctor_finds_a_live_database_well_and_names_what_was_tampered_with() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    person.finishes(&lab, "stop").await;
    let findings = examine(&lab.path(), Clock::start()).await.unwrap();
    assert!(
        findings
            .iter()
            .all(|finding| finding.health == Health::Sound),
        "{findings:?}"
    );
    lab.store.close().await;
    for (statement, check) in [
        ("update counter set n_all = n_all + 1", "counters"),
        (
            "update answer set action = 'accelerate' where action = 'stop'",
            "answers",
        ),
        ("delete from run", "references"),
        (
            "update _sqlx_migrations set version = 9 where version = 4",
            "schema",
        ),
    ] {
        let folder = TempDir::new().unwrap();
        let copy = folder.path().join("copy.db");
        back_up(&lab.path(), &copy).await.unwrap();
        change(&copy, statement).await;
        let findings = examine(&copy, Clock::start()).await.unwrap();
        let wrong = findings
            .iter()
            .find(|finding| finding.check == check)
            .unwrap();
        assert_eq!(wrong.health, Health::Wrong, "{statement}: {findings:?}");
        assert!(!wrong.advice.is_empty());
    }
}

#[tokio::test]
async fn the_doctor_says_what_to_do_about_a_file_that_cannot_be_read_through() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    person.finishes(&lab, "stop").await;
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("copy.db");
    back_up(&lab.path(), &copy).await.unwrap();
    let whole = std::fs::read(&copy).unwrap();
    for (what, bytes) in [
        ("cut", whole[..whole.len() / 2].to_vec()),
        (
            "overwritten",
            [&whole[..100], &[0xA5; 12_000], &whole[12_100..]].concat(),
        ),
    ] {
        let damaged = folder.path().join(what);
        std::fs::write(&damaged, bytes).unwrap();
        let findings = examine(&damaged, Clock::start()).await.unwrap();
        let wrong = findings
            .iter()
            .find(|finding| finding.health == Health::Wrong && finding.advice.contains("restore"));
        assert!(wrong.is_some(), "{what}: {findings:?}");
    }
}
