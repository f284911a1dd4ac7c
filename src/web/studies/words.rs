//! States, times and counts in the words of these pages.

use super::super::results::count;
use crate::{
    store::{RunState, StudyState},
    study::{Flag, Timestamp},
};

/// What nothing is shown as.
pub(super) const NONE: &str = "–";

/// `21 Nov 2026, 14:05 UTC`.
pub(super) fn moment(at: Timestamp) -> String {
    jiff::Timestamp::from_millisecond(at.0).map_or_else(
        |_| NONE.to_owned(),
        |at| at.strftime("%-d %b %Y, %H:%M UTC").to_string(),
    )
}

/// `2.4 s`, `3 min 20 s` or `2 h 5 min`.
pub(super) fn duration(ms: u64) -> String {
    let seconds = ms / 1_000;
    match seconds {
        0..60 => format!("{}.{} s", seconds, ms % 1_000 / 100),
        60..3_600 => format!("{} min {} s", seconds / 60, seconds % 60),
        3_600.. => format!("{} h {} min", seconds / 3_600, seconds % 3_600 / 60),
    }
}

/// The same, or a dash.
pub(super) fn duration_or_none(ms: Option<u64>) -> String {
    ms.map_or_else(|| NONE.to_owned(), duration)
}

/// `1 person`, `2 people`.
pub(super) fn people(n: u64) -> String {
    format!("{} {}", count(n), if n == 1 { "person" } else { "people" })
}

pub(super) fn study_state(state: StudyState) -> &'static str {
    match state {
        StudyState::Draft => "Draft",
        StudyState::Open => "Open",
        StudyState::Paused => "Paused",
        StudyState::Closed => "Closed",
    }
}

pub(super) fn run_state(state: RunState) -> &'static str {
    match state {
        RunState::Active => "under way",
        RunState::Completed => "completed",
        RunState::Declined => "declined",
        RunState::ScreenedOut => "screened out",
        RunState::FailedCheck => "failed a check",
        RunState::TimedOut => "timed out",
        RunState::Withdrawn => "withdrawn",
    }
}

pub(super) fn flag(flag: Flag) -> &'static str {
    match flag {
        Flag::FastChoice => "choice under 0.3 s",
        Flag::ShortRun => "under a third of the median time",
        Flag::HiddenPage => "page hidden during a question",
        Flag::FailedCheck => "check answered wrongly",
        Flag::LateAnswer => "late answer",
        Flag::SeveralArrivals => "came by several links",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_told_in_the_largest_units_that_say_something() {
        for (ms, text) in [
            (0, "0.0 s"),
            (2_450, "2.4 s"),
            (59_999, "59.9 s"),
            (200_000, "3 min 20 s"),
            (7_500_000, "2 h 5 min"),
        ] {
            assert_eq!(duration(ms), text);
        }
        assert_eq!(duration_or_none(None), "–");
        assert_eq!(
            moment(Timestamp(1_700_000_000_000)),
            "14 Nov 2023, 22:13 UTC"
        );
        assert_eq!(people(1), "1 person");
        assert_eq!(people(1_200), "1\u{202f}200 people");
    }
}
