//! A person's way through a study, with everything that people and networks do to it.

use riskaware::store::{
    AnswerStatus, Error, EventKind, ImportedAnswer, ImportedRun, NewArrival, NewRun, Population,
    RunState, StudyState, Token, Verdict, draw_run,
};
use riskaware::study::step::ClientTiming;
use riskaware::study::{NotAdmitted, Reply, StepKind, Study, StudyId, TimeFactor, built_in};

use super::lab::{
    CONSENT, FORM, GRACE_MS, LIMIT_MS, Lab, Person, START_PAGE, THANKS, TIMED_HIGH, TIMED_LOW,
    UNTIMED_LOW, choice, form, preview, steps,
};

fn recruited(person: &str) -> NewArrival {
    NewArrival {
        person: Some(("prolific".to_owned(), person.to_owned())),
        ..NewArrival::default()
    }
}

#[tokio::test]
async fn two_people_in_two_studies_are_kept_apart() {
    let mut lab = Lab::open().await;
    let mut people = Vec::new();
    for (study, action) in [
        ("driving", "stop"),
        ("driving", "accelerate"),
        ("cups", "stop"),
        ("cups", "stop"),
    ] {
        let mut person = lab.start_and_reach_timed(study).await;
        person.finishes(&lab, action).await;
        people.push(person);
    }
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 1)
    );
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "accelerate")
            .await,
        (1, 1)
    );
    assert_eq!(
        lab.chosen("cups", "explicit/timed/low", "stop").await,
        (2, 2)
    );
    assert_eq!(
        lab.chosen("cups", "explicit/timed/low", "accelerate").await,
        (0, 0)
    );
    for person in &people {
        let view = lab.store.run(&person.link).await.unwrap();
        assert_eq!((view.run, view.state), (person.run, RunState::Completed));
        assert_eq!(view.step.unwrap().position, THANKS);
        assert!(
            lab.store
                .stored_count(person.run)
                .await
                .unwrap()
                .is_complete()
        );
    }
    let totals = lab
        .store
        .totals(&StudyId::from("cups"), Population::People)
        .await
        .unwrap();
    assert_eq!(
        (totals.started, totals.completed, totals.under_way()),
        (2, 2, 0)
    );
    let simulated = lab
        .store
        .totals(&StudyId::from("cups"), Population::Simulated)
        .await
        .unwrap();
    assert_eq!((simulated.started, simulated.data_version), (0, 0));
    lab.check().await;
}

#[tokio::test]
async fn a_built_in_study_is_stored_as_it_was_drawn() {
    let mut lab = Lab::open().await;
    let (name, text) = built_in()[0];
    let study = &Study::parse(name, text).unwrap();
    let version = lab
        .store
        .publish(study.id(), study.hash(), study.text(), StudyState::Open)
        .await
        .unwrap();
    let candidates = draw_run(study, &mut lab.rng).unwrap();
    let steps = candidates[0].steps.clone();
    let run = NewRun {
        version,
        candidates,
        ..lab.new_run("driving")
    };
    let person = lab.start_as("driving", run).await;
    assert_eq!(
        lab.store.visit(&person.link).await.unwrap().steps as usize,
        steps.len()
    );
    for (position, step) in (0..).zip(&steps) {
        assert_eq!(
            lab.store.step(person.run, position).await.unwrap(),
            step.plan
        );
        let is_counted_choice = step.plan.kind == StepKind::Choice && !step.is_practice;
        assert_eq!(step.asked.is_some(), is_counted_choice, "step {position}");
    }
    let fitted = steps.iter().filter(|step| step.is_fitted).count();
    assert_eq!(
        fitted,
        study.cells().iter().filter(|cell| cell.fitted).count()
    );
}

#[tokio::test]
async fn an_answer_counts_at_once_and_as_completed_only_at_the_end() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    person.chooses(&lab, TIMED_LOW, "stop").await;
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 0)
    );
    assert!(
        !lab.store
            .stored_count(person.run)
            .await
            .unwrap()
            .is_complete()
    );
    person.chooses(&lab, TIMED_HIGH, "stop").await;
    person.chooses(&lab, UNTIMED_LOW, "stop").await;
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 0)
    );
    person.chooses(&lab, UNTIMED_LOW + 1, "stop").await;
    person
        .says(
            &lab,
            FORM,
            Reply::Filled {
                values: serde_json::Map::new(),
            },
        )
        .await
        .unwrap();
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 1)
    );
    lab.check().await;
}

#[tokio::test]
async fn an_answer_two_seconds_after_the_limit_is_late_and_one_just_before_it_counts() {
    let mut lab = Lab::open().await;
    let (mut slow, mut fast) = (
        lab.start_and_reach_timed("driving").await,
        lab.start_and_reach_timed("driving").await,
    );
    lab.clock.advance(7_900);
    assert_eq!(
        fast.chooses(&lab, TIMED_LOW, "stop").await,
        Verdict::Answered
    );
    lab.clock.advance(2_100);
    assert_eq!(slow.chooses(&lab, TIMED_LOW, "stop").await, Verdict::Late);
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 0)
    );
    assert_eq!(lab.with_status("driving", AnswerStatus::Late).await, (1, 0));
    lab.check().await;
}

#[tokio::test]
async fn the_deadline_is_fixed_by_the_first_look_and_nothing_moves_it() {
    let mut lab = Lab::open().await;
    let person = lab.start_and_reach_timed("driving").await;
    let first = lab.store.visit(&person.link).await.unwrap().step.unwrap();
    assert_eq!((first.position, first.limit_ms), (TIMED_LOW, Some(8_000)));
    assert_eq!(
        first.deadline.unwrap().0 - first.shown_at.unwrap().0,
        LIMIT_MS + GRACE_MS
    );
    lab.clock.advance(3_000);
    assert_eq!(
        lab.store.visit(&person.link).await.unwrap().step.unwrap(),
        first
    );
    lab.restart().await;
    assert_eq!(
        lab.store.visit(&person.link).await.unwrap().step.unwrap(),
        first
    );
}

#[tokio::test]
async fn a_timed_question_after_another_block_starts_with_the_look_at_it() {
    let mut lab = Lab::open().await;
    let person = lab.start_and_reach_timed("driving").await;
    lab.clock.advance(LIMIT_MS + GRACE_MS + 5_001);
    assert_eq!(lab.store.close_overdue().await.unwrap(), 1);
    let waiting = lab.store.run(&person.link).await.unwrap().step.unwrap();
    assert_eq!(
        (waiting.position, waiting.shown_at),
        (TIMED_HIGH, None),
        "nobody is there to see it"
    );
    lab.clock.advance(60_000);
    assert_eq!(lab.store.close_overdue().await.unwrap(), 0);
    let now = lab.clock.now();
    let shown = lab.store.visit(&person.link).await.unwrap().step.unwrap();
    assert_eq!((shown.position, shown.shown_at), (TIMED_HIGH, Some(now)));
    assert_eq!(
        lab.with_status("driving", AnswerStatus::TimedOut).await,
        (1, 0)
    );
    lab.check().await;
}

#[tokio::test]
async fn who_comes_back_after_the_time_sees_the_next_question() {
    let mut lab = Lab::open().await;
    let person = lab.start_and_reach_timed("driving").await;
    lab.clock.advance(LIMIT_MS + GRACE_MS + 1);
    let view = lab.store.visit(&person.link).await.unwrap();
    assert_eq!(view.step.unwrap().position, TIMED_HIGH);
    let kinds: Vec<EventKind> = lab
        .store
        .events(person.run)
        .await
        .unwrap()
        .into_iter()
        .map(|event| event.kind)
        .collect();
    assert_eq!(
        kinds.last_chunk(),
        Some(&[EventKind::RanOut, EventKind::Shown])
    );
    lab.check().await;
}

#[tokio::test]
async fn the_page_cannot_end_a_question_early() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    lab.clock.advance(7_999);
    let early = lab
        .store
        .submit(person.run, form(TIMED_LOW, "one form", Reply::GaveUp))
        .await
        .unwrap();
    assert_eq!((early.verdict, early.position), (Verdict::Early, TIMED_LOW));
    let chosen = lab
        .store
        .submit(person.run, form(TIMED_LOW, "one form", choice("stop")))
        .await
        .unwrap();
    assert_eq!(
        chosen.verdict,
        Verdict::Answered,
        "the form was not used up"
    );
    lab.clock.advance(8_000);
    assert_eq!(
        person
            .says(&lab, TIMED_HIGH, Reply::GaveUp)
            .await
            .unwrap()
            .verdict,
        Verdict::TimedOut
    );
    lab.check().await;
}

#[tokio::test]
async fn the_same_form_gets_the_same_receipt_and_the_first_answer_stands() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    let stop = form(TIMED_LOW, "a form", choice("stop"));
    let first = lab.store.submit(person.run, stop.clone()).await.unwrap();
    lab.clock.advance(500);
    let retry = lab.store.submit(person.run, stop.clone()).await.unwrap();
    assert_eq!(
        (retry.verdict, retry.receipt),
        (Verdict::Retry, first.receipt)
    );
    let other = form(TIMED_LOW, "a form", choice("accelerate"));
    let conflict = lab.store.submit(person.run, other).await.unwrap();
    assert_eq!(
        (conflict.verdict, conflict.receipt),
        (Verdict::Conflict, first.receipt)
    );
    assert_eq!(
        person.chooses(&lab, TIMED_LOW, "accelerate").await,
        Verdict::Duplicate
    );
    lab.restart().await;
    let retry = lab.store.submit(person.run, stop).await.unwrap();
    assert_eq!(
        (retry.verdict, retry.receipt),
        (Verdict::Retry, first.receipt)
    );
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 0)
    );
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "accelerate")
            .await,
        (0, 0)
    );
    let verdicts: Vec<Verdict> = lab
        .store
        .events(person.run)
        .await
        .unwrap()
        .into_iter()
        .filter_map(|event| event.verdict)
        .skip(2)
        .collect();
    let expected = [
        Verdict::Answered,
        Verdict::Retry,
        Verdict::Conflict,
        Verdict::Duplicate,
        Verdict::Retry,
    ];
    assert_eq!(verdicts, expected, "everything that arrived is kept");
    lab.check().await;
}

#[tokio::test]
async fn a_double_click_and_two_tabs_within_one_commit_count_once() {
    let mut lab = Lab::open().await;
    let person = lab.start_and_reach_timed("driving").await;
    let mut clicks = tokio::task::JoinSet::new();
    for click in 0..40 {
        let (store, run) = (lab.store.clone(), person.run);
        let key = format!("tab {}", click % 2);
        clicks.spawn(async move {
            store
                .submit(run, form(TIMED_LOW, &key, choice("stop")))
                .await
                .unwrap()
        });
    }
    let clicks = clicks.join_all().await;
    assert_eq!(
        clicks
            .iter()
            .filter(|click| click.verdict == Verdict::Answered)
            .count(),
        1
    );
    assert_eq!(
        clicks
            .iter()
            .filter(|click| click.verdict == Verdict::Duplicate)
            .count(),
        1
    );
    assert_eq!(
        clicks
            .iter()
            .filter(|click| click.verdict == Verdict::Retry)
            .count(),
        38
    );
    assert!(clicks.iter().all(|click| click.position == TIMED_HIGH));
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (1, 0)
    );
    lab.check().await;
}

#[tokio::test]
async fn steps_out_of_order_and_answers_of_the_wrong_kind_are_refused_and_not_kept() {
    let mut lab = Lab::open().await;
    let mut person = lab.start("driving").await;
    let before = lab.store.events(person.run).await.unwrap();
    for (position, reply) in [
        (TIMED_LOW, choice("stop")),
        (CONSENT, choice("stop")),
        (99, Reply::Continued),
        (CONSENT, Reply::GaveUp),
    ] {
        let refused = person.says(&lab, position, reply).await.unwrap_err();
        assert!(matches!(refused, Error::Refused(_)), "{refused}");
    }
    let refused = lab
        .store
        .submit(person.run, form(CONSENT, "", Reply::Agreed))
        .await
        .unwrap_err();
    assert_eq!(
        refused.to_string(),
        "the form's key has 0 bytes; 1 to 64 are allowed"
    );
    let unknown = lab
        .store
        .submit(999.into(), form(CONSENT, "k", Reply::Agreed))
        .await
        .unwrap_err();
    assert_eq!(unknown.to_string(), "run not found");
    assert_eq!(lab.store.events(person.run).await.unwrap(), before);
}

#[tokio::test]
async fn declining_ends_the_run_and_is_counted() {
    let mut lab = Lab::open().await;
    let mut person = lab.start("driving").await;
    let declined = person.says(&lab, CONSENT, Reply::Declined).await.unwrap();
    assert_eq!(declined.state, RunState::Declined);
    assert!(matches!(
        person.says(&lab, START_PAGE, Reply::Continued).await,
        Err(Error::Refused(_))
    ));
    let view = lab.store.visit(&person.link).await.unwrap();
    assert_eq!(
        (view.state, view.finished_at),
        (RunState::Declined, Some(lab.clock.now()))
    );
    let totals = lab
        .store
        .totals(&StudyId::from("driving"), Population::People)
        .await
        .unwrap();
    assert_eq!(
        (totals.started, totals.declined, totals.completed),
        (1, 1, 0)
    );
    lab.check().await;
}

#[tokio::test]
async fn pressing_start_again_leads_to_the_same_run() {
    let mut lab = Lab::open().await;
    let arrival = lab.arrival("driving", NewArrival::default()).await;
    assert_eq!(lab.store.arrival(&arrival).await.unwrap().link, None);
    let run = lab.new_run("driving");
    let (one, two) = tokio::join!(
        lab.store.start(&arrival, run.clone()),
        lab.store.start(&arrival, run.clone())
    );
    let (one, two) = (one.unwrap(), two.unwrap());
    assert_eq!(
        (&one.link, one.run, one.is_resumed),
        (&two.link, two.run, false)
    );
    assert!(two.is_resumed && two.is_owner);
    lab.restart().await;
    let three = lab.store.start(&arrival, run).await.unwrap();
    assert_eq!((&three.link, three.is_owner), (&one.link, true));
    assert_eq!(
        lab.store.arrival(&arrival).await.unwrap().link,
        Some(one.link)
    );
    lab.check().await;
}

#[tokio::test]
async fn a_recruited_person_has_one_run_in_each_study() {
    let mut lab = Lab::open().await;
    let (first, second) = (
        lab.arrival("driving", recruited("p1")).await,
        lab.arrival("driving", recruited("p1")).await,
    );
    let run = lab.new_run("driving");
    let (owner, other) = tokio::join!(
        lab.store.start(&first, run.clone()),
        lab.store.start(&second, run.clone())
    );
    let (owner, other) = (owner.unwrap(), other.unwrap());
    assert_eq!(owner.run, other.run);
    assert_ne!(owner.link, other.link);
    assert!(owner.is_owner && !other.is_owner && other.is_resumed);
    let again = lab.store.start(&second, run).await.unwrap();
    assert_eq!((again.run, again.is_owner), (owner.run, false));

    assert!(lab.store.run(&owner.link).await.unwrap().is_owner);
    assert!(!lab.store.run(&other.link).await.unwrap().is_owner);
    assert!(matches!(
        lab.store.withdraw(&other.link).await,
        Err(Error::Refused(_))
    ));

    let elsewhere = lab.arrival("cups", recruited("p1")).await;
    assert!(
        !lab.store
            .start(&elsewhere, lab.new_run("cups"))
            .await
            .unwrap()
            .is_resumed
    );
    let somebody = lab.arrival("driving", recruited("p2")).await;
    assert_ne!(
        lab.store
            .start(&somebody, lab.new_run("driving"))
            .await
            .unwrap()
            .run,
        owner.run
    );
}

#[tokio::test]
async fn runs_without_an_end_and_imported_ones_take_no_place() {
    let mut lab = Lab::open().await;
    let driving = StudyId::from("driving");
    lab.start("driving").await;
    let imported = ImportedRun {
        participant: "1".to_owned(),
        answers: vec![ImportedAnswer {
            step: steps()[UNTIMED_LOW as usize].clone(),
            shown_at: None,
            at: lab.clock.now(),
            reply: choice("stop"),
            timing: ClientTiming::default(),
        }],
        condition: None,
        has_times: true,
        is_completed: true,
    };
    let import = async || {
        let runs = vec![imported.clone()];
        let version = lab.version("driving");
        lab.store.import(&driving, version, "elsewhere", runs).await
    };
    assert_eq!(import().await.unwrap(), 1);
    // What the retention date erases is links; the same people are still known.
    lab.store.forget_people(&driving).await.unwrap();
    assert!(matches!(import().await, Err(Error::Refused(_))));

    let with_quota = NewRun {
        quota: Some(1),
        time_limit_ms: Some(60_000),
        ..lab.new_run("driving")
    };
    lab.start_as("driving", with_quota.clone()).await;
    let arrival = lab.arrival("driving", NewArrival::default()).await;
    assert!(matches!(
        lab.store.start(&arrival, with_quota).await,
        Err(Error::NotAdmitted(NotAdmitted::Full))
    ));
}

#[tokio::test]
async fn every_ending_is_shown_on_the_link_on_which_its_person_was() {
    let mut lab = Lab::open().await;
    let run = NewRun {
        time_limit_ms: Some(60_000),
        ..lab.new_run("driving")
    };
    let mut links = Vec::new();
    for person in ["declines", "leaves"] {
        for _ in 0..2 {
            let arrival = lab.arrival("driving", recruited(person)).await;
            links.push(lab.store.start(&arrival, run.clone()).await.unwrap());
            lab.clock.advance(1_000);
        }
    }
    let [_, declining, leaving, left] = &links[..] else {
        panic!("two people with two links each");
    };
    let decline = form(CONSENT, "no", Reply::Declined);
    let on_link = lab
        .store
        .submit_on(&declining.link, declining.run, decline)
        .await;
    assert_eq!(on_link.unwrap().state, RunState::Declined);
    lab.clock.advance(60_000);
    assert_eq!(lab.store.close_overdue().await.unwrap(), 1);
    let (mut late, ends) = (lab.arrival("driving", recruited("leaves")).await, left.run);
    late = lab.store.start(&late, run).await.unwrap().link;

    for (link, state) in [
        (&declining.link, RunState::Declined),
        (&left.link, RunState::TimedOut),
        (&leaving.link, RunState::TimedOut),
    ] {
        let view = lab.store.run(link).await.unwrap();
        assert_eq!((view.state, view.shows_code), (state, true));
    }
    // A link that was made after the end is anybody's who knows the person's id.
    let view = lab.store.run(&late).await.unwrap();
    assert_eq!((view.run, view.shows_code), (ends, false));
}

#[tokio::test]
async fn who_has_finished_gets_no_second_run() {
    let mut lab = Lab::open().await;
    let arrival = lab.arrival("driving", recruited("p1")).await;
    let started = lab
        .store
        .start(&arrival, lab.new_run("driving"))
        .await
        .unwrap();
    let mut person = Person::of(&started);
    person.says(&lab, CONSENT, Reply::Agreed).await.unwrap();
    person
        .says(&lab, START_PAGE, Reply::Continued)
        .await
        .unwrap();
    person.finishes(&lab, "stop").await;
    let again = lab.arrival("driving", recruited("p1")).await;
    let again = lab
        .store
        .start(&again, lab.new_run("driving"))
        .await
        .unwrap();
    assert_eq!(
        (again.run, again.state, again.is_owner),
        (person.run, RunState::Completed, false)
    );
}

#[tokio::test]
async fn closed_and_unknown_studies_take_nobody_in_and_let_people_finish() {
    let mut lab = Lab::open().await;
    let driving = StudyId::from("driving");
    let mut person = lab.start_and_reach_timed("driving").await;
    let arrival = lab.arrival("driving", NewArrival::default()).await;
    for state in [StudyState::Paused, StudyState::Closed] {
        lab.store.set_study_state(&driving, state).await.unwrap();
        let refused = lab
            .store
            .start(&arrival, lab.new_run("driving"))
            .await
            .unwrap_err();
        assert_eq!(refused.to_string(), format!("study driving is {state}"));
        let token = Token::random(&mut lab.rng);
        let refused = lab
            .store
            .arrive(&token, &driving, NewArrival::default())
            .await
            .unwrap_err();
        assert!(matches!(refused, Error::Closed { .. }), "{refused}");
    }
    assert_eq!(
        lab.store.study(&driving).await.unwrap().state,
        StudyState::Closed
    );
    assert_eq!(
        lab.store.study(&StudyId::from("cups")).await.unwrap().state,
        StudyState::Open
    );
    person.finishes(&lab, "stop").await;
    let looks = lab.arrival("driving", preview()).await;
    assert!(
        lab.store
            .start(&looks, lab.new_run("driving"))
            .await
            .is_ok(),
        "a preview starts in any state"
    );
    let token = Token::random(&mut lab.rng);
    let unknown = lab
        .store
        .arrive(&token, &StudyId::from("mazes"), NewArrival::default())
        .await
        .unwrap_err();
    assert_eq!(unknown.to_string(), "study not found");
    let unknown = lab
        .store
        .set_study_state(&StudyId::from("mazes"), StudyState::Open)
        .await
        .unwrap_err();
    assert_eq!(unknown.to_string(), "study not found");
}

#[tokio::test]
async fn an_arrival_ends_after_a_day_unless_it_led_to_a_run() {
    let mut lab = Lab::open().await;
    let (used, unused) = (
        lab.arrival("driving", NewArrival::default()).await,
        lab.arrival("driving", NewArrival::default()).await,
    );
    let run = lab.new_run("driving");
    let started = lab.store.start(&used, run.clone()).await.unwrap();
    lab.clock.advance(24 * 60 * 60 * 1_000 + 1);
    assert!(matches!(
        lab.store.arrival(&unused).await,
        Err(Error::NotFound("arrival"))
    ));
    assert!(matches!(
        lab.store.start(&unused, run.clone()).await,
        Err(Error::NotFound("arrival"))
    ));
    assert_eq!(lab.store.start(&used, run).await.unwrap().run, started.run);
    assert_eq!(lab.store.forget_arrivals().await.unwrap(), 1);
    assert_eq!(lab.store.forget_arrivals().await.unwrap(), 0);
    assert_eq!(
        lab.store.arrival(&used).await.unwrap().link,
        Some(started.link)
    );
}

#[tokio::test]
async fn previews_simulated_people_and_extra_time_are_not_mixed_in() {
    let mut lab = Lab::open().await;
    let usual = lab.new_run("driving");
    for (arrival, run) in [
        (preview(), usual.clone()),
        (
            NewArrival::default(),
            NewRun {
                population: Population::Simulated,
                ..usual.clone()
            },
        ),
        (
            NewArrival::default(),
            NewRun {
                factor: TimeFactor::new(2.0).unwrap(),
                ..usual
            },
        ),
    ] {
        let mut person = lab.start_from("driving", arrival, run).await;
        person.says(&lab, CONSENT, Reply::Agreed).await.unwrap();
        person
            .says(&lab, START_PAGE, Reply::Continued)
            .await
            .unwrap();
        person.finishes(&lab, "stop").await;
    }
    let driving = StudyId::from("driving");
    assert_eq!(
        lab.chosen("driving", "explicit/timed/low", "stop").await,
        (0, 0),
        "timed, with extra time"
    );
    assert_eq!(
        lab.chosen("driving", "explicit/untimed/low", "stop").await,
        (1, 1),
        "without a limit"
    );
    let people = lab
        .store
        .totals(&driving, Population::People)
        .await
        .unwrap();
    let simulated = lab
        .store
        .totals(&driving, Population::Simulated)
        .await
        .unwrap();
    assert_eq!((people.started, simulated.started), (1, 1));
    lab.check().await;
}

#[tokio::test]
async fn whoever_has_a_run_may_return_to_a_closed_study() {
    let mut lab = Lab::open().await;
    let driving = StudyId::from("driving");
    let first = lab.arrival("driving", recruited("p1")).await;
    let begun = lab
        .store
        .start(&first, lab.new_run("driving"))
        .await
        .unwrap();
    lab.store
        .set_study_state(&driving, StudyState::Closed)
        .await
        .unwrap();
    let again = lab.arrival("driving", recruited("p1")).await;
    let resumed = lab
        .store
        .start(&again, lab.new_run("driving"))
        .await
        .unwrap();
    assert_eq!(resumed.run, begun.run);
    for arrival in [recruited("p2"), NewArrival::default()] {
        let token = Token::random(&mut lab.rng);
        let refused = lab.store.arrive(&token, &driving, arrival).await;
        assert!(matches!(refused, Err(Error::Closed { .. })), "{refused:?}");
    }
}

#[tokio::test]
async fn an_arrival_starts_no_run_of_another_study() {
    let mut lab = Lab::open().await;
    let arrival = lab.arrival("driving", NewArrival::default()).await;
    let refused = lab.store.start(&arrival, lab.new_run("cups")).await;
    assert!(
        matches!(refused, Err(Error::NotFound("arrival"))),
        "{refused:?}"
    );
    lab.store
        .start(&arrival, lab.new_run("driving"))
        .await
        .unwrap();
    lab.check().await;
}
