//! The driving study: its design, its runs, and its texts.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use riskaware::study::step::{Field, FieldKind, Fields};
use riskaware::study::{
    Include, RecruitingIds, Reply, Step, StepKind, StepPlan, Study, Weighting, Words, built_in,
};

pub fn driving() -> Study {
    let (name, text) = built_in()
        .into_iter()
        .find(|(name, _)| *name == "driving.toml")
        .expect("driving.toml is built in");
    Study::parse(name, text).unwrap_or_else(|error| panic!("{error}"))
}

fn run(study: &Study, seed: u64) -> Vec<StepPlan> {
    study.draw_steps(None, &mut ChaCha8Rng::seed_from_u64(seed))
}

/// `block/question` of each choice, `block` of other steps.
fn outline(steps: &[StepPlan]) -> Vec<String> {
    steps
        .iter()
        .map(|step| match &step.question {
            Some(question) => format!("{}/{question}", step.block),
            None => format!("{} {}", step.kind.as_str(), step.block),
        })
        .collect()
}

#[test]
fn the_design_is_the_papers() {
    let study = driving();
    let cells: Vec<(String, bool, Option<String>)> = study
        .cells()
        .iter()
        .map(|cell| {
            let problem = cell
                .problem
                .as_ref()
                .map(|problem| serde_json::to_string(problem).unwrap());
            (cell.id.to_string(), cell.fitted, problem)
        })
        .collect();
    let problem = |risk: &str| {
        let (red, green) = if risk == "high" {
            ("0.95", "0.05")
        } else {
            ("0.05", "0.95")
        };
        format!(r#"{{"accelerate":[[{green},0.0],[{red},-500.0]],"stop":[[1.0,-50.0]]}}"#)
    };
    let mut expected = Vec::new();
    for time in ["timed", "untimed"] {
        expected.push((format!("none/{time}/unknown"), false, None));
        for information in ["implicit", "explicit"] {
            for risk in ["high", "low"] {
                expected.push((
                    format!("{information}/{time}/{risk}"),
                    true,
                    Some(problem(risk)),
                ));
            }
        }
    }
    assert_eq!(cells, expected);
    assert_eq!(study.reference_reward(), -500.0);
    assert_eq!(study.reward_unit().format(-500.0), "\u{2212}$500");
    assert_eq!(study.include(), Include::All);
    assert_eq!(study.recruiting().ids, RecruitingIds::Hashed);
    assert_eq!(
        (study.fit().samples, study.fit().weighting),
        (30, Weighting::Monotone)
    );
    let low = study.cell("explicit/timed/low").unwrap();
    assert_eq!(low.label, "Explicit · Timed · Low");
}

#[test]
fn each_plan_holds_every_fitted_cell_once() {
    let study = driving();
    let fitted: Vec<usize> = (0..study.cells().len())
        .filter(|index| study.cells()[*index].fitted)
        .collect();
    let mut parts = BTreeMap::new();
    for plan in study.plans() {
        let mut cells: Vec<usize> = plan
            .parts
            .iter()
            .flat_map(|part| part.cells.clone())
            .collect();
        cells.sort_unstable();
        assert_eq!(cells, fitted, "plan {}", plan.id);
        parts.insert(
            plan.id.to_string(),
            plan.parts
                .iter()
                .map(|part| part.id.to_string())
                .collect::<Vec<_>>(),
        );
    }
    assert_eq!(parts["all"], ["all"]);
    assert_eq!(parts["risk"], ["high", "low"]);
    assert_eq!(parts["cell"].len(), 8);
    assert!(
        parts["cell"]
            .iter()
            .all(|id| study.cell(id).is_some_and(|cell| cell.fitted))
    );
}

#[test]
fn baseline_questions_have_the_optimal_actions_of_the_protocol() {
    let study = driving();
    let optimal: Vec<(&str, &str)> = study
        .baseline()
        .iter()
        .map(|baseline| (baseline.label.as_str(), baseline.optimal.as_str()))
        .collect();
    assert_eq!(
        optimal,
        [
            ("5% risk, $400 fine", "accelerate"),
            ("10% risk, $450 fine", "accelerate"),
            ("95% risk, $25 fine", "stop"),
            ("90% risk, $50 fine", "stop"),
        ]
    );
    assert_eq!(study.baseline_share(), Some(0.93));
}

#[test]
fn the_papers_figures_stand_beside_ours() {
    let study = driving();
    let figures: Vec<_> = study
        .paper()
        .iter()
        .map(|figure| {
            (
                figure.levels.len(),
                figure.t,
                figure.df,
                figure.p.as_deref(),
                figure.n,
            )
        })
        .collect();
    assert_eq!(
        figures,
        [
            (0, Some(-11.5), Some(239), Some("< .001"), Some(30)),
            (1, Some(0.42), Some(119), Some(".67"), Some(30)),
            (1, Some(-17.3), Some(119), Some("< .001"), Some(30)),
        ]
    );
    let together = &study.paper()[0];
    assert_eq!(
        together.risk_aware.map(|figure| (figure.mean, figure.sd)),
        Some((-5.7, 3.3))
    );
    assert_eq!(
        together
            .noisy_rational
            .map(|figure| (figure.mean, figure.sd)),
        Some((-3.3, 1.3))
    );
}

/// The outline of a run with everything drawn left open: pairs of risks and baseline questions sorted.
fn settled_outline(steps: &[StepPlan]) -> Vec<String> {
    let mut outline = outline(steps);
    for first in [5, 7, 11, 13] {
        outline[first..first + 2].sort();
    }
    outline[16..20].sort();
    outline
}

proptest! {
    #[test]
    fn every_run_asks_the_same_questions_in_the_order_of_the_protocol(seed: u64) {
        let study = driving();
        let steps = run(&study, seed);
        prop_assert_eq!(settled_outline(&steps), [
            "consent consent",
            "info situation",
            "practice/umbrella",
            "info timed",
            "timed/none-unknown",
            "timed/implicit-high",
            "timed/implicit-low",
            "timed/explicit-high",
            "timed/explicit-low",
            "info no-limit",
            "untimed/none-unknown",
            "untimed/implicit-high",
            "untimed/implicit-low",
            "untimed/explicit-high",
            "untimed/explicit-low",
            "info other-fines",
            "baseline/p05-fine400",
            "baseline/p10-fine450",
            "baseline/p90-fine50",
            "baseline/p95-fine25",
            "form about-you",
            "thanks thanks",
        ]);
    }

    #[test]
    fn stored_steps_come_back_unchanged_and_can_be_shown(seed: u64) {
        let study = driving();
        for plan in run(&study, seed) {
            let stored = serde_json::to_string(&plan).unwrap();
            prop_assert_eq!(&serde_json::from_str::<StepPlan>(&stored).unwrap(), &plan);
            let step = study.step(&plan).unwrap();
            let kind = match step {
                Step::Consent(_) => StepKind::Consent,
                Step::Info(_) => StepKind::Info,
                Step::Replays(_) => StepKind::Replays,
                Step::Choice(_) => StepKind::Choice,
                Step::Form(_) => StepKind::Form,
                Step::Thanks(_) => StepKind::Thanks,
            };
            prop_assert_eq!(kind, plan.kind);
        }
    }

    #[test]
    fn each_cell_is_asked_once_and_timed_cells_have_the_limit(seed: u64) {
        let study = driving();
        let mut asked = BTreeSet::new();
        for plan in run(&study, seed) {
            let Step::Choice(choice) = study.step(&plan).unwrap() else {
                prop_assert_eq!(plan.limit_ms, None);
                continue;
            };
            prop_assert_eq!(choice.limit_ms.is_some(), plan.block == "timed");
            prop_assert!(1 <= choice.number && choice.number <= choice.of);
            let Some(cell) = choice.cell else {
                prop_assert!(choice.practice || choice.baseline);
                prop_assert!(!choice.fitted);
                continue;
            };
            let is_timed = cell.as_str().split('/').nth(1) == Some("timed");
            prop_assert_eq!(choice.limit_ms, is_timed.then_some(8_000));
            prop_assert_eq!(choice.problem, study.cell(cell.as_str()).unwrap().problem.as_ref());
            prop_assert!(asked.insert(cell.clone()), "{} is asked twice", cell);
        }
        prop_assert_eq!(asked.len(), study.cells().len());
    }
}

#[test]
fn risks_and_baseline_questions_come_in_each_order_about_equally_often() {
    let study = driving();
    let runs: u64 = 2_000;
    let mut high_first = [0_u32; 4];
    let mut first_baseline: BTreeMap<String, u32> = BTreeMap::new();
    let mut joint: BTreeSet<[bool; 4]> = BTreeSet::new();
    for seed in 0..runs {
        let outline = outline(&run(&study, seed));
        let order = [5, 7, 11, 13].map(|first| outline[first].ends_with("high"));
        joint.insert(order);
        for (count, is_high) in high_first.iter_mut().zip(order) {
            *count += u32::from(is_high);
        }
        *first_baseline.entry(outline[16].clone()).or_default() += 1;
    }
    // Five standard deviations of a binomial share around 1/2 (1000 ± 112) and 1/4 (500 ± 97).
    assert!(
        high_first.iter().all(|count| count.abs_diff(1_000) < 112),
        "{high_first:?}"
    );
    assert_eq!(first_baseline.len(), 4);
    assert!(
        first_baseline
            .values()
            .all(|count| count.abs_diff(500) < 97),
        "{first_baseline:?}"
    );
    // The four pairs are drawn apart from each other.
    assert_eq!(joint.len(), 16);
}

#[test]
fn equal_seeds_give_equal_runs() {
    let study = driving();
    assert_eq!(run(&study, 7), run(&study, 7));
}

/// Everything that participants read, in the order of one run.
#[test]
fn texts() {
    let study = driving();
    let mut page = String::new();
    for plan in run(&study, 1) {
        let place = match &plan.question {
            Some(question) => format!("{}/{question}", plan.block),
            None => plan.block.to_string(),
        };
        writeln!(page, "=== {} {place}", plan.kind.as_str()).unwrap();
        write_step(&mut page, &study.step(&plan).unwrap());
        writeln!(page).unwrap();
    }
    insta::assert_snapshot!(page);
}

fn write_step(page: &mut String, step: &Step<'_>) {
    match step {
        Step::Consent(step) => {
            writeln!(
                page,
                "{} (version {})\n{}",
                step.title, step.version, step.text_html
            )
            .unwrap();
            writeln!(page, "[{}] [{}]", step.agree, step.decline).unwrap();
            writeln!(
                page,
                "declined: {}\n{}",
                step.declined.title, step.declined.text_html
            )
            .unwrap();
        }
        Step::Info(step) => {
            writeln!(
                page,
                "{} (scene {:?})\n{}[{}]",
                step.title, step.scene, step.text_html, step.button
            )
            .unwrap();
        }
        Step::Choice(step) => {
            let limit = step
                .limit_ms
                .map_or("no limit".to_owned(), |limit| format!("{limit} ms"));
            writeln!(
                page,
                "{} ({} of {}, {limit})\n{}",
                step.title, step.number, step.of, step.text_html
            )
            .unwrap();
            for action in &step.actions {
                writeln!(page, "[{}] {}", action.label, action.detail).unwrap();
            }
        }
        Step::Replays(step) => {
            writeln!(
                page,
                "{}\n{}{:?}[{}]",
                step.title, step.text_html, step.replays, step.button
            )
            .unwrap();
        }
        Step::Form(step) => {
            writeln!(page, "{}\n{}", step.title, step.text_html).unwrap();
            for field in step.fields {
                writeln!(
                    page,
                    "{}: {} {}",
                    field.id,
                    field.label,
                    field.hint.as_deref().unwrap_or("")
                )
                .unwrap();
                if let FieldKind::Choice { options, other, .. } = &field.kind {
                    let labels: Vec<&str> =
                        options.iter().map(|option| option.label.as_str()).collect();
                    writeln!(
                        page,
                        "  ( ) {}{}",
                        labels.join(" ( ) "),
                        if *other { " ( ) ____" } else { "" }
                    )
                    .unwrap();
                }
            }
            writeln!(page, "[{}]", step.button).unwrap();
        }
        Step::Thanks(step) => {
            writeln!(
                page,
                "{}\n{}",
                step.completion.title, step.completion.text_html
            )
            .unwrap();
        }
    }
}

#[test]
fn timed_questions_can_be_read_in_their_time() {
    let study = driving();
    for plan in run(&study, 1).iter().filter(|plan| plan.limit_ms.is_some()) {
        let Step::Choice(choice) = study.step(plan).unwrap() else {
            panic!("{plan:?}")
        };
        let words = |text: &str| text.split_whitespace().count();
        let details: usize = choice
            .actions
            .iter()
            .map(|action| words(&action.label) + words(&action.detail))
            .sum();
        let all = words(choice.text_html) + details;
        // People read about 240 words a minute (Brysbaert 2019), so 32 words in 8 s.
        assert!(all <= 32, "{:?}: {all} words", plan.question);
    }
}

#[test]
fn demographics_are_optional_and_the_attention_check_judges_nobody() {
    let study = driving();
    let plan = run(&study, 1)
        .into_iter()
        .find(|plan| plan.kind == StepKind::Form)
        .unwrap();
    let step = study.step(&plan).unwrap();
    assert_eq!(
        step.read(&Fields::new(), &Words::english()),
        Ok(Reply::Filled {
            values: serde_json::Map::new()
        })
    );
    let Step::Form(form) = &step else {
        panic!("{plan:?}")
    };
    let check: &Field = form
        .fields
        .iter()
        .find(|field| field.id == "attention")
        .unwrap();
    for (answer, passes) in [("rarely", true), ("often", false)] {
        let fields = Fields::from([("attention".to_owned(), answer.to_owned())]);
        let Ok(Reply::Filled { values }) = step.read(&fields, &Words::english()) else {
            panic!("{answer} is refused")
        };
        assert_eq!(check.passes(&values), Some(passes), "{answer}");
    }
    assert_eq!(check.passes(&serde_json::Map::new()), None);
}
