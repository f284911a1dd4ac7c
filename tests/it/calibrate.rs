//! `riskaware calibrate`, run as a program.

use serde_json::Value;

use crate::program::{riskaware, stderr, stdout};

const SMALL: [&str; 9] = [
    "calibrate",
    "--designs",
    "cups",
    "--models",
    "noisy_rational",
    "--seeds",
    "1,2",
    "--samples",
    "15",
];

#[test]
fn every_seed_and_quantity_is_reported_whatever_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let figures = folder.path().join("figures");
    let run = |threads: &str| {
        let mut arguments = SMALL.to_vec();
        arguments.extend(["--replicates", "6", "--json", "--threads", threads]);
        arguments.extend(["--figures", figures.to_str().unwrap()]);
        let output = riskaware(&arguments, "");
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        stdout(&output)
    };
    let text = run("1");
    assert_eq!(text, run("3"));

    let found: Value = serde_json::from_str(&text).unwrap();
    // Four quantities, each tested for two seeds and for both together.
    assert_eq!(
        (found["tests"].as_u64(), found["calibrated"].as_bool()),
        (Some(12), Some(true))
    );
    let experiment = &found["experiments"][0];
    assert_eq!(experiment["unconverged"].as_array().unwrap().len(), 2);
    let quantities = experiment["quantities"].as_array().unwrap();
    let names: Vec<&str> = quantities
        .iter()
        .map(|found| found["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        names,
        ["theta", "tau", "P(stable) in cups", "ln likelihood"]
    );
    for quantity in quantities {
        for test in quantity["seeds"].as_array().unwrap() {
            assert!(test["p"].as_f64().unwrap() <= test["corrected_p"].as_f64().unwrap());
            assert_eq!(test["ranks_below"].as_array().unwrap().len(), 15);
        }
        assert!(quantity["together"]["p"].is_f64());
    }

    let figure = std::fs::read_to_string(figures.join("cups-noisy-rational.svg")).unwrap();
    assert!(figure.starts_with("<svg xmlns=") && figure.ends_with("</svg>\n"));
    assert_eq!(figure.matches("<g ").count(), quantities.len());
    for name in names {
        assert!(figure.contains(name), "{name}");
    }
}

#[test]
fn a_wrong_prior_is_noticed_and_exits_with_1() {
    let mut arguments = SMALL.to_vec();
    arguments.extend(["--replicates", "40", "--wrong-prior"]);
    let output = riskaware(&arguments, "");
    assert_eq!(output.status.code(), Some(1), "{}", stdout(&output));
    assert!(
        stdout(&output).contains("NOT CALIBRATED"),
        "{}",
        stdout(&output)
    );
    assert!(stderr(&output).contains("the fits are not calibrated"));
}

#[test]
fn wrong_usage_exits_with_2() {
    for wrong in [
        ["--designs", "dice"],
        ["--samples", "5"],
        ["--replicates", "0"],
    ] {
        let arguments = [&["calibrate"], &wrong[..]].concat();
        assert_eq!(
            riskaware(&arguments, "").status.code(),
            Some(2),
            "{wrong:?}"
        );
    }
}

/// Both models of the paper on three designs, with the five seeds of the command: a thousand simulated studies for each
/// design and model.
#[test]
#[ignore = "simulates and fits 6,000 studies: about ten minutes of processor time"]
fn fits_are_calibrated() {
    let output = riskaware(&["calibrate", "--replicates", "200"], "");
    println!("{}", stdout(&output));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}
