//! Withdrawal removes what a person gave, and nothing of anybody else.

use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use riskaware::store::{
    AnalysisSet, Error, EventKind, NewArrival, NewRun, Population, RunId, RunState, Store, Token,
};
use riskaware::study::{NotAdmitted, Reply, StudyId, TimeFactor};
use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;

use super::lab::{CONSENT, Lab, Person, START_PAGE, TIMED_LOW};

#[tokio::test]
async fn a_withdrawn_run_leaves_an_anonymous_row_and_its_share_of_the_counts() {
    let mut lab = Lab::open().await;
    let arrival = NewArrival {
        person: Some(("prolific".to_owned(), "5f3-secret-id".to_owned())),
        recruiting: [("PROLIFIC_PID".to_owned(), "5f3-secret-id".to_owned())].into(),
        source: Some("prolific".to_owned()),
        ..NewArrival::default()
    };
    let token = lab.arrival("driving", arrival.clone()).await;
    let unused = lab.arrival("driving", arrival.clone()).await;
    let started = lab
        .store
        .start(&token, lab.new_run("driving"))
        .await
        .unwrap();
    let mut leaves = Person::of(&started);
    leaves.says(&lab, CONSENT, Reply::Agreed).await.unwrap();
    leaves
        .says(&lab, START_PAGE, Reply::Continued)
        .await
        .unwrap();
    leaves.finishes(&lab, "stop").await;
    let mut stays = lab.start_and_reach_timed("driving").await;
    stays.finishes(&lab, "stop").await;
    let mut elsewhere = lab.start_and_reach_timed("cups").await;
    elsewhere.finishes(&lab, "stop").await;

    lab.store.withdraw(&leaves.link).await.unwrap();
    lab.check().await;
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 1)
    );
    assert_eq!(
        lab.chosen("cups", "explicit/timed/low", "stop").await,
        (1, 1)
    );
    let driving = StudyId::from("driving");
    let totals = lab
        .store
        .totals(&driving, Population::People)
        .await
        .unwrap();
    assert_eq!(
        (
            totals.started,
            totals.completed,
            totals.withdrawn,
            totals.under_way()
        ),
        (2, 1, 1, 0)
    );

    let events = lab.store.events(leaves.run).await.unwrap();
    assert_eq!(
        events.iter().map(|event| event.kind).collect::<Vec<_>>(),
        [EventKind::Erased]
    );
    let view = lab.store.visit(&leaves.link).await.unwrap();
    assert_eq!(
        (view.state, view.step, view.steps),
        (RunState::Withdrawn, None, 0)
    );
    assert!(
        matches!(lab.store.arrival(&unused).await, Err(Error::NotFound(_))),
        "their other arrival is gone too"
    );
    assert!(lab.store.events(stays.run).await.unwrap().len() > 5);

    // Nothing that identified the person is left in the files.
    lab.store.close().await;
    let file = String::from_utf8_lossy(&std::fs::read(lab.path()).unwrap()).into_owned();
    assert!(!file.contains("5f3-secret-id"));
}

#[tokio::test]
async fn withdrawing_again_changes_nothing_and_later_forms_are_refused() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    person.chooses(&lab, TIMED_LOW, "stop").await;
    lab.store.withdraw(&person.link).await.unwrap();
    let before = lab
        .store
        .totals(&StudyId::from("driving"), Population::People)
        .await
        .unwrap();
    lab.store.withdraw(&person.link).await.unwrap();
    assert_eq!(
        lab.store
            .totals(&StudyId::from("driving"), Population::People)
            .await
            .unwrap(),
        before
    );
    for position in [TIMED_LOW, TIMED_LOW + 1] {
        let refused = person
            .says(&lab, position, Reply::Continued)
            .await
            .unwrap_err();
        assert_eq!(refused.to_string(), "the run is withdrawn");
    }
    lab.clock.advance(60_000);
    assert_eq!(lab.store.close_overdue().await.unwrap(), 0);
    lab.check().await;
}

#[tokio::test]
async fn who_withdrew_may_come_again() {
    let mut lab = Lab::open().await;
    let person = || NewArrival {
        person: Some(("mturk".to_owned(), "A1".to_owned())),
        ..NewArrival::default()
    };
    let first = lab.arrival("driving", person()).await;
    let started = lab
        .store
        .start(&first, lab.new_run("driving"))
        .await
        .unwrap();
    lab.store.withdraw(&started.link).await.unwrap();
    let same_arrival = lab
        .store
        .start(&first, lab.new_run("driving"))
        .await
        .unwrap();
    assert_eq!(
        (same_arrival.run, same_arrival.state),
        (started.run, RunState::Withdrawn)
    );
    let again = lab.arrival("driving", person()).await;
    let again = lab
        .store
        .start(&again, lab.new_run("driving"))
        .await
        .unwrap();
    assert!(again.run != started.run && again.is_owner);
}

#[tokio::test]
async fn whoever_withdraws_after_the_end_gets_no_second_try_until_the_retention_date() {
    let mut lab = Lab::open().await;
    let driving = StudyId::from("driving");
    let person = |name: &str| NewArrival {
        person: Some(("mturk".to_owned(), name.to_owned())),
        ..NewArrival::default()
    };
    let first = lab.arrival("driving", person("A1")).await;
    let started = lab
        .store
        .start(&first, lab.new_run("driving"))
        .await
        .unwrap();
    let mut finishes = Person::of(&started);
    finishes.says(&lab, CONSENT, Reply::Agreed).await.unwrap();
    finishes
        .says(&lab, START_PAGE, Reply::Continued)
        .await
        .unwrap();
    finishes.finishes(&lab, "stop").await;
    lab.store.withdraw(&finishes.link).await.unwrap();

    let arrive = |token: Token, arrival| {
        let (store, driving) = (lab.store.clone(), driving.clone());
        async move { store.arrive(&token, &driving, arrival).await }
    };
    let token = |seed| Token::random(&mut ChaCha12Rng::seed_from_u64(seed));
    assert!(matches!(
        arrive(token(900), person("A1")).await,
        Err(Error::NotAdmitted(NotAdmitted::Withdrawn))
    ));
    arrive(token(901), person("A2")).await.unwrap();

    lab.store.forget_people(&driving).await.unwrap();
    arrive(token(902), person("A1")).await.unwrap();
    lab.check().await;
}

#[tokio::test]
async fn the_row_that_stays_tells_neither_condition_nor_clock_nor_more_time() {
    let mut lab = Lab::open().await;
    let driving = StudyId::from("driving");
    lab.clock.advance(12_345);
    let mut run = NewRun {
        factor: TimeFactor::new(2.0).unwrap(),
        ..lab.new_run("driving")
    };
    run.candidates[0].condition = Some("a/b".into());
    let person = lab.start_as("driving", run).await;
    let row = async || {
        let rows = lab
            .store
            .participants(&driving, Population::People, RunId::from(0), 10)
            .await
            .unwrap();
        rows.into_iter().next().unwrap()
    };
    let before = row().await;
    assert!(before.condition.is_some() && before.started_at.unwrap().0 % 86_400_000 != 0);
    lab.store.withdraw(&person.link).await.unwrap();
    let after = row().await;
    assert_eq!((after.condition, after.time_factor), (None, 1.0));
    assert_eq!(after.started_at.unwrap().0 % 86_400_000, 0);
}

#[tokio::test]
async fn a_withdrawal_is_judged_in_its_place_among_other_jobs() {
    let mut lab = Lab::open().await;
    let person = lab.start_and_reach_timed("driving").await;
    let other = lab.start_and_reach_timed("driving").await;
    let answer = |store: Store, run, position| async move {
        let form = super::lab::form(
            position,
            &format!("at {position}"),
            super::lab::choice("stop"),
        );
        store.submit(run, form).await
    };
    // Sent in this order without waiting: all of them can stand in one batch.
    let (before, withdrawn, after, others) = tokio::join!(
        answer(lab.store.clone(), person.run, 2),
        lab.store.withdraw(&person.link),
        answer(lab.store.clone(), person.run, 3),
        answer(lab.store.clone(), other.run, 2),
    );
    assert!(before.is_ok() && withdrawn.is_ok() && others.is_ok());
    // The withdrawal looks the link up first, so the form after it may come before it. Either way it is gone.
    assert!(after.is_ok() || matches!(after, Err(Error::Refused(_))));
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 0)
    );
    assert_eq!(
        lab.chosen("driving", "explicit/timed/high", "stop").await,
        (0, 0)
    );
    lab.check().await;
}

#[tokio::test]
async fn patterns_forget_the_withdrawn() {
    let mut lab = Lab::open().await;
    let mut link = None;
    for action in ["stop", "stop", "accelerate"] {
        let mut person = lab.start_and_reach_timed("driving").await;
        person.finishes(&lab, action).await;
        link = Some(person.link);
    }
    let driving = StudyId::from("driving");
    let problems: Vec<_> = lab
        .store
        .cell_counts(&driving, Population::People)
        .await
        .unwrap()
        .into_iter()
        .map(|count| count.problem)
        .collect();
    let patterns = || {
        lab.store
            .patterns(&driving, Population::People, AnalysisSet::All, &problems)
    };
    let weights = |patterns: Vec<riskaware::store::Pattern>| -> Vec<u64> {
        patterns.into_iter().map(|pattern| pattern.weight).collect()
    };
    assert_eq!(weights(patterns().await.unwrap()), [2, 1]);
    lab.store.withdraw(&link.unwrap()).await.unwrap();
    assert_eq!(weights(patterns().await.unwrap()), [2]);
}

#[tokio::test]
async fn the_write_ahead_log_keeps_nothing_of_an_erased_form() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    person.finishes(&lab, "a-very-particular-action").await;
    let path = lab.path();
    let holds = |path: &std::path::Path| {
        String::from_utf8_lossy(&std::fs::read(path).unwrap_or_default())
            .contains("a-very-particular-action")
    };
    assert!(holds(&path) || holds(&path.with_extension("db-wal")));
    lab.store.withdraw(&person.link).await.unwrap();
    lab.store.close().await;
    let mut raw = SqliteConnection::connect(path.to_str().unwrap())
        .await
        .unwrap();
    let ok: String = sqlx::query_scalar("pragma integrity_check")
        .fetch_one(&mut raw)
        .await
        .unwrap();
    assert_eq!(ok, "ok");
    assert!(!holds(&path.with_extension("db-wal")));
}

#[tokio::test]
async fn of_somebody_who_declines_no_id_is_kept() {
    let mut lab = Lab::open().await;
    let arrival = NewArrival {
        person: Some(("prolific".to_owned(), "5f3-secret-id".to_owned())),
        recruiting: [("PROLIFIC_PID".to_owned(), "5f3-secret-id".to_owned())].into(),
        ..NewArrival::default()
    };
    let token = lab.arrival("driving", arrival).await;
    let started = lab
        .store
        .start(&token, lab.new_run("driving"))
        .await
        .unwrap();
    let mut person = Person::of(&started);
    person.says(&lab, CONSENT, Reply::Declined).await.unwrap();
    let mut raw = SqliteConnection::connect(lab.path().to_str().unwrap())
        .await
        .unwrap();
    let kept: (i64, i64) = sqlx::query_as(
        r#"
        select
            (select count(*) from run where platform is not null or platform_key is not null or recruiting is not null),
            (select count(*) from arrival where platform is not null or platform_key is not null or recruiting is not null)
        "#,
    )
    .fetch_one(&mut raw)
    .await
    .unwrap();
    assert_eq!(kept, (0, 0));
    assert_eq!(
        lab.store.visit(&person.link).await.unwrap().state,
        RunState::Declined
    );
}
