//! All ranks of a calibration judged together.

use std::collections::BTreeMap;

use super::{Bands, RankedQuantity, Replicate, UniformRanks};
use crate::inference::comparison::holm;

/// Probability with which the bands hold all of one quantity's ranks of one seed, if its posterior is right.
pub const LEVEL: f64 = 0.99;

/// The replicates of one experiment.
#[derive(Debug, Clone, Copy)]
pub struct RankSet<'a> {
    /// The replicates of each seed, equally many; at least one.
    pub seeds: &'a [Vec<Replicate>],
}

/// What a calibration says.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// For each experiment its quantities.
    pub experiments: Vec<Vec<QuantityJudgement>>,
    /// How many tests were made, and corrected for.
    pub tests: usize,
    /// The smallest corrected p-value.
    pub smallest_p: f64,
    /// Whether no test fails: all corrected p-values above 1 − [`LEVEL`].
    pub is_calibrated: bool,
}

/// What the ranks of one quantity say.
#[derive(Debug, Clone, PartialEq)]
pub struct QuantityJudgement {
    /// The quantity.
    pub quantity: RankedQuantity,
    /// One test for each seed.
    pub seeds: Vec<RankTest>,
    /// The test of all seeds together, which sees smaller faults; left out where there is one seed.
    pub together: Option<RankTest>,
}

/// One test of uniformity.
#[derive(Debug, Clone, PartialEq)]
pub struct RankTest {
    /// How many ranks there are below 1, 2, ….
    pub counts: Vec<usize>,
    /// Whether the counts stay between the bands of [`LEVEL`].
    pub is_inside: bool,
    /// p-value, as if this were the only test.
    pub p: f64,
    /// p-value after Holm's correction for all tests of the calibration.
    pub corrected_p: f64,
}

/// Tests the ranks of every quantity of every experiment, for each seed and for all seeds together, and corrects for
/// their number.
///
/// * `values`: how many values a rank can have.
///
/// Each test is of the bands of [`UniformRanks`]. One in a hundred leaves its bands of 99 % by chance, so the verdict
/// rests on p-values after [`holm`]'s correction over all tests: a right program fails in at most one calibration of a
/// hundred. The tests of a quantity with seeds and together depend on each other, which the correction allows.
pub fn judge(experiments: &[RankSet<'_>], values: usize) -> Judgement {
    let mut known = BTreeMap::new();
    let mut judged: Vec<Vec<QuantityJudgement>> = experiments
        .iter()
        .map(|experiment| {
            let first = &experiment.seeds[0][0];
            let quantities = first.ranks.iter().enumerate();
            quantities
                .map(|(place, (quantity, _))| {
                    let of_seed = |seed: &Vec<Replicate>| -> Vec<usize> {
                        seed.iter()
                            .map(|replicate| replicate.ranks[place].1)
                            .collect()
                    };
                    let seeds: Vec<Vec<usize>> = experiment.seeds.iter().map(of_seed).collect();
                    let mut test = |ranks: &[usize]| RankTest::of(ranks, values, &mut known);
                    QuantityJudgement {
                        quantity: quantity.clone(),
                        together: (seeds.len() > 1).then(|| test(&seeds.concat())),
                        seeds: seeds.iter().map(|ranks| test(ranks)).collect(),
                    }
                })
                .collect()
        })
        .collect();
    let mut tests: Vec<&mut RankTest> = judged
        .iter_mut()
        .flatten()
        .flat_map(|quantity| quantity.seeds.iter_mut().chain(&mut quantity.together))
        .collect();
    let corrected = holm(&tests.iter().map(|test| test.p).collect::<Vec<f64>>());
    for (test, p) in tests.iter_mut().zip(&corrected) {
        test.corrected_p = *p;
    }
    let smallest_p = corrected.iter().copied().fold(1.0, f64::min);
    Judgement {
        tests: corrected.len(),
        smallest_p,
        is_calibrated: smallest_p > 1.0 - LEVEL,
        experiments: judged,
    }
}

impl RankTest {
    /// `known` holds, by the number of ranks, the distributions and bands that were needed before.
    fn of(
        ranks: &[usize],
        values: usize,
        known: &mut BTreeMap<usize, (UniformRanks, Bands)>,
    ) -> Self {
        let (uniform, bands) = known.entry(ranks.len()).or_insert_with(|| {
            let uniform = UniformRanks::new(ranks.len(), values);
            let bands = uniform.bands(LEVEL);
            (uniform, bands)
        });
        let counts = uniform.counts(ranks);
        let p = uniform.p_value(ranks);
        Self {
            is_inside: bands.hold(&counts),
            counts,
            p,
            corrected_p: p,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::inference::Quantity;
    use crate::inference::sampler::random_stream;

    const VALUES: usize = 16;

    /// Two seeds of an experiment with two quantities; the second leans by `power`.
    fn experiment(stream: u64, power: f64) -> Vec<Vec<Replicate>> {
        let mut rng = random_stream(2, stream);
        let mut replicate = |_| {
            let mut rank = |power: f64| (rng.random::<f64>().powf(power) * VALUES as f64) as usize;
            Replicate {
                ranks: vec![
                    (RankedQuantity::Reported(Quantity::Tau), rank(1.0)),
                    (RankedQuantity::LnLikelihood, rank(power)),
                ],
                converged: true,
            }
        };
        (0..2)
            .map(|_| (0..300).map(&mut replicate).collect())
            .collect()
    }

    #[test]
    fn one_wrong_quantity_among_right_ones_fails() {
        let right = [experiment(0, 1.0), experiment(1, 1.0)];
        let wrong = [experiment(0, 1.0), experiment(1, 1.5)];
        let judged = |all: &[Vec<Vec<Replicate>>]| {
            let sets: Vec<RankSet<'_>> = all.iter().map(|seeds| RankSet { seeds }).collect();
            judge(&sets, VALUES)
        };
        let good = judged(&right);
        assert_eq!((good.tests, good.is_calibrated), (12, true));
        let bad = judged(&wrong);
        assert!(!bad.is_calibrated && bad.smallest_p < 0.01);
        let (fine, faulty) = (&bad.experiments[1][0], &bad.experiments[1][1]);
        assert_eq!(faulty.quantity, RankedQuantity::LnLikelihood);
        assert!(
            faulty
                .seeds
                .iter()
                .all(|test| !test.is_inside && test.corrected_p < 0.01)
        );
        assert!(fine.seeds.iter().all(|test| test.corrected_p > 0.01));
        // Seen together a fault is clearer than in any seed.
        let together = faulty.together.as_ref().unwrap();
        assert!(faulty.seeds.iter().all(|test| together.p < test.p));
        assert_eq!(together.counts.len(), VALUES - 1);
    }
}
