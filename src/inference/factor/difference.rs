//! The difference of a parameter between two independent posteriors.

use serde::Serialize;

use crate::inference::diagnostics::{mean, quantile, variance};

/// The posterior of d = x − y, where x and y are one parameter learned from different people.
///
/// The two posteriors are independent, so every draw of one may stand beside every draw of the other:
///
/// ```text
/// P(d > 0) = P(x > y) ≈ (#{(i, j): xᵢ > yⱼ} + ½ #{(i, j): xᵢ = yⱼ}) / (I J)
/// ```
///
/// which is Mann and Whitney's U over the number of pairs. Quantiles, mean and sd are those of xᵢ − yᵢ.
///
/// Source: Mann & Whitney (1947), *Annals of Mathematical Statistics* 18, for the count; that posteriors of disjoint data
/// with independent priors are independent follows from Bayes' rule.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = LevelDifference)]
pub struct Difference {
    /// Posterior mean; heavy tails of θ and τ make it jump: judge those by quantiles.
    pub mean: f64,
    /// Posterior standard deviation.
    pub sd: f64,
    /// 5 % quantile.
    pub q5: f64,
    /// Median.
    pub q50: f64,
    /// 95 % quantile.
    pub q95: f64,
    /// Posterior probability that the parameter is larger in the first, in [0, 1].
    pub probability_larger: f64,
    /// Whether the choices of both said something about the parameter; else the difference is largely one of priors.
    pub informed: bool,
}

impl Difference {
    /// The difference of draws from two independent posteriors; nothing without draws.
    ///
    /// * `first`, `second`: draws of x and y, in any unit. Beyond the shorter of the two, draws count for the probability
    ///   only.
    pub fn of(first: &[f64], second: &[f64], informed: bool) -> Option<Self> {
        let mut differences: Vec<f64> = first.iter().zip(second).map(|(x, y)| x - y).collect();
        if differences.is_empty() {
            return None;
        }
        differences.sort_by(f64::total_cmp);
        Some(Self {
            mean: mean(&differences),
            sd: variance(&differences).sqrt(),
            q5: quantile(&differences, 0.05),
            q50: quantile(&differences, 0.5),
            q95: quantile(&differences, 0.95),
            probability_larger: probability_larger(first, second),
            informed,
        })
    }
}

/// The share of pairs in which the first is larger, ties as half.
fn probability_larger(first: &[f64], second: &[f64]) -> f64 {
    let mut sorted = second.to_vec();
    sorted.sort_by(f64::total_cmp);
    let wins: f64 = first
        .iter()
        .map(|x| {
            let below = sorted.partition_point(|y| y < x);
            let up_to = sorted.partition_point(|y| y <= x);
            (below + up_to) as f64 / 2.0
        })
        .sum();
    wins / (first.len() as f64 * second.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_counts_and_ties_count_half() {
        // Of nine pairs five are larger, two are ties.
        let found = probability_larger(&[1.0, 2.0, 3.0], &[0.0, 2.0, 3.0]);
        assert!((found - 5.0 / 9.0).abs() < 1e-12, "{found}");
        assert_eq!(probability_larger(&[2.0, 2.0], &[2.0]), 0.5);
        assert_eq!(probability_larger(&[5.0], &[1.0, 2.0]), 1.0);
    }

    #[test]
    fn a_difference_turns_its_sign_with_the_order() {
        let first = [0.4, 0.9, 1.3, 2.2];
        let second = [0.1, 1.1, 0.7, 0.3];
        let found = Difference::of(&first, &second, true).unwrap();
        let turned = Difference::of(&second, &first, true).unwrap();
        assert!((found.mean - 0.65).abs() < 1e-12 && (found.mean + turned.mean).abs() < 1e-12);
        assert!((found.q5 + turned.q95).abs() < 1e-12 && (found.q50 + turned.q50).abs() < 1e-12);
        assert!((found.probability_larger + turned.probability_larger - 1.0).abs() < 1e-12);
        assert!((found.sd - turned.sd).abs() < 1e-12);
        assert_eq!(Difference::of(&[], &[1.0], true), None);
    }
}
