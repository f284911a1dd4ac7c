//! `riskaware predict`: one line in, one line out.

use crate::program::{riskaware, stderr, stdout};

const CUPS: &str = r#""problem":{"stable":[[1.0,20.0]],"unstable":[[0.2,105.0],[0.8,0.0]]}"#;

fn answers(lines: &[String]) -> Vec<serde_json::Value> {
    let output = riskaware(&["predict"], &lines.join("\n"));
    let found: Vec<serde_json::Value> = stdout(&output)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let wrong = found
        .iter()
        .filter(|answer| answer["error"].is_string())
        .count();
    assert_eq!(output.status.code(), Some(i32::from(wrong > 0)));
    let told = stderr(&output);
    assert_eq!(
        told.contains(&format!(
            "{wrong} of {} lines could not be answered",
            lines.len()
        )),
        wrong > 0,
        "{told}"
    );
    found
}

#[track_caller]
fn check_error(line: &str, expected: &str) {
    let found = answers(&[line.to_owned()]);
    let error = found[0]["error"].as_str().unwrap();
    assert!(error.contains(expected), "{error}");
}

/// The known value of the cup problem at the medians of Tversky & Kahneman (1992).
#[test]
fn a_wrong_line_is_answered_and_the_rest_is_too() {
    let risk_aware = format!(
        r#"{{"model":"risk_aware","parameters":{{"alpha":0.88,"beta":0.88,"lambda":2.25,"gamma":0.61,"delta":0.69,"theta":0.2}},{CUPS}}}"#
    );
    let rational = format!(r#"{{"model":"noisy_rational","parameters":{{"theta":0.2}},{CUPS}}}"#);
    let found = answers(&[risk_aware, "nonsense".to_owned(), String::new(), rational]);
    assert_eq!(found.len(), 4);
    let stable = found[0]["probabilities"]["stable"].as_f64().unwrap();
    assert!((stable - 0.4156651).abs() < 5e-8);
    assert!(found[1]["error"].is_string() && found[2]["error"].is_string());
    assert_eq!(
        found[3]["utilities"],
        serde_json::json!({"stable": 20.0, "unstable": 21.0})
    );
    let stable = found[3]["probabilities"]["stable"].as_f64().unwrap();
    // One utility apart at θ = 0.2. A number with fewer digits than it has would be off by more.
    assert!((stable - 1.0 / (1.0 + 0.2_f64.exp())).abs() < 1e-15);
}

#[test]
fn actions_keep_their_order() {
    let line = r#"{"model":"noisy_rational","parameters":{"theta":1},"problem":{"z":[[1,0]],"a":[[1,0]],"m":[[1,0]]}}"#;
    let output = riskaware(&["predict"], line);
    let position = |name| stdout(&output).find(name).unwrap();
    assert!(position(r#""z""#) < position(r#""a""#) && position(r#""a""#) < position(r#""m""#));
}

#[test]
fn errors_say_what_is_wrong() {
    let with = |model: &str, parameters: &str, problem: &str| {
        format!(r#"{{"model":"{model}","parameters":{parameters},"problem":{problem}}}"#)
    };
    let good = r#"{"a":[[1,1]],"b":[[1,2]]}"#;
    check_error(
        &with("oracle", "{}", good),
        "unknown model `oracle`, allowed are noisy_rational, expected_utility,",
    );
    check_error(
        &with("noisy_rational", "{}", good),
        "noisy_rational needs parameter `theta`",
    );
    check_error(
        &with("noisy_rational", r#"{"theta":1,"beta":1}"#, good),
        "parameter `beta`",
    );
    check_error(
        &with("noisy_rational", r#"{"theta":-1}"#, good),
        "`theta` is -1, allowed is 0 or more",
    );
    check_error(
        &with("noisy_rational", r#"{"theta":1}"#, r#"{"a":[[1,1]]}"#),
        "2 or more actions",
    );
    check_error(
        &with(
            "noisy_rational",
            r#"{"theta":1}"#,
            r#"{"a":[[1,1]],"b":[[0.5,2]]}"#,
        ),
        "action `b`: probabilities sum to 0.5",
    );
    check_error(
        &with("noisy_rational", r#"{"theta":1e999}"#, good),
        "number out of range",
    );
    check_error(
        r#"{"model":"noisy_rational","parameters":{"theta":1}}"#,
        "missing field `problem`",
    );
    check_error(
        &format!(
            r#"{{"model":"noisy_rational","parameters":{{"theta":1}},"problem":{good},"thetta":1}}"#
        ),
        "unknown field `thetta`",
    );
}
