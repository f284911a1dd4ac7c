//! Convergence diagnostics of Markov chains, as ArviZ 0.23 computes them.
//!
//! A quantity comes as chains of equal length. Every chain is split into halves first, so that a chain that drifts
//! disagrees with itself.
//!
//! Source: Vehtari, Gelman, Simpson, Carpenter & Bürkner (2021), *Rank-normalization, folding, and localization: an
//! improved R̂*, arXiv 1903.08008; Geyer (1992) for the truncation of autocorrelations.

mod half_chains;
mod ordering;
mod scores;

use statrs::function::beta::inv_beta_reg;

use self::half_chains::HalfChains;
use self::ordering::{Ranking, Sorter};
pub use self::scores::NormalScores;
use super::lanes::LANES;

/// Largest R̂ of a fit that is called converged.
pub const RHAT_LIMIT: f64 = 1.01;

/// Smallest bulk and tail effective sample size of a fit that is called converged.
pub const ESS_LIMIT: f64 = 400.0;

/// Convergence of one quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Convergence {
    /// Rank-normalised split R̂; NaN if the quantity never moved, or for one chain, which has none to agree with.
    pub rhat: f64,
    /// Effective sample size for the middle of the distribution.
    pub ess_bulk: f64,
    /// Effective sample size for its tails.
    pub ess_tail: f64,
}

impl Convergence {
    /// The diagnostics of one quantity.
    pub fn of(chains: &[&[f64]]) -> Self {
        let halves: usize = chains.iter().map(|chain| chain.len() / 2 * 2).sum();
        Workspace::default()
            .order(chains)
            .convergence(&NormalScores::new(halves))
    }

    /// Of draws that are not all numbers: nothing is known.
    pub const NONE: Self = Self {
        rhat: f64::NAN,
        ess_bulk: f64::NAN,
        ess_tail: f64::NAN,
    };

    /// Of draws that are the same whatever the chains do, which need not converge.
    pub fn of_constant(draws: usize) -> Self {
        Self {
            rhat: 1.0,
            ess_bulk: draws as f64,
            ess_tail: draws as f64,
        }
    }

    /// The worse of two in each respect.
    pub fn worse(self, other: Self) -> Self {
        Self {
            rhat: larger(self.rhat, other.rhat),
            ess_bulk: smaller(self.ess_bulk, other.ess_bulk),
            ess_tail: smaller(self.ess_tail, other.ess_tail),
        }
    }

    /// Whether the draws may be used: R̂ under 1.01, both effective sample sizes over 400.
    pub fn is_converged(&self) -> bool {
        self.rhat < RHAT_LIMIT && self.ess_bulk > ESS_LIMIT && self.ess_tail > ESS_LIMIT
    }
}

fn larger(left: f64, right: f64) -> f64 {
    if left.is_nan() || left > right {
        left
    } else {
        right
    }
}

fn smaller(left: f64, right: f64) -> f64 {
    if left.is_nan() || left < right {
        left
    } else {
        right
    }
}

/// Effective sample size for the mean.
pub fn ess_mean(chains: &[&[f64]]) -> f64 {
    Workspace::default().ess_mean(chains)
}

/// The quantile of sorted values by linear interpolation (type 7 of Hyndman & Fan 1996).
///
/// * `sorted`: increasing, at least one.
/// * `probability`: in [0, 1].
pub fn quantile(sorted: &[f64], probability: f64) -> f64 {
    // Written as SciPy's `mquantiles` computes it, rounding included: a rejected proposal repeats a draw, and whether
    // repeated draws lie at or below the quantile must come out as it does there.
    let size = sorted.len() as f64;
    let place = size * probability + (1.0 - probability);
    let below = place.clamp(1.0, (size - 1.0).max(1.0)).floor();
    let share = (place - below).clamp(0.0, 1.0);
    let low = sorted[below as usize - 1];
    let high = sorted[(below as usize).min(sorted.len() - 1)];
    // Infinities must not turn into NaN.
    if low == high && low.is_infinite() || share == 0.0 {
        return low;
    }
    (1.0 - share) * low + share * high
}

/// The mean of values.
#[inline(always)]
pub fn mean(values: &[f64]) -> f64 {
    sum_by(values, |value| value) / values.len() as f64
}

/// The sample variance of values, with n − 1 below.
pub fn variance(values: &[f64]) -> f64 {
    let centre = mean(values);
    sum_by(values, |value| (value - centre) * (value - centre)) / (values.len() as f64 - 1.0)
}

/// A sum in eight strands, which do not wait for each other.
#[inline(always)]
fn sum_by(values: &[f64], term: impl Fn(f64) -> f64) -> f64 {
    let (blocks, rest) = values.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for block in blocks {
        for lane in 0..LANES {
            sums[lane] += term(block[lane]);
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|value| term(*value)).sum::<f64>()
}

/// Room for the diagnostics of one quantity, which serves again for the next.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    sorter: Sorter,
    /// All draws, chain after chain.
    draws: Vec<f64>,
    ranking: Ranking,
    halves: HalfChains,
}

impl Workspace {
    /// Puts the draws of one quantity in order.
    pub fn order<'a>(&'a mut self, chains: &'a [&'a [f64]]) -> Ordered<'a> {
        self.draws.clear();
        for chain in chains {
            self.draws.extend_from_slice(chain);
        }
        self.ranking.sort(&mut self.sorter, &self.draws);
        Ordered {
            chains,
            workspace: self,
        }
    }

    /// Effective sample size for the mean.
    pub fn ess_mean(&mut self, chains: &[&[f64]]) -> f64 {
        self.halves.fill(chains, |value| value);
        self.halves.centre().effective_size()
    }

    /// Effective sample size for the share of draws at or below a value.
    fn ess_at_most(&mut self, chains: &[&[f64]], at: f64) -> f64 {
        self.halves
            .fill(chains, |value| f64::from(u8::from(value <= at)));
        self.halves.centre().effective_size()
    }

    /// Integrated autocorrelation time in steps of one chain: draws per effective draw for the mean.
    pub fn autocorrelation_time(&mut self, chains: &[&[f64]]) -> f64 {
        let draws: usize = chains.iter().map(|chain| chain.len()).sum();
        draws as f64 / self.ess_mean(chains)
    }
}

/// The draws of one quantity in order.
#[derive(Debug)]
pub struct Ordered<'a> {
    chains: &'a [&'a [f64]],
    workspace: &'a mut Workspace,
}

impl Ordered<'_> {
    /// All draws, increasing.
    pub fn values(&self) -> &[f64] {
        &self.workspace.ranking.values
    }

    /// The diagnostics of convergence.
    ///
    /// * `scores`: of the draws without the middle ones of chains of odd length.
    pub fn convergence(self, scores: &NormalScores) -> Convergence {
        let [low, median, high] = [0.05, 0.5, 0.95].map(|at| quantile(self.values(), at));
        let Self { chains, workspace } = self;
        let length = chains.first().map_or(0, |chain| chain.len());
        let Workspace {
            sorter,
            draws,
            ranking,
            halves,
        } = &mut *workspace;
        ranking.halve(length);
        halves.reset(chains);
        ranking.scores(scores, halves);
        let centred = halves.centre();
        let (rhat, ess_bulk) = (centred.rhat(), centred.effective_size());
        // The same for the distances from the median.
        for draw in &mut *draws {
            *draw = (*draw - median).abs();
        }
        ranking.sort(sorter, draws);
        ranking.halve(length);
        ranking.scores(scores, halves);
        let folded_rhat = halves.centre().rhat();
        let tails = [low, high].map(|at| workspace.ess_at_most(chains, at));
        Convergence {
            // `f64::max` ignores NaN, which must not hide that one of the two could not be computed.
            rhat: if chains.len() < 2 {
                f64::NAN
            } else {
                larger(rhat, folded_rhat)
            },
            ess_bulk,
            ess_tail: smaller(tails[0], tails[1]),
        }
    }

    /// Effective sample size for a quantile: that of the indicator of lying at or below it.
    ///
    /// * `probability`: of the quantile, in (0, 1).
    pub fn ess_quantile(&mut self, probability: f64) -> f64 {
        let at = quantile(self.values(), probability);
        self.workspace.ess_at_most(self.chains, at)
    }

    /// Monte-Carlo standard error of a quantile, by the central 68 % of the Beta distribution of its rank.
    ///
    /// * `probability`: of the quantile, in (0, 1).
    pub fn mcse_quantile(&mut self, probability: f64) -> f64 {
        let ess = self.ess_quantile(probability);
        let sorted = self.values();
        let size = sorted.len() as f64;
        let (a, b) = (ess * probability + 1.0, ess * (1.0 - probability) + 1.0);
        let low = inv_beta_reg(a, b, 0.158_655_3) * size - 1.0;
        let high = inv_beta_reg(a, b, 0.841_344_7) * size - 1.0;
        let low = sorted[low.max(0.0).floor() as usize];
        let high = sorted[high.min(size - 1.0).ceil() as usize];
        (high - low) / 2.0
    }

    /// Monte-Carlo standard error of the mean: sd / sqrt(ESS).
    pub fn mcse_mean(&mut self) -> f64 {
        let sd = variance(self.values()).sqrt();
        sd / self.workspace.ess_mean(self.chains).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;
    use crate::model::OrderedMap;

    #[derive(Deserialize)]
    struct Vectors {
        cases: OrderedMap<Case>,
    }

    #[derive(Deserialize)]
    struct Case {
        draws: Vec<Vec<f64>>,
        arviz: OrderedMap<serde_json::Value>,
    }

    #[track_caller]
    fn check(case: &str, name: &str, found: f64, expected: &serde_json::Value) {
        let Some(expected) = expected.as_f64() else {
            assert!(found.is_nan(), "{case}: {name} is {found}, ArviZ has NaN");
            return;
        };
        let close = (found - expected).abs() <= 1e-6 * expected.abs();
        assert!(close, "{case}: {name} is {found}, ArviZ has {expected}");
    }

    /// tests/data/diagnostics.json holds draws and what ArviZ 0.23.4 says about them.
    #[test]
    fn diagnostics_agree_with_arviz() {
        let text = include_str!("../../tests/data/diagnostics.json");
        let vectors: Vectors = serde_json::from_str(text).unwrap();
        assert_eq!(vectors.cases.iter().count(), 16, "every vector there is");
        for (name, case) in vectors.cases.iter() {
            let chains: Vec<&[f64]> = case.draws.iter().map(Vec::as_slice).collect();
            let found = Convergence::of(&chains);
            let mut workspace = Workspace::default();
            let mut ordered = workspace.order(&chains);
            let expected = |key: &str| case.arviz.get(key).unwrap();
            check(name, "rhat", found.rhat, expected("rhat_rank"));
            check(name, "bulk", found.ess_bulk, expected("ess_bulk"));
            check(name, "tail", found.ess_tail, expected("ess_tail"));
            check(name, "mean", ess_mean(&chains), expected("ess_mean"));
            check(
                name,
                "mcse of mean",
                ordered.mcse_mean(),
                expected("mcse_mean"),
            );
            check(
                name,
                "mcse of median",
                ordered.mcse_quantile(0.5),
                expected("mcse_median"),
            );
            let ess_median = expected("ess_quantile_0.5");
            check(name, "ess of median", ordered.ess_quantile(0.5), ess_median);
            for (probability, key) in [(0.05, "0.05"), (0.95, "0.95")] {
                let ess = expected(&format!("ess_quantile_{key}"));
                check(name, "quantile", ordered.ess_quantile(probability), ess);
                let mcse = expected(&format!("mcse_quantile_{key}"));
                check(
                    name,
                    "mcse of quantile",
                    ordered.mcse_quantile(probability),
                    mcse,
                );
            }
        }
    }

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.5), 2.0);
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.75), 3.0);
        assert_eq!(quantile(&[7.0], 0.3), 7.0);
        assert_eq!(
            quantile(&[f64::NEG_INFINITY, f64::NEG_INFINITY, 0.0], 0.25),
            f64::NEG_INFINITY
        );
    }
}
