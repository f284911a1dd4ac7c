//! Numbers as pages show them; static/js/figures/format.mjs writes the same.

use crate::study::Timestamp;

const NONE: &str = "–";

/// Digits in groups of three.
pub(in crate::web) fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3 * 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// A number with a fixed count of decimals and a real minus sign.
pub(in crate::web) fn decimal(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(
        || NONE.to_owned(),
        |value| {
            let text = format!("{value:.digits$}");
            // What is rounded to nothing has no sign.
            if text.trim_start_matches(['-', '0', '.']).is_empty() {
                return text.trim_start_matches('-').to_owned();
            }
            text.replace('-', "\u{2212}")
        },
    )
}

/// A number with three significant digits, for what may be 0.01 as well as 100.
pub(in crate::web) fn significant(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-4..1e6).contains(&size) {
        return format!("{value:.1e}").replace('-', "\u{2212}");
    }
    let digits = [(0.01, 5), (0.1, 4), (1.0, 3), (10.0, 2), (100.0, 1)]
        .into_iter()
        .find(|(bound, _)| size > 0.0 && size < *bound)
        .map_or(0, |(_, digits)| digits);
    decimal(Some(value), digits)
}

/// A share as a whole percentage.
pub(in crate::web) fn percent(share: Option<f64>) -> String {
    share.map_or_else(
        || NONE.to_owned(),
        |share| format!("{} %", (share * 100.0).round()),
    )
}

/// A percentage's interval.
pub(in crate::web) fn percents(low: Option<f64>, high: Option<f64>) -> String {
    match (low, high) {
        (Some(_), Some(_)) => format!("{} to {}", percent(low), percent(high)),
        (None, Some(_) | None) | (Some(_), None) => NONE.to_owned(),
    }
}

/// Two ends of an interval.
pub(super) fn interval(low: Option<f64>, high: Option<f64>, digits: usize) -> String {
    match (low, high) {
        (Some(_), Some(_)) => format!("{} to {}", decimal(low, digits), decimal(high, digits)),
        (None, Some(_) | None) | (Some(_), None) => NONE.to_owned(),
    }
}

/// `−5.70 ± 3.30`.
pub(in crate::web) fn mean_sd(mean: Option<f64>, sd: Option<f64>, digits: usize) -> String {
    match (mean, sd) {
        (Some(_), Some(_)) => format!("{} ± {}", decimal(mean, digits), decimal(sd, digits)),
        (None, Some(_) | None) | (Some(_), None) => NONE.to_owned(),
    }
}

/// A point in time for programs.
pub(in crate::web) fn rfc3339(at: Timestamp) -> String {
    moment(at).to_string()
}

fn moment(at: Timestamp) -> jiff::Timestamp {
    // Out of jiff's range are only the times of a clock that is wrong by millennia.
    jiff::Timestamp::from_millisecond(at.0).unwrap_or(jiff::Timestamp::UNIX_EPOCH)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_like_those_of_the_scripts() {
        assert_eq!(count(7), "7");
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(decimal(Some(-1.335), 1), "\u{2212}1.3");
        assert_eq!(decimal(Some(-0.04), 1), "0.0");
        assert_eq!(decimal(None, 1), "–");
        for (value, text) in [
            (0.0, "0"),
            (0.01234, "0.0123"),
            (0.5, "0.500"),
            (3.456, "3.46"),
            (123.4, "123"),
        ] {
            assert_eq!(significant(value), text);
        }
        assert_eq!(significant(-2.5e-6), "\u{2212}2.5e\u{2212}6");
        assert_eq!(percent(Some(0.834)), "83 %");
        assert_eq!(mean_sd(Some(-5.7), Some(3.3), 1), "\u{2212}5.7 ± 3.3");
        assert_eq!(mean_sd(None, Some(3.3), 1), "–");
        assert_eq!(
            rfc3339(Timestamp(1_700_000_000_000)),
            "2023-11-14T22:13:20Z"
        );
    }
}
