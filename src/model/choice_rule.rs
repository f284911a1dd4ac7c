//! From prospects to decision weights, utilities and choice probabilities.

use serde::{Deserialize, Serialize};

use super::psychophysics::{WeightingFunction, value};
use super::{ChoiceProblem, Parameter, Parameters, Prospect};

/// Where an outcome of exactly nothing belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ZeroOutcome {
    /// Nothing is a gain, as in the paper's value function.
    #[default]
    Gain,
    /// Nothing joins the losses of a prospect without gains, whose weights then sum to 1.
    SameSign,
}

/// The choices within the Risk-Aware model that are not parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RiskAwareOptions {
    /// Whether decision weights are divided by their sum (the paper; not Tversky & Kahneman 1992).
    pub normalise: bool,
    /// Where an outcome of nothing belongs.
    pub zero: ZeroOutcome,
    /// How probabilities are felt.
    pub weighting_function: WeightingFunction,
}

impl Default for RiskAwareOptions {
    fn default() -> Self {
        Self {
            normalise: true,
            zero: ZeroOutcome::Gain,
            weighting_function: WeightingFunction::TverskyKahneman,
        }
    }
}

/// The decision weights of a prospect's outcomes, in their order.
///
/// ```text
/// gain i:  πᵢ = w⁺(p₁ + … + pᵢ) − w⁺(p₁ + … + pᵢ₋₁)
/// loss i:  πᵢ = w⁻(pᵢ + … + p_K) − w⁻(pᵢ₊₁ + … + p_K)
/// π̄ᵢ = πᵢ / Σ π        (left out when `options.normalise` is false)
/// ```
///
/// * outcomes are sorted by decreasing reward; rewards ≥ 0 are gains, zero as `options.zero` says.
/// * `parameters`: γ and η⁺ distort the probabilities of gains, δ and η⁻ those of losses; at 1 they leave them as they are.
///
/// Source: Tversky & Kahneman (1992), equations 1 and 2; the normalisation is the paper's.
///
/// # Errors
/// When the weights are so small that their sum underflows to 0 (γ or δ near 0).
pub fn decision_weights(
    prospect: &Prospect,
    parameters: &Parameters,
    options: RiskAwareOptions,
) -> Result<Vec<f64>, WeightsVanish> {
    weights_of_spans(&weight_spans(prospect, options.zero), parameters, options)
}

/// [`decision_weights`] from spans, which many parameters share.
pub(crate) fn weights_of_spans(
    spans: &[WeightSpan],
    parameters: &Parameters,
    options: RiskAwareOptions,
) -> Result<Vec<f64>, WeightsVanish> {
    use Parameter::{Delta, EtaGain, EtaLoss, Gamma};
    let of_gains = [Gamma, EtaGain].map(|name| parameters.get(name));
    let of_losses = [Delta, EtaLoss].map(|name| parameters.get(name));
    let mut weights: Vec<f64> = spans
        .iter()
        .map(|span| {
            let distortion = if span.is_gain { of_gains } else { of_losses };
            let weight = |at: Cumulative| at.weight(options.weighting_function, distortion);
            weight(span.outer) - weight(span.inner)
        })
        .collect();
    if options.normalise {
        let sum: f64 = weights.iter().sum();
        if sum < f64::MIN_POSITIVE {
            return Err(WeightsVanish);
        }
        for weight in &mut weights {
            *weight /= sum;
        }
    }
    Ok(weights)
}

/// Decision weights that sum to nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("decision weights vanish, gamma or delta is too small")]
pub struct WeightsVanish;

/// The utility of each action, in its order.
///
/// ```text
/// U(a) = Σ π̄ᵢ v(Rᵢ)
/// ```
///
/// With every parameter at 1 this is the expected reward Σ p R, the Noisy Rational model's utility.
///
/// # Errors
/// When decision weights vanish or a utility overflows; the error names the action.
pub fn utilities(
    problem: &ChoiceProblem,
    parameters: &Parameters,
    options: RiskAwareOptions,
) -> Result<Vec<f64>, ChoiceError> {
    use Parameter::{Alpha, Beta, Delta, EtaGain, EtaLoss, Gamma, Lambda};
    let [alpha, beta, lambda] = [Alpha, Beta, Lambda].map(|name| parameters.get(name));
    let is_undistorted = [Gamma, Delta, EtaGain, EtaLoss]
        .into_iter()
        .all(|name| parameters.get(name) == 1.0);
    let utility = |prospect: &Prospect| -> Result<f64, WeightsVanish> {
        if is_undistorted {
            // Differences of sums would only add rounding.
            let plain = |o: &super::Outcome| o.probability * value(o.reward, alpha, beta, lambda);
            return Ok(prospect.outcomes().iter().map(plain).sum());
        }
        let weights = decision_weights(prospect, parameters, options)?;
        let weighed = weights.iter().zip(prospect.outcomes());
        Ok(weighed
            .map(|(weight, o)| weight * value(o.reward, alpha, beta, lambda))
            .sum())
    };
    let mut found = Vec::with_capacity(problem.actions().len());
    for action in problem.actions() {
        let utility =
            utility(&action.prospect).map_err(|WeightsVanish| ChoiceError::WeightsVanish {
                action: action.name.clone(),
            })?;
        if !utility.is_finite() {
            return Err(ChoiceError::UtilityOverflows {
                action: action.name.clone(),
            });
        }
        found.push(utility);
    }
    Ok(found)
}

/// ln P(a) for each action of a problem, in its order.
///
/// ```text
/// P(a) = softmax(θ U)(a)
/// ```
///
/// No finite θ and U overflow; an action that is hopeless beyond the range of numbers gets −∞.
///
/// # Errors
/// As [`utilities`].
pub fn ln_probabilities(
    problem: &ChoiceProblem,
    parameters: &Parameters,
    options: RiskAwareOptions,
) -> Result<Vec<f64>, ChoiceError> {
    let mut values = utilities(problem, parameters, options)?;
    ln_softmax_into(parameters.get(Parameter::Theta), &mut values);
    Ok(values)
}

/// P(a) for each action of a problem, in its order. They sum to 1 within rounding.
///
/// # Errors
/// As [`utilities`].
pub fn probabilities(
    problem: &ChoiceProblem,
    parameters: &Parameters,
    options: RiskAwareOptions,
) -> Result<Vec<f64>, ChoiceError> {
    let mut values = ln_probabilities(problem, parameters, options)?;
    for value in &mut values {
        *value = value.exp();
    }
    Ok(values)
}

/// Replaces utilities U by ln softmax(θ U).
///
/// * `theta`: θ ≥ 0 in 1/utility.
/// * `values`: finite utilities, at least one.
pub fn ln_softmax_into(theta: f64, values: &mut [f64]) {
    let (best, highest) =
        values
            .iter()
            .copied()
            .enumerate()
            .fold((0, f64::NEG_INFINITY), |best, (i, value)| {
                if value > best.1 { (i, value) } else { best }
            });
    // Differences first: θU itself may overflow, θ(U − max U) at worst reaches −∞ (and 0 where θ is 0).
    let mut others = 0.0;
    for (index, value) in values.iter_mut().enumerate() {
        *value = if theta == 0.0 {
            0.0
        } else {
            theta * (*value - highest)
        };
        if index != best {
            others += value.exp();
        }
    }
    let ln_sum = others.ln_1p();
    for value in values {
        *value -= ln_sum;
    }
}

/// Why a model gives no probabilities for a problem.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ChoiceError {
    /// The decision weights of an action sum to nothing.
    #[error("the decision weights of action `{action}` vanish, gamma or delta is too small")]
    WeightsVanish {
        /// The action's name.
        action: String,
    },
    /// The utility of an action is beyond the range of numbers.
    #[error("the utility of action `{action}` is not finite, its rewards are too large")]
    UtilityOverflows {
        /// The action's name.
        action: String,
    },
}

/// A cumulative probability with its complement: near 1 the complement carries the digits that matter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cumulative {
    pub(crate) probability: f64,
    pub(crate) complement: f64,
}

impl Cumulative {
    /// Its logarithm, from whichever of the two carries more digits.
    pub(crate) fn ln(self) -> f64 {
        if self.complement < 0.5 {
            (-self.complement).ln_1p()
        } else {
            self.probability.ln()
        }
    }

    /// Its weight under an exponent and an elevation.
    fn weight(self, function: WeightingFunction, [exponent, elevation]: [f64; 2]) -> f64 {
        if self.probability <= 0.0 {
            0.0
        } else if self.complement <= 0.0 {
            1.0
        } else if (exponent, elevation) == (1.0, 1.0) {
            self.probability
        } else {
            function
                .ln_weight(self.ln(), self.complement.ln(), exponent, elevation)
                .exp()
        }
    }
}

/// The decision weight of one outcome as a difference: w(outer) − w(inner).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WeightSpan {
    /// Whether w⁺ applies, rather than w⁻.
    pub(crate) is_gain: bool,
    /// This outcome and all better gains, or all worse losses.
    pub(crate) outer: Cumulative,
    /// The same without this outcome.
    pub(crate) inner: Cumulative,
}

/// What each outcome's decision weight is made of, in the prospect's order.
pub(crate) fn weight_spans(prospect: &Prospect, zero: ZeroOutcome) -> Vec<WeightSpan> {
    let outcomes = prospect.outcomes();
    let has_gain = outcomes.iter().any(|outcome| outcome.reward > 0.0);
    let zero_is_gain = match zero {
        ZeroOutcome::Gain => true,
        ZeroOutcome::SameSign => has_gain,
    };
    // above[i] is the sum of the first i probabilities, below[i] of the others: so the whole is exactly 1.
    let mut above = vec![0.0];
    for outcome in outcomes {
        above.push(above[above.len() - 1] + outcome.probability);
    }
    let mut below = vec![0.0; outcomes.len() + 1];
    for (index, outcome) in outcomes.iter().enumerate().rev() {
        below[index] = below[index + 1] + outcome.probability;
    }
    let from_above = |count: usize| cumulative(above[count], below[count]);
    let from_below = |start: usize| cumulative(below[start], above[start]);
    outcomes
        .iter()
        .enumerate()
        .map(|(index, outcome)| {
            if outcome.reward > 0.0 || (outcome.reward == 0.0 && zero_is_gain) {
                WeightSpan {
                    is_gain: true,
                    outer: from_above(index + 1),
                    inner: from_above(index),
                }
            } else {
                WeightSpan {
                    is_gain: false,
                    outer: from_below(index),
                    inner: from_below(index + 1),
                }
            }
        })
        .collect()
}

fn cumulative(probability: f64, complement: f64) -> Cumulative {
    Cumulative {
        probability: probability.clamp(0.0, 1.0),
        complement: complement.clamp(0.0, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Outcome, RISK_AWARE, weighting};

    fn prospect(outcomes: &[(f64, f64)]) -> Prospect {
        Prospect::new(outcomes.iter().copied().map(Outcome::from)).unwrap()
    }

    #[track_caller]
    fn check(found: &[f64], expected: &[f64], tolerance: f64) {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (found - expected).abs() < tolerance,
                "{found} is not {expected}"
            );
        }
    }

    fn unnormalised() -> RiskAwareOptions {
        RiskAwareOptions {
            normalise: false,
            ..RiskAwareOptions::default()
        }
    }

    fn chooser(
        alpha: f64,
        beta: f64,
        gamma: f64,
        delta: f64,
        lambda: f64,
        theta: f64,
    ) -> Parameters {
        let values = [alpha, beta, gamma, delta, lambda, theta];
        let entries = RISK_AWARE
            .parameters
            .iter()
            .zip(values)
            .map(|(name, value)| (name.key(), value));
        RISK_AWARE.parameters_from(entries).unwrap()
    }

    fn distorted(gamma: f64, delta: f64) -> Parameters {
        chooser(1.0, 1.0, gamma, delta, 1.0, 1.0)
    }

    /// The parameters that Tversky & Kahneman (1992) found, their medians over 25 students.
    fn tversky_kahneman(theta: f64) -> Parameters {
        chooser(0.88, 0.88, 0.61, 0.69, 2.25, theta)
    }

    /// The driving study's high-speed action with a fine of 500 at 5 %.
    #[test]
    fn weights_of_a_rare_loss() {
        let weights = decision_weights(
            &prospect(&[(0.05, -500.0), (0.95, 0.0)]),
            &distorted(0.61, 0.69),
            RiskAwareOptions::default(),
        )
        .unwrap();
        check(&weights, &[0.8768180, 0.1231820], 5e-8);
    }

    #[test]
    fn the_cup_problem() {
        let problem = ChoiceProblem::from_outcomes([
            ("stable", vec![(1.0, 20.0)]),
            ("unstable", vec![(0.2, 105.0), (0.8, 0.0)]),
        ])
        .unwrap();
        let options = RiskAwareOptions::default();
        let found = probabilities(&problem, &tversky_kahneman(0.2), options).unwrap();
        check(&found, &[0.4156651, 0.5843349], 5e-8);
    }

    /// Wakker, *Prospect Theory* (2010), Exercise 5.4.3: w(p) = √p, v(R) = R. Rank dependence with another w:
    /// the differences of cumulative weights are what is shown here.
    #[test]
    fn rank_dependent_weights_of_wakker() {
        let spans = weight_spans(
            &prospect(&[(1.0 / 6.0, 80.0), (0.5, 30.0), (1.0 / 3.0, 20.0)]),
            ZeroOutcome::Gain,
        );
        let weights: Vec<f64> = spans
            .iter()
            .map(|span| span.outer.probability.sqrt() - span.inner.probability.sqrt())
            .collect();
        check(&weights, &[0.40825, 0.40825, 0.18350], 5e-6);
        let total: f64 = weights
            .iter()
            .zip([80.0, 30.0, 20.0])
            .map(|(weight, reward)| weight * reward)
            .sum();
        assert!((total - 48.577).abs() < 5e-4, "{total}");
    }

    /// Tversky & Kahneman (1992, pp. 301 f.): a die is rolled; even pays its points, odd costs them. The capacities
    /// of the worked example are those of the cumulative sets {6}, {4, 6}, {2, 4, 6} and {5}, {3, 5}, {1, 3, 5}.
    #[test]
    fn cumulative_sets_of_the_die_of_tversky_and_kahneman() {
        let sixth = 1.0 / 6.0;
        let die = prospect(&[
            (sixth, -5.0),
            (sixth, -3.0),
            (sixth, -1.0),
            (sixth, 2.0),
            (sixth, 4.0),
            (sixth, 6.0),
        ]);
        let weights = decision_weights(&die, &distorted(0.61, 0.69), unnormalised()).unwrap();
        let gain = |count: f64| weighting(count / 6.0, 0.61);
        let loss = |count: f64| weighting(count / 6.0, 0.69);
        let expected = [
            gain(1.0),
            gain(2.0) - gain(1.0),
            gain(3.0) - gain(2.0),
            loss(3.0) - loss(2.0),
            loss(2.0) - loss(1.0),
            loss(1.0),
        ];
        check(&weights, &expected, 1e-12);
    }

    /// Kahneman & Tversky's (1979) problem 3: with the 1992 medians, 3000 for sure is worth more than 4000 at 80 %
    /// although it has the lower expectation. U = 3000^.88 and w⁺(.8)·4000^.88, w⁺(.8) = 0.6074; by hand.
    #[test]
    fn the_certainty_effect() {
        let problem = ChoiceProblem::from_outcomes([
            ("risky", vec![(0.8, 4000.0), (0.2, 0.0)]),
            ("sure", vec![(1.0, 3000.0)]),
        ])
        .unwrap();
        let found = utilities(&problem, &tversky_kahneman(1.0), unnormalised()).unwrap();
        check(&found, &[897.969, 1147.800], 0.5);
        let expected = utilities(&problem, &Parameters::ONES, unnormalised()).unwrap();
        check(&expected, &[3200.0, 3000.0], 1e-9);
    }

    #[test]
    fn zero_may_join_the_losses() {
        let same_sign = RiskAwareOptions {
            zero: ZeroOutcome::SameSign,
            ..RiskAwareOptions::default()
        };
        let losses = prospect(&[(0.05, -500.0), (0.95, 0.0)]);
        let weights = decision_weights(&losses, &distorted(0.3, 0.69), same_sign).unwrap();
        check(
            &weights,
            &[1.0 - weighting(0.05, 0.69), weighting(0.05, 0.69)],
            1e-12,
        );
        // With a gain in the prospect zero stays a gain, whatever the option.
        let mixed = prospect(&[(0.2, 10.0), (0.3, 0.0), (0.5, -10.0)]);
        assert_eq!(
            decision_weights(&mixed, &distorted(0.5, 0.7), same_sign),
            decision_weights(&mixed, &distorted(0.5, 0.7), RiskAwareOptions::default())
        );
    }

    #[test]
    fn vanishing_weights_are_an_error() {
        let problem = ChoiceProblem::from_outcomes([
            ("sure", vec![(1.0, 1.0)]),
            ("mixed", vec![(0.5, 3.0), (0.5, -3.0)]),
        ])
        .unwrap();
        let tiny = chooser(1.0, 1.0, 1e-4, 1e-4, 1.0, 1.0);
        let error = probabilities(&problem, &tiny, RiskAwareOptions::default()).unwrap_err();
        assert_eq!(
            error,
            ChoiceError::WeightsVanish {
                action: "mixed".to_owned()
            }
        );
        let found = probabilities(&problem, &tiny, unnormalised()).unwrap();
        check(
            &found,
            &[1.0 / (1.0 + (-1.0_f64).exp()), 1.0 / (1.0 + 1.0_f64.exp())],
            1e-12,
        );
    }

    #[test]
    fn overflowing_utilities_are_an_error() {
        let problem = ChoiceProblem::from_outcomes([
            ("low", vec![(1.0, -1e308)]),
            ("none", vec![(1.0, 0.0)]),
        ])
        .unwrap();
        let error = utilities(
            &problem,
            &chooser(1.0, 1.0, 1.0, 1.0, 100.0, 1.0),
            unnormalised(),
        );
        assert_eq!(
            error,
            Err(ChoiceError::UtilityOverflows {
                action: "low".to_owned()
            })
        );
    }

    #[test]
    fn extremes_stay_finite() {
        let mut values = [1e308, -1e308];
        ln_softmax_into(1e308, &mut values);
        assert_eq!(values, [0.0, f64::NEG_INFINITY]);
        let mut values = [1e308, -1e308];
        ln_softmax_into(0.0, &mut values);
        assert_eq!(values, [-std::f64::consts::LN_2; 2]);
        let mut values = [800.0, 0.0];
        ln_softmax_into(1.0, &mut values);
        assert_eq!(values, [0.0, -800.0]);
    }

    #[test]
    fn options_are_read_with_defaults() {
        let read: RiskAwareOptions = serde_json::from_str(r#"{"zero":"same_sign"}"#).unwrap();
        assert_eq!(
            read,
            RiskAwareOptions {
                normalise: true,
                zero: ZeroOutcome::SameSign,
                weighting_function: WeightingFunction::TverskyKahneman,
            }
        );
        assert!(serde_json::from_str::<RiskAwareOptions>(r#"{"normalize":true}"#).is_err());
    }
}
