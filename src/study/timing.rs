//! Time limits: pure rules over times that the caller measured.

use serde::{Deserialize, Serialize};

/// Extra time for the network: an answer counts when it arrives within limit + grace (studies.md, section 1).
pub const DEFAULT_GRACE_MS: u64 = 1_500;

/// A moment in milliseconds since 1970-01-01 UTC.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// Milliseconds from `earlier` to `self`; zero if the clock went back between the two.
    pub fn millis_since(self, earlier: Self) -> u64 {
        u64::try_from(self.0.saturating_sub(earlier.0)).unwrap_or(0)
    }
}

/// How much longer than others a person may take, asked for before the run: 1 is no extra time.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct TimeFactor(f64);

/// A time factor that is not allowed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("time factor {0} is not allowed: it must be a number from 1 to 10")]
pub struct TimeFactorError(f64);

impl TimeFactor {
    /// No extra time.
    pub const ONE: Self = Self(1.0);

    /// Checks a factor: 1 to 10.
    ///
    /// # Errors
    /// When the factor is not a number or lies outside that range.
    pub fn new(factor: f64) -> Result<Self, TimeFactorError> {
        if (1.0..=10.0).contains(&factor) {
            Ok(Self(factor))
        } else {
            Err(TimeFactorError(factor))
        }
    }

    /// The factor as a number.
    pub fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for TimeFactor {
    type Error = TimeFactorError;

    fn try_from(factor: f64) -> Result<Self, Self::Error> {
        Self::new(factor)
    }
}

impl From<TimeFactor> for f64 {
    fn from(factor: TimeFactor) -> Self {
        factor.0
    }
}

/// What an answer's arrival time makes of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// Within limit + grace: the answer counts.
    InTime,
    /// After that: the answer is kept, flagged and never counted.
    Late,
}

/// The deadline of one timed question for one person, relative to the moment when the question was shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Deadline {
    limit_ms: u64,
    grace_ms: u64,
}

impl Deadline {
    /// The question's limit times the person's factor, with the grace on top.
    pub fn new(limit_ms: u64, factor: TimeFactor, grace_ms: u64) -> Self {
        // Limits are at most an hour, so the product is far inside what an f64 holds exactly.
        let limit_ms = (limit_ms as f64 * factor.get()).round() as u64;
        Self { limit_ms, grace_ms }
    }

    /// The limit that the person is shown, extra time included.
    pub fn limit_ms(self) -> u64 {
        self.limit_ms
    }

    /// Judges an answer that arrived `elapsed_ms` after the question was shown.
    pub fn judge(self, elapsed_ms: u64) -> Arrival {
        if self.is_past_grace(elapsed_ms) {
            Arrival::Late
        } else {
            Arrival::InTime
        }
    }

    /// What the countdown shows, in milliseconds; zero from the limit on.
    pub fn remaining_ms(self, elapsed_ms: u64) -> u64 {
        self.limit_ms.saturating_sub(elapsed_ms)
    }

    /// Whether the countdown has ended, so that a page may report that it ran out.
    pub fn has_run_out(self, elapsed_ms: u64) -> bool {
        elapsed_ms >= self.limit_ms
    }

    /// Whether no answer can count any more, so that the server may close an abandoned question.
    pub fn is_past_grace(self, elapsed_ms: u64) -> bool {
        elapsed_ms > self.limit_ms.saturating_add(self.grace_ms)
    }

    /// The last moment at which an answer counts, for a question shown at `shown`.
    pub fn closes_at(self, shown: Timestamp) -> Timestamp {
        let open_for =
            i64::try_from(self.limit_ms.saturating_add(self.grace_ms)).unwrap_or(i64::MAX);
        Timestamp(shown.0.saturating_add(open_for))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eight_seconds(factor: f64) -> Deadline {
        Deadline::new(8_000, TimeFactor::new(factor).unwrap(), DEFAULT_GRACE_MS)
    }

    #[track_caller]
    fn check(elapsed_ms: u64, arrival: Arrival, remaining_ms: u64, has_run_out: bool) {
        let deadline = eight_seconds(1.0);
        assert_eq!(
            deadline.judge(elapsed_ms),
            arrival,
            "judged after {elapsed_ms} ms"
        );
        assert_eq!(
            deadline.remaining_ms(elapsed_ms),
            remaining_ms,
            "remaining after {elapsed_ms} ms"
        );
        assert_eq!(
            deadline.has_run_out(elapsed_ms),
            has_run_out,
            "ran out after {elapsed_ms} ms"
        );
    }

    #[test]
    fn an_answer_counts_up_to_limit_and_grace_inclusive() {
        check(0, Arrival::InTime, 8_000, false);
        check(7_900, Arrival::InTime, 100, false);
        check(7_999, Arrival::InTime, 1, false);
        check(8_000, Arrival::InTime, 0, true);
        check(9_500, Arrival::InTime, 0, true);
        check(9_501, Arrival::Late, 0, true);
        check(10_000, Arrival::Late, 0, true);
        check(u64::MAX, Arrival::Late, 0, true);
    }

    #[test]
    fn extra_time_stretches_the_limit_but_not_the_grace() {
        let deadline = eight_seconds(1.5);
        assert_eq!(deadline.limit_ms(), 12_000);
        assert_eq!(deadline.judge(13_500), Arrival::InTime);
        assert_eq!(deadline.judge(13_501), Arrival::Late);
        assert_eq!(
            Deadline::new(333, TimeFactor::new(1.5).unwrap(), 0).limit_ms(),
            500
        );
    }

    #[test]
    fn no_grace_is_allowed() {
        let deadline = Deadline::new(1, TimeFactor::ONE, 0);
        assert_eq!(deadline.judge(1), Arrival::InTime);
        assert_eq!(deadline.judge(2), Arrival::Late);
    }

    #[test]
    fn the_closing_time_agrees_with_the_judgement() {
        let (deadline, shown) = (eight_seconds(1.0), Timestamp(1_000_000));
        let closes = deadline.closes_at(shown);
        assert_eq!(closes, Timestamp(1_009_500));
        assert_eq!(deadline.judge(closes.millis_since(shown)), Arrival::InTime);
        assert_eq!(
            deadline.judge(Timestamp(closes.0 + 1).millis_since(shown)),
            Arrival::Late
        );
        assert_eq!(deadline.closes_at(Timestamp(i64::MAX)), Timestamp(i64::MAX));
    }

    #[test]
    fn a_clock_that_went_back_gives_no_elapsed_time() {
        assert_eq!(Timestamp(5).millis_since(Timestamp(9)), 0);
        assert_eq!(
            Timestamp(i64::MAX).millis_since(Timestamp(i64::MIN)),
            i64::MAX as u64
        );
    }

    #[test]
    fn factors_outside_one_to_ten_are_refused() {
        for factor in [0.0, 0.99, 10.01, f64::NAN, f64::INFINITY, -1.0] {
            assert!(TimeFactor::new(factor).is_err(), "{factor}");
        }
        assert_eq!(
            serde_json::from_str::<TimeFactor>("1.5").unwrap(),
            TimeFactor::new(1.5).unwrap()
        );
        assert!(serde_json::from_str::<TimeFactor>("0.5").is_err());
    }
}
