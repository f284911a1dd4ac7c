//! What is stored beside the fits: comparisons, checkpoints, and that a rule for stopping was reached.

use riskaware::store::{Checkpoint, LookCount, NewCheckpoints, NewComparison, Population, Reached};
use riskaware::study::{Reply, StudyId};

use super::lab::{CONSENT, Lab, START_PAGE, TIMED_LOW};

const CELL: &str = "explicit/untimed/low";

/// How many chose what in one cell, look by look.
fn of_cell(counts: &[LookCount]) -> Vec<(u64, &str, u64)> {
    counts
        .iter()
        .filter(|count| count.cell == CELL)
        .map(|count| (count.look, count.action.as_str(), count.n))
        .collect()
}

#[tokio::test]
async fn people_count_in_the_order_in_which_they_finished() {
    let mut lab = Lab::open().await;
    // The first to begin is the last to finish.
    let mut slow = lab.start_and_reach_timed("driving").await;
    for action in ["stop", "stop", "go", "go"] {
        lab.clock.advance(100);
        let mut person = lab.start_and_reach_timed("driving").await;
        person.finishes(&lab, action).await;
    }
    let mut other = lab.start_and_reach_timed("cups").await;
    other.finishes(&lab, "stop").await;
    let mut preview = lab.start_preview("driving").await;
    preview.says(&lab, CONSENT, Reply::Agreed).await.unwrap();
    preview
        .says(&lab, START_PAGE, Reply::Continued)
        .await
        .unwrap();
    preview.finishes(&lab, "stop").await;
    // The clock was set back, or the last form arrived before others and was stored after them.
    lab.clock.advance(-250);
    slow.finishes(&lab, "slow").await;
    // Not finished.
    lab.start_and_reach_timed("driving").await;

    let driving = StudyId::from("driving");
    let looks = async |minimum, every| {
        lab.store
            .look_counts(&driving, Population::People, minimum, every)
            .await
            .unwrap()
    };
    let each = looks(1, 1).await;
    assert_eq!(
        of_cell(&each),
        [
            (0, "stop", 1),
            (1, "stop", 1),
            (2, "go", 1),
            (3, "go", 1),
            (4, "slow", 1)
        ]
    );
    let pairs = looks(3, 2).await;
    assert_eq!(
        of_cell(&pairs),
        [(0, "go", 1), (0, "stop", 2), (1, "go", 1), (1, "slow", 1)]
    );
    assert_eq!(
        of_cell(&looks(9, 1).await).len(),
        3,
        "all in the first look"
    );
    let simulated = lab
        .store
        .look_counts(&driving, Population::Simulated, 1, 1)
        .await
        .unwrap();
    assert_eq!(simulated, []);
}

#[tokio::test]
async fn a_comparison_takes_the_place_of_the_one_before() {
    let lab = Lab::open().await;
    let comparison = |plan: &str, hash: &str, outcome: Result<&str, &str>| NewComparison {
        study: StudyId::from("driving"),
        population: Population::People,
        plan: plan.into(),
        input_hash: hash.to_owned(),
        data_version: 7,
        version: lab.driving,
        seed: u64::MAX,
        outcome: outcome.map(str::to_owned).map_err(str::to_owned),
        cpu_ms: 90,
    };
    let mut changes = lab.store.subscribe();
    for new in [
        comparison("cell", "a", Err("no")),
        comparison("all", "b", Ok("{}")),
        comparison("cell", "c", Ok("{\"n\":1}")),
    ] {
        lab.store.save_comparison(new).await.unwrap();
        assert!(changes.try_recv().is_ok(), "the page turns");
    }
    let driving = StudyId::from("driving");
    let stored = lab
        .store
        .comparisons(&driving, Population::People, &[])
        .await
        .unwrap();
    let shown: Vec<_> = stored
        .iter()
        .map(|row| {
            (
                row.plan.as_str(),
                row.input_hash.as_str(),
                row.outcome.as_deref(),
            )
        })
        .collect();
    assert_eq!(
        shown,
        [("all", "b", Ok("{}")), ("cell", "c", Ok("{\"n\":1}"))]
    );
    assert_eq!((stored[0].seed, stored[0].data_version), (u64::MAX, 7));
    for (study, population) in [
        (driving, Population::Simulated),
        (StudyId::from("cups"), Population::People),
    ] {
        assert_eq!(
            lab.store
                .comparisons(&study, population, &[])
                .await
                .unwrap(),
            []
        );
    }
}

#[tokio::test]
async fn a_rule_is_reached_once_whatever_comes_later() {
    let lab = Lab::open().await;
    let driving = StudyId::from("driving");
    let checkpoint = |n, hash: &str| Checkpoint {
        n,
        input_hash: hash.to_owned(),
        result: "{}".to_owned(),
    };
    let new = |checkpoints, reached: Option<(&str, u64)>| NewCheckpoints {
        study: driving.clone(),
        population: Population::People,
        data_version: 0,
        checkpoints,
        reached: reached.map(|(rule_hash, n)| Reached {
            rule_hash: rule_hash.to_owned(),
            rule: "{\"bayes_factor\":10}".to_owned(),
            n,
            value: 12.5,
        }),
    };
    let save = async |new| lab.store.save_checkpoints(new).await.unwrap();
    assert!(!save(new(vec![checkpoint(5, "a"), checkpoint(10, "b")], None)).await);
    let at = lab.clock.now();
    assert!(save(new(vec![checkpoint(15, "c")], Some(("rule", 15)))).await);
    lab.clock.advance(1_000);
    assert!(!save(new(vec![checkpoint(5, "d")], Some(("rule", 5)))).await);
    assert!(save(new(Vec::new(), Some(("another rule", 5)))).await);

    let stored = lab
        .store
        .checkpoints(&driving, Population::People)
        .await
        .unwrap();
    assert_eq!(
        stored,
        [checkpoint(5, "d"), checkpoint(10, "b"), checkpoint(15, "c")]
    );
    let reached = lab
        .store
        .stopping(&driving, Population::People, "rule")
        .await
        .unwrap()
        .unwrap();
    assert_eq!(
        (reached.n, reached.value, reached.reached_at),
        (15, 12.5, at)
    );
    // A withdrawal came between the reading of the answers and the end of the look at them.
    let mut lab = lab;
    let mut leaves = lab.start_and_reach_timed("driving").await;
    leaves.chooses(&lab, TIMED_LOW, "stop").await;
    lab.store.withdraw(&leaves.link).await.unwrap();
    let late = NewCheckpoints {
        study: driving.clone(),
        population: Population::People,
        data_version: 0,
        checkpoints: vec![checkpoint(5, "e")],
        reached: Some(Reached {
            rule_hash: "no rule".to_owned(),
            rule: "{}".to_owned(),
            n: 5,
            value: 12.5,
        }),
    };
    assert!(!lab.store.save_checkpoints(late).await.unwrap());
    let left = lab.store.checkpoints(&driving, Population::People).await;
    assert_eq!(left.unwrap(), []);
    for (study, population, rule) in [
        (&driving, Population::People, "no rule"),
        (&driving, Population::Simulated, "rule"),
        (&StudyId::from("cups"), Population::People, "rule"),
    ] {
        let found = lab.store.stopping(study, population, rule).await.unwrap();
        assert_eq!(found, None);
    }
}
