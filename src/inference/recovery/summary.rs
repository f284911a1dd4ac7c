//! What many simulated studies found.

use serde::Serialize;

use super::{RecoveredQuantity, Replicate, ScoreGap};
use crate::inference::diagnostics::{mean, variance};
use crate::inference::{Estimate, Quantity};

/// A Bayes factor above this speaks clearly for a model.
///
/// Source: Jeffreys (1961), appendix B: the lower end of strong evidence.
const CLEAR_BAYES_FACTOR: f64 = 10.0;

/// What studies of one size find. Every figure has its Monte-Carlo error, and is missing if no study gives it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Recovery {
    /// How many people take part.
    pub people: u64,
    /// How many studies were simulated.
    pub replicates: usize,
    /// In how many of them the model that people follow did not converge; its figures leave them out.
    pub unconverged: usize,
    /// In how many of them one of the two models did not converge; Bayes factors leave them out.
    pub not_compared: usize,
    /// In how many of them that, or a fit without one of the people did not converge; elpd leaves them out.
    pub not_scored: usize,
    /// How often the right model predicts people who were left out better, by more than two standard errors.
    pub elpd_beyond_two_se: Option<Estimate>,
    /// How often the wrong one predicts them better, by however little.
    pub elpd_favours_wrong: Option<Estimate>,
    /// How often the Bayes factor of right to wrong model exceeds 10.
    pub bayes_factor_above_10: Option<Estimate>,
    /// How often it is below 1.
    pub bayes_factor_favours_wrong: Option<Estimate>,
    /// Of each parameter of the model that people follow.
    pub quantities: Vec<QuantityRecovery>,
}

/// How well one quantity is recovered.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct QuantityRecovery {
    /// The quantity.
    pub quantity: Quantity,
    /// On which scale bias and width are differences.
    pub scale: Scale,
    /// Whether no choice depends on it, so that its posterior is its prior whatever the size.
    pub is_prior: bool,
    /// Posterior median less truth.
    pub bias: Estimate,
    /// How often the 90 % interval holds the truth.
    pub coverage: Estimate,
    /// Width of the 90 % interval.
    pub width: Estimate,
}

/// A scale for differences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// The quantity itself: for those between 0 and 1.
    Value,
    /// Its natural logarithm, on which 0.1 is about 10 %: for those without an upper bound, whose means a few huge
    /// values would make.
    Log,
}

impl Scale {
    fn of(quantity: Quantity) -> Self {
        match quantity {
            Quantity::Parameter(parameter) if parameter.is_share() => Self::Value,
            Quantity::Parameter(_) | Quantity::Tau | Quantity::LambdaTheta => Self::Log,
        }
    }

    fn difference(self, high: f64, low: f64) -> f64 {
        match self {
            Self::Value => high - low,
            Self::Log => (high / low).ln(),
        }
    }
}

impl Recovery {
    /// Sums up studies of one size.
    ///
    /// * `people`: how many took part in each.
    pub fn of(people: u64, replicates: &[Replicate]) -> Self {
        let converged: Vec<&Vec<RecoveredQuantity>> = replicates
            .iter()
            .filter_map(|replicate| replicate.quantities.as_ref())
            .collect();
        let ln_factors: Vec<f64> = replicates
            .iter()
            .filter_map(|replicate| replicate.ln_bayes_factor)
            .collect();
        let gaps: Vec<ScoreGap> = replicates
            .iter()
            .filter_map(|replicate| replicate.score_gap)
            .collect();
        let quantities = converged.first().map_or(0, |first| first.len());
        let of_quantity = |place: usize| {
            let column: Vec<RecoveredQuantity> =
                converged.iter().map(|replicate| replicate[place]).collect();
            QuantityRecovery::of(&column)
        };
        Self {
            people,
            replicates: replicates.len(),
            unconverged: replicates.len() - converged.len(),
            not_compared: replicates.len() - ln_factors.len(),
            not_scored: replicates.len() - gaps.len(),
            elpd_beyond_two_se: share(&gaps, |gap| gap.beyond_two_se && gap.value > 0.0),
            elpd_favours_wrong: share(&gaps, |gap| gap.value < 0.0),
            bayes_factor_above_10: share(&ln_factors, |ln| *ln > CLEAR_BAYES_FACTOR.ln()),
            bayes_factor_favours_wrong: share(&ln_factors, |ln| *ln < 0.0),
            quantities: (0..quantities).filter_map(of_quantity).collect(),
        }
    }
}

impl QuantityRecovery {
    /// Nothing if there is no study.
    fn of(column: &[RecoveredQuantity]) -> Option<Self> {
        let first = column.first()?;
        let scale = Scale::of(first.quantity);
        let average = |value: &dyn Fn(&RecoveredQuantity) -> f64| {
            average(&column.iter().map(value).collect::<Vec<f64>>())
        };
        Some(Self {
            quantity: first.quantity,
            scale,
            is_prior: first.is_prior,
            bias: average(&|found| scale.difference(found.median, found.truth)),
            coverage: share(column, |found| {
                let (low, high) = found.interval;
                low <= found.truth && found.truth <= high
            })?,
            width: average(&|found| scale.difference(found.interval.1, found.interval.0)),
        })
    }
}

/// A mean with its standard error sd/√n.
fn average(values: &[f64]) -> Estimate {
    Estimate {
        value: mean(values),
        se: (variance(values) / values.len() as f64).sqrt(),
    }
}

/// How often something is so, with its standard error; nothing of nothing.
///
/// ```text
/// se = sqrt(p̃ (1 − p̃)/n),   p̃ = (k + ½)/(n + 1)
/// ```
///
/// The error is that of a share drawn a little towards one half, so that it is not 0 where all cases are alike.
fn share<T>(all: &[T], is_so: impl Fn(&T) -> bool) -> Option<Estimate> {
    if all.is_empty() {
        return None;
    }
    let n = all.len() as f64;
    let count = all.iter().filter(|case| is_so(case)).count() as f64;
    let smoothed = (count + 0.5) / (n + 1.0);
    Some(Estimate {
        value: count / n,
        se: (smoothed * (1.0 - smoothed) / n).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Parameter;

    fn replicate(median: f64, interval: (f64, f64), ln_bayes_factor: f64, gap: f64) -> Replicate {
        let quantity = |quantity, factor: f64| RecoveredQuantity {
            quantity,
            truth: 0.5 * factor,
            median: median * factor,
            interval: (interval.0 * factor, interval.1 * factor),
            is_prior: false,
        };
        Replicate {
            quantities: Some(vec![
                quantity(Quantity::Parameter(Parameter::Gamma), 1.0),
                quantity(Quantity::Tau, 10.0),
            ]),
            ln_bayes_factor: Some(ln_bayes_factor),
            score_gap: Some(ScoreGap {
                value: gap,
                beyond_two_se: gap.abs() > 3.0,
            }),
        }
    }

    /// Four studies by hand, one without convergence.
    #[test]
    fn studies_are_summed_up() {
        let lost = Replicate {
            quantities: None,
            ln_bayes_factor: None,
            score_gap: None,
        };
        let replicates = [
            replicate(0.4, (0.3, 0.45), 3.0, 5.0),
            replicate(0.5, (0.4, 0.6), 2.0, 1.0),
            replicate(0.75, (0.4, 1.0), -3.0, -4.0),
            lost,
        ];
        let recovery = Recovery::of(7, &replicates);
        assert_eq!(
            (
                recovery.people,
                recovery.replicates,
                recovery.unconverged,
                recovery.not_scored
            ),
            (7, 4, 1, 1)
        );
        let third = 1.0 / 3.0;
        for (found, expected) in [
            (recovery.elpd_beyond_two_se, third),
            (recovery.elpd_favours_wrong, third),
            (recovery.bayes_factor_above_10, third),
            (recovery.bayes_factor_favours_wrong, third),
        ] {
            let found = found.unwrap();
            assert_eq!(found.value, expected);
            let smoothed: f64 = 1.5 / 4.0;
            assert!((found.se - (smoothed * (1.0 - smoothed) / 3.0).sqrt()).abs() < 1e-12);
        }
        let [gamma, tau] = recovery.quantities.as_slice() else {
            panic!("{recovery:?}");
        };
        assert_eq!((gamma.scale, tau.scale), (Scale::Value, Scale::Log));
        assert!((gamma.bias.value - 0.05).abs() < 1e-12);
        assert!((gamma.width.value - 0.95 / 3.0).abs() < 1e-12);
        assert_eq!(gamma.coverage.value, 2.0 / 3.0);
        assert_eq!(tau.coverage, gamma.coverage);
        let ln_bias = ((0.4_f64 / 0.5).ln() + (0.75_f64 / 0.5).ln()) / 3.0;
        assert!((tau.bias.value - ln_bias).abs() < 1e-12);
        // −0.1, 0 and 0.25 have the variance 0.0325.
        assert!((gamma.bias.se - (0.0325_f64 / 3.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_share_of_none_or_all_still_has_an_error() {
        let none = share(&[1, 2, 3], |case| *case > 5).unwrap();
        assert!(none.value == 0.0 && none.se > 0.1);
        assert_eq!(share(&[0; 0], |_| true), None);
    }
}
