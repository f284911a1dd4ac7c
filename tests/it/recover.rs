//! `riskaware recover`, run as a program.

use serde_json::Value;

use crate::program::{riskaware, stderr, stdout};

const PROBLEMS: &str = r#"{
    "even": {"safe": [[1, 20]], "risky": [[0.2, 105], [0.8, 0]]},
    "clear": {"safe": [[1, 60]], "risky": [[0.2, 105], [0.8, 0]]}
}"#;

/// Runs the command on the problems above.
fn recover(more: &[&str]) -> std::process::Output {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("problems.json");
    std::fs::write(&path, PROBLEMS).unwrap();
    let mut arguments = vec!["recover", "--problems", path.to_str().unwrap()];
    arguments.extend(more);
    riskaware(&arguments, "")
}

#[test]
fn figures_have_errors_and_do_not_depend_on_threads() {
    let run = |threads: &str| -> Value {
        let output = recover(&[
            "--json",
            "--model",
            "noisy_rational",
            "--rival",
            "expected_utility",
            "--parameter",
            "theta=0.1",
            "--n",
            "5,60",
            "--replicates",
            "6",
            "--threads",
            threads,
        ]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let mut found: Value = serde_json::from_str(&stdout(&output)).unwrap();
        // The temporary file's name.
        assert!(found["source"].take().is_string());
        found
    };
    let found = run("1");
    assert_eq!(found, run("3"));
    assert_eq!(found["parameters"]["theta"], 0.1);
    let sizes = found["sizes"].as_array().unwrap();
    let width = |size: &Value| {
        assert_eq!(size["replicates"], 6);
        for figure in [
            "elpd_beyond_two_se",
            "elpd_favours_wrong",
            "bayes_factor_above_10",
            "bayes_factor_favours_wrong",
        ] {
            let share = size[figure]["value"].as_f64().unwrap();
            assert!((0.0..=1.0).contains(&share) && size[figure]["se"].as_f64().unwrap() > 0.0);
        }
        let theta = &size["quantities"][0];
        assert_eq!(
            (theta["quantity"].as_str(), theta["scale"].as_str()),
            (Some("theta"), Some("log"))
        );
        assert!(theta["bias"]["value"].is_f64() && theta["coverage"]["se"].is_f64());
        theta["width"]["value"].as_f64().unwrap()
    };
    assert!(width(&sizes[1]) < width(&sizes[0]));
}

#[test]
fn people_get_a_table() {
    let output = recover(&["--n", "20", "--replicates", "2", "--interval", "gamma"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let table = stdout(&output);
    for expected in [
        "2 problems, each answered once by each person",
        "People follow Risk-Aware (parameters from the prior",
        "Risk-Aware or Noisy Rational",
        "width of gamma",
        "20 people: posterior medians and 90 % intervals",
        "ln lambda",
        "no choice depends on it",
    ] {
        assert!(table.contains(expected), "{expected}\n{table}");
    }
}

#[test]
fn a_built_in_study_can_be_named() {
    let arguments = [
        "recover",
        "--study",
        "driving",
        "--n",
        "3",
        "--replicates",
        "2",
    ];
    let output = riskaware(&arguments, "");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(
        stdout(&output).contains("study driving: 8 problems"),
        "{}",
        stdout(&output)
    );
}

#[test]
fn errors_say_what_is_wrong() {
    for (wrong, code, expected) in [
        (
            &["--parameter", "alpha=0.88"][..],
            1,
            "risk_aware needs parameter `beta`",
        ),
        (&["--parameter", "alpha"], 2, "allowed is NAME=VALUE"),
        (
            &["--model", "noisy_rational", "--parameter", "theta=-1"],
            1,
            "allowed is 0 or more",
        ),
        (&["--rival", "risk_aware"], 1, "allowed are two models"),
        (
            &["--model", "noisy_rational", "--interval", "gamma"],
            1,
            "has no such parameter",
        ),
        (&["--interval", "zeta"], 2, "unknown quantity `zeta`"),
        (&["--n", "0"], 2, "--n"),
    ] {
        let output = recover(wrong);
        assert_eq!(output.status.code(), Some(code), "{wrong:?}");
        assert!(
            stderr(&output).contains(expected),
            "{expected}\n{}",
            stderr(&output)
        );
    }
}
