//! Sums of scores over independent units, and differences between two models' sums.

use serde::{Deserialize, Serialize};

use crate::inference::summary::null_as_nan;

/// A difference in expected log score between two models, first minus second, over the same units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ScoreDifference {
    /// Σ Δᵢ in nats: above 0 the first model predicts better.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub value: f64,
    /// √(N·Var Δᵢ); missing for fewer than two units.
    pub se: Option<f64>,
    /// N, how many units (people, answers or distinct problems) the sum goes over.
    pub units: u64,
    /// Whether |Σ Δᵢ| exceeds two standard errors.
    pub beyond_two_se: bool,
}

/// Scores of units that stand for several equal ones: `(weight, score)`.
pub(super) type Weighted = (u64, f64);

/// Σ and its standard error √(N·Var), the latter missing for fewer than two units.
///
/// ```text
/// Σ wᵢ xᵢ,   sqrt(N · Σ wᵢ (xᵢ − x̄)²/(N − 1)),   N = Σ wᵢ
/// ```
pub(super) fn sum_and_se(scores: &[Weighted]) -> (f64, Option<f64>) {
    let n: u64 = scores.iter().map(|(weight, _)| weight).sum();
    let sum: f64 = scores.iter().map(|(weight, x)| *weight as f64 * x).sum();
    if n < 2 {
        return (sum, None);
    }
    let n = n as f64;
    let mean = sum / n;
    let squares: f64 = scores
        .iter()
        .map(|(weight, x)| *weight as f64 * (x - mean).powi(2))
        .sum();
    (sum, Some((n * squares / (n - 1.0)).sqrt()))
}

impl ScoreDifference {
    /// The difference of two models' scores of the same units, in the same order.
    pub(super) fn of(first: &[Weighted], second: &[Weighted]) -> Self {
        let differences: Vec<Weighted> = first
            .iter()
            .zip(second)
            .map(|((weight, left), (_, right))| (*weight, left - right))
            .collect();
        let (value, se) = sum_and_se(&differences);
        Self {
            value,
            se,
            units: differences.iter().map(|(weight, _)| weight).sum(),
            beyond_two_se: se.is_some_and(|se| value.abs() > 2.0 * se),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1, 1, 4: sum 6, variance 3, so √(3·3).
    #[test]
    fn weights_stand_for_equal_units() {
        assert_eq!(sum_and_se(&[(2, 1.0), (1, 4.0)]), (6.0, Some(3.0)));
        assert_eq!(
            sum_and_se(&[(1, 1.0), (1, 4.0), (1, 1.0)]),
            (6.0, Some(3.0))
        );
        assert_eq!(sum_and_se(&[(1, 2.0)]), (2.0, None));
    }

    #[test]
    fn differences_are_paired() {
        let found = ScoreDifference::of(&[(1, -1.0), (2, -2.0)], &[(1, -2.0), (2, -3.0)]);
        assert_eq!((found.value, found.se, found.units), (3.0, Some(0.0), 3));
        assert!(found.beyond_two_se);
    }
}
