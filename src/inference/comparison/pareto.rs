//! Pareto-smoothed importance sampling.
//!
//! Sources: Vehtari, Simpson, Gelman, Yao & Gabry (2024), *Pareto smoothed importance sampling*, Journal of Machine
//! Learning Research 25(72); Zhang & Stephens (2009), *A new and efficient estimation method for the generalized Pareto
//! distribution*, Technometrics 51. Numbers agree with ArviZ 0.23 (`psislw`).

/// Importance weights whose largest values were replaced by what a generalised Pareto distribution expects there.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothedWeights {
    /// ln w, normalised: the w sum to 1. In the order of the draws.
    pub ln_weights: Vec<f64>,
    /// k̂, the shape of the tail; +∞ if there are too few distinct weights to fit one, −∞ if all weights are equal.
    pub shape: f64,
}

/// The largest k̂ under which an estimate from `draws` weighted draws is trusted.
///
/// ```text
/// min(1 − 1/log₁₀ S, 0.7)
/// ```
///
/// * `draws`: S ≥ 2.
///
/// Source: Vehtari et al. (2024), equation 13.
pub fn shape_threshold(draws: usize) -> f64 {
    (1.0 - 1.0 / (draws as f64).log10()).min(0.7)
}

/// Smooths importance weights given as logarithms, normalised or not.
///
/// * `ln_ratios`: ln of target over proposal density at each draw, finite or −∞, at least one finite.
/// * `relative_efficiency`: effective draws per draw, above 0; 1 for independent draws.
///
/// The largest M = min(S/5, 3 sqrt(S/r)) weights become the expected order statistics of the fitted distribution, and
/// none exceeds the largest raw weight.
pub fn smooth(ln_ratios: &[f64], relative_efficiency: f64) -> SmoothedWeights {
    /// Tails of fewer draws are not fitted.
    const LEAST_TAIL: usize = 5;
    let draws = ln_ratios.len() as f64;
    let highest = ln_ratios.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut ln_weights: Vec<f64> = ln_ratios.iter().map(|ratio| ratio - highest).collect();
    if ln_weights.iter().all(|ln_weight| *ln_weight == 0.0) {
        return SmoothedWeights {
            ln_weights: vec![-draws.ln(); ln_ratios.len()],
            shape: f64::NEG_INFINITY,
        };
    }
    let mut sorted = ln_weights.clone();
    sorted.sort_by(f64::total_cmp);
    let length = (draws / 5.0)
        .min(3.0 * (draws / relative_efficiency).sqrt())
        .ceil() as usize;
    let place = sorted.len().saturating_sub(length + 1);
    let cutoff = sorted[place].max(f64::MIN_POSITIVE.ln());
    let mut tail: Vec<usize> = (0..ln_weights.len())
        .filter(|index| ln_weights[*index] > cutoff)
        .collect();
    tail.sort_by(|left, right| ln_weights[*left].total_cmp(&ln_weights[*right]));
    let mut shape = f64::INFINITY;
    if tail.len() >= LEAST_TAIL {
        let base = cutoff.exp();
        let excesses: Vec<f64> = tail
            .iter()
            .map(|index| ln_weights[*index].exp() - base)
            .collect();
        let fitted = GeneralisedPareto::fit(&excesses);
        shape = fitted.shape;
        if fitted.shape.is_finite() && fitted.scale > 0.0 {
            for (rank, index) in tail.iter().enumerate() {
                let probability = (rank as f64 + 0.5) / tail.len() as f64;
                let expected = (fitted.quantile(probability) + base).ln();
                ln_weights[*index] = expected.min(0.0);
            }
        }
    }
    let ln_sum = ln_sum_exp(&ln_weights);
    for ln_weight in &mut ln_weights {
        *ln_weight -= ln_sum;
    }
    SmoothedWeights { ln_weights, shape }
}

/// ln Σ exp(x) without overflow; −∞ for nothing.
pub(super) fn ln_sum_exp(values: &[f64]) -> f64 {
    let highest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if highest == f64::NEG_INFINITY {
        return highest;
    }
    let sum: f64 = values.iter().map(|value| (value - highest).exp()).sum();
    highest + sum.ln()
}

/// A generalised Pareto distribution of excesses over a threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeneralisedPareto {
    /// k, the shape; moments of order 1/k and above do not exist.
    pub shape: f64,
    /// σ > 0, the scale.
    pub scale: f64,
}

impl GeneralisedPareto {
    /// The empirical Bayes estimate of Zhang & Stephens, with a weak prior on k.
    ///
    /// ```text
    /// b = Σ bᵢ wᵢ,  bᵢ = 1/x_n + (1 − sqrt(m/(i − ½)))/(3 x_q),  i = 1 … m = 30 + ⌊√n⌋
    /// k = mean ln(1 − b x),  σ = −k/b,  then k ← (n k + 10 · ½)/(n + 10)
    /// ```
    ///
    /// * `excesses`: increasing, above 0, at least 5; x_q is their first quartile.
    ///
    /// The prior, worth ten observations at ½, keeps short tails from erratic shapes (Vehtari et al. 2024, appendix G).
    pub fn fit(excesses: &[f64]) -> Self {
        const PRIOR_OBSERVATIONS: f64 = 10.0;
        const PRIOR_SHAPE: f64 = 0.5;
        let n = excesses.len() as f64;
        let candidates = 30 + n.sqrt() as usize;
        let quartile = excesses[(n / 4.0 + 0.5) as usize - 1];
        let largest = excesses[excesses.len() - 1];
        let shape_at = |b: f64| excesses.iter().map(|x| (-b * x).ln_1p()).sum::<f64>() / n;
        let profile: Vec<(f64, f64)> = (1..=candidates)
            .map(|i| {
                let spread = 1.0 - (candidates as f64 / (i as f64 - 0.5)).sqrt();
                let b = spread / (3.0 * quartile) + 1.0 / largest;
                let k = shape_at(b);
                (b, n * ((-(b / k)).ln() - k - 1.0))
            })
            .collect();
        let ln_likelihoods: Vec<f64> = profile.iter().map(|(_, ln_l)| *ln_l).collect();
        let ln_sum = ln_sum_exp(&ln_likelihoods);
        let weighted = profile
            .iter()
            .map(|(b, ln_l)| (*b, (ln_l - ln_sum).exp()))
            .filter(|(_, weight)| *weight >= 10.0 * f64::EPSILON);
        let (sum, total) = weighted.fold((0.0, 0.0), |(sum, total), (b, weight)| {
            (sum + b * weight, total + weight)
        });
        let b = sum / total;
        let k = shape_at(b);
        Self {
            shape: (n * k + PRIOR_OBSERVATIONS * PRIOR_SHAPE) / (n + PRIOR_OBSERVATIONS),
            scale: -k / b,
        }
    }

    /// The excess below which the share `probability` lies.
    ///
    /// ```text
    /// σ ((1 − p)^(−k) − 1)/k,   −σ ln(1 − p) for k = 0
    /// ```
    ///
    /// * `probability`: p in (0, 1).
    pub fn quantile(&self, probability: f64) -> f64 {
        let ln_above = (-probability).ln_1p();
        if self.shape.abs() < f64::EPSILON {
            -self.scale * ln_above
        } else {
            self.scale * (-self.shape * ln_above).exp_m1() / self.shape
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    /// What `tests/data/psis.py` writes.
    #[derive(Deserialize)]
    struct Vector {
        name: String,
        relative_efficiency: f64,
        ln_ratios: Vec<f64>,
        ln_weights: Vec<f64>,
        shape: Option<f64>,
    }

    #[derive(Deserialize)]
    struct Vectors {
        weights: Vec<Vector>,
    }

    #[test]
    fn weights_and_shapes_agree_with_arviz() {
        let vectors: Vectors =
            serde_json::from_str(include_str!("../../../tests/data/psis.json")).unwrap();
        assert!(vectors.weights.len() >= 6);
        for vector in vectors.weights {
            let found = smooth(&vector.ln_ratios, vector.relative_efficiency);
            let name = &vector.name;
            match vector.shape {
                Some(shape) => assert!(
                    (found.shape - shape).abs() < 1e-6,
                    "{name}: k {} {shape}",
                    found.shape
                ),
                None => assert_eq!(found.shape, f64::INFINITY, "{name}"),
            }
            // Among draws with one and the same weight the order of the smoothed ones is left to the sorting.
            let sorted = |weights: &[f64]| {
                let mut sorted = weights.to_vec();
                sorted.sort_by(f64::total_cmp);
                sorted
            };
            let pairs = sorted(&found.ln_weights)
                .into_iter()
                .zip(sorted(&vector.ln_weights));
            for (ours, theirs) in pairs {
                assert!((ours - theirs).abs() < 1e-6, "{name}: {ours} {theirs}");
            }
            let distinct = name != "repeated draws";
            for (ours, theirs) in found.ln_weights.iter().zip(&vector.ln_weights) {
                assert!(
                    !distinct || (ours - theirs).abs() < 1e-6,
                    "{name}: {ours} {theirs}"
                );
            }
        }
    }

    #[test]
    fn equal_weights_need_no_smoothing() {
        let found = smooth(&[3.0; 8], 1.0);
        assert_eq!(found.shape, f64::NEG_INFINITY);
        assert!(
            found
                .ln_weights
                .iter()
                .all(|ln_w| (ln_w + 8.0_f64.ln()).abs() < 1e-15)
        );
    }

    #[test]
    fn draws_of_no_weight_stay_without() {
        let mut ratios: Vec<f64> = (0..100).map(|i| f64::from(i).sqrt()).collect();
        ratios[7] = f64::NEG_INFINITY;
        let found = smooth(&ratios, 1.0);
        assert_eq!(found.ln_weights[7], f64::NEG_INFINITY);
        assert!((ln_sum_exp(&found.ln_weights)).abs() < 1e-12);
    }

    /// 1 − 1/log₁₀ 100 = ½; from 2155 draws on the bound is 0.7.
    #[test]
    fn thresholds() {
        assert_eq!(shape_threshold(100), 0.5);
        assert_eq!(shape_threshold(4000), 0.7);
    }

    #[test]
    fn quantiles_of_a_known_distribution() {
        let exponential = GeneralisedPareto {
            shape: 0.0,
            scale: 2.0,
        };
        assert!((exponential.quantile(0.5) - 2.0 * std::f64::consts::LN_2).abs() < 1e-15);
        let heavy = GeneralisedPareto {
            shape: 1.0,
            scale: 2.0,
        };
        assert!((heavy.quantile(0.75) - 6.0).abs() < 1e-12);
    }
}
