//! Exports and summaries, with two studies and several people in the way.

use riskaware::store::{
    AnalysisSet, AnswerKey, AnswerStatus, FormAnswer, NewArrival, Population, RunState,
};
use riskaware::study::step::{ClientTiming, InputDevice};
use riskaware::study::{BlockId, Reply, StudyId};

use super::lab::{CONSENT, Lab, START_PAGE, TIMED_LOW, choice, form};

#[tokio::test]
async fn an_export_pages_through_every_choice_of_its_study_once() {
    let mut lab = Lab::open().await;
    for study in ["driving", "cups", "driving", "driving"] {
        let mut person = lab.start_and_reach_timed(study).await;
        person.finishes(&lab, "stop").await;
    }
    let mut preview = lab.start_preview("driving").await;
    preview.says(&lab, CONSENT, Reply::Agreed).await.unwrap();
    preview
        .says(&lab, START_PAGE, Reply::Continued)
        .await
        .unwrap();
    preview.finishes(&lab, "stop").await;

    let driving = StudyId::from("driving");
    let all = lab
        .store
        .answers(&driving, Population::People, AnswerKey::START, 1_000)
        .await
        .unwrap();
    assert_eq!(all.len(), 3 * 4, "three people, four choices each");
    assert!(all.is_sorted_by_key(|row| row.key));
    let mut paged = Vec::new();
    loop {
        let after = paged
            .last()
            .map_or(AnswerKey::START, |row: &riskaware::store::AnswerRow| {
                row.key
            });
        let page = lab
            .store
            .answers(&driving, Population::People, after, 5)
            .await
            .unwrap();
        if page.is_empty() {
            break;
        }
        paged.extend(page);
    }
    assert_eq!(paged, all);
    assert_eq!(
        lab.store
            .answers(&driving, Population::Simulated, AnswerKey::START, 10)
            .await
            .unwrap(),
        []
    );
}

#[tokio::test]
async fn a_row_of_the_export_says_what_was_asked_answered_and_measured() {
    let mut lab = Lab::open().await;
    let arrival = NewArrival {
        source: Some("campus".to_owned()),
        ..NewArrival::default()
    };
    let arrival = lab.arrival("driving", arrival).await;
    let started = lab
        .store
        .start(&arrival, lab.new_run("driving"))
        .await
        .unwrap();
    let run = started.run;
    lab.store
        .submit(run, form(CONSENT, "1", Reply::Agreed))
        .await
        .unwrap();
    lab.store
        .submit(run, form(START_PAGE, "2", Reply::Continued))
        .await
        .unwrap();
    let shown_at = lab.clock.now();
    lab.clock.advance(1_234);
    let mut stop = form(TIMED_LOW, "3", choice("stop"));
    stop.timing = ClientTiming {
        client_rt_ms: Some(1_100),
        input: Some(InputDevice::Touch),
        hidden_ms: Some(20),
    };
    lab.store.submit(run, stop).await.unwrap();
    let rows = lab
        .store
        .answers(
            &StudyId::from("driving"),
            Population::People,
            AnswerKey::START,
            10,
        )
        .await
        .unwrap();
    let [row] = rows.as_slice() else {
        panic!("one choice: {rows:?}")
    };
    assert_eq!(
        (row.key, row.version),
        (
            AnswerKey {
                run,
                position: TIMED_LOW
            },
            lab.driving
        )
    );
    assert_eq!(
        (row.run_state, row.status, row.is_counted),
        (RunState::Active, AnswerStatus::Answered, true)
    );
    assert_eq!(
        (row.block.as_str(), row.problem.as_deref()),
        ("timed", Some("explicit/timed/low"))
    );
    assert_eq!(
        row.action.as_ref().map(|action| action.as_str()),
        Some("stop")
    );
    assert_eq!(
        (row.shown_at, row.answered_at),
        (Some(shown_at), Some(lab.clock.now()))
    );
    assert_eq!(
        (row.server_ms, row.client_rt_ms, row.limit_ms),
        (Some(1_234), Some(1_100), Some(8_000))
    );
    assert_eq!(
        (row.input.as_deref(), row.hidden_ms),
        (Some("touch"), Some(20))
    );
    assert_eq!(
        (row.source.as_deref(), row.population),
        (Some("campus"), Population::People)
    );
}

#[tokio::test]
async fn form_answers_are_counted_by_field_and_study() {
    let mut lab = Lab::open().await;
    for study in ["driving", "driving", "driving", "cups"] {
        let mut person = lab.start_and_reach_timed(study).await;
        person.finishes(&lab, "stop").await;
    }
    let answers = |study: &str, field: &'static str| {
        let (store, study) = (lab.store.clone(), StudyId::from(study));
        async move {
            let about = BlockId::from("about");
            store
                .form_answers(
                    &study,
                    Population::People,
                    AnalysisSet::Completed,
                    &about,
                    field,
                    false,
                )
                .await
                .unwrap()
        }
    };
    assert_eq!(
        answers("driving", "age").await,
        [FormAnswer {
            value: Some("33".to_owned()),
            n: 3
        }]
    );
    assert_eq!(
        answers("cups", "gender").await,
        [FormAnswer {
            value: Some("woman".to_owned()),
            n: 1
        }]
    );
    assert_eq!(
        answers("driving", "country").await,
        [FormAnswer { value: None, n: 3 }]
    );
}

#[tokio::test]
async fn patterns_group_people_by_what_they_chose() {
    let mut lab = Lab::open().await;
    for action in ["stop", "accelerate", "stop"] {
        let mut person = lab.start_and_reach_timed("driving").await;
        person.finishes(&lab, action).await;
    }
    let mut unfinished = lab.start_and_reach_timed("driving").await;
    unfinished.chooses(&lab, TIMED_LOW, "stop").await;
    let driving = StudyId::from("driving");
    let counts = lab
        .store
        .cell_counts(&driving, Population::People)
        .await
        .unwrap();
    let low = counts
        .iter()
        .find(|count| count.cell == "explicit/timed/low")
        .unwrap()
        .problem;
    let all = lab
        .store
        .patterns(&driving, Population::People, AnalysisSet::All, &[low])
        .await
        .unwrap();
    assert_eq!(
        all.iter().map(|pattern| pattern.weight).collect::<Vec<_>>(),
        [3, 1]
    );
    assert_eq!(all[0].choices, [(low, "stop".into())]);
    let completed = lab
        .store
        .patterns(&driving, Population::People, AnalysisSet::Completed, &[low])
        .await
        .unwrap();
    assert_eq!(
        completed
            .iter()
            .map(|pattern| pattern.weight)
            .collect::<Vec<_>>(),
        [2, 1]
    );
}
