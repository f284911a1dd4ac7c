//! How rewards and probabilities are felt: the value function and the probability weighting functions.

use serde::{Deserialize, Serialize};

/// The value of a reward.
///
/// ```text
/// v(R) = R^α          for R ≥ 0
/// v(R) = −λ (−R)^β    for R < 0
/// ```
///
/// * `reward`: R, in the study's unit, finite. v(0) = 0 whatever α is.
/// * `alpha`, `beta`: curvature for gains and losses, in (0, 1].
/// * `lambda`: loss aversion, ≥ 0; a loss weighs λ times a gain of the same size when α = β.
///
/// Source: Tversky & Kahneman (1992), equation 5; the paper, section on the Risk-Aware model.
pub fn value(reward: f64, alpha: f64, beta: f64, lambda: f64) -> f64 {
    if reward > 0.0 {
        reward.powf(alpha)
    } else if reward < 0.0 {
        -lambda * (-reward).powf(beta)
    } else {
        0.0
    }
}

/// The weight of a cumulative probability.
///
/// ```text
/// w(p) = p^γ / (p^γ + (1−p)^γ)^(1/γ)
/// ```
///
/// * `p`: probability; values outside [0, 1] are clamped. w(0) = 0 and w(1) = 1 exactly.
/// * `gamma`: distortion in (0, 1]; 1 leaves probabilities as they are. Below about 0.2792 the function is not
///   monotone (Rieger & Wang 2006; Ingersoll 2008).
///
/// Source: Tversky & Kahneman (1992), equation 6.
pub fn weighting(p: f64, gamma: f64) -> f64 {
    WeightingFunction::TverskyKahneman.weight(p, gamma, 1.0)
}

/// A family of probability weighting functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum WeightingFunction {
    /// `w(p) = p^γ / (p^γ + (1−p)^γ)^(1/γ)`, without elevation. Source: Tversky & Kahneman (1992), equation 6.
    #[default]
    TverskyKahneman,
    /// `w(p) = exp(−η (−ln p)^γ)`, monotone for every γ. Source: Prelec (1998), equations 3.1 (η = 1) and 3.2.
    Prelec,
}

impl WeightingFunction {
    /// The weight of a cumulative probability.
    ///
    /// * `p`: probability; values outside [0, 1] are clamped. w(0) = 0 and w(1) = 1 exactly.
    /// * `exponent`: γ or δ, in (0, 1]; `elevation`: η above 0, without effect on Tversky and Kahneman's function. Where
    ///   both are 1 probabilities are left as they are.
    pub fn weight(self, p: f64, exponent: f64, elevation: f64) -> f64 {
        if p <= 0.0 {
            0.0
        } else if p >= 1.0 {
            1.0
        } else if (exponent, elevation) == (1.0, 1.0) {
            p
        } else {
            self.ln_weight(p.ln(), (-p).ln_1p(), exponent, elevation)
                .exp()
        }
    }

    /// ln w(p) from ln p and ln(1 − p), both finite and below 0.
    pub(crate) fn ln_weight(
        self,
        ln_p: f64,
        ln_complement: f64,
        exponent: f64,
        elevation: f64,
    ) -> f64 {
        match self {
            Self::TverskyKahneman => {
                let (mine, other) = (exponent * ln_p, exponent * ln_complement);
                let ln_sum = mine.max(other) + (-(mine - other).abs()).exp().ln_1p();
                mine - ln_sum / exponent
            }
            Self::Prelec => -elevation * (-ln_p).powf(exponent),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[track_caller]
    fn check_weight(p: f64, gamma: f64, expected: f64) {
        let found = weighting(p, gamma);
        assert!(
            (found - expected).abs() < 5e-8,
            "w({p}) = {found}, expected {expected}"
        );
    }

    /// Computed with the equation of Tversky & Kahneman (1992) and their γ for gains.
    #[test]
    fn weights_at_the_median_gamma_of_tversky_and_kahneman() {
        check_weight(0.05, 0.61, 0.1316257);
        check_weight(0.10, 0.61, 0.1863026);
        check_weight(0.50, 0.61, 0.4206394);
        check_weight(0.90, 0.61, 0.7117161);
        check_weight(0.95, 0.61, 0.7931958);
    }

    /// Prelec (1998): w(1/e) = exp(−η) whatever the exponent is.
    #[test]
    fn the_fixed_point_of_prelec_does_not_move_with_the_exponent() {
        let fixed = (-1.0_f64).exp();
        for (exponent, elevation) in [(0.3, 1.0), (0.65, 1.0), (0.65, 1.4), (1.0, 0.7)] {
            let found = WeightingFunction::Prelec.weight(fixed, exponent, elevation);
            assert!((found - (-elevation).exp()).abs() < 1e-15, "{found}");
        }
        assert_eq!(WeightingFunction::Prelec.weight(0.3, 1.0, 1.0), 0.3);
    }

    /// At p = ½ the equation reduces to w = ½^γ / (2·½^γ)^(1/γ) = 2^(1 − γ − 1/γ).
    #[test]
    fn the_weight_of_one_half_has_a_closed_form() {
        for gamma in [0.05_f64, 0.28, 0.5, 0.69, 1.0] {
            check_weight(0.5, gamma, 2.0_f64.powf(1.0 - gamma - 1.0 / gamma));
        }
    }

    #[test]
    fn ends_are_exact_and_values_outside_are_clamped() {
        for gamma in [1e-3, 0.28, 0.61, 1.0] {
            assert_eq!(weighting(0.0, gamma), 0.0);
            assert_eq!(weighting(1.0, gamma), 1.0);
            assert_eq!(weighting(-1e-12, gamma), 0.0);
            assert_eq!(weighting(1.0 + 1e-12, gamma), 1.0);
        }
    }

    #[test]
    fn below_its_floor_the_function_is_not_monotone() {
        let falls = |gamma: f64| {
            (1..2000).any(|step| {
                let p = f64::from(step) / 2000.0;
                weighting(p + 1.0 / 2000.0, gamma) < weighting(p, gamma)
            })
        };
        assert!(falls(0.27));
        assert!(!falls(0.28));
    }

    #[test]
    fn value_of_nothing_is_nothing() {
        assert_eq!(value(0.0, 1e-9, 0.5, 2.0), 0.0);
        assert_eq!(value(-0.0, 1.0, 1.0, 2.0), 0.0);
    }

    /// 100^0.88 = 57.54399; the loss counts 2.25 times.
    #[test]
    fn values_by_hand() {
        assert!((value(100.0, 0.88, 0.5, 9.0) - 57.543_993_733_715_7).abs() < 1e-10);
        assert!((value(-100.0, 0.5, 0.88, 2.25) + 129.473_985_900_860_3).abs() < 1e-9);
        assert_eq!(value(-9.0, 1.0, 0.5, 2.0), -6.0);
    }

    proptest! {
        #[test]
        fn weights_stay_between_zero_and_one(p in 0.0..=1.0, gamma in 1e-4..=1.0) {
            let weight = weighting(p, gamma);
            prop_assert!((0.0..=1.0).contains(&weight), "{weight}");
        }

        #[test]
        fn weights_rise_with_probability(p in 0.0..1.0, step in 0.0..1.0, gamma in 0.28..=1.0) {
            let higher = p + step * (1.0 - p);
            prop_assert!(weighting(higher, gamma) >= weighting(p, gamma) - 1e-14);
        }

        #[test]
        fn value_rises_with_reward(low in -1e6..1e6, step in 0.0..1e6, alpha in 0.01..=1.0, beta in 0.01..=1.0, lambda in 0.0..10.0) {
            prop_assert!(value(low + step, alpha, beta, lambda) >= value(low, alpha, beta, lambda));
        }
    }
}
