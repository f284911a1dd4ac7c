//! The cup study: what it tells, what it shows, and what its replays step accepts.

use std::collections::BTreeSet;

use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use riskaware::planning::table::{Outcome, Tower};
use riskaware::study::step::{FieldError, Fields};
use riskaware::study::{
    ReplayId, Reply, Step, StepError, StepKind, StepPlan, Study, Words, built_in,
};

fn cups() -> Study {
    let (name, text) = built_in()
        .into_iter()
        .find(|(name, _)| *name == "cups.toml")
        .expect("cups.toml is built in");
    Study::parse(name, text).unwrap_or_else(|error| panic!("{error}"))
}

fn run(study: &Study, seed: u64) -> Vec<StepPlan> {
    study.draw_steps(None, &mut ChaCha8Rng::seed_from_u64(seed))
}

fn watching(study: &Study, seed: u64) -> StepPlan {
    run(study, seed)
        .into_iter()
        .find(|step| step.kind == StepKind::Replays)
        .expect("the study shows replays")
}

#[test]
fn the_points_are_told_and_the_odds_are_the_papers() {
    let study = cups();
    let cells: Vec<(&str, String)> = study
        .cells()
        .iter()
        .map(|cell| {
            let problem = cell.problem.as_ref().unwrap();
            (cell.id.as_str(), serde_json::to_string(problem).unwrap())
        })
        .collect();
    let problem = r#"{"stable":[[1.0,20.0]],"unstable":[[0.2,105.0],[0.8,0.0]]}"#;
    assert_eq!(
        cells,
        [
            ("timed", problem.to_owned()),
            ("untimed", problem.to_owned())
        ]
    );
    // Nobody is told a probability before the questions.
    for step in run(&study, 1) {
        let text = match study.step(&step).unwrap() {
            Step::Info(step) => step.text_html,
            Step::Replays(step) => step.text_html,
            Step::Choice(step) => step.text_html,
            Step::Consent(_) | Step::Form(_) | Step::Thanks(_) => continue,
        };
        for told in ["80", "20%", "four of five", "one of five", "probab"] {
            assert!(!text.contains(told), "{told}: {text}");
        }
    }
}

#[test]
fn the_replays_show_the_odds() {
    let study = cups();
    let count = |tower: Tower, outcome: Outcome| {
        study
            .replays()
            .filter(|shown| shown.replay.tower == tower && shown.replay.outcome == outcome)
            .count()
    };
    assert_eq!(count(Tower::Stable, Outcome::Stands), 5);
    assert_eq!(count(Tower::Stable, Outcome::Falls), 0);
    assert_eq!(count(Tower::Unstable, Outcome::Stands), 1);
    assert_eq!(count(Tower::Unstable, Outcome::Falls), 4);
}

#[test]
fn a_run_follows_the_protocol() {
    let outline: Vec<String> = run(&cups(), 1)
        .iter()
        .map(|step| format!("{} {}", step.kind.as_str(), step.block))
        .collect();
    assert_eq!(
        outline,
        [
            "consent consent",
            "info task",
            "replays watch",
            "info timed",
            "choice timed",
            "info no-limit",
            "choice untimed",
            "form about-you",
            "thanks thanks",
        ]
    );
}

proptest! {
    #[test]
    fn each_run_shows_each_replay_once_in_an_order_of_its_own(seed: u64) {
        let study = cups();
        let shown = watching(&study, seed).data.replays;
        let distinct: BTreeSet<&ReplayId> = shown.iter().collect();
        let named: BTreeSet<&ReplayId> = study.replays().map(|replay| &replay.id).collect();
        prop_assert_eq!(shown.len(), 10);
        prop_assert_eq!(distinct, named);
        prop_assert_ne!(&shown, &watching(&study, seed.wrapping_add(1)).data.replays);
    }
}

fn viewings<'a>(replays: impl IntoIterator<Item = &'a ReplayId>) -> String {
    let list: Vec<serde_json::Value> = replays
        .into_iter()
        .map(|replay| {
            serde_json::json!({
                "replay": replay, "started_ms": 5, "seen_ms": 8_000, "plays": 1, "stills": false,
            })
        })
        .collect();
    serde_json::to_string(&list).unwrap()
}

#[test]
fn a_person_goes_on_who_saw_all_replays() {
    let study = cups();
    let plan = watching(&study, 1);
    let step = study.step(&plan).unwrap();
    let read = |text: String| {
        step.read(
            &Fields::from([("viewings".to_owned(), text)]),
            &Words::english(),
        )
    };
    let shown = &plan.data.replays;

    let Ok(Reply::Watched { viewings: all }) = read(viewings(shown.iter().rev())) else {
        panic!("all were watched");
    };
    assert_eq!(all.len(), 10);
    assert_eq!((all[0].started_ms, all[0].seen_ms), (5, 8_000));

    let refusal = |text: String| match read(text) {
        Ok(reply) => panic!("{reply:?}"),
        Err(errors) => errors
            .iter()
            .map(FieldError::to_string)
            .collect::<Vec<_>>()
            .join("; "),
    };
    assert_eq!(
        refusal(viewings(&shown[..9])),
        "viewings: You have watched 9 of 10 replays. You can go on when you have seen all of them to the end."
    );
    assert!(refusal(viewings(shown.iter().take(9).chain(&shown[..1]))).contains("9 of 10"));
    assert!(refusal(viewings(shown.iter().chain(&shown[..1]))).contains("11 viewings"));
    assert!(refusal(viewings([&"stable-falls-99".into()])).contains("0 of 10"));
    let backwards = viewings(shown).replace(r#""seen_ms":8000"#, r#""seen_ms":4"#);
    assert!(refusal(backwards).contains("0 of 10"));
    assert!(refusal("[".to_owned()).contains("Load it again"));
    assert!(refusal("null".to_owned()).contains("Load it again"));
}

#[test]
fn a_page_without_scripts_names_no_viewings() {
    let study = cups();
    let plan = watching(&study, 1);
    let step = study.step(&plan).unwrap();
    let nothing = Ok(Reply::Watched {
        viewings: Vec::new(),
    });
    assert_eq!(step.read(&Fields::new(), &Words::english()), nothing);
    let empty = Fields::from([("viewings".to_owned(), String::new())]);
    assert_eq!(step.read(&empty, &Words::english()), nothing);
}

#[test]
fn an_order_of_other_replays_is_refused() {
    let study = cups();
    let plan = watching(&study, 1);
    let refused = |change: fn(&mut Vec<ReplayId>)| {
        let mut plan = plan.clone();
        change(&mut plan.data.replays);
        assert!(matches!(study.step(&plan), Err(StepError::Replays { .. })));
    };
    refused(|replays| drop(replays.pop()));
    refused(|replays| replays[0] = replays[1].clone());
    refused(|replays| replays[0] = "unstable-falls-99".into());
}

#[test]
fn what_is_wrong_with_a_replay_is_told() {
    let (_, text) = built_in()
        .into_iter()
        .find(|(name, _)| *name == "cups.toml")
        .unwrap();
    let check = |from: &str, to: &str, expected: &str| {
        assert!(text.contains(from), "{from}");
        let error = Study::parse("mine.toml", &text.replacen(from, to, 1)).unwrap_err();
        let told = error.to_string();
        assert!(told.contains(expected), "{told}");
        assert!(error.line().is_some(), "{told}");
    };
    check(
        "tower = \"unstable\"",
        "tower = \"unstabel\"",
        "block[watch].replay[#6].tower: found unknown variant `unstabel`, did you mean `unstable`?; allowed: `stable` or `unstable`",
    );
    check(
        "outcome = \"falls\"",
        "outcome = \"fell\"",
        "allowed: `stands` or `falls`",
    );
    check(
        "seed = 2\n",
        "seed = -2\n",
        "block[watch].replay[#2].seed: found -2; allowed: a whole number from 0 to 9007199254740991",
    );
    check(
        "seed = 2\n",
        "seed = 1\n",
        "found `stable-stands-1` for the second time; allowed: another seed",
    );
    check("seed = 2\n", "seed = 2.5\n", "a whole number");
    check("seed = 2\n", "", "no key `seed`");
    check(
        "hypothesis.better = \"risk_aware\"",
        "hypothesis.better = \"prelec\"",
        "analysis.hypothesis.better: found `prelec`; allowed: one of the fitted models: `noisy_rational`, `risk_aware`",
    );
    check(
        "hypothesis.than = \"noisy_rational\"",
        "hypothesis.than = \"risk_aware\"",
        "analysis.hypothesis.than: found `risk_aware`; allowed: another model than `better`",
    );
    check(
        "choices = { stable = 42",
        "choices = { stabel = 42",
        "paper[#1].choices.stabel: found unknown action `stabel`, did you mean `stable`?",
    );
    check(
        "choices = { stable = 42, unstable = 8 }",
        "choices = { stable = 0 }",
        "paper[#1].choices: found no choice at all",
    );
}
