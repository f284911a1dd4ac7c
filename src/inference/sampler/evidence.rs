//! The marginal likelihood, by importance sampling from the proposal.

use rand_chacha::ChaCha12Rng;

use super::{BLOCK, LogDensity, Proposal};
use crate::inference::lanes::LaneRandom;

/// ln of the integral of prior × likelihood, and its Monte-Carlo standard error.
///
/// ```text
/// Z ≈ mean of prior(x) L(x) / q(x),   x from q
/// ```
///
/// * q: the proposal, whose tails are heavier than the posterior's; `draws`: at least 2, rounded up to whole blocks.
///
/// The prior's density must be normalised on the coordinates.
pub fn ln_evidence<D: LogDensity>(
    density: &mut D,
    proposal: &Proposal,
    draws: usize,
    rng: &mut ChaCha12Rng,
) -> (f64, f64) {
    let mut random = LaneRandom::new(rng);
    let mut positions = vec![[0.0; BLOCK]; density.dimension()];
    let mut ln_weights = Vec::with_capacity(draws);
    while ln_weights.len() < draws {
        let ln_proposal = proposal.propose(&mut random, &mut positions);
        let ln_posterior = density.evaluate(&positions).posterior();
        ln_weights.extend(ln_posterior.iter().zip(ln_proposal).map(|(p, q)| p - q));
    }
    let highest = ln_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = ln_weights
        .iter()
        .map(|ln_weight| (ln_weight - highest).exp())
        .collect();
    let n = weights.len() as f64;
    let mean = weights.iter().sum::<f64>() / n;
    let squares: f64 = weights.iter().map(|weight| (weight - mean).powi(2)).sum();
    (highest + mean.ln(), (squares / (n - 1.0) / n).sqrt() / mean)
}
