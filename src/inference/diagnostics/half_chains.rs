//! Chains cut into halves, so that a chain that drifts disagrees with itself: R̂ and effective sample size.

use super::{mean, sum_by, variance};
use crate::inference::lanes::{InstructionSet, Kernel, LANES};

/// Draws that differ by less than this are one value.
const RESOLUTION: f64 = 1e-15;

/// Half chains of equal length, one after the other.
#[derive(Debug, Clone, Default)]
pub(super) struct HalfChains {
    pub(super) values: Vec<f64>,
    length: usize,
}

impl HalfChains {
    /// Takes the first and last halves of each chain, or something of each draw; the middle one of an odd chain is left out.
    pub(super) fn fill(&mut self, chains: &[&[f64]], of: impl Fn(f64) -> f64) {
        self.clear(chains);
        let length = self.length;
        for chain in chains {
            for half in [&chain[..length], &chain[chain.len() - length..]] {
                self.values.extend(half.iter().map(|value| of(*value)));
            }
        }
    }

    /// As many zeros as these chains have draws in their halves.
    pub(super) fn reset(&mut self, chains: &[&[f64]]) {
        self.clear(chains);
        self.values.resize(2 * self.length * chains.len(), 0.0);
    }

    fn clear(&mut self, chains: &[&[f64]]) {
        self.length = chains.first().map_or(0, |chain| chain.len() / 2);
        self.values.clear();
    }

    /// Takes away each half's mean.
    pub(super) fn centre(&mut self) -> Centred<'_> {
        // Two draws that differ suffice, so the whole is gone through only where there are none.
        let all = || self.values.iter().copied();
        let first = self.values.first().copied().unwrap_or(f64::NAN);
        let range =
            || all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min);
        let is_constant =
            !all().any(|value| (value - first).abs() >= RESOLUTION) && range() < RESOLUTION;
        let instructions = InstructionSet::widest();
        let (means, variances) = instructions.run(Centre(self));
        Centred {
            halves: self,
            is_constant,
            within: mean(&variances),
            between: variance(&means),
            instructions,
        }
    }

    fn each(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.length.max(1))
    }
}

/// Half chains whose means were taken away.
pub(super) struct Centred<'a> {
    halves: &'a HalfChains,
    /// Whether all draws were one value.
    is_constant: bool,
    /// Mean variance within half chains.
    within: f64,
    /// Variance of their means.
    between: f64,
    instructions: InstructionSet,
}

impl Centred<'_> {
    /// Split R̂.
    ///
    /// ```text
    /// R̂ = sqrt((B/W + N − 1)/N)
    /// ```
    ///
    /// * N: length of a half chain; B: N times the variance of their means; W: mean variance within.
    pub(super) fn rhat(&self) -> f64 {
        let length = self.halves.length as f64;
        ((length * self.between / self.within + length - 1.0) / length).sqrt()
    }

    /// Effective sample size for the mean; NaN for half chains of less than four draws.
    pub(super) fn effective_size(&self) -> f64 {
        let length = self.halves.length;
        if length < 4 {
            return f64::NAN;
        }
        let total = self.halves.values.len() as f64;
        if self.is_constant {
            return total;
        }
        let autocovariance = |lag: usize| -> f64 {
            let products = Products {
                halves: self.halves,
                lag,
            };
            self.instructions.run(products) / total
        };
        let n = length as f64;
        let var_plus = self.within * (n - 1.0) / n + self.between;
        let correlation = |lag: usize| 1.0 - (self.within - autocovariance(lag)) / var_plus;

        // Geyer's initial positive sequence: pairs of neighbours as long as their sum is positive.
        let (mut even, mut odd) = (1.0, correlation(1));
        let mut rho = vec![even, odd];
        let mut lag = 1;
        while lag < length - 3 && even + odd > 0.0 {
            even = correlation(lag + 1);
            odd = correlation(lag + 2);
            let is_positive = even + odd >= 0.0;
            rho.extend(if is_positive { [even, odd] } else { [0.0, 0.0] });
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
}

/// Takes away the mean of each half; the means, and the variances.
struct Centre<'a>(&'a mut HalfChains);

impl Kernel for Centre<'_> {
    type Output = (Vec<f64>, Vec<f64>);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let length = self.0.length.max(1);
        let halves = self.0.values.len() / length;
        let (mut means, mut variances) = (vec![0.0; halves], vec![0.0; halves]);
        for (index, half) in self.0.values.chunks_exact_mut(length).enumerate() {
            let centre = mean(half);
            for value in &mut *half {
                *value -= centre;
            }
            means[index] = centre;
            variances[index] = sum_by(half, |value| value * value) / (length as f64 - 1.0);
        }
        (means, variances)
    }
}

/// Σ x(t) x(t + lag) over all half chains.
struct Products<'a> {
    halves: &'a HalfChains,
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
