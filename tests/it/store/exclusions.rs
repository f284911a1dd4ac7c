//! Who is left out of the analysis is left out of everything that is counted for it, and of nothing else.

use riskaware::store::{
    AnalysisSet, AnswerKey, Checkpoint, Error, ExclusionReason, NewCheckpoints, Population, RunId,
    StudyState, Totals, Verdict,
};
use riskaware::study::{BlockId, ExclusionRule, Flag, Reply, StudyId};
use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;

use super::lab::{CONSENT, Lab, TIMED_HIGH, TIMED_LOW, UNTIMED_LOW};

const LOW: &str = "explicit/timed/low";

fn driving() -> StudyId {
    StudyId::from("driving")
}

async fn exclude(lab: &Lab, run: RunId, reason: &str) -> Result<(), Error> {
    let reason = ExclusionReason::new(reason).unwrap();
    let (study, actor) = (driving(), "ada".to_owned());
    let store = &lab.store;
    store
        .exclude(&study, Population::People, run, reason, actor)
        .await
}

async fn include(lab: &Lab, run: RunId) -> Result<(), Error> {
    lab.store.include(&driving(), Population::People, run).await
}

async fn totals(lab: &Lab) -> Totals {
    lab.store
        .totals(&driving(), Population::People)
        .await
        .unwrap()
}

/// The same database with a rule from now on.
async fn with_rule(flags: &[Flag]) -> Lab {
    let mut lab = Lab::open().await;
    publish(&mut lab, flags).await;
    lab
}

async fn publish(lab: &mut Lab, flags: &[Flag]) {
    let rule = ExclusionRule {
        flags: flags.to_vec(),
        checks: Vec::new(),
    };
    let (hash, text) = (format!("with {flags:?}"), format!("# {flags:?}"));
    lab.driving = lab
        .store
        .publish(&driving(), &hash, &text, StudyState::Open, Some(&rule))
        .await
        .unwrap();
}

/// Everything that an analysis reads, each as how often `stop` was chosen in the cell.
async fn seen(lab: &Lab, set: AnalysisSet) -> [u64; 4] {
    let (study, people) = (driving(), Population::People);
    let counts = lab.store.cell_counts(&study, people).await.unwrap();
    let row = counts
        .iter()
        .find(|row| row.cell == LOW && row.action.as_ref().is_some_and(|action| *action == "stop"))
        .unwrap();
    let patterns = lab
        .store
        .patterns(&study, people, set, &[row.problem])
        .await
        .unwrap();
    let stops = patterns
        .iter()
        .filter(|pattern| pattern.choices[0].1 == "stop");
    let sources = lab
        .store
        .choices_by_source(&study, people, set)
        .await
        .unwrap();
    let by_source = sources
        .iter()
        .filter(|count| count.cell == LOW && count.action == "stop");
    let looks = lab.store.look_counts(&study, people, 1, 1).await.unwrap();
    let by_look = looks
        .iter()
        .filter(|count| count.cell == LOW && count.action == "stop");
    [
        row.n(set),
        stops.map(|pattern| pattern.weight).sum(),
        by_source.map(|count| count.n).sum(),
        by_look.map(|count| count.n).sum(),
    ]
}

#[tokio::test]
async fn whoever_is_left_out_by_hand_counts_nowhere_and_everywhere_again_when_taken_in() {
    let mut lab = Lab::open().await;
    let mut people = Vec::new();
    for action in ["stop", "stop", "accelerate"] {
        let mut person = lab.start_and_reach_timed("driving").await;
        person.finishes(&lab, action).await;
        people.push(person);
    }
    let before = totals(&lab).await;
    let look = NewCheckpoints {
        study: driving(),
        population: Population::People,
        data_version: before.data_version,
        checkpoints: vec![Checkpoint {
            n: 2,
            input_hash: "of two".to_owned(),
            result: "{}".to_owned(),
        }],
        reached: None,
    };
    lab.store.save_checkpoints(look.clone()).await.unwrap();
    assert_eq!(seen(&lab, AnalysisSet::Completed).await, [2; 4]);

    let run = people[1].run;
    exclude(&lab, run, "talked to the first one").await.unwrap();
    lab.check().await;
    for set in [AnalysisSet::All, AnalysisSet::Completed] {
        assert_eq!(seen(&lab, set).await, [1; 4], "{set:?}");
        assert_eq!(
            lab.store
                .exclusions(&driving(), Population::People, set)
                .await
                .unwrap(),
            [(None, 1)]
        );
    }
    let ages = lab
        .store
        .form_answers(
            &driving(),
            Population::People,
            AnalysisSet::Completed,
            &BlockId::from("about"),
            "age",
            false,
        )
        .await
        .unwrap();
    assert_eq!(ages.iter().map(|answer| answer.n).sum::<u64>(), 2);
    let without = totals(&lab).await;
    assert_eq!(
        (
            without.completed,
            without.excluded_completed,
            without.analysed()
        ),
        (3, 1, 2)
    );
    assert!(
        without.data_version > before.data_version,
        "fits are behind"
    );
    // A look that counted them is gone, and one that was under way is not stored.
    let checkpoints = async || {
        lab.store
            .checkpoints(&driving(), Population::People)
            .await
            .unwrap()
            .len()
    };
    assert_eq!(checkpoints().await, 0);
    lab.store.save_checkpoints(look).await.unwrap();
    assert_eq!(checkpoints().await, 0);

    // Their answers stay where data are given out.
    let answers = lab
        .store
        .answers(&driving(), Population::People, AnswerKey::START, 100)
        .await
        .unwrap();
    assert_eq!(answers.len(), 3 * 4);
    for answer in answers {
        let reason = (answer.key.run == run).then_some("by hand: talked to the first one");
        assert_eq!(answer.excluded.as_deref(), reason);
    }

    // Another reason takes the place of the first one, and counts nobody twice.
    exclude(&lab, run, "asked for it").await.unwrap();
    let by_hand = lab.store.exclusion(run).await.unwrap().unwrap().by_hand;
    let by_hand = by_hand.unwrap();
    assert_eq!(
        (by_hand.reason.as_str(), by_hand.actor.as_str(), by_hand.at),
        ("asked for it", "ada", lab.clock.now())
    );
    let now = totals(&lab).await;
    assert_eq!(
        (now.excluded, now.data_version),
        (without.excluded, without.data_version)
    );

    include(&lab, run).await.unwrap();
    lab.check().await;
    assert_eq!(seen(&lab, AnalysisSet::Completed).await, [2; 4]);
    assert_eq!(totals(&lab).await.analysed(), 3);
    assert_eq!(lab.store.exclusion(run).await.unwrap(), None);
}

#[tokio::test]
async fn answers_that_come_later_of_somebody_left_out_count_nowhere_either() {
    let mut lab = Lab::open().await;
    let mut other = lab.start_and_reach_timed("driving").await;
    other.finishes(&lab, "stop").await;
    let mut person = lab.start_and_reach_timed("driving").await;
    exclude(&lab, person.run, "a colleague who tries it out")
        .await
        .unwrap();
    person.chooses(&lab, TIMED_LOW, "stop").await;
    lab.check().await;
    assert_eq!(seen(&lab, AnalysisSet::All).await, [1; 4]);
    assert_eq!(totals(&lab).await.excluded, 1);
    assert_eq!(totals(&lab).await.excluded_completed, 0);
    let mut again = lab.start_and_reach_timed("driving").await;
    again.finishes(&lab, "stop").await;
    for position in [TIMED_HIGH, UNTIMED_LOW] {
        person.chooses(&lab, position, "stop").await;
    }
    person.chooses(&lab, UNTIMED_LOW + 1, "stop").await;
    let values = serde_json::Map::new();
    person
        .says(&lab, UNTIMED_LOW + 2, Reply::Filled { values })
        .await
        .unwrap();
    lab.check().await;
    assert_eq!(seen(&lab, AnalysisSet::Completed).await, [2; 4]);
    assert_eq!(
        (totals(&lab).await.completed, totals(&lab).await.analysed()),
        (3, 2)
    );
    lab.store.withdraw(&person.link).await.unwrap();
    lab.check().await;
    assert_eq!(seen(&lab, AnalysisSet::All).await, [2; 4]);
    assert_eq!(
        (totals(&lab).await.excluded, totals(&lab).await.analysed()),
        (0, 2)
    );
    assert_eq!(lab.store.exclusion(person.run).await.unwrap(), None);
}

#[tokio::test]
async fn a_rule_judges_a_run_when_it_ends_and_each_by_its_own_version() {
    let mut lab = Lab::open().await;
    // Began before there was a rule.
    let mut early = lab.start_and_reach_timed("driving").await;
    publish(&mut lab, &[Flag::LateAnswer, Flag::FailedCheck]).await;
    let mut late = lab.start_and_reach_timed("driving").await;
    lab.clock.advance(10_000);
    for person in [&mut early, &mut late] {
        assert_eq!(person.chooses(&lab, TIMED_LOW, "stop").await, Verdict::Late);
    }
    assert_eq!(totals(&lab).await.excluded, 0, "not before it ends");
    for person in [&mut early, &mut late] {
        person.chooses(&lab, TIMED_HIGH, "stop").await;
        person.chooses(&lab, UNTIMED_LOW, "stop").await;
        person.chooses(&lab, UNTIMED_LOW + 1, "stop").await;
        let values = serde_json::Map::new();
        person
            .says(&lab, UNTIMED_LOW + 2, Reply::Filled { values })
            .await
            .unwrap();
    }
    let mut fine = lab.start_and_reach_timed("driving").await;
    fine.finishes(&lab, "stop").await;
    lab.check().await;
    assert_eq!(lab.store.exclusion(early.run).await.unwrap(), None);
    assert_eq!(lab.store.exclusion(fine.run).await.unwrap(), None);
    let exclusion = lab.store.exclusion(late.run).await.unwrap().unwrap();
    assert_eq!(exclusion.flags, [Flag::LateAnswer]);
    assert_eq!(exclusion.by_hand, None);
    assert_eq!(
        (totals(&lab).await.completed, totals(&lab).await.analysed()),
        (3, 2)
    );
    assert_eq!(
        lab.chosen("driving", "explicit/untimed/low", "stop").await,
        (2, 2)
    );

    // What the rule decided is not undone by hand; a reason beside it can be.
    let refused = include(&lab, late.run).await.unwrap_err();
    assert!(
        refused.to_string().contains("by the study's rule"),
        "{refused}"
    );
    exclude(&lab, late.run, "asked for it").await.unwrap();
    let rows = lab
        .store
        .moment()
        .await
        .unwrap()
        .participants(
            &driving(),
            Population::People,
            RunId::from(0),
            RunId::from(i64::MAX),
            10,
        )
        .await
        .unwrap();
    assert_eq!(
        rows[1].excluded.as_deref(),
        Some("late-answer; by hand: asked for it")
    );
    include(&lab, late.run).await.unwrap();
    lab.check().await;
    assert_eq!(totals(&lab).await.analysed(), 2);
    lab.store.withdraw(&late.link).await.unwrap();
    lab.check().await;
    assert_eq!(
        (totals(&lab).await.excluded, totals(&lab).await.analysed()),
        (0, 2)
    );
}

#[tokio::test]
async fn a_rule_finds_whom_it_left_out_by_hand_before() {
    let mut lab = with_rule(&[Flag::LateAnswer]).await;
    let mut late = lab.start_and_reach_timed("driving").await;
    exclude(&lab, late.run, "sat beside another").await.unwrap();
    lab.clock.advance(10_000);
    late.chooses(&lab, TIMED_LOW, "stop").await;
    late.chooses(&lab, TIMED_HIGH, "stop").await;
    late.chooses(&lab, UNTIMED_LOW, "stop").await;
    late.chooses(&lab, UNTIMED_LOW + 1, "stop").await;
    let values = serde_json::Map::new();
    late.says(&lab, UNTIMED_LOW + 2, Reply::Filled { values })
        .await
        .unwrap();
    lab.check().await;
    assert_eq!(
        lab.store
            .exclusions(&driving(), Population::People, AnalysisSet::Completed)
            .await
            .unwrap(),
        [(Some(Flag::LateAnswer), 1)],
        "one person, one reason"
    );
    include(&lab, late.run).await.unwrap();
    lab.check().await;
    assert_eq!(totals(&lab).await.analysed(), 0, "the rule stands");
}

#[tokio::test]
async fn the_checks_find_an_exclusion_that_the_rule_does_not_make() {
    let mut lab = with_rule(&[Flag::LateAnswer]).await;
    let mut person = lab.start_and_reach_timed("driving").await;
    person.finishes(&lab, "stop").await;
    lab.check().await;
    let mut raw = SqliteConnection::connect(lab.path().to_str().unwrap())
        .await
        .unwrap();
    sqlx::query("insert into exclusion (run_id, flags) values (?, 'late-answer')")
        .bind(person.run)
        .execute(&mut raw)
        .await
        .unwrap();
    let found = lab.store.check_answers().await.unwrap();
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].place.contains("exclusion of run 1"), "{found:?}");
    // Three cells, and the totals.
    assert_eq!(lab.store.check_counters().await.unwrap().len(), 4);
}

#[tokio::test]
async fn there_must_be_answers_to_leave_out_and_an_exclusion_to_undo() {
    let mut lab = Lab::open().await;
    let mut declines = lab.start("driving").await;
    declines.says(&lab, CONSENT, Reply::Declined).await.unwrap();
    let withdraws = lab.start_and_reach_timed("driving").await;
    lab.store.withdraw(&withdraws.link).await.unwrap();
    for run in [declines.run, withdraws.run] {
        let refused = exclude(&lab, run, "any").await.unwrap_err();
        assert!(refused.to_string().contains("no answers"), "{refused}");
    }
    let stays = lab.start_and_reach_timed("driving").await;
    let refused = include(&lab, stays.run).await.unwrap_err();
    assert!(refused.to_string().contains("is not left out"), "{refused}");
    let elsewhere = lab.start_and_reach_timed("cups").await;
    for run in [elsewhere.run, RunId::from(99)] {
        assert!(matches!(
            exclude(&lab, run, "any").await,
            Err(Error::NotFound(_))
        ));
    }
    assert_eq!(totals(&lab).await.excluded, 0);
    lab.check().await;
    for text in ["", "  ", "two\nlines", &"x".repeat(201)] {
        assert!(ExclusionReason::new(text).is_err(), "{text}");
    }
}
