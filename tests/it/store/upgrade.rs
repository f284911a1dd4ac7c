//! Databases of earlier versions: everything in them is there after the upgrade.

use riskaware::clock::Clock;
use riskaware::store::{AnswerKey, FitKey, FitOutcome, NewFit, Options, Population, Store};
use riskaware::study::{StudyId, Timestamp};
use sqlx::Connection;
use sqlx::migrate::Migrator;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use tempfile::TempDir;

use super::lab::Lab;

const SCHEMA_1: &str = include_str!("../../../migrations/0001_studies_runs_answers_fits.sql");

/// The lab's rows in a new file with the tables of schema 1, as the first release would have written them.
async fn as_schema_1(lab: &Lab, folder: &TempDir) -> std::path::PathBuf {
    let migrations = folder.path().join("migrations");
    std::fs::create_dir(&migrations).unwrap();
    std::fs::write(
        migrations.join("0001_studies_runs_answers_fits.sql"),
        SCHEMA_1,
    )
    .unwrap();
    let path = folder.path().join("released.db");
    let options = SqliteConnectOptions::new()
        .filename(&path)
        .create_if_missing(true)
        .foreign_keys(false);
    let mut raw = SqliteConnection::connect_with(&options).await.unwrap();
    let released = Migrator::new(migrations).await.unwrap();
    released.run(&mut raw).await.unwrap();
    sqlx::query("attach ? as newer")
        .bind(lab.path().to_str().unwrap())
        .execute(&mut raw)
        .await
        .unwrap();
    let tables: Vec<(String, String)> = sqlx::query_as(
        r#"
        select tables.name, group_concat('"' || columns.name || '"', ', ')
        from main.sqlite_schema as tables, pragma_table_info(tables.name, 'main') as columns
        where tables.type = 'table' and tables.name not like 'sqlite_%' and tables.name not like '_sqlx_%'
        group by tables.name
        "#,
    )
    .fetch_all(&mut raw)
    .await
    .unwrap();
    for (table, columns) in tables {
        let copy = format!(
            r#"insert into main."{table}" ({columns}) select {columns} from newer."{table}""#
        );
        sqlx::query(sqlx::AssertSqlSafe(copy))
            .execute(&mut raw)
            .await
            .unwrap();
    }
    raw.close().await.unwrap();
    path
}

#[tokio::test]
async fn schema_1_keeps_every_answer_and_its_fits_are_final() {
    let mut lab = Lab::open().await;
    for study in ["driving", "cups", "driving"] {
        let mut person = lab.start_and_reach_timed(study).await;
        person.finishes(&lab, "stop").await;
    }
    lab.start_and_reach_timed("driving").await;
    let driving = StudyId::from("driving");
    let fit = NewFit {
        study: driving.clone(),
        population: Population::People,
        key: FitKey {
            plan: "risk".into(),
            part: "low".into(),
            model: "risk_aware".to_owned(),
        },
        input_hash: "of the counts".to_owned(),
        data_version: 3,
        version: lab.driving,
        seed: 5,
        attempts: 1,
        is_provisional: false,
        outcome: FitOutcome::Converged("{}".to_owned()),
        draws: Some(vec![1, 2, 3]),
        cpu_ms: 40,
    };
    let fit = lab.store.save_fits(vec![fit]).await.unwrap()[0];

    let read = async |store: &Store| {
        let people = Population::People;
        let mut answers = Vec::new();
        for study in [driving.clone(), StudyId::from("cups")] {
            answers.push((
                store
                    .answers(&study, people, AnswerKey::START, 1_000)
                    .await
                    .unwrap(),
                store.cell_counts(&study, people).await.unwrap(),
                store.totals(&study, people).await.unwrap(),
            ));
        }
        answers
    };
    let before = read(&lab.store).await;
    assert_eq!(before[0].0.len() + before[1].0.len(), 3 * 4);

    let folder = TempDir::new().unwrap();
    let path = as_schema_1(&lab, &folder).await;
    let clock = Clock::manual(Timestamp(1_800_000_000_000));
    let store = Store::open(Options::at(&path), clock).await.unwrap();
    assert_eq!(read(&store).await, before);
    assert_eq!(store.check_answers().await.unwrap(), []);
    assert_eq!(store.check_counters().await.unwrap(), []);
    assert_eq!(
        store.completion_code(1.into()),
        lab.store.completion_code(1.into())
    );
    let fits = store
        .latest_fits(&driving, Population::People)
        .await
        .unwrap();
    assert_eq!(
        fits.iter()
            .map(|fit| (fit.id, fit.is_provisional))
            .collect::<Vec<_>>(),
        [(fit, false)]
    );
    assert_eq!(store.fit_draws(fit).await.unwrap(), [1, 2, 3]);
    assert_eq!(
        store
            .comparisons(&driving, Population::People, &[])
            .await
            .unwrap(),
        []
    );
    assert_eq!(
        store
            .checkpoints(&driving, Population::People)
            .await
            .unwrap(),
        []
    );
}
