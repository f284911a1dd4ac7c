//! Convergence diagnostics of Markov chains, as ArviZ 0.23 computes them.
//!
//! A quantity comes as chains of equal length. Every chain is split into halves first, so that a chain that drifts
//! disagrees with itself.
//!
//! Source: Vehtari, Gelman, Simpson, Carpenter & Bürkner (2021), *Rank-normalization, folding, and localization: an
//! improved R̂*, arXiv 1903.08008; Geyer (1992) for the truncation of autocorrelations.

mod ordering;

use statrs::function::beta::inv_beta_reg;

pub use self::ordering::NormalScores;
use self::ordering::order;
use super::lanes::{InstructionSet, Kernel, LANES};

/// Draws that differ by less than this are one value.
const RESOLUTION: f64 = 1e-15;

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
        Self::with(&NormalScores::new(halves), chains)
    }

    /// The diagnostics of one quantity, with scores that serve for all of as many draws.
    ///
    /// * `scores`: of the draws without the middle ones of chains of odd length.
    pub fn with(scores: &NormalScores, chains: &[&[f64]]) -> Self {
        let sorted = Sorted::of(chains);
        let median = quantile(&sorted.values, 0.5);
        let ranked = sorted.scores(scores, &sorted.values, &sorted.places);
        let (distances, places) = sorted.folded(median);
        let folded = sorted.scores(scores, &distances, &places);
        let tail =
            |probability| plain_ess(&sorted.indicators(quantile(&sorted.values, probability)));
        Self {
            // `f64::max` ignores NaN, which must not hide that one of the two could not be computed.
            rhat: if chains.len() < 2 {
                f64::NAN
            } else {
                larger(plain_rhat(&ranked), plain_rhat(&folded))
            },
            ess_bulk: plain_ess(&ranked),
            ess_tail: smaller(tail(0.05), tail(0.95)),
        }
    }

    /// Of draws that are not all numbers: nothing is known.
    pub const NONE: Self = Self {
        rhat: f64::NAN,
        ess_bulk: f64::NAN,
        ess_tail: f64::NAN,
    };

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

/// Rank-normalised split R̂: the larger of that of the draws and that of their distances from the median.
///
/// ```text
/// R̂ = sqrt((B/W + N − 1)/N)
/// ```
///
/// * N: length of a half chain; B: N times the variance of their means; W: mean variance within.
pub fn rhat(chains: &[&[f64]]) -> f64 {
    Convergence::of(chains).rhat
}

/// Effective sample size for the mean.
pub fn ess_mean(chains: &[&[f64]]) -> f64 {
    plain_ess(&split(chains))
}

/// Effective sample size for a quantile: that of the indicator of lying at or below it.
///
/// * `probability`: of the quantile, in (0, 1).
pub fn ess_quantile(chains: &[&[f64]], probability: f64) -> f64 {
    let sorted = Sorted::of(chains);
    plain_ess(&sorted.indicators(quantile(&sorted.values, probability)))
}

/// Monte-Carlo standard error of the mean: sd / sqrt(ESS).
pub fn mcse_mean(chains: &[&[f64]]) -> f64 {
    let all: Vec<f64> = chains.concat();
    variance(&all).sqrt() / ess_mean(chains).sqrt()
}

/// Monte-Carlo standard error of a quantile, by the central 68 % of the Beta distribution of its rank.
///
/// * `probability`: of the quantile, in (0, 1).
pub fn mcse_quantile(chains: &[&[f64]], probability: f64) -> f64 {
    let order = Sorted::of(chains);
    let ess = plain_ess(&order.indicators(quantile(&order.values, probability)));
    let sorted = &order.values;
    let size = sorted.len() as f64;
    let (a, b) = (ess * probability + 1.0, ess * (1.0 - probability) + 1.0);
    let low = inv_beta_reg(a, b, 0.158_655_3) * size - 1.0;
    let high = inv_beta_reg(a, b, 0.841_344_7) * size - 1.0;
    let low = sorted[low.max(0.0).floor() as usize];
    let high = sorted[high.min(size - 1.0).ceil() as usize];
    (high - low) / 2.0
}

/// Integrated autocorrelation time in steps of one chain: draws per effective draw for the mean.
pub fn autocorrelation_time(chains: &[&[f64]]) -> f64 {
    let draws: usize = chains.iter().map(|chain| chain.len()).sum();
    draws as f64 / ess_mean(chains)
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
pub fn mean(values: &[f64]) -> f64 {
    sum_by(values, |value| value) / values.len() as f64
}

/// The sample variance of values, with n − 1 below.
pub fn variance(values: &[f64]) -> f64 {
    let centre = mean(values);
    sum_by(values, |value| (value - centre) * (value - centre)) / (values.len() as f64 - 1.0)
}

/// A sum in eight strands, which do not wait for each other.
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

/// Half chains of equal length, one after the other.
struct Halves {
    values: Vec<f64>,
    length: usize,
}

impl Halves {
    fn each(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.length.max(1))
    }
}

/// First and last halves of each chain; the middle draw of an odd one is left out.
fn split(chains: &[&[f64]]) -> Halves {
    let length = chains.first().map_or(0, |chain| chain.len() / 2);
    let mut values = Vec::with_capacity(2 * length * chains.len());
    for chain in chains {
        values.extend_from_slice(&chain[..length]);
        values.extend_from_slice(&chain[chain.len() - length..]);
    }
    Halves { values, length }
}

/// All draws in increasing order.
struct Sorted<'a> {
    chains: &'a [&'a [f64]],
    values: Vec<f64>,
    /// Where each value stood among all draws, chain after chain.
    places: Vec<u32>,
}

impl<'a> Sorted<'a> {
    fn of(chains: &'a [&'a [f64]]) -> Self {
        let all = chains.concat();
        let places = order(&all);
        Self {
            chains,
            values: places.iter().map(|place| all[*place as usize]).collect(),
            places,
        }
    }

    /// 1 for each draw at or below a value, else 0, in half chains.
    fn indicators(&self, at: f64) -> Halves {
        let mut halves = split(self.chains);
        for value in &mut halves.values {
            *value = f64::from(u8::from(*value <= at));
        }
        halves
    }

    /// The distances from a value in increasing order, and their places: a merge of those below and above.
    fn folded(&self, centre: f64) -> (Vec<f64>, Vec<u32>) {
        let mut above = self.values.partition_point(|value| *value < centre);
        let mut below = above;
        let mut distances = Vec::with_capacity(self.values.len());
        let mut places = Vec::with_capacity(self.values.len());
        let distance = |index: usize| (self.values[index] - centre).abs();
        while distances.len() < self.values.len() {
            let is_above =
                below == 0 || (above < self.values.len() && distance(above) <= distance(below - 1));
            let index = if is_above {
                above += 1;
                above - 1
            } else {
                below -= 1;
                below
            };
            distances.push(distance(index));
            places.push(self.places[index]);
        }
        (distances, places)
    }

    /// Normal scores of the average ranks among the draws in half chains.
    fn scores(&self, scores: &NormalScores, sorted: &[f64], places: &[u32]) -> Halves {
        let length = self.chains.first().map_or(0, |chain| chain.len());
        let half = length / 2;
        let mut values = vec![0.0; 2 * half * self.chains.len()];
        let is_odd = !length.is_multiple_of(2);
        // Where a draw stands in half chains; nothing for the middle one of an odd chain.
        let place_in_halves = |place: usize| {
            if !is_odd {
                return Some(place);
            }
            let (chain, at) = (place / length, place % length);
            (at != half).then(|| chain * 2 * half + at - usize::from(at > half))
        };
        let mut start = 0;
        let mut before = 0;
        while start < sorted.len() {
            // NaN equals nothing, itself included; it still takes one rank.
            let mut end = start + 1;
            while end < sorted.len() && sorted[end] == sorted[start] {
                end += 1;
            }
            let tied = places[start..end].iter();
            let tied = tied.filter_map(|place| place_in_halves(*place as usize));
            let ties = if is_odd {
                tied.clone().count()
            } else {
                end - start
            };
            if ties > 0 {
                let score = scores.of(2 * before + ties + 1);
                for place in tied {
                    values[place] = score;
                }
            }
            before += ties;
            start = end;
        }
        debug_assert_eq!(before, scores.size());
        Halves {
            values,
            length: half,
        }
    }
}

fn plain_rhat(halves: &Halves) -> f64 {
    let length = halves.length as f64;
    let means: Vec<f64> = halves.each().map(mean).collect();
    let variances: Vec<f64> = halves.each().map(variance).collect();
    let between = length * variance(&means);
    let within = mean(&variances);
    ((between / within + length - 1.0) / length).sqrt()
}

/// Σ x(t) x(t + lag) over all half chains.
struct Products<'a> {
    halves: &'a Halves,
    lag: usize,
}

impl Kernel for Products<'_> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        let mut sums = [0.0; 2 * LANES];
        let mut rest = 0.0;
        for half in self.halves.each() {
            let (now, now_rest) = half[..half.len() - self.lag].as_chunks::<{ 2 * LANES }>();
            let (later, later_rest) = half[self.lag..].as_chunks::<{ 2 * LANES }>();
            for (now, later) in now.iter().zip(later) {
                for lane in 0..2 * LANES {
                    sums[lane] += now[lane] * later[lane];
                }
            }
            for (now, later) in now_rest.iter().zip(later_rest) {
                rest += now * later;
            }
        }
        sums.iter().sum::<f64>() + rest
    }
}

fn plain_ess(halves: &Halves) -> f64 {
    let length = halves.length;
    if length < 4 {
        return f64::NAN;
    }
    let total = halves.values.len() as f64;
    // Two draws that differ suffice, so the whole is gone through only where there are none.
    let all = || halves.values.iter().copied();
    let first = halves.values[0];
    let range = || all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min);
    if !all().any(|value| (value - first).abs() >= RESOLUTION) && range() < RESOLUTION {
        return total;
    }

    let means: Vec<f64> = halves.each().map(mean).collect();
    let mut centred = Halves {
        values: halves.values.clone(),
        length,
    };
    for (half, centre) in centred.values.chunks_exact_mut(length).zip(&means) {
        for value in half {
            *value -= centre;
        }
    }
    let instructions = InstructionSet::widest();
    let autocovariance = |lag: usize| -> f64 {
        let products = Products {
            halves: &centred,
            lag,
        };
        instructions.run(products) / total
    };
    let n = length as f64;
    let mean_variance = autocovariance(0) * n / (n - 1.0);
    let var_plus = mean_variance * (n - 1.0) / n + variance(&means);
    let correlation = |lag: usize| 1.0 - (mean_variance - autocovariance(lag)) / var_plus;

    // Geyer's initial positive sequence: pairs of neighbours as long as their sum is positive.
    let mut rho = vec![0.0; length];
    let (mut even, mut odd) = (1.0, correlation(1));
    rho[0] = even;
    rho[1] = odd;
    let mut lag = 1;
    while lag < length - 3 && even + odd > 0.0 {
        even = correlation(lag + 1);
        odd = correlation(lag + 2);
        if even + odd >= 0.0 {
            rho[lag + 1] = even;
            rho[lag + 2] = odd;
        }
        lag += 2;
    }
    // `last` is the odd lag that ends the last pair kept; with lag = 1 there is none behind the first.
    let last = lag as isize - 2;
    let next = (last + 1) as usize;
    if even > 0.0 {
        rho[next] = even;
    }
    // Initial monotone sequence: no pair above the one before it.
    let mut lag = 1;
    while lag as isize <= last - 2 {
        if rho[lag + 1] + rho[lag + 2] > rho[lag - 1] + rho[lag] {
            rho[lag + 1] = (rho[lag - 1] + rho[lag]) / 2.0;
            rho[lag + 2] = rho[lag + 1];
        }
        lag += 2;
    }
    let time = -1.0 + 2.0 * rho[..next].iter().sum::<f64>() + rho[next];
    total / time.max(1.0 / total.log10())
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
            let expected = |key: &str| case.arviz.get(key).unwrap();
            check(name, "rhat", found.rhat, expected("rhat_rank"));
            check(name, "bulk", found.ess_bulk, expected("ess_bulk"));
            check(name, "tail", found.ess_tail, expected("ess_tail"));
            check(name, "mean", ess_mean(&chains), expected("ess_mean"));
            check(
                name,
                "mcse of mean",
                mcse_mean(&chains),
                expected("mcse_mean"),
            );
            check(
                name,
                "mcse of median",
                mcse_quantile(&chains, 0.5),
                expected("mcse_median"),
            );
            let ess_median = expected("ess_quantile_0.5");
            check(
                name,
                "ess of median",
                ess_quantile(&chains, 0.5),
                ess_median,
            );
            for (probability, key) in [(0.05, "0.05"), (0.95, "0.95")] {
                let ess = expected(&format!("ess_quantile_{key}"));
                check(name, "quantile", ess_quantile(&chains, probability), ess);
                let mcse = expected(&format!("mcse_quantile_{key}"));
                check(
                    name,
                    "mcse of quantile",
                    mcse_quantile(&chains, probability),
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
