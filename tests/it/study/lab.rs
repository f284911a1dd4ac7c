//! A lab's own studies: no Rust is needed for other actions, factors, gains and losses.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use riskaware::model::ZeroOutcome;
use riskaware::study::step::{ClientTiming, FieldError, Fields, InputDevice};
use riskaware::study::{
    ActionId, CompletionCode, Include, PriorChange, RecruitingIds, Reply, Step, StepError,
    StepKind, StepPlan, Study, Weighting, Words,
};

pub const GAMBLES: &str = include_str!("../../data/gambles.toml");

fn gambles() -> Study {
    Study::parse("gambles.toml", GAMBLES).unwrap_or_else(|error| panic!("{error}"))
}

fn run(study: &Study, seed: u64) -> Vec<StepPlan> {
    study.draw_steps(None, &mut ChaCha8Rng::seed_from_u64(seed))
}

fn fields(entries: &[(&str, &str)]) -> Fields {
    entries
        .iter()
        .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()))
        .collect()
}

fn plan_of(study: &Study, question: &str) -> StepPlan {
    let is_it = |plan: &StepPlan| plan.question.as_ref().is_some_and(|id| *id == *question);
    run(study, 1)
        .into_iter()
        .find(is_it)
        .unwrap_or_else(|| panic!("no question {question}"))
}

#[test]
fn cells_take_their_numbers_from_levels() {
    let study = gambles();
    let cells: Vec<(&str, Option<String>)> = study
        .cells()
        .iter()
        .map(|cell| {
            (
                cell.id.as_str(),
                cell.problem
                    .as_ref()
                    .map(|problem| serde_json::to_string(problem).unwrap()),
            )
        })
        .collect();
    let mild = r#"{"safe":[[1.0,5.0]],"middle":[[0.5,12.0],[0.25,0.0],[0.25,-2.0]],"bold":[[0.5,20.0],[0.5,-8.0]]}"#;
    let wild = r#"{"safe":[[1.0,7.0]],"middle":[[0.5,12.0],[0.25,0.0],[0.25,-2.0]],"bold":[[0.1,200.0],[0.9,-30.5]]}"#;
    assert_eq!(
        cells,
        [
            ("wild/quick", Some(wild.to_owned())),
            ("mild/quick", Some(mild.to_owned())),
            ("hidden/quick", None),
            ("mild/slow", Some(mild.to_owned())),
            ("wild/slow", Some(wild.to_owned())),
        ]
    );
    assert_eq!(study.reference_reward(), 200.0);
    let together: Vec<_> = study.plans()[0]
        .parts
        .iter()
        .map(|part| (part.id.as_str(), part.cells.as_slice()))
        .collect();
    assert_eq!(together, [("all", [0, 1, 3, 4].as_slice())]);
    let both: Vec<_> = study.plans()[1]
        .parts
        .iter()
        .map(|part| part.id.as_str())
        .collect();
    assert_eq!(both, ["wild/quick", "mild/quick", "mild/slow", "wild/slow"]);
}

#[test]
fn settings_are_read() {
    let study = gambles();
    let fit = study.fit();
    assert_eq!((fit.samples, fit.weighting), (50, Weighting::PaperRange));
    assert_eq!(
        (fit.options.normalise, fit.options.zero),
        (false, ZeroOutcome::SameSign)
    );
    assert_eq!(
        fit.priors.gamma,
        Some(PriorChange::Uniform {
            low: 0.4,
            high: 1.0
        })
    );
    assert_eq!(
        fit.priors.tau,
        Some(PriorChange::LogNormal {
            median: 3.0,
            log_sd: 1.0
        })
    );
    assert_eq!(fit.priors.alpha, None);
    assert_eq!(study.recruiting().ids, RecruitingIds::Plain);
    assert_eq!(study.include(), Include::Completed);
    let completion = study.completion();
    assert_eq!(
        completion.code,
        CompletionCode::Fixed("GAMBLE-1".to_owned())
    );
    assert_eq!(
        completion
            .redirect
            .as_ref()
            .and_then(|target| target.address(Some("GAMBLE-1"), &BTreeMap::new()))
            .as_deref(),
        Some("https://panel.example/done?cc=GAMBLE-1")
    );
    assert_eq!(study.reward_unit().format(-30.5), "\u{2212}30.5 points");
}

#[test]
fn texts_take_the_values_of_their_question() {
    let study = gambles();
    let plan = plan_of(&study, "wild");
    let Ok(Step::Choice(choice)) = study.step(&plan) else {
        panic!("{plan:?}")
    };
    assert_eq!(choice.title, "Choose within 2.5 s");
    assert_eq!(choice.limit_ms, Some(2_500));
    let detail = |id: &str| {
        choice
            .actions
            .iter()
            .find(|action| action.id == *id)
            .unwrap()
            .detail
            .as_str()
    };
    assert_eq!(detail("bold"), "10% for 200 points, else you lose 30.5.");
    assert_eq!(detail("safe"), "7 points for sure.");

    let plan = plan_of(&study, "unknown-odds");
    let Ok(Step::Choice(choice)) = study.step(&plan) else {
        panic!("{plan:?}")
    };
    assert_eq!(
        choice.text_html,
        "<p>Nobody knows the odds of the bold bet. Which one?</p>\n"
    );
    assert!(!choice.fitted && choice.problem.is_none());
    assert_eq!(choice.cell.map(|cell| cell.as_str()), Some("hidden/quick"));
}

#[test]
fn one_order_of_actions_holds_for_a_whole_run_and_varies_between_runs() {
    let study = gambles();
    let mut orders = std::collections::BTreeSet::new();
    for seed in 0..200 {
        let steps = run(&study, seed);
        let of_run: std::collections::BTreeSet<&[ActionId]> = steps
            .iter()
            .filter(|step| step.kind == StepKind::Choice)
            .map(|step| step.data.actions.as_slice())
            .collect();
        assert_eq!(of_run.len(), 1, "seed {seed}");
        orders.extend(of_run.into_iter().map(<[ActionId]>::to_vec));
    }
    assert_eq!(orders.len(), 6, "three actions have six orders");
}

#[test]
fn groups_stay_together_in_a_random_block() {
    let study = gambles();
    let mut outlines = std::collections::BTreeSet::new();
    for seed in 0..50 {
        let quick: Vec<String> = run(&study, seed)
            .iter()
            .filter(|step| step.block == "quick")
            .filter_map(|step| step.question.as_ref().map(ToString::to_string))
            .collect();
        outlines.insert(quick.join(" "));
    }
    let outlines: Vec<String> = outlines.into_iter().collect();
    assert_eq!(
        outlines,
        ["unknown-odds wild mild", "wild mild unknown-odds"]
    );
}

#[test]
fn a_choice_is_one_of_the_actions_on_the_page() {
    let study = gambles();
    let (timed, untimed) = (
        plan_of(&study, "wild"),
        run(&study, 1)
            .into_iter()
            .rfind(|step| step.question.is_some()),
    );
    let timed = study.step(&timed).unwrap();
    let untimed = untimed.unwrap();
    let untimed = study.step(&untimed).unwrap();
    let chose = |action: &str| {
        Ok(Reply::Chose {
            action: ActionId::from(action),
        })
    };
    assert_eq!(
        timed.read(&fields(&[("action", "bold")]), &Words::english()),
        chose("bold")
    );
    // A choice made at the last moment counts for more than the page's countdown.
    assert_eq!(
        timed.read(
            &fields(&[("action", "bold"), ("timed_out", "1")]),
            &Words::english()
        ),
        chose("bold")
    );
    assert_eq!(
        timed.read(&fields(&[("timed_out", "1")]), &Words::english()),
        Ok(Reply::GaveUp)
    );
    assert_eq!(
        timed.read(
            &fields(&[("timed_out", "1"), ("action", "")]),
            &Words::english()
        ),
        Ok(Reply::GaveUp)
    );
    for nonsense in [
        &[("action", "BOLD")][..],
        &[("action", "")],
        &[],
        &[("timed_out", "0")],
    ] {
        let errors = timed
            .read(&fields(nonsense), &Words::english())
            .unwrap_err();
        assert_eq!(errors[0].field, "action", "{nonsense:?}");
    }
    assert!(
        untimed
            .read(&fields(&[("timed_out", "1")]), &Words::english())
            .is_err(),
        "there is no limit that could run out"
    );
}

#[test]
fn what_the_page_measured_is_taken_where_it_makes_sense() {
    let read = |entries: &[(&str, &str)]| ClientTiming::read(&fields(entries));
    let all = read(&[
        ("client_rt_ms", "1234.5"),
        ("input", "touch"),
        ("hidden_ms", "0"),
    ]);
    assert_eq!(all.client_rt_ms, Some(1_235));
    assert_eq!(all.input, Some(InputDevice::Touch));
    assert_eq!(all.hidden_ms, Some(0));
    for nonsense in ["", "-1", "NaN", "inf", "1e99", "soon"] {
        let timing = read(&[
            ("client_rt_ms", nonsense),
            ("input", nonsense),
            ("hidden_ms", nonsense),
        ]);
        assert_eq!(timing, ClientTiming::default(), "{nonsense}");
    }
}

#[test]
fn forms_are_checked_field_by_field() {
    let study = gambles();
    let plan = run(&study, 1)
        .into_iter()
        .find(|plan| plan.kind == StepKind::Form)
        .unwrap();
    let step = study.step(&plan).unwrap();
    let read = |entries: &[(&str, &str)]| match step.read(&fields(entries), &Words::english()) {
        Ok(Reply::Filled { values }) => Ok(serde_json::Value::from(values).to_string()),
        Ok(other) => panic!("{other:?}"),
        Err(errors) => Err(errors.iter().map(FieldError::to_string).collect::<Vec<_>>()),
    };
    let refused =
        |messages: &[&str]| Err(messages.iter().map(ToString::to_string).collect::<Vec<_>>());

    assert_eq!(
        read(&[("colour", "red"), ("age", " 30 ")]),
        Ok(r#"{"age":30,"colour":"red"}"#.to_owned())
    );
    assert_eq!(
        read(&[("colour", "other"), ("colour-other", " =teal ")]),
        Ok(r#"{"colour":"other","colour-other":"=teal"}"#.to_owned())
    );
    assert_eq!(
        read(&[("colour", "other")]),
        Ok(r#"{"colour":"other"}"#.to_owned())
    );
    assert_eq!(
        read(&[("colour", "red"), ("colour-other", "teal")]),
        Ok(r#"{"colour":"red"}"#.to_owned())
    );
    // Length counts characters, not bytes.
    assert_eq!(
        read(&[("colour", "red"), ("remark", "ääääääääää")]),
        Ok(r#"{"colour":"red","remark":"ääääääääää"}"#.to_owned())
    );
    assert_eq!(
        read(&[("age", "17"), ("remark", "12345678901"), ("check", "c")]),
        refused(&[
            "age: Enter a whole number from 18 to 120.",
            "colour: This question needs an answer.",
            "remark: Use at most 10 characters; these are 11.",
            "check: Choose one of the options.",
        ])
    );
    for age in ["18.5", "abc", "1e2", "99999999999999999999"] {
        assert_eq!(
            read(&[("age", age), ("colour", "red")]),
            refused(&["age: Enter a whole number from 18 to 120."]),
            "{age}"
        );
    }
}

#[test]
fn a_step_of_another_study_is_refused() {
    let study = gambles();
    let mut plan = plan_of(&study, "wild");
    plan.data.actions.swap_remove(0);
    assert!(matches!(study.step(&plan), Err(StepError::Actions { .. })));
    plan.data.actions.push(plan.data.actions[0].clone());
    assert!(matches!(study.step(&plan), Err(StepError::Actions { .. })));
    plan.question = None;
    assert!(matches!(study.step(&plan), Err(StepError::Question { .. })));
    plan.kind = StepKind::Form;
    let error = study.step(&plan).unwrap_err();
    assert_eq!(
        error.to_string(),
        "study three-gambles has no form block quick"
    );
    plan.block = "slow".into();
    plan.kind = StepKind::Info;
    assert!(
        study.step(&plan).is_err(),
        "an untimed block has no start page"
    );
}

#[test]
fn the_last_step_accepts_nothing() {
    let study = gambles();
    let plan = run(&study, 1).pop().unwrap();
    assert_eq!(plan.kind, StepKind::Thanks);
    assert!(
        study
            .step(&plan)
            .unwrap()
            .read(&Fields::new(), &Words::english())
            .is_err()
    );
}

/// Questions with their own actions, and no factor at all.
#[test]
fn a_study_without_factors_has_a_cell_per_question() {
    let text = r#"
        format = 1
        id = "plain"
        title = "Plain"
        summary = "Two questions"
        minutes = 1
        contact = "us"
        reward_unit = { name = "points" }
        question = { text = "Which?" }
        completion = { title = "Thanks", text = "" }

        [[block]]
        kind = "choice"
        id = "all"
        title = "Choose"

        [[block.question]]
        id = "gain"
        [[block.question.actions]]
        id = "sure"
        label = "Sure"
        outcomes = [{ p = 1, reward = 10 }]
        [[block.question.actions]]
        id = "bet"
        label = "Bet"
        outcomes = [{ p = 0.1, reward = 100 }, { p = "rest", reward = 0 }]

        [[block.question]]
        id = "loss"
        [[block.question.actions]]
        id = "bet"
        label = "Bet"
        outcomes = [{ p = 0.1, reward = -100 }, { p = "rest", reward = 0 }]
        [[block.question.actions]]
        id = "sure"
        label = "Sure"
        outcomes = [{ p = 1, reward = -10 }]
        [[block.question.actions]]
        id = "pass"
        label = "Pass"
        outcomes = [{ p = 1, reward = 0 }]
    "#;
    let study = Study::parse("plain.toml", text).unwrap_or_else(|error| panic!("{error}"));
    let cells: Vec<(&str, String)> = study
        .cells()
        .iter()
        .map(|cell| (cell.id.as_str(), cell.problem.as_ref().unwrap().to_string()))
        .collect();
    assert_eq!(
        cells,
        [
            ("gain", "sure: (1, 10); bet: (0.1, 100) (0.9, 0)".to_owned()),
            (
                "loss",
                "bet: (0.9, 0) (0.1, -100); sure: (1, -10); pass: (1, 0)".to_owned()
            ),
        ]
    );
    // A gain and a loss of the same size: the gain.
    assert_eq!(study.reference_reward(), 100.0);
    let parts: Vec<_> = study
        .plans()
        .iter()
        .flat_map(|plan| &plan.parts)
        .map(|part| part.cells.len())
        .collect();
    assert_eq!(
        parts,
        [2],
        "without a plan in the file all cells are fitted together"
    );
    assert_eq!(study.completion().code, CompletionCode::PerRun);
}
