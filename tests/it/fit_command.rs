//! `riskaware fit`: files in, a table or JSON out.

use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::program::{riskaware, stderr, stdout};

pub const PROBLEMS: &str = r#"{"low":{"accelerate":[[0.05,-500],[0.95,0]],"stop":[[1,-100]]},
"high":{"accelerate":[[0.95,-500],[0.05,0]],"stop":[[1,-100]]}}"#;

pub struct Files {
    pub folder: TempDir,
}

impl Files {
    pub fn new(problems: &str, choices: &str) -> Self {
        let folder = TempDir::new().unwrap();
        std::fs::write(folder.path().join("problems.json"), problems).unwrap();
        std::fs::write(folder.path().join("choices.csv"), choices).unwrap();
        Self { folder }
    }

    pub fn fit(&self, more: &[&str]) -> std::process::Output {
        fit_in(self.folder.path(), more)
    }

    #[track_caller]
    fn check_error(&self, expected: &str) {
        let output = self.fit(&[]);
        assert_eq!(output.status.code(), Some(1));
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
        assert_eq!(stdout(&output), "");
    }
}

fn fit_in(folder: &Path, more: &[&str]) -> std::process::Output {
    let problems = folder.join("problems.json");
    let choices = folder.join("choices.csv");
    let mut arguments = vec![
        "fit",
        "--problems",
        problems.to_str().unwrap(),
        "--choices",
        choices.to_str().unwrap(),
    ];
    arguments.extend(more);
    riskaware(&arguments, "")
}

pub const COUNTED: &str =
    "count,action,problem\n5,accelerate,low\n25,stop,low\n2,accelerate,high\n28,stop,high\n";

#[test]
fn the_published_choices_of_1979_give_the_json_of_the_manual() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/kahneman-tversky-1979");
    let output = fit_in(&folder, &["--json", "--seed", "7"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(
        (found["n"].as_u64(), found["seed"].as_u64()),
        (Some(1064), Some(7))
    );
    for (model, parameters, highest) in [
        ("noisy_rational", vec!["theta", "tau"], -737.5086),
        (
            "risk_aware",
            vec!["alpha", "beta", "gamma", "delta", "lambda", "theta", "tau"],
            -593.9208,
        ),
    ] {
        let fit = &found["models"][model];
        assert_eq!(fit["converged"], true);
        for name in parameters {
            for key in [
                "mean",
                "sd",
                "q5",
                "q50",
                "q95",
                "rhat",
                "ess_bulk",
                "ess_tail",
                "prior_q5",
                "prior_q50",
                "prior_q95",
                "contraction",
            ] {
                assert!(
                    fit["parameters"][name][key].is_f64(),
                    "{model} {name} {key}"
                );
            }
            assert!(fit["parameters"][name]["informed"].is_boolean());
        }
        assert!((fit["max_log_likelihood"].as_f64().unwrap() - highest).abs() < 0.01);
        assert!(fit["log_marginal_likelihood"]["value"].as_f64().unwrap() < highest);
        assert!(fit["log_kl"]["3'"]["median"].is_f64());
        let shares = &fit["predicted"]["14'"];
        let sum = shares["A"]["mean"].as_f64().unwrap() + shares["B"]["mean"].as_f64().unwrap();
        assert!((sum - 1.0).abs() < 1e-9);
    }
}

#[test]
fn rows_counts_and_columns_in_any_order_are_one() {
    let mut long = "status,participant,note,problem,action\n".to_owned();
    for (problem, action, count) in [
        ("low", "accelerate", 5),
        ("low", "stop", 25),
        ("high", "accelerate", 2),
        ("high", "stop", 28),
    ] {
        for person in 0..count {
            long += &format!("answered,{action}{person},x,{problem},{action}\n");
        }
    }
    long += "late,p,x,low,stop\ntimed_out,p,x,low,\n";
    long += "answered,p,x,practice,left\nanswered,p,x,baseline,stop\nlate,p,x,practice,left\n";
    let arguments = ["--json", "--models", "noisy_rational"];
    let read = |choices: &str| -> Value {
        let output = Files::new(PROBLEMS, choices).fit(&arguments);
        serde_json::from_str(&stdout(&output)).unwrap()
    };
    let (rows, counts) = (read(&long), read(COUNTED));
    assert_eq!(rows["models"], counts["models"]);
    assert_eq!(
        (rows["n"].as_u64(), rows["left_out"].as_u64()),
        (Some(60), Some(3))
    );
    assert_eq!(rows["other_problems"].as_u64(), Some(2));
    assert_eq!(counts["other_problems"].as_u64(), Some(0));
    assert_eq!(counts["left_out"].as_u64(), Some(0));
}

/// A coin flip for gain and loss, chosen by one and declined by another.
const MIXED: &str = r#"{"small":{"flip":[[0.5,20],[0.5,-10]],"pass":[[1,0]]},
"large":{"flip":[[0.5,400],[0.5,-200]],"pass":[[1,0]]},
"sure":{"flip":[[0.5,100],[0.5,0]],"take":[[1,40]]}}"#;

#[test]
fn notes_stand_below_each_model_and_in_the_json() {
    let losses = Files::new(PROBLEMS, COUNTED);
    let table = stdout(&losses.fit(&["--weighting-floor", "0.05"]));
    for expected in [
        "Note: All rewards here are losses or nothing. So α (curvature of gains) cannot be learned at all",
        "learned only as their product λ·θ",
        "of the posterior of δ (24 % of its prior) lies under 0.28",
        "the paper’s wide range, here Uniform(0.05, 1)",
    ] {
        assert!(table.contains(expected), "{expected}\n{table}");
    }

    let choices = "problem,action,count\nsmall,flip,9\nsmall,pass,21\nlarge,flip,6\nlarge,pass,24\nsure,flip,11\nsure,take,19\n";
    let mixed = Files::new(MIXED, choices);
    let models = ["--models", "risk_aware,cumulative_prospect"];
    let table = stdout(&mixed.fit(&models));
    for expected in ["at 10 ", "at 40 ", "at 400 ", "in CPT, α = β"] {
        assert!(table.contains(expected), "{expected}\n{table}");
    }
    let output = mixed.fit(&[models[0], models[1], "--json"]);
    let found: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let [aware, one_curvature] =
        ["risk_aware", "cumulative_prospect"].map(|model| &found["models"][model]);
    let amounts = aware["loss_aversion"].as_array().unwrap();
    assert_eq!(amounts[1]["amount"], 40.0);
    assert!(amounts[1]["q5"].as_f64() < amounts[1]["q95"].as_f64());
    assert!(one_curvature["loss_aversion"].is_null());
    let kinds = |fit: &Value| -> Vec<String> {
        let notes = fit["notes"].as_array().unwrap();
        notes
            .iter()
            .map(|note| note["kind"].as_str().unwrap().to_owned())
            .collect()
    };
    assert!(kinds(aware).contains(&"loss_aversion_varies".to_owned()));
    assert!(!kinds(one_curvature).contains(&"loss_aversion_varies".to_owned()));
}

#[test]
fn models_that_are_fitted_together_are_compared() {
    let mut choices = "participant,problem,action\n".to_owned();
    for person in 0..40 {
        let low = if person % 6 == 0 {
            "accelerate"
        } else {
            "stop"
        };
        choices += &format!("p{person},low,{low}\np{person},high,stop\n");
    }
    let read = |choices: &str, more: &[&str]| -> Value {
        let arguments = [&["--json"], more].concat();
        let output = Files::new(PROBLEMS, choices).fit(&arguments);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        serde_json::from_str::<Value>(&stdout(&output)).unwrap()["comparison"].clone()
    };
    let people = read(&choices, &[]);
    assert_eq!(
        (people["unit"].as_str(), people["units"].as_u64()),
        (Some("participant"), Some(40))
    );
    let pair = &people["pairs"][0];
    assert!(pair["leave_one_out"]["value"].is_f64() && pair["bayes_factor"]["ln"]["se"].is_f64());
    assert!(people["held_out"].is_null() && pair["bayes_factor"]["sensitivity"].is_null());

    let counted = read(COUNTED, &["--compare"]);
    assert_eq!(
        (counted["unit"].as_str(), counted["units"].as_u64()),
        (Some("answer"), Some(60))
    );
    assert_eq!(counted["held_out"]["problems"].as_array().unwrap().len(), 2);
    assert!(
        counted["pairs"][0]["bayes_factor"]["sensitivity"]
            .as_array()
            .unwrap()
            .len()
            > 5
    );

    assert!(read(COUNTED, &["--models", "risk_aware"]).is_null());
}

#[test]
fn people_get_a_table() {
    let output = Files::new(PROBLEMS, COUNTED).fit(&[
        "--weighting-floor",
        "0.05",
        "--reference-reward",
        "-500",
    ]);
    let table = stdout(&output);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for expected in [
        "60 choices in 2 problems",
        "random",
        "Noisy Rational",
        "Risk-Aware",
        "lambda_theta",
        "no choice depends on it",
        "Prediction of 60 answers, each left out in turn",
        "depends on the priors",
    ] {
        assert!(table.contains(expected), "{expected}\n{table}");
    }
}

#[test]
fn an_unconverged_fit_fails_and_shows_diagnostics_only() {
    let files = Files::new(PROBLEMS, COUNTED);
    let few = [
        "--json",
        "--models",
        "risk_aware",
        "--chains",
        "2",
        "--draws",
        "100",
    ];
    let output = files.fit(&few);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("have not converged"));
    let found: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let fit = &found["models"]["risk_aware"];
    assert_eq!(fit["converged"], false);
    assert!(fit["parameters"].is_null() && fit["predicted"].is_null() && fit["log_kl"].is_null());
    assert!(fit["diagnostics"]["parameters"]["beta"]["ess_bulk"].is_f64());

    let shown = files.fit(&[&few[..], &["--show-unconverged"]].concat());
    assert_eq!(shown.status.code(), Some(1));
    let found: Value = serde_json::from_str(&stdout(&shown)).unwrap();
    assert_eq!(found["models"]["risk_aware"]["converged"], false);
    assert!(found["models"]["risk_aware"]["parameters"]["beta"]["mean"].is_f64());
}

#[test]
fn errors_name_file_line_column_value_and_what_is_allowed() {
    let check = |choices: &str, expected: &str| Files::new(PROBLEMS, choices).check_error(expected);
    check(
        "problem,action\nlow,stop\nlow,fly\n",
        "choices.csv, line 3: column `action`: `fly` is no action of problem `low`, allowed are accelerate, stop",
    );
    check(
        "problem,action\nmid,stop\n",
        "line 2: column `problem`: unknown problem `mid`, allowed are low, high",
    );
    check(
        "problem,action,status\nmid,stop,answered\n",
        "file (1 answered rows are of other problems)",
    );
    check(
        "problem,action,count\nlow,stop,-1\n",
        "line 2: column `count`: `-1` is not a number of choices",
    );
    check(
        "problem,choice\nlow,stop\n",
        "line 1: no column `action`, there are problem, choice",
    );
    check(
        "problem,action,action\nlow,stop,stop\n",
        "column `action` comes twice",
    );
    check("problem,action\nlow\n", "choices.csv");
    Files::new(r#"{"x":{"a":[[1,0]],"b":[[0.4,1]]}}"#, COUNTED)
        .check_error("problem `x`: action `b`: probabilities sum to 0.4, not 1");
    Files::new("[", COUNTED).check_error("problems.json is not of the form");
    Files::new("{}", COUNTED).check_error("has no problem");
    let zeros = r#"{"low":{"a":[[1,0]],"b":[[1,0]]}}"#;
    Files::new(zeros, "problem,action\nlow,a\n").check_error("reference reward is 0");

    let missing = riskaware(
        &[
            "fit",
            "--problems",
            "/nowhere.json",
            "--choices",
            "/nowhere.csv",
        ],
        "",
    );
    assert_eq!(missing.status.code(), Some(1));
    assert!(stderr(&missing).contains("cannot read /nowhere.json"));
}

#[test]
fn files_without_a_choice_are_refused() {
    for choices in ["problem,action\n", "problem,action,count\nlow,stop,0\n"] {
        Files::new(PROBLEMS, choices).check_error("there is no choice to fit");
    }
}

#[test]
fn wrong_usage_exits_with_2() {
    let files = Files::new(PROBLEMS, COUNTED);
    for wrong in [
        &["--chains", "1"][..],
        &["--weighting-floor", "1"],
        &["--models", "oracle"],
        &["--reference-reward", "0"],
        &["--nonsense"],
    ] {
        assert_eq!(files.fit(wrong).status.code(), Some(2), "{wrong:?}");
    }
    assert_eq!(riskaware(&["fit"], "").status.code(), Some(2));
}
