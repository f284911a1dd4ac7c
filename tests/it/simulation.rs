//! Simulated people take the study through the same pages as everybody else.

use crate::program::{riskaware, stderr, stdout};

#[test]
fn the_load_plays_whole_participants_and_counts_their_pages() {
    let output = riskaware(
        &["load", "--people", "3", "--rounds", "2", "--log", "warn"],
        "",
    );
    assert!(output.status.success(), "{}", stderr(&output));
    let printed = stdout(&output);
    // Landing, consent, situation, practice, start, timed, pause, untimed, pause, baseline, form.
    let pages = 6 * (1 + 1 + 1 + 1 + 1 + 5 + 1 + 5 + 1 + 4 + 1);
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
fn simulated_people_need_no_time_for_replays() {
    let args = ["load", "--study", "cups", "--people", "2", "--rounds", "1"];
    let output = riskaware(&args, "");
    assert!(output.status.success(), "{}", stderr(&output));
    // Landing, consent, task, replays, start, timed, pause, untimed, form.
    let printed = stdout(&output);
    let pages = format!("page turns {}", 2 * 9);
    let words: Vec<&str> = printed.split_whitespace().collect();
    assert!(words.join(" ").contains(&pages), "{printed}");
}

#[test]
fn people_whose_parameters_are_out_of_range_are_refused() {
    let output = riskaware(&["demo", "--gamma", "1.5"], "");
    assert_eq!(output.status.code(), Some(1));
    let message = stderr(&output);
    assert!(
        message.contains("gamma") && message.contains("1.5"),
        "{message}"
    );
}
