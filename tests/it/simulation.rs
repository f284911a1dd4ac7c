//! Simulated people take the study through the same pages as everybody else.

use std::process::Command;

#[test]
fn the_load_plays_whole_participants_and_counts_their_pages() {
    let output = Command::new(env!("CARGO_BIN_EXE_riskaware"))
        .args(["load", "--people", "3", "--rounds", "2", "--log", "warn"])
        .output()
        .unwrap();
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    // Consent, situation, practice, start, 5 timed, pause, 5 untimed, pause, 4 baseline, form; and the landing page.
    let pages = 6 * (1 + 2 + 1 + 1 + 5 + 1 + 5 + 1 + 4 + 1);
    let line = printed
        .lines()
        .find(|line| line.starts_with("page turns"))
        .unwrap();
    assert_eq!(
        line.split_whitespace().nth(2),
        Some(pages.to_string().as_str()),
        "{printed}"
    );
    assert!(printed.contains("fsyncs per second"), "{printed}");
}

#[test]
fn people_whose_parameters_are_out_of_range_are_refused() {
    let output = Command::new(env!("CARGO_BIN_EXE_riskaware"))
        .args(["demo", "--gamma", "1.5"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(
        message.contains("gamma") && message.contains("1.5"),
        "{message}"
    );
}
