//! Which databases are accepted.

use riskaware::clock::Clock;
use riskaware::store::{OpenError, Options, Store, StudyState};
use riskaware::study::StudyId;
use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;
use tempfile::TempDir;

use super::lab::Lab;

async fn raw(lab: &Lab) -> SqliteConnection {
    SqliteConnection::connect(lab.path().to_str().unwrap())
        .await
        .unwrap()
}

#[tokio::test]
async fn a_second_server_is_refused_and_told_why() {
    let lab = Lab::open().await;
    let refused = Store::open(Options::at(lab.path()), Clock::start())
        .await
        .unwrap_err();
    assert!(matches!(refused, OpenError::InUse(_)), "{refused}");
    assert!(
        refused
            .to_string()
            .contains("in use by another riskaware server"),
        "{refused}"
    );
    // The first one goes on.
    assert_eq!(lab.store.studies().await.unwrap().len(), 2);
}

#[tokio::test]
async fn a_restart_migrates_nothing_and_keeps_the_secret() {
    let mut lab = Lab::open().await;
    let code = lab.store.completion_code(1.into());
    lab.restart().await;
    assert_eq!(lab.store.completion_code(1.into()), code);
    let mut raw = raw(&lab).await;
    let applied: Vec<i64> = sqlx::query_scalar("select version from _sqlx_migrations")
        .fetch_all(&mut raw)
        .await
        .unwrap();
    assert_eq!(applied, [1, 2, 3, 4]);
}

#[tokio::test]
async fn two_databases_have_two_secrets() {
    let (one, two) = (Lab::open().await, Lab::open().await);
    let driving = StudyId::from("driving");
    assert_ne!(
        one.store.completion_code(1.into()),
        two.store.completion_code(1.into())
    );
    let (one, two) = (
        one.store.recruiting_id(&driving, "pid", "x"),
        two.store.recruiting_id(&driving, "pid", "x"),
    );
    assert_ne!(one, two);
}

#[tokio::test]
async fn the_database_holds_to_the_rules_of_durability() {
    let lab = Lab::open().await;
    let mut raw = raw(&lab).await;
    let journal: String = sqlx::query_scalar("pragma journal_mode")
        .fetch_one(&mut raw)
        .await
        .unwrap();
    assert_eq!(journal, "wal");
    let loose: Vec<String> =
        sqlx::query_scalar("select name from pragma_table_list where schema = 'main' and strict = 0 and name not like 'sqlite_%' and name not like '_sqlx_%'")
            .fetch_all(&mut raw)
            .await
            .unwrap();
    assert_eq!(loose, [""; 0], "every table is strict");
    let cascading: Vec<String> = sqlx::query_scalar(
        r#"
        select tables.name
        from pragma_table_list as tables, pragma_foreign_key_list(tables.name) as keys
        where keys.on_delete <> 'NO ACTION' or keys.on_update <> 'NO ACTION'
        "#,
    )
    .fetch_all(&mut raw)
    .await
    .unwrap();
    assert_eq!(cascading, [""; 0], "no deletion spreads by itself");
}

#[tokio::test]
async fn a_file_that_is_no_database_is_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("notes.db");
    std::fs::write(
        &path,
        "these are the notes of a meeting, and not a database at all".repeat(20),
    )
    .unwrap();
    let refused = Store::open(Options::at(&path), Clock::start())
        .await
        .unwrap_err();
    assert!(refused.to_string().contains("notes.db"), "{refused}");
    assert!(
        std::fs::read_to_string(&path)
            .unwrap()
            .starts_with("these are the notes")
    );
}

#[tokio::test]
async fn publishing_the_same_text_again_changes_nothing() {
    let lab = Lab::open().await;
    let driving = StudyId::from("driving");
    let mut changes = lab.store.subscribe();
    let same = lab
        .store
        .publish(
            &driving,
            "hash of driving",
            "id = 'driving'",
            StudyState::Open,
        )
        .await
        .unwrap();
    assert_eq!(same, lab.driving);
    assert!(changes.try_recv().is_err());
    let newer = lab
        .store
        .publish(
            &driving,
            "another hash",
            "id = 'driving' # changed",
            StudyState::Open,
        )
        .await
        .unwrap();
    assert_ne!(newer, lab.driving);
    assert_eq!(lab.store.study(&driving).await.unwrap().version, newer);
    assert_eq!(
        lab.store
            .study(&StudyId::from("cups"))
            .await
            .unwrap()
            .version,
        lab.cups
    );
    let versions = lab.store.study_versions(&driving).await.unwrap();
    assert_eq!(
        versions
            .iter()
            .map(|version| (version.id, version.number.get()))
            .collect::<Vec<_>>(),
        [(lab.driving, 1), (newer, 2)]
    );
    let cups = lab.store.study_version(lab.cups).await.unwrap();
    assert_eq!(cups.number.get(), 1, "every study counts its own versions");
    assert_eq!(
        lab.store.study_version(newer).await.unwrap().text,
        "id = 'driving' # changed"
    );
    let back = lab
        .store
        .publish(
            &driving,
            "hash of driving",
            "id = 'driving'",
            StudyState::Open,
        )
        .await
        .unwrap();
    assert_eq!(
        back, lab.driving,
        "a text that was served before is the version that it was"
    );
}

#[tokio::test]
async fn a_command_writes_beside_a_server_which_sees_it() {
    let lab = Lab::open().await;
    let beside = Store::open_beside(lab.path(), lab.clock.clone())
        .await
        .unwrap();
    let driving = StudyId::from("driving");
    beside
        .set_study_state(&driving, StudyState::Paused)
        .await
        .unwrap();
    let seen = lab.store.study(&driving).await.unwrap();
    assert_eq!(seen.state, StudyState::Paused);
    // And the other way round, while both are open.
    lab.store
        .set_study_state(&driving, StudyState::Open)
        .await
        .unwrap();
    let seen = beside.study(&driving).await.unwrap();
    assert_eq!(seen.state, StudyState::Open);
    beside.close().await;
    assert!(lab.store.is_taking_answers());
}

#[tokio::test]
async fn a_command_makes_no_database_and_touches_none_of_another_schema() {
    let folder = TempDir::new().unwrap();
    let missing = folder.path().join("nowhere.db");
    let refused = Store::open_beside(&missing, Clock::start())
        .await
        .unwrap_err();
    assert!(matches!(refused, OpenError::Missing(_)), "{refused}");
    assert!(!missing.exists());

    let lab = Lab::open().await;
    let mut raw = raw(&lab).await;
    for (change, expected) in [
        (
            "update _sqlx_migrations set version = 99 where version = 4",
            "schema 99 of a later riskaware; this one knows schemas up to 4",
        ),
        (
            "delete from _sqlx_migrations where version = 99",
            "has schema 3, this riskaware needs 4; start `riskaware serve`",
        ),
        ("drop table _sqlx_migrations", "is not a riskaware database"),
    ] {
        sqlx::query(change).execute(&mut raw).await.unwrap();
        let refused = Store::open_beside(lab.path(), Clock::start())
            .await
            .unwrap_err();
        assert!(refused.to_string().contains(expected), "{refused}");
    }
}

#[tokio::test]
async fn a_new_database_is_for_its_owner_alone() {
    use std::os::unix::fs::PermissionsExt;

    let lab = Lab::open().await;
    for suffix in ["", "-wal"] {
        let file = format!("{}{suffix}", lab.path().display());
        let mode = std::fs::metadata(&file).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "{file}");
    }
}
