//! `riskaware simulate` and `riskaware fit --by`: people who do not exist, fitted and told apart.

use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::TempDir;

use crate::{
    conditions::BETWEEN,
    program::{riskaware, stderr, stdout},
};

const PEOPLE: [&str; 12] = [
    "--parameter",
    "alpha=0.88",
    "--parameter",
    "beta=0.7",
    "--parameter",
    "gamma=0.61",
    "--parameter",
    "delta=0.5",
    "--parameter",
    "lambda=2.25",
    "--parameter",
    "theta=0.05",
];

#[track_caller]
fn simulated(arguments: &[&str]) -> String {
    let mut all = vec!["simulate"];
    all.extend(arguments);
    let output = riskaware(&all, "");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    stdout(&output)
}

/// Simulated people whose only parameter is their sensitivity.
fn noisy(theta: f64, n: u32, more: &[&str]) -> String {
    let (theta, n) = (format!("theta={theta}"), n.to_string());
    let mut arguments = vec!["--study", "driving", "--model", "noisy_rational"];
    arguments.extend(["--parameter", &theta, "--n", &n]);
    arguments.extend(more);
    simulated(&arguments)
}

/// Two files under one header.
fn joined(first: &str, second: &str) -> String {
    let (_, rows) = second.split_once('\n').unwrap();
    format!("{first}{rows}")
}

fn file(folder: &TempDir, choices: &str) -> PathBuf {
    let path = folder.path().join("choices.csv");
    std::fs::write(&path, choices).unwrap();
    path
}

fn fit(study: &str, choices: &Path, more: &[&str]) -> std::process::Output {
    let mut arguments = vec!["fit", "--study", study];
    arguments.extend(["--choices", choices.to_str().unwrap()]);
    arguments.extend(more);
    riskaware(&arguments, "")
}

#[track_caller]
fn fitted(choices: &str, more: &[&str]) -> Value {
    let folder = TempDir::new().unwrap();
    let mut arguments = vec!["--json"];
    arguments.extend(more);
    let output = fit("driving", &file(&folder, choices), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    serde_json::from_str(&stdout(&output)).unwrap()
}

#[test]
fn a_seed_makes_a_file_in_the_form_of_an_export() {
    let people = |n: &str, seed: &str| {
        let arguments = ["--study", "driving", "--source", "lab", "--seed", seed];
        simulated(&[&arguments, &["--n", n][..], &PEOPLE].concat())
    };
    let text = people("3", "4");
    assert_eq!(text, people("3", "4"));
    assert!(people("5", "4").starts_with(&text));
    assert_ne!(text, people("3", "5"));

    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header: Vec<String> = reader
        .headers()
        .unwrap()
        .iter()
        .map(str::to_owned)
        .collect();
    assert_eq!(
        header.join(","),
        "study,version,participant,run_state,block,position,question,problem,information,time,risk,action,status,\
         shown_at_ms,answered_at_ms,server_ms,client_rt_ms,limit_ms,input,hidden_ms,source,simulated"
    );
    let at = |name: &str| header.iter().position(|column| column == name).unwrap();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    for (column, expected) in [
        ("study", "driving"),
        ("status", "answered"),
        ("source", "lab"),
        ("simulated", "true"),
    ] {
        assert!(
            rows.iter().all(|row| &row[at(column)] == expected),
            "{column}"
        );
    }
    for person in ["1", "2", "3"] {
        let mut cells: Vec<&str> = rows
            .iter()
            .filter(|row| &row[at("participant")] == person)
            .filter(|row| !row[at("risk")].is_empty())
            .map(|row| &row[at("problem")])
            .collect();
        cells.sort_unstable();
        cells.dedup();
        assert_eq!(cells.len(), 10, "every cell once");
    }
}

#[test]
fn conditions_take_turns() {
    let folder = TempDir::new().unwrap();
    let study = folder.path().join("between.toml");
    std::fs::write(&study, BETWEEN).unwrap();
    let text = simulated(&[
        "--study",
        study.to_str().unwrap(),
        "--model",
        "noisy_rational",
        "--parameter",
        "theta=0.1",
        "--n",
        "8",
    ]);
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().unwrap().clone();
    let factors = header.iter().skip(8).take_while(|name| *name != "action");
    assert!(factors.count() > 0);
    let mut met: std::collections::BTreeMap<String, std::collections::BTreeSet<String>> =
        Default::default();
    for row in reader.records().map(Result::unwrap) {
        let problem = row[7].to_owned();
        if !problem.contains(':') {
            met.entry(row[2].to_owned()).or_default().insert(problem);
        }
    }
    assert_eq!(met.len(), 8);
    // Of four conditions each person has the one that the fourth before them had, and no two neighbours have the same.
    let of = |person: u32| &met[&person.to_string()];
    for person in 1..=4 {
        assert_eq!(of(person), of(person + 4));
        assert_ne!(of(person), of(person % 4 + 1));
    }
}

#[test]
fn a_fit_finds_the_parameters_that_people_were_made_with() {
    let people = [
        &["--study", "driving", "--n", "400", "--seed", "11"],
        &PEOPLE[..],
    ]
    .concat();
    let found = fitted(&simulated(&people), &["--models", "risk_aware"]);
    let parameters = &found["models"]["risk_aware"]["parameters"];
    let theta = 0.05;
    let tau = theta * 2.25 * 500_f64.powf(0.7);
    for (name, truth) in [
        ("beta", 0.7),
        ("gamma", 0.61),
        ("delta", 0.5),
        ("tau", tau),
        ("lambda_theta", 2.25 * theta),
    ] {
        let at = |key: &str| parameters[name][key].as_f64().unwrap();
        // From the 90 % interval to 95 %, each side by itself, as of a normal distribution.
        let wider = 1.96 / 1.645;
        let low = at("q50") - wider * (at("q50") - at("q5"));
        let high = at("q50") + wider * (at("q95") - at("q50"));
        assert!(low < truth && truth < high, "{name}: {low} {truth} {high}");
    }

    let found = fitted(&noisy(0.008, 400, &[]), &["--models", "noisy_rational"]);
    let theta = &found["models"]["noisy_rational"]["parameters"]["theta"];
    let at = |key: &str| theta[key].as_f64().unwrap();
    assert!((at("mean") - 0.008).abs() < 1.96 * at("sd"), "{theta}");
    assert!(found.get("by").is_none());
}

#[test]
fn sources_with_other_parameters_are_told_apart_and_others_are_not() {
    let by_source = |second: f64| {
        let lab = noisy(0.012, 60, &["--source", "lab"]);
        let web = noisy(
            second,
            60,
            &["--source", "web", "--first", "61", "--seed", "2"],
        );
        fitted(&joined(&lab, &web), &["--by", "source"])
    };
    for (second, verdict, sign) in [(0.003, "differ", 1.0), (0.012, "alike", -1.0)] {
        let found = by_source(second);
        let by = &found["by"];
        assert_eq!(by["factor"], "source");
        for (level, name) in ["lab", "web"].into_iter().enumerate() {
            let level = &by["levels"][level];
            assert_eq!(
                (&level["level"], &level["people"], &level["n"]),
                (&name.into(), &60.into(), &480.into())
            );
        }
        for model in ["noisy_rational", "risk_aware"] {
            let model = &by["models"][model];
            let evidence = &model["evidence"];
            assert_eq!(evidence["verdict"], verdict, "{second} {evidence}");
            let value = evidence["ln_bayes_factor"]["value"].as_f64().unwrap();
            assert!(value * sign > 3_f64.ln(), "{value}");
            assert!(evidence["ln_bayes_factor"]["se"].as_f64().unwrap() < 0.2);
        }
        // Everybody is compared, so the shared fit is the one of the whole file.
        let shared = &by["models"]["noisy_rational"]["parts"][0]["shared"];
        let whole = &found["models"]["noisy_rational"];
        assert_eq!(shared["parameters"], whole["parameters"]);
        assert_eq!(shared["ln_evidence"], whole["log_marginal_likelihood"]);
        let contrast = &by["models"]["noisy_rational"]["parts"][0]["contrasts"][0];
        assert_eq!(
            (&contrast["level"], &contrast["against"], &contrast["other"]),
            (&"lab".into(), &"level".into(), &"web".into())
        );
        let larger = contrast["differences"]["theta"]["probability_larger"]
            .as_f64()
            .unwrap();
        assert_eq!(larger > 0.99, sign > 0.0, "{larger}");
    }
}

#[test]
fn any_column_splits_the_choices_and_the_table_says_what_limits_it() {
    let folder = TempDir::new().unwrap();
    let choices = file(&folder, &noisy(0.01, 3, &[]));
    let output = fit("driving", &choices, &["--by", "participant"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let table = stdout(&output);
    for expected in [
        "Values of participant",
        "Noisy Rational by participant: ",
        "ln Bayes factor of separate to shared parameters: ",
        "(depends on the priors)",
        "3 − the rest",
        "the prior: no choice depends on it",
        "not informed in both",
        "not corrected for their number",
    ] {
        assert!(table.contains(expected), "{expected}\n{table}");
    }
    let people: Vec<&str> = table
        .lines()
        .skip_while(|line| !line.starts_with("Values of"))
        .skip(2)
        .take(3)
        .map(|line| line.split_whitespace().next().unwrap())
        .collect();
    assert_eq!(people, ["1", "2", "3"]);

    // Empty cells are a value of their own.
    let known = noisy(0.01, 10, &["--source", "web", "--first", "11"]);
    let text = joined(&noisy(0.01, 10, &[]), &known);
    let found = fitted(&text, &["--by", "source", "--models", "noisy_rational"]);
    let names = [0, 1].map(|level| found["by"]["levels"][level]["level"].clone());
    assert_eq!(names, [Value::Null, "web".into()]);
}

#[track_caller]
fn refused(output: &std::process::Output, code: i32, expected: &[&str]) {
    assert_eq!(output.status.code(), Some(code), "{}", stderr(output));
    let text = stderr(output);
    for expected in expected {
        assert!(text.contains(expected), "{expected}\n{text}");
    }
    assert_eq!(stdout(output), "");
}

#[test]
fn what_cannot_be_done_is_said_with_what_is_there() {
    let folder = TempDir::new().unwrap();
    let choices = file(&folder, &noisy(0.01, 3, &["--source", "lab"]));
    let output = fit("driving", &choices, &["--by", "sorce"]);
    refused(&output, 1, &["no column `sorce`", "client_rt_ms", "source"]);
    let output = fit("driving", &choices, &["--by", "source"]);
    refused(&output, 1, &["`lab` in every row", "nothing to compare"]);

    let simulate = |more: &[&str]| {
        let arguments = [
            &[
                "simulate",
                "--study",
                "driving",
                "--model",
                "noisy_rational",
            ],
            more,
        ]
        .concat();
        riskaware(&arguments, "")
    };
    let output = simulate(&["--parameter", "alpha=0.5"]);
    refused(&output, 1, &["--parameter", "alpha", "theta"]);
    refused(&simulate(&[]), 2, &["--parameter"]);
    let theta = ["--parameter", "theta=0.1"];
    let output = simulate(&[&theta[..], &["--output", choices.to_str().unwrap()]].concat());
    refused(&output, 1, &["choices.csv"]);
    let output = simulate(&[&theta[..], &["--n", "0"]].concat());
    refused(&output, 2, &["--n"]);
}
