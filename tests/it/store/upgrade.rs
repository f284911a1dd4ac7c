//! Databases of earlier versions: everything in them is there after the upgrade.

use std::path::{Path, PathBuf};

use riskaware::clock::Clock;
use riskaware::store::{
    AnswerKey, AskedProblem, FitId, FitKey, FitOutcome, NewFit, OpenError, Options, Population,
    Store, StudyState, back_up, restore,
};
use riskaware::study::{Reply, StudyId, Timestamp};
use sqlx::Connection;
use sqlx::migrate::Migrator;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use tempfile::TempDir;

use super::lab::{CONSENT, Lab, START_PAGE};

/// The migrations by number, as they were released.
const MIGRATIONS: [(&str, &str); 3] = [
    (
        "0001_studies_runs_answers_fits.sql",
        include_str!("../../../migrations/0001_studies_runs_answers_fits.sql"),
    ),
    (
        "0002_provisional_fits_comparisons_checkpoints.sql",
        include_str!("../../../migrations/0002_provisional_fits_comparisons_checkpoints.sql"),
    ),
    (
        "0003_steps_of_any_kind.sql",
        include_str!("../../../migrations/0003_steps_of_any_kind.sql"),
    ),
];

/// The lab's rows in a new file with the tables of an earlier schema, as its release would have written them.
async fn as_schema(version: usize, lab: &Lab, folder: &TempDir) -> PathBuf {
    let migrations = folder.path().join("migrations");
    std::fs::create_dir(&migrations).unwrap();
    for (name, text) in &MIGRATIONS[..version] {
        std::fs::write(migrations.join(name), text).unwrap();
    }
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
    // Those schemas told problems apart by their prospects alone.
    sqlx::raw_sql(
        r#"
        create temporary table pooled as
        select
            id, substr(hash, 1, instr(hash || ':', ':') - 1) as prospects,
            min(id) over (partition by study_id, cell, substr(hash, 1, instr(hash || ':', ':') - 1)) as first
        from problem;
        update step set problem_id = (select first from pooled where id = problem_id) where problem_id is not null;
        update answer set problem_id = (select first from pooled where id = problem_id) where problem_id is not null;
        create temporary table counted as
        select study_id, is_simulated, first, status, action, sum(n_all), sum(n_completed)
        from counter join pooled on id = problem_id
        group by 1, 2, 3, 4, 5;
        delete from counter;
        insert into counter select * from counted;
        delete from problem where id not in (select first from pooled);
        update problem set hash = (select prospects from pooled where pooled.id = problem.id);
        "#,
    )
    .execute(&mut raw)
    .await
    .unwrap();
    raw.close().await.unwrap();
    path
}

/// Every row of a table, as text: what a migration must not change, column by column.
async fn rows(path: &Path, table: &str, columns: &str) -> Vec<String> {
    let options = SqliteConnectOptions::new().filename(path).read_only(true);
    let mut raw = SqliteConnection::connect_with(&options).await.unwrap();
    let listed = columns
        .split(", ")
        .map(|column| format!("quote({column})"))
        .collect::<Vec<_>>()
        .join(" || ',' || ");
    let query = format!(r#"select {listed} from "{table}" order by 1"#);
    let rows = sqlx::query_scalar(sqlx::AssertSqlSafe(query))
        .fetch_all(&mut raw)
        .await
        .unwrap();
    raw.close().await.unwrap();
    rows
}

/// The tables of a file with their columns.
async fn tables(path: &Path) -> Vec<(String, String)> {
    let options = SqliteConnectOptions::new().filename(path).read_only(true);
    let mut raw = SqliteConnection::connect_with(&options).await.unwrap();
    let tables = sqlx::query_as(
        r#"
        select tables.name, group_concat('"' || columns.name || '"', ', ')
        from sqlite_schema as tables, pragma_table_info(tables.name) as columns
        where tables.type = 'table' and tables.name not like 'sqlite_%' and tables.name not like '_sqlx_%'
        group by tables.name
        "#,
    )
    .fetch_all(&mut raw)
    .await
    .unwrap();
    raw.close().await.unwrap();
    tables
}

/// People who finished, one under way, one who declined, one who withdrew, and a fit.
async fn filled() -> (Lab, FitId) {
    let mut lab = Lab::open().await;
    lab.store
        .publish(
            &StudyId::from("driving"),
            "hash of a later file",
            "id = 'driving' # changed",
            StudyState::Open,
            None,
        )
        .await
        .unwrap();
    for study in ["driving", "cups", "driving"] {
        let mut person = lab.start_and_reach_timed(study).await;
        person.finishes(&lab, "stop").await;
    }
    lab.start_and_reach_timed("driving").await;
    let mut declines = lab.start("driving").await;
    declines.says(&lab, CONSENT, Reply::Declined).await.unwrap();
    let withdraws = lab.start_and_reach_timed("driving").await;
    lab.store.withdraw(&withdraws.link).await.unwrap();
    let fit = NewFit {
        study: StudyId::from("driving"),
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
    (lab, fit)
}

#[tokio::test]
async fn every_released_schema_keeps_everything() {
    for version in 1..=MIGRATIONS.len() {
        let (lab, fit) = filled().await;
        let driving = StudyId::from("driving");
        let read = async |store: &Store| {
            let people = Population::People;
            let mut answers = Vec::new();
            for study in [driving.clone(), StudyId::from("cups")] {
                let versions = store.study_versions(&study).await.unwrap();
                answers.push((
                    versions
                        .iter()
                        .map(|version| (version.id, version.number.get()))
                        .collect::<Vec<_>>(),
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
        let mut before = read(&lab.store).await;
        // Earlier schemas did not note it.
        for answer in before.iter_mut().flat_map(|study| &mut study.1) {
            answer.program_version = None;
        }
        assert_eq!(before[0].1.len() + before[1].1.len(), 3 * 4);
        let numbers = |of: usize| before[of].0.iter().map(|(_, number)| *number);
        assert_eq!(numbers(0).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(numbers(1).collect::<Vec<_>>(), [1]);

        let folder = TempDir::new().unwrap();
        let path = as_schema(version, &lab, &folder).await;
        let released = folder.path().join("copy-of-released.db");
        std::fs::copy(&path, &released).unwrap();
        let clock = Clock::manual(Timestamp(1_800_000_000_000));
        let store = Store::open(Options::at(&path), clock).await.unwrap();
        assert_eq!(read(&store).await, before, "schema {version}");
        assert_eq!(store.check_answers().await.unwrap(), []);
        assert_eq!(store.check_counters().await.unwrap(), []);
        assert_eq!(
            store.completion_code(1.into()),
            lab.store.completion_code(1.into())
        );
        let fits = store
            .new_fits(&driving, Population::People, &[])
            .await
            .unwrap()
            .1;
        assert_eq!(
            fits.iter()
                .map(|fit| (fit.id, fit.is_provisional))
                .collect::<Vec<_>>(),
            [(fit, false)]
        );
        assert_eq!(store.fit_draws(fit).await.unwrap(), [1, 2, 3]);
        store.close().await;

        // No column of any table lost a value, and the copy that was kept is the database as it was.
        let copy = folder.path().join("released.db.before-schema-4");
        for (table, columns) in tables(&released).await {
            // The one column that means something else now; the counts above are found by it.
            let columns = match table.as_str() {
                "problem" => columns.replace(r#""hash", "#, ""),
                _ => columns,
            };
            let as_it_was = rows(&released, &table, &columns).await;
            assert_eq!(
                rows(&path, &table, &columns).await,
                as_it_was,
                "schema {version}: {table}"
            );
            assert_eq!(
                rows(&copy, &table, &columns).await,
                as_it_was,
                "schema {version}: {table}"
            );
        }
    }
}

#[tokio::test]
async fn without_a_copy_nothing_is_upgraded() {
    let (lab, _) = filled().await;
    let folder = TempDir::new().unwrap();
    let path = as_schema(2, &lab, &folder).await;
    // A folder of this name is in the way of the copy.
    std::fs::create_dir(folder.path().join("released.db.before-schema-4.partial")).unwrap();
    let clock = Clock::manual(Timestamp(1_800_000_000_000));
    let refused = Store::open(Options::at(&path), clock.clone())
        .await
        .unwrap_err();
    let told = refused.to_string();
    assert!(told.contains("no copy of it can be kept"), "{told}");
    let before = tables(&path).await;
    assert!(
        before.iter().all(|(table, _)| table != "account"),
        "it is as it was"
    );

    std::fs::remove_dir(folder.path().join("released.db.before-schema-4.partial")).unwrap();
    Store::open(Options::at(&path), clock)
        .await
        .unwrap()
        .close()
        .await;
    assert!(
        tables(&path)
            .await
            .iter()
            .any(|(table, _)| table == "account")
    );
}

#[tokio::test]
async fn a_database_of_a_later_program_is_refused() {
    let (lab, _) = filled().await;
    let path = lab.path();
    let clock = lab.clock.clone();
    lab.store.close().await;
    let folder = TempDir::new().unwrap();
    let later = folder.path().join("later.db");
    back_up(&path, &later).await.unwrap();
    let options = SqliteConnectOptions::new().filename(&later);
    let mut raw = SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query("insert into _sqlx_migrations (version, description, success, checksum, execution_time) values (5, 'later', 1, x'00', 0)")
        .execute(&mut raw)
        .await
        .unwrap();
    raw.close().await.unwrap();
    for refused in [
        Store::open(Options::at(&later), clock.clone()).await,
        Store::open_to_read(&later, clock.clone()).await,
        Store::open_beside(&later, clock).await,
    ] {
        let told = refused.unwrap_err().to_string();
        for part in ["schema 5", "up to 4", "restore a backup"] {
            assert!(told.contains(part), "{told}");
        }
    }
    let target = folder.path().join("target.db");
    let told = restore(&later, &target).await.unwrap_err().to_string();
    assert!(told.contains("its schema is 5"), "{told}");
    assert!(!target.exists());
}

#[tokio::test]
async fn answers_under_two_limits_are_told_apart_by_the_upgrade() {
    for version in 1..=MIGRATIONS.len() {
        let mut lab = Lab::open().await;
        for (action, limit_ms) in [("stop", 8_000), ("stop", 4_000), ("go", 4_000)] {
            let mut run = lab.new_run("driving");
            for step in &mut run.candidates[0].steps {
                if step.plan.limit_ms.is_some()
                    && let Some(asked) = &step.asked
                {
                    step.plan.limit_ms = Some(limit_ms);
                    step.asked = Some(AskedProblem::new(asked.cell.clone(), None, Some(limit_ms)));
                }
            }
            let mut person = lab.start_as("driving", run).await;
            person.says(&lab, CONSENT, Reply::Agreed).await.unwrap();
            person
                .says(&lab, START_PAGE, Reply::Continued)
                .await
                .unwrap();
            person.finishes(&lab, action).await;
        }
        let driving = StudyId::from("driving");
        let read = async |store: &Store| {
            let counts = store
                .cell_counts(&driving, Population::People)
                .await
                .unwrap();
            let mut counts: Vec<_> = counts
                .into_iter()
                .map(|count| {
                    (
                        count.cell,
                        count.hash,
                        count.action,
                        count.n_all,
                        count.n_completed,
                    )
                })
                .collect();
            counts.sort();
            counts
        };
        let before = read(&lab.store).await;
        assert_eq!(before.len(), 2 * 3 + 2, "two timed cells, an untimed one");
        let folder = TempDir::new().unwrap();
        let path = as_schema(version, &lab, &folder).await;
        let pooled = rows(&path, "problem", "hash").await;
        assert_eq!(pooled.len(), 3, "{pooled:?}");
        let clock = Clock::manual(Timestamp(1_800_000_000_000));
        let store = Store::open(Options::at(&path), clock).await.unwrap();
        assert_eq!(read(&store).await, before, "schema {version}");
        assert_eq!(store.check_answers().await.unwrap(), []);
        assert_eq!(store.check_counters().await.unwrap(), []);
        store.close().await;
    }
}

#[tokio::test]
async fn what_a_migration_left_damaged_is_refused_at_every_start() {
    let (lab, _) = filled().await;
    let folder = TempDir::new().unwrap();
    let path = as_schema(3, &lab, &folder).await;
    let options = SqliteConnectOptions::new()
        .filename(&path)
        .foreign_keys(false);
    let mut raw = SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query("update run_token set run_id = 999 where is_owner = 1")
        .execute(&mut raw)
        .await
        .unwrap();
    raw.close().await.unwrap();
    let clock = Clock::manual(Timestamp(1_800_000_000_000));
    for start in 1..=3 {
        let refused = Store::open(Options::at(&path), clock.clone()).await;
        let refused = refused.unwrap_err();
        assert!(
            matches!(refused, OpenError::BrokenReferences { .. }),
            "start {start}: {refused}"
        );
    }
    for refused in [
        Store::open_beside(&path, clock.clone()).await,
        Store::open_to_read(&path, clock.clone()).await,
    ] {
        assert!(matches!(refused.unwrap_err(), OpenError::Unchecked(_)));
    }

    // The copy that was kept is as it was, and of a sound one nothing is left to check.
    let sound = TempDir::new().unwrap();
    let path = as_schema(3, &lab, &sound).await;
    for _ in 0..2 {
        let store = Store::open(Options::at(&path), clock.clone())
            .await
            .unwrap();
        store.close().await;
    }
    assert!(
        tables(&path)
            .await
            .iter()
            .all(|(table, _)| table != "unchecked_migration")
    );
}

#[tokio::test]
async fn withdrawals_under_earlier_schemas_lose_their_clocks() {
    let (lab, _) = filled().await;
    for version in 1..=MIGRATIONS.len() {
        let folder = TempDir::new().unwrap();
        let path = as_schema(version, &lab, &folder).await;
        let mut raw = SqliteConnection::connect(path.to_str().unwrap())
            .await
            .unwrap();
        sqlx::raw_sql(
            r#"
            update run set source = 'poster', started_at_ms = 1700000012345, finished_at_ms = 1700000054321
            where state = 'withdrawn';
            update arrival set source = 'poster', created_at_ms = 1700000011111
            where run_id in (select id from run where state = 'withdrawn');
            update event set at_ms = 1700000054321 where kind = 'erased';
            "#,
        )
        .execute(&mut raw)
        .await
        .unwrap();
        raw.close().await.unwrap();
        let clock = Clock::manual(Timestamp(1_800_000_000_000));
        let store = Store::open(Options::at(&path), clock).await.unwrap();
        store.close().await;
        let mut raw = SqliteConnection::connect(path.to_str().unwrap())
            .await
            .unwrap();
        let left: Vec<(Option<String>, i64)> = sqlx::query_as(
            r#"
            select source, started_at_ms from run where state = 'withdrawn'
            union all
            select source, finished_at_ms from run where state = 'withdrawn'
            union all
            select source, created_at_ms from arrival where run_id in (select id from run where state = 'withdrawn')
            union all
            select null, at_ms from event where kind = 'erased'
            "#,
        )
        .fetch_all(&mut raw)
        .await
        .unwrap();
        assert_eq!(left.len(), 4);
        for (source, at_ms) in left {
            assert_eq!((source, at_ms % 86_400_000), (None, 0), "schema {version}");
        }
    }
}
