//! The normal scores of ranks.

use crate::inference::lanes::{InstructionSet, Kernel, ln};

/// Φ⁻¹((r − 3/8)/(S + 1/4)) for the ranks r of S draws, halves included, since ties share their mean rank.
#[derive(Debug, Clone)]
pub struct NormalScores {
    /// Of rank 1, 1½, 2, … S.
    scores: Vec<f64>,
}

impl NormalScores {
    /// The scores of this many draws.
    pub fn new(size: usize) -> Self {
        let mut scores: Vec<f64> = (2..=2 * size)
            .map(|twice| (0.5 * twice as f64 - 0.375) / (size as f64 + 0.25))
            .collect();
        InstructionSet::widest().run(Quantiles(&mut scores));
        Self { scores }
    }

    /// The score of a rank, given as twice of it.
    pub(super) fn of(&self, twice: usize) -> f64 {
        self.scores[twice - 2]
    }

    /// How many draws there are.
    pub(super) fn size(&self) -> usize {
        self.scores.len().div_ceil(2)
    }
}

/// Standard normal quantiles of probabilities in place.
struct Quantiles<'a>(&'a mut [f64]);

impl Kernel for Quantiles<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for value in self.0 {
            *value = normal_quantile(*value);
        }
    }
}

const CENTRE: [[f64; 8]; 2] = [
    [
        2.509_080_928_730_122_7e3,
        3.343_057_558_358_813e4,
        6.726_577_092_700_87e4,
        4.592_195_393_154_987e4,
        1.373_169_376_550_946e4,
        1.971_590_950_306_551_3e3,
        1.331_416_678_917_843_8e2,
        3.387_132_872_796_366_5,
    ],
    [
        5.226_495_278_852_854e3,
        2.872_908_573_572_194_3e4,
        3.930_789_580_009_271e4,
        2.121_379_430_158_659_7e4,
        5.394_196_021_424_751e3,
        6.871_870_074_920_579e2,
        4.231_333_070_160_091e1,
        1.0,
    ],
];

const TAIL: [[f64; 8]; 2] = [
    [
        7.745_450_142_783_414e-4,
        2.272_384_498_926_918_4e-2,
        2.417_807_251_774_506e-1,
        1.270_458_252_452_368_4,
        3.647_848_324_763_204_5,
        5.769_497_221_460_691,
        4.630_337_846_156_546,
        1.423_437_110_749_683_5,
    ],
    [
        1.050_750_071_644_416_9e-9,
        5.475_938_084_995_345e-4,
        1.519_866_656_361_645_7e-2,
        1.481_039_764_274_800_8e-1,
        6.897_673_349_851e-1,
        1.676_384_830_183_803_8,
        2.053_191_626_637_759,
        1.0,
    ],
];

/// Φ⁻¹(p) for p from 10⁻¹⁰ to 1 − 10⁻¹⁰, by the rational functions of algorithm AS 241 (Wichura 1988).
#[inline(always)]
fn normal_quantile(p: f64) -> f64 {
    let ratio = |[above, below]: &[[f64; 8]; 2], x: f64| {
        let horner = |coefficients: &[f64; 8]| {
            let mut value = coefficients[0];
            for coefficient in &coefficients[1..] {
                value = value * x + coefficient;
            }
            value
        };
        horner(above) / horner(below)
    };
    let q = p - 0.5;
    let centre = q * ratio(&CENTRE, 0.180_625 - q * q);
    let share = if q < 0.0 { p } else { 1.0 - p };
    let tail = ratio(&TAIL, (-ln(share)).sqrt() - 1.6);
    let tail = if q < 0.0 { -tail } else { tail };
    if q.abs() <= 0.425 { centre } else { tail }
}

#[cfg(test)]
mod tests {
    use statrs::distribution::{ContinuousCDF, Normal};

    use super::*;

    #[test]
    fn scores_are_quantiles_of_the_normal_distribution() {
        for size in [4, 100, 3001] {
            let scores = NormalScores::new(size);
            assert_eq!(scores.size(), size);
            for twice in 2..=2 * size {
                let p = (0.5 * twice as f64 - 0.375) / (size as f64 + 0.25);
                let expected = Normal::standard().inverse_cdf(p);
                assert!(
                    (scores.of(twice) - expected).abs() < 1e-9,
                    "{twice} of {size}"
                );
            }
        }
        assert!((normal_quantile(1e-9) - Normal::standard().inverse_cdf(1e-9)).abs() < 1e-8);
    }
}
