//! `riskaware fit`: a study and priors in, draws and a report out.

use std::fs;

use serde_json::Value;

use crate::fit_command::{COUNTED, Files, PROBLEMS};
use crate::program::{riskaware, stderr, stdout};

/// Too few draws to converge.
const FEW: [&str; 4] = ["--chains", "2", "--draws", "100"];

fn names(folder: &std::path::Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn draws_are_written_once_unless_forced() {
    let files = Files::new(PROBLEMS, COUNTED);
    let folder = files.folder.path().join("out/draws");
    let folder_text = folder.to_str().unwrap();
    let arguments = [
        "--models",
        "noisy_rational",
        "--chains",
        "10",
        "--draws-dir",
        folder_text,
    ];
    let output = files.fit(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let written = names(&folder);
    assert_eq!(written.len(), 11);
    assert_eq!(
        (
            written[0].as_str(),
            written[9].as_str(),
            written[10].as_str()
        ),
        (
            "noisy_rational-01.csv",
            "noisy_rational-10.csv",
            "noisy_rational.json"
        )
    );
    let content = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    let before: Vec<String> = written.iter().map(|name| content(name)).collect();

    fs::remove_file(folder.join("noisy_rational-01.csv")).unwrap();
    let output = files.fit(&arguments);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("noisy_rational-02.csv exists already, --force overwrites it"),
        "{}",
        stderr(&output)
    );
    assert_eq!(names(&folder).len(), 10, "nothing is written in between");

    let output = files.fit(&[&arguments[..], &["--force"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let after: Vec<String> = written.iter().map(|name| content(name)).collect();
    assert!(before == after, "the same seed gives the same files");
}

#[test]
fn draws_that_have_not_converged_are_written_only_when_asked_for() {
    let files = Files::new(PROBLEMS, COUNTED);
    let folder = files.folder.path().join("draws");
    let arguments = [
        &FEW[..],
        &[
            "--models",
            "risk_aware",
            "--draws-dir",
            folder.to_str().unwrap(),
        ],
    ]
    .concat();
    assert_eq!(files.fit(&arguments).status.code(), Some(1));
    assert_eq!(names(&folder).len(), 0);
    assert_eq!(
        files
            .fit(&[&arguments[..], &["--show-unconverged"]].concat())
            .status
            .code(),
        Some(1)
    );
    let chain = fs::read_to_string(folder.join("risk_aware-2.csv")).unwrap();
    assert!(chain.contains("# converged = false\n"));
}

#[test]
fn the_report_stands_alone() {
    let files = Files::new(PROBLEMS, COUNTED);
    let page = files.folder.path().join("report.html");
    let arguments = ["--html", page.to_str().unwrap()];
    assert_eq!(files.fit(&arguments).status.code(), Some(0));
    let html = fs::read_to_string(&page).unwrap();
    for expected in [
        "What did they choose?",
        "choices.csv",
        "Risk-Aware",
        "lambda_theta",
        "ln marginal likelihood",
        "low",
    ] {
        assert!(html.contains(expected), "{expected}");
    }
    for foreign in ["<script", "src=", "href=", "url(", "@import"] {
        assert!(!html.contains(foreign), "{foreign}");
    }
    let again = files.fit(&arguments);
    assert!(
        stderr(&again).contains("report.html exists already"),
        "{}",
        stderr(&again)
    );

    let few = [&FEW[..], &arguments, &["--force", "--models", "risk_aware"]].concat();
    assert_eq!(files.fit(&few).status.code(), Some(1));
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("Not converged"));
    assert!(!html.contains("Which model predicts them?") && !html.contains("Contraction"));
}

#[test]
fn priors_come_from_a_file() {
    let files = Files::new(PROBLEMS, COUNTED);
    let path = files.folder.path().join("priors.toml");
    let prior = [
        "--prior",
        path.to_str().unwrap(),
        "--models",
        "noisy_rational",
    ];
    fs::write(
        &path,
        "tau = { log_normal = { median = 2, log_sd = 0.5 } }\n",
    )
    .unwrap();
    let output = files.fit(&[&prior[..], &["--json"]].concat());
    let found: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let tau = &found["models"]["noisy_rational"]["parameters"]["tau"];
    assert!(
        (tau["prior_q50"].as_f64().unwrap() - 2.0).abs() < 0.01,
        "{tau}"
    );

    fs::write(
        &path,
        "alpha = { uniform = [0, 1] }\nteta = { uniform = [0, 1] }\n",
    )
    .unwrap();
    let refused = files.fit(&prior);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        stderr(&refused).contains("priors.toml, line 2, teta: found unknown key `teta`"),
        "{}",
        stderr(&refused)
    );

    fs::write(&path, "gamma = { uniform = [0.1, 1] }\n").unwrap();
    let both = files.fit(&[&prior[..], &["--weighting-floor", "0.05"]].concat());
    assert!(
        stderr(&both).contains("--weighting-floor and")
            && stderr(&both).contains("both give a prior of `gamma`"),
        "{}",
        stderr(&both)
    );
}

#[test]
fn a_study_brings_its_problems_and_settings() {
    let export = "study,problem,action,status\n\
                  driving,explicit/timed/low,stop,answered\n\
                  driving,explicit/timed/low,accelerate,answered\n\
                  driving,none/timed/unknown,stop,answered\n\
                  driving,implicit/untimed/high,stop,answered\n\
                  driving,implicit/untimed/high,,timed_out\n";
    let files = Files::new(PROBLEMS, export);
    let choices = files.folder.path().join("choices.csv");
    let choices = choices.to_str().unwrap();
    let fit = |more: &[&str]| {
        let arguments = [
            "fit",
            "--choices",
            choices,
            "--models",
            "noisy_rational",
            "--json",
        ];
        riskaware(&[&arguments[..], more].concat(), "")
    };
    let output = fit(&["--study", "driving"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let built_in: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(
        (built_in["n"].as_u64(), built_in["other_problems"].as_u64()),
        (Some(3), Some(1))
    );
    assert_eq!(built_in["reference_reward"], -500.0);
    let predicted = built_in["models"]["noisy_rational"]["predicted"]
        .as_object()
        .unwrap();
    assert_eq!(predicted.len(), 8, "all fitted cells, answered or not");

    let (_, text) = riskaware::study::built_in()[0];
    let path = files.folder.path().join("mine.toml");
    fs::write(&path, text).unwrap();
    let of_file = fit(&["--study", path.to_str().unwrap()]);
    assert_eq!(stdout(&of_file), stdout(&output));

    let unknown = fit(&["--study", "drivin"]);
    assert_eq!(unknown.status.code(), Some(1));
    assert!(
        stderr(&unknown).contains("unknown study `drivin`, built in are driving"),
        "{}",
        stderr(&unknown)
    );
    let both = fit(&["--study", "driving", "--problems", "problems.json"]);
    assert_eq!(both.status.code(), Some(2));
}
