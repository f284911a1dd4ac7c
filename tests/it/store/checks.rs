//! Whatever happens in whatever order, counters and answers are what the events make of them.

use proptest::prelude::*;
use riskaware::store::{Error, NewRun, Population};
use riskaware::study::{Reply, TimeFactor};
use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;

use super::lab::{Lab, Person, THANKS, choice, form};

/// Something that somebody or something does.
#[derive(Debug, Clone)]
enum Deed {
    Start {
        study: usize,
        kind: usize,
    },
    /// The form of the person's current step, or of another one.
    Say {
        person: usize,
        ahead: i64,
        reply: usize,
        key: usize,
    },
    Look {
        person: usize,
    },
    Wait {
        millis: i64,
    },
    Sweep,
    Withdraw {
        person: usize,
    },
    Restart,
}

fn deeds() -> impl Strategy<Value = Vec<Deed>> {
    let deed = prop_oneof![
        3 => (0..2_usize, 0..5_usize).prop_map(|(study, kind)| Deed::Start { study, kind }),
        // Mostly the current step with a new key, as people do.
        24 => (0..6_usize, 0..8_usize).prop_map(|(person, reply)| Deed::Say { person, ahead: 0, reply, key: 99 }),
        4 => (0..6_usize, -3..3_i64, 0..8_usize, 0..3_usize)
            .prop_map(|(person, ahead, reply, key)| Deed::Say { person, ahead, reply, key }),
        4 => (0..6_usize).prop_map(|person| Deed::Look { person }),
        4 => prop_oneof![Just(100_i64), Just(4_000), Just(8_000), Just(12_000)]
            .prop_map(|millis| Deed::Wait { millis }),
        3 => Just(Deed::Sweep),
        1 => (0..6_usize).prop_map(|person| Deed::Withdraw { person }),
        1 => Just(Deed::Restart),
    ];
    proptest::collection::vec(deed, 40..120)
}

async fn act(lab: &mut Lab, people: &mut Vec<Person>, number: usize, deed: &Deed) {
    match deed {
        Deed::Start { study, kind } => {
            let study = ["driving", "cups"][*study];
            let usual = lab.new_run(study);
            let run = match kind {
                0 => {
                    people.push(lab.start_preview(study).await);
                    return;
                }
                1 => NewRun {
                    population: Population::Simulated,
                    ..usual
                },
                2 => NewRun {
                    factor: TimeFactor::new(1.5).unwrap(),
                    ..usual
                },
                _ => usual,
            };
            people.push(lab.start_as(study, run).await);
        }
        Deed::Say {
            person,
            ahead,
            reply,
            key,
        } => {
            let Some(person) = people.get(person % people.len().max(1)) else {
                return;
            };
            let view = lab.store.run(&person.link).await.unwrap();
            let current = view.step.map_or(0, |step| i64::from(step.position));
            let position = u32::try_from((current + ahead).max(0)).unwrap();
            let reply = match (reply, position) {
                // Mostly what fits the step.
                (0, 0) => Reply::Declined,
                (_, 0) => Reply::Agreed,
                (_, 1) => Reply::Continued,
                (0, 2 | 3) => Reply::GaveUp,
                (1..=3, 2..=5) => choice("accelerate"),
                (_, 2..=5) => choice("stop"),
                (0, _) => Reply::Continued,
                (_, _) => Reply::Filled {
                    values: serde_json::Map::new(),
                },
            };
            let key = if *key == 99 {
                format!("new {number}")
            } else {
                format!("used {key}")
            };
            let result = lab
                .store
                .submit(person.run, form(position, &key, reply))
                .await;
            assert!(
                matches!(result, Ok(_) | Err(Error::Refused(_))),
                "{result:?}"
            );
        }
        Deed::Look { person } => {
            if let Some(person) = people.get(person % people.len().max(1)) {
                lab.store.visit(&person.link).await.unwrap();
            }
        }
        Deed::Wait { millis } => lab.clock.advance(*millis),
        Deed::Sweep => {
            lab.store.close_overdue().await.unwrap();
        }
        Deed::Withdraw { person } => {
            if let Some(person) = people.get(person % people.len().max(1)) {
                lab.store.withdraw(&person.link).await.unwrap();
            }
        }
        Deed::Restart => lab.restart().await,
    }
}

proptest! {
    // Each case commits some hundred times to a real disk.
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn counters_are_a_recount_and_answers_a_replay(deeds in deeds()) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let mut lab = Lab::open().await;
            let mut people = Vec::new();
            for (number, deed) in deeds.iter().enumerate() {
                act(&mut lab, &mut people, number, deed).await;
            }
            // The last look at an untimed page may still wait to be written.
            lab.restart().await;
            lab.check().await;
        });
    }
}

#[tokio::test]
async fn the_checks_find_what_was_tampered_with() {
    let mut lab = Lab::open().await;
    let mut person = lab.start_and_reach_timed("driving").await;
    person.finishes(&lab, "stop").await;
    assert_eq!(
        lab.store
            .run(&person.link)
            .await
            .unwrap()
            .step
            .unwrap()
            .position,
        THANKS
    );
    lab.check().await;
    let mut raw = SqliteConnection::connect(lab.path().to_str().unwrap())
        .await
        .unwrap();
    sqlx::query("update answer set action = 'accelerate' where position = 2")
        .execute(&mut raw)
        .await
        .unwrap();
    assert_eq!(lab.store.check_answers().await.unwrap().len(), 1);
    // One action too few, one that was never chosen.
    assert_eq!(lab.store.check_counters().await.unwrap().len(), 2);
    sqlx::query("update answer set action = 'stop' where position = 2")
        .execute(&mut raw)
        .await
        .unwrap();
    lab.check().await;
    sqlx::query("update population set completed = 7 where study_id = 'driving'")
        .execute(&mut raw)
        .await
        .unwrap();
    assert_eq!(
        lab.store.check_counters().await.unwrap().len(),
        2,
        "both populations"
    );
}
