//! Whether ranks are uniform: simultaneous bands for their empirical distribution function, and the p-value that
//! belongs to them.
//!
//! Source: Säilynoja, Bürkner & Vehtari (2022), *Graphical test for discrete uniformity and its applications in
//! goodness-of-fit evaluation and multiple sample comparison*, Statistics and Computing 32, sections 2 and 3.

use statrs::function::gamma::ln_gamma;

/// Tail probabilities that differ by less than this share are one: mirrored ones differ by rounding.
const RESOLUTION: f64 = 1e-9;

/// The distribution of the empirical distribution function of ranks that are independent and uniform on 0..ranks.
///
/// ```text
/// C_i = how many of n ranks are below i,   C_i ~ Binomial(n, i/K),   i = 1 … K − 1
/// t_i = 2 min(P(C ≤ C_i), P(C ≥ C_i))
/// ```
///
/// * n: how many ranks; K: how many values a rank can have.
///
/// A band of pointwise level 1 − γ holds the C_i with t_i ≥ γ. The probability that all C_i lie in it follows from the
/// steps between neighbours: C_{i+1} − C_i given C_i is Binomial(n − C_i, 1/(K − i)).
#[derive(Debug, Clone)]
pub struct UniformRanks {
    size: usize,
    values: usize,
    ln_factorials: Vec<f64>,
    /// t by position i − 1 and count.
    tails: Vec<Vec<f64>>,
}

/// Counts between which the empirical distribution function stays.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bands {
    /// Least count by position i − 1.
    pub low: Vec<usize>,
    /// Largest count by position i − 1.
    pub high: Vec<usize>,
}

impl Bands {
    /// Whether counts stay between the bands everywhere.
    pub fn hold(&self, counts: &[usize]) -> bool {
        let bounds = self.low.iter().zip(&self.high);
        counts
            .iter()
            .zip(bounds)
            .all(|(count, (low, high))| low <= count && count <= high)
    }
}

impl UniformRanks {
    /// The distribution for `size` ranks with `values` possible values, both at least 1.
    pub fn new(size: usize, values: usize) -> Self {
        let mut uniform = Self {
            size,
            values,
            ln_factorials: (0..=size).map(|k| ln_gamma(k as f64 + 1.0)).collect(),
            tails: Vec::new(),
        };
        uniform.tails = (1..values)
            .map(|position| {
                let share = position as f64 / values as f64;
                let probabilities: Vec<f64> = (0..=size)
                    .map(|count| uniform.binomial(size, count, share))
                    .collect();
                let running = |sum: &mut f64, p: &f64| {
                    *sum += p;
                    Some(*sum)
                };
                let below = probabilities.iter().scan(0.0, running);
                let mut above: Vec<f64> = probabilities.iter().rev().scan(0.0, running).collect();
                above.reverse();
                below
                    .zip(above)
                    .map(|(below, above)| (2.0 * below.min(above)).min(1.0))
                    .collect()
            })
            .collect();
        uniform
    }

    /// How many of the ranks are below 1, 2, …, K − 1.
    ///
    /// * `ranks`: as many as this distribution is for, each below K.
    pub fn counts(&self, ranks: &[usize]) -> Vec<usize> {
        let mut counts = vec![0; self.values];
        for rank in ranks {
            counts[*rank] += 1;
        }
        let mut below = 0;
        counts[..self.values - 1]
            .iter()
            .map(|count| {
                below += count;
                below
            })
            .collect()
    }

    /// The narrowest bands that hold all counts with at least this probability.
    ///
    /// * `level`: in (0, 1), such as 0.99.
    pub fn bands(&self, level: f64) -> Bands {
        // Bands of pointwise level 1 − γ: γ lies between (1 − level) shared out over all positions, and 1.
        let mut low = ((1.0 - level) / self.values as f64).ln();
        let mut high = 0.0;
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.coverage(&self.within(middle.exp())) >= level {
                low = middle;
            } else {
                high = middle;
            }
        }
        self.within(low.exp())
    }

    /// The probability that uniform ranks stray from uniformity, at their worst position, as far as these do.
    ///
    /// It is below 1 − level if the counts leave the [`bands`](Self::bands) of that level.
    pub fn p_value(&self, ranks: &[usize]) -> f64 {
        let counts = self.counts(ranks);
        let worst = counts
            .iter()
            .zip(&self.tails)
            .map(|(count, tails)| tails[*count])
            .fold(1.0, f64::min);
        // Those that stray as far count as well, so the band is the next narrower one.
        let narrower = self.within(worst * (1.0 + RESOLUTION) + f64::MIN_POSITIVE);
        (1.0 - self.coverage(&narrower)).clamp(0.0, 1.0)
    }

    /// The band of counts with a two-sided tail probability of at least `gamma`.
    fn within(&self, gamma: f64) -> Bands {
        let inside = |tails: &Vec<f64>| {
            let low = tails.iter().position(|tail| *tail >= gamma);
            let high = tails.iter().rposition(|tail| *tail >= gamma);
            // An empty band is one that no count can be in.
            low.zip(high).unwrap_or((1, 0))
        };
        let (low, high) = self.tails.iter().map(inside).unzip();
        Bands { low, high }
    }

    /// The probability that uniform ranks stay within a band.
    fn coverage(&self, bands: &Bands) -> f64 {
        // Probability of each count at the position before, having stayed within the band so far.
        let mut first = 0;
        let mut here = vec![1.0];
        for (position, (&low, &high)) in bands.low.iter().zip(&bands.high).enumerate() {
            let share = 1.0 / (self.values - position) as f64;
            let mut next = vec![0.0; (high + 1).saturating_sub(low)];
            for (offset, weight) in here.iter().enumerate() {
                let from = first + offset;
                if *weight > 0.0 {
                    let (least, most) = self.likely_steps(from, share);
                    for to in low.max(from + least)..=high.min(from + most) {
                        next[to - low] +=
                            weight * self.binomial(self.size - from, to - from, share);
                    }
                }
            }
            (first, here) = (low, next);
        }
        here.iter().sum()
    }

    /// Steps from a count, outside of which less than 1e-20 of the probability lies: for many ranks nearly all do.
    fn likely_steps(&self, from: usize, share: f64) -> (usize, usize) {
        let left = (self.size - from) as f64;
        let mean = left * share;
        let reach = 12.0 * (mean * (1.0 - share)).sqrt() + 24.0;
        // The conversion takes what is below 0 as 0.
        (
            (mean - reach) as usize,
            (mean + reach).ceil().min(left) as usize,
        )
    }

    /// P(X = k) for X ~ Binomial(n, p), n at most the number of ranks.
    fn binomial(&self, n: usize, k: usize, p: f64) -> f64 {
        if n < k {
            return 0.0;
        }
        if p >= 1.0 {
            return f64::from(u8::from(k == n));
        }
        let ways = self.ln_factorials[n] - self.ln_factorials[k] - self.ln_factorials[n - k];
        (ways + k as f64 * p.ln() + (n - k) as f64 * (-p).ln_1p()).exp()
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::inference::sampler::random_stream;

    /// With two values there is one position, and the test is the exact two-sided binomial one.
    #[test]
    fn two_values_are_a_binomial_test() {
        let uniform = UniformRanks::new(10, 2);
        let ranks = [1; 10];
        assert!((uniform.p_value(&ranks) - 2.0 / 1024.0).abs() < 1e-12);
        // One of ten at 0: (1 + 10) / 1024 on each side.
        let ranks = [0, 1, 1, 1, 1, 1, 1, 1, 1, 1];
        assert!((uniform.p_value(&ranks) - 22.0 / 1024.0).abs() < 1e-12);
    }

    /// All 4^6 equally likely sets of ranks, one by one.
    #[test]
    fn coverage_is_that_of_counting_all_cases() {
        let (size, values) = (6, 4);
        let uniform = UniformRanks::new(size, values);
        let cases: Vec<Vec<usize>> = (0..values.pow(size as u32))
            .map(|case| {
                (0..size)
                    .map(|place| case / values.pow(place as u32) % values)
                    .collect()
            })
            .collect();
        let p: Vec<f64> = cases.iter().map(|ranks| uniform.p_value(ranks)).collect();
        let total = cases.len() as f64;
        for bound in [0.001, 0.01, 0.05, 0.2, 0.5, 1.0] {
            let share = p.iter().filter(|p| **p <= bound).count() as f64 / total;
            assert!(share <= bound + 1e-9, "{share} {bound}");
        }
        for level in [0.5, 0.9, 0.99] {
            let bands = uniform.bands(level);
            let held = cases
                .iter()
                .filter(|ranks| bands.hold(&uniform.counts(ranks)));
            let share = held.count() as f64 / total;
            assert!((share - uniform.coverage(&bands)).abs() < 1e-12);
            assert!(share >= level);
            for (ranks, p) in cases.iter().zip(&p) {
                assert_eq!(
                    bands.hold(&uniform.counts(ranks)),
                    *p > 1.0 - level + 1e-12,
                    "{p}"
                );
            }
        }
    }

    #[test]
    fn bands_hold_uniform_ranks_as_often_as_they_say() {
        let (size, values, sets) = (200, 32, 4000);
        let uniform = UniformRanks::new(size, values);
        let mut rng = random_stream(12, 0);
        for level in [0.9, 0.99] {
            let bands = uniform.bands(level);
            let mut held = 0;
            for _ in 0..sets {
                let ranks: Vec<usize> = (0..size).map(|_| rng.random_range(0..values)).collect();
                held += usize::from(bands.hold(&uniform.counts(&ranks)));
            }
            let share = held as f64 / sets as f64;
            let error = (level * (1.0 - level) / sets as f64).sqrt();
            assert!(
                (share - uniform.coverage(&bands)).abs() < 4.0 * error,
                "{share} {level}"
            );
            // Counts are whole, so bands can hold a little more than they must.
            assert!((uniform.coverage(&bands) - level).abs() < 0.01);
        }
    }

    #[test]
    fn ranks_that_lean_or_pile_up_are_noticed() {
        let (size, values) = (500, 64);
        let uniform = UniformRanks::new(size, values);
        let bands = uniform.bands(0.99);
        let mut rng = random_stream(13, 0);
        let even = |rng: &mut rand_chacha::ChaCha12Rng| rng.random::<f64>();
        let lean = |rng: &mut rand_chacha::ChaCha12Rng| rng.random::<f64>().powf(1.3);
        let piled =
            |rng: &mut rand_chacha::ChaCha12Rng| (rng.random::<f64>() + rng.random::<f64>()) / 2.0;
        let mut ranks = |draw: &dyn Fn(&mut rand_chacha::ChaCha12Rng) -> f64| -> Vec<usize> {
            (0..size)
                .map(|_| (draw(&mut rng) * values as f64) as usize)
                .collect()
        };
        let (even, lean, piled) = (ranks(&even), ranks(&lean), ranks(&piled));
        assert!(bands.hold(&uniform.counts(&even)) && uniform.p_value(&even) > 0.01);
        for ranks in [lean, piled] {
            assert!(!bands.hold(&uniform.counts(&ranks)) && uniform.p_value(&ranks) < 1e-3);
        }
    }
}
