//! Group commit: many answers in few commits, a bad job alone, and nothing acknowledged that is not on disk.

use std::time::Duration;

use riskaware::clock::Clock;
use riskaware::store::{Error, NewArrival, NewRun, Options, Store, StudyState, Token, Verdict};
use riskaware::study::{Reply, StudyId, Timestamp};
use tempfile::TempDir;
use tokio::task::JoinSet;

use super::lab::{CONSENT, Lab, START_PAGE, choice, form};

#[tokio::test]
async fn many_answers_share_few_commits() {
    let mut lab = Lab::open().await;
    let mut people = Vec::new();
    for _ in 0..100 {
        people.push(lab.start("driving").await);
    }
    let before = lab.store.commits();
    let mut answers = JoinSet::new();
    for person in people {
        let store = lab.store.clone();
        answers.spawn(async move {
            store
                .submit(person.run, form(CONSENT, "1", Reply::Agreed))
                .await
                .unwrap();
            store
                .submit(person.run, form(START_PAGE, "2", Reply::Continued))
                .await
                .unwrap();
            store
                .submit(person.run, form(2, "3", choice("stop")))
                .await
                .unwrap()
                .verdict
        });
    }
    let verdicts = answers.join_all().await;
    assert!(verdicts.iter().all(|verdict| *verdict == Verdict::Answered));
    let commits = lab.store.commits() - before;
    assert!(
        (1..=60).contains(&commits),
        "300 answers took {commits} commits"
    );
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (100, 0)
    );
    lab.check().await;
}

#[tokio::test]
async fn one_bad_job_fails_alone() {
    let mut lab = Lab::open().await;
    let mut people = Vec::new();
    for _ in 0..20 {
        people.push(lab.start("driving").await);
    }
    let arrival = lab.arrival("driving", NewArrival::default()).await;
    // A version of another study breaks a rule of the schema, not of a run.
    let bad = NewRun {
        version: lab.cups,
        ..lab.new_run("driving")
    };
    let before = lab.store.commits();
    let mut jobs = JoinSet::new();
    let store = lab.store.clone();
    jobs.spawn(async move { store.start(&arrival, bad).await.map(|_| ()) });
    for person in people {
        let store = lab.store.clone();
        jobs.spawn(async move {
            store
                .submit(person.run, form(CONSENT, "1", Reply::Agreed))
                .await
                .map(|_| ())
        });
    }
    let results = jobs.join_all().await;
    let failed: Vec<&Error> = results
        .iter()
        .filter_map(|result| result.as_ref().err())
        .collect();
    assert!(matches!(failed[..], [Error::Database(_)]), "{failed:?}");
    assert!(
        lab.store.commits() - before >= 20,
        "the batch was written job by job"
    );
    let totals = lab
        .store
        .totals(
            &StudyId::from("driving"),
            riskaware::store::Population::People,
        )
        .await
        .unwrap();
    assert_eq!(totals.started, 20);
    lab.check().await;
}

#[tokio::test]
async fn what_is_acknowledged_is_on_disk() {
    let mut lab = Lab::open().await;
    let person = lab.start("driving").await;
    for round in 0..5 {
        let submitted = if round == 0 {
            lab.store
                .submit(person.run, form(CONSENT, "c", Reply::Agreed))
                .await
                .unwrap()
        } else {
            lab.store
                .submit(
                    person.run,
                    form(CONSENT, &format!("{round}"), Reply::Agreed),
                )
                .await
                .unwrap()
        };
        // What another process would find after a kill at this moment: the files as they are.
        let crashed = TempDir::new().unwrap();
        let copy = crashed.path().join("test.db");
        std::fs::copy(lab.path(), &copy).unwrap();
        std::fs::copy(
            lab.path().with_extension("db-wal"),
            copy.with_extension("db-wal"),
        )
        .unwrap();
        let found = Store::open(Options::at(&copy), Clock::manual(Timestamp(0)))
            .await
            .unwrap();
        let events = found.events(person.run).await.unwrap();
        assert!(
            events
                .iter()
                .any(|event| event.id == submitted.receipt.event),
            "round {round}"
        );
        found.close().await;
    }
}

#[tokio::test]
async fn a_full_queue_says_busy_and_what_was_accepted_is_stored() {
    let folder = TempDir::new().unwrap();
    let options = Options {
        queue: 4,
        ..Options::at(folder.path().join("small.db"))
    };
    let store = Store::open(options, Clock::start()).await.unwrap();
    let driving = StudyId::from("driving");
    store
        .publish(&driving, "hash", "text", StudyState::Open)
        .await
        .unwrap();
    let mut rng = <rand_chacha::ChaCha12Rng as rand::SeedableRng>::seed_from_u64(1);
    let tokens: Vec<Token> = (0..64).map(|_| Token::random(&mut rng)).collect();
    let mut jobs = JoinSet::new();
    for token in tokens.clone() {
        let (store, driving) = (store.clone(), driving.clone());
        jobs.spawn(async move {
            (
                store.arrive(&token, &driving, NewArrival::default()).await,
                token,
            )
        });
    }
    let (mut stored, mut busy) = (0, 0);
    for (result, token) in jobs.join_all().await {
        let is_there = store.arrival(&token).await.is_ok();
        match result {
            Ok(()) => stored += 1,
            Err(Error::Busy) => busy += 1,
            Err(other) => panic!("{other}"),
        }
        assert_eq!(is_there, result.is_ok());
    }
    assert!(stored >= 4 && busy > 0, "{stored} stored, {busy} refused");
}

#[tokio::test]
async fn closing_writes_what_waits_and_refuses_what_comes_later() {
    let mut lab = Lab::open().await;
    let person = lab.start("driving").await;
    let (store, run) = (lab.store.clone(), person.run);
    let waiting =
        tokio::spawn(async move { store.submit(run, form(CONSENT, "1", Reply::Agreed)).await });
    tokio::task::yield_now().await;
    lab.store.close().await;
    assert!(waiting.await.unwrap().is_ok());
    let late = lab
        .store
        .submit(run, form(START_PAGE, "2", Reply::Continued))
        .await
        .unwrap_err();
    assert_eq!(
        late.to_string(),
        "answers cannot be stored at the moment: the server is shutting down"
    );
}

#[tokio::test]
async fn another_process_that_writes_makes_us_wait_and_not_fail() {
    let mut lab = Lab::open().await;
    let person = lab.start("driving").await;
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(lab.path());
    let mut other = sqlx::ConnectOptions::connect(&options).await.unwrap();
    sqlx::query("begin immediate")
        .execute(&mut other)
        .await
        .unwrap();
    let (store, run) = (lab.store.clone(), person.run);
    let mut waiting =
        tokio::spawn(async move { store.submit(run, form(CONSENT, "1", Reply::Agreed)).await });
    let early = tokio::time::timeout(Duration::from_millis(50), &mut waiting).await;
    assert!(
        early.is_err(),
        "acknowledged while another process held the lock"
    );
    sqlx::query("commit").execute(&mut other).await.unwrap();
    assert!(waiting.await.unwrap().is_ok());
}

#[tokio::test]
async fn listeners_hear_of_each_change_after_its_commit() {
    let mut lab = Lab::open().await;
    let mut changes = lab.store.subscribe();
    let person = lab.start("driving").await;
    let started = changes.recv().await.unwrap();
    assert_eq!(
        (started.study.as_str(), started.data_version),
        ("driving", 1)
    );
    lab.store
        .submit(person.run, form(CONSENT, "1", Reply::Agreed))
        .await
        .unwrap();
    lab.store
        .submit(person.run, form(CONSENT, "1", Reply::Agreed))
        .await
        .unwrap();
    lab.store.visit(&person.link).await.unwrap();
    lab.start_preview("driving").await;
    assert!(
        changes.try_recv().is_err(),
        "neither consent nor a retry nor a look nor a preview changes what is shown"
    );
    let totals = lab
        .store
        .totals(&started.study, started.population)
        .await
        .unwrap();
    assert_eq!(
        (totals.data_version, totals.page_version),
        (started.data_version, started.page_version)
    );
}
