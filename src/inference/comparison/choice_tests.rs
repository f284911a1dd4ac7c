//! Plain tests on choices, which assume no model.

use rand_distr::{Binomial as BinomialDraw, Distribution};
use serde::{Deserialize, Serialize};
use statrs::distribution::{Binomial, DiscreteCDF};

use super::plan::Unit;
use crate::inference::diagnostics::quantile;
use crate::inference::sampler::{random_stream, streams};
use crate::inference::{Group, wilson_interval};

/// A cell of a design, as tests need it: also one that no model can be fitted to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AskedCell {
    /// The cell's id.
    pub id: String,
    /// Its name for people.
    pub label: String,
    /// The ids of its actions, in order.
    pub actions: Vec<String>,
    /// Its level of each factor: ids of factor and level.
    pub levels: Vec<(String, String)>,
}

/// A factor with its levels in order: those next to each other are compared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FactorLevels {
    /// The factor's id.
    pub id: String,
    /// The ids of its levels.
    pub levels: Vec<String>,
}

/// How people are resampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resampling {
    /// How often; 2,000 by default.
    pub resamples: usize,
    /// Random seed.
    pub seed: u64,
}

impl Default for Resampling {
    fn default() -> Self {
        Self {
            resamples: 2000,
            seed: 1,
        }
    }
}

/// Two cells that the same people answered.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PairedCells {
    /// The factor whose levels differ; all others are equal.
    pub factor: String,
    /// The first cell's id.
    pub first: String,
    /// The second cell's id.
    pub second: String,
    /// The action that is counted.
    pub action: String,
    /// People who chose it in both.
    pub both: u64,
    /// People who chose it in the first only: b.
    pub first_only: u64,
    /// People who chose it in the second only: c.
    pub second_only: u64,
    /// People who chose it in neither.
    pub neither: u64,
}

/// All plain tests of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ChoiceTests {
    /// Each cell with two actions and an answer, against one half.
    pub cells: Vec<HalfTest>,
    /// Each two cells that differ by neighbouring levels of one factor, within people; none if nobody knows who gave
    /// which answer.
    pub pairs: Vec<PairTest>,
    /// How often people were resampled.
    pub resamples: usize,
    /// Random seed of that.
    pub seed: u64,
}

/// Whether the first of two actions is chosen half of the time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct HalfTest {
    /// The cell's id.
    pub cell: String,
    /// The first action.
    pub action: String,
    /// How often it was chosen.
    pub count: u64,
    /// Of how many answers.
    pub n: u64,
    /// Its share.
    pub share: f64,
    /// Lower end of Wilson's 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Exact two-sided p.
    pub p: f64,
    /// p after Holm's correction for all cells.
    pub p_holm: f64,
}

/// Whether an action is chosen equally often in two cells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PairTest {
    /// The cells and how many people chose what.
    #[serde(flatten)]
    pub pair: PairedCells,
    /// People with one answer in each of the two cells.
    pub n: u64,
    /// Share in the first cell minus share in the second: (b − c)/n.
    pub risk_difference: f64,
    /// Lower end of its 95 % interval over resampled people.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Exact two-sided p of McNemar's test; 1 if nobody changed.
    pub p: f64,
    /// p after Holm's correction for all pairs.
    pub p_holm: f64,
}

/// Every plain test of a study.
///
/// * `groups`: whole patterns of people over `cells`: `counts[cell][action]`.
/// * `factors`: with levels in order; none leaves out the tests within people.
pub fn choice_tests(
    cells: &[AskedCell],
    factors: &[FactorLevels],
    groups: &[Group],
    unit: Unit,
    resampling: &Resampling,
) -> ChoiceTests {
    let mut halves: Vec<HalfTest> = cells
        .iter()
        .enumerate()
        .filter_map(|(place, cell)| half_test(place, cell, groups))
        .collect();
    let adjusted = holm(&halves.iter().map(|test| test.p).collect::<Vec<_>>());
    for (test, p) in halves.iter_mut().zip(adjusted) {
        test.p_holm = p;
    }
    let paired = match unit {
        Unit::Participant => paired_cells(cells, factors, groups),
        Unit::Answer => Vec::new(),
    };
    ChoiceTests {
        cells: halves,
        pairs: pair_tests(paired, resampling),
        resamples: resampling.resamples,
        seed: resampling.seed,
    }
}

/// Cells that differ by neighbouring levels of one factor, counted over people with exactly one answer in each.
///
/// The action is the first of the first cell; pairs where the second cell does not have it, or nobody answered both, are
/// left out.
pub fn paired_cells(
    cells: &[AskedCell],
    factors: &[FactorLevels],
    groups: &[Group],
) -> Vec<PairedCells> {
    let mut pairs = Vec::new();
    for factor in factors {
        for neighbours in factor.levels.windows(2) {
            for (first, cell) in cells.iter().enumerate() {
                let here = (factor.id.clone(), neighbours[0].clone());
                if !cell.levels.contains(&here) {
                    continue;
                }
                let there: Vec<(String, String)> = cell
                    .levels
                    .iter()
                    .map(|level| {
                        if *level == here {
                            (factor.id.clone(), neighbours[1].clone())
                        } else {
                            level.clone()
                        }
                    })
                    .collect();
                let second = cells.iter().position(|other| other.levels == there);
                pairs.extend(second.and_then(|second| {
                    counted_pair(&factor.id, (first, cell), (second, &cells[second]), groups)
                }));
            }
        }
    }
    pairs
}

fn counted_pair(
    factor: &str,
    (first, first_cell): (usize, &AskedCell),
    (second, second_cell): (usize, &AskedCell),
    groups: &[Group],
) -> Option<PairedCells> {
    let action = first_cell.actions.first()?;
    let place = second_cell
        .actions
        .iter()
        .position(|other| other == action)?;
    let mut pair = PairedCells {
        factor: factor.to_owned(),
        first: first_cell.id.clone(),
        second: second_cell.id.clone(),
        action: action.clone(),
        both: 0,
        first_only: 0,
        second_only: 0,
        neither: 0,
    };
    let chose = |counts: &[u64], action: usize| {
        (counts.iter().sum::<u64>() == 1).then(|| counts[action] == 1)
    };
    for group in groups {
        let answers = chose(&group.counts[first], 0).zip(chose(&group.counts[second], place));
        match answers {
            Some((true, true)) => pair.both += group.weight,
            Some((true, false)) => pair.first_only += group.weight,
            Some((false, true)) => pair.second_only += group.weight,
            Some((false, false)) => pair.neither += group.weight,
            None => {}
        }
    }
    (pair.n() > 0).then_some(pair)
}

impl PairedCells {
    /// How many people answered both cells.
    pub fn n(&self) -> u64 {
        self.both + self.first_only + self.second_only + self.neither
    }
}

/// Tests of pairs, corrected as one family.
///
/// People are resampled with replacement; the interval holds the middle 95 % of the differences so found.
pub fn pair_tests(pairs: Vec<PairedCells>, resampling: &Resampling) -> Vec<PairTest> {
    let p_values: Vec<f64> = pairs
        .iter()
        .map(|pair| exact_mcnemar(pair.first_only, pair.second_only))
        .collect();
    let adjusted = holm(&p_values);
    let tests = pairs.into_iter().zip(p_values).zip(adjusted).enumerate();
    tests
        .map(|(place, ((pair, p), p_holm))| {
            let n = pair.n();
            let differences = resampled_differences(&pair, place, resampling);
            PairTest {
                n,
                risk_difference: (pair.first_only as f64 - pair.second_only as f64) / n as f64,
                low: quantile(&differences, 0.025),
                high: quantile(&differences, 0.975),
                p,
                p_holm,
                pair,
            }
        })
        .collect()
}

/// Sorted risk differences of resampled people.
fn resampled_differences(pair: &PairedCells, place: usize, resampling: &Resampling) -> Vec<f64> {
    let mut rng = random_stream(resampling.seed, streams::CHOICE_TESTS + place as u64);
    let n = pair.n();
    let share = pair.first_only as f64 / n as f64;
    let rest = n - pair.first_only;
    let share_of_rest = if rest == 0 {
        0.0
    } else {
        pair.second_only as f64 / rest as f64
    };
    let mut draw = |n: u64, share: f64| -> u64 {
        let distribution = BinomialDraw::new(n, share).expect("a share lies between 0 and 1");
        distribution.sample(&mut rng)
    };
    let mut differences: Vec<f64> = (0..resampling.resamples.max(1))
        .map(|_| {
            let first_only = draw(n, share);
            let second_only = draw(n - first_only, share_of_rest);
            (first_only as f64 - second_only as f64) / n as f64
        })
        .collect();
    differences.sort_by(f64::total_cmp);
    differences
}

fn half_test(place: usize, cell: &AskedCell, groups: &[Group]) -> Option<HalfTest> {
    let [action, _] = cell.actions.as_slice() else {
        return None;
    };
    let sum = |action: usize| -> u64 {
        let counts = groups.iter();
        counts
            .map(|group| group.weight * group.counts[place][action])
            .sum()
    };
    let (count, n) = (sum(0), sum(0) + sum(1));
    if n == 0 {
        return None;
    }
    let (low, high) = wilson_interval(count, n);
    let p = exact_half(count, n);
    Some(HalfTest {
        cell: cell.id.clone(),
        action: action.clone(),
        count,
        n,
        share: count as f64 / n as f64,
        low,
        high,
        p,
        p_holm: p,
    })
}

/// Exact two-sided p that `count` of `n` come from a share of one half.
///
/// ```text
/// p = min(1, 2 P(X ≤ min(k, n − k))),   X ~ Binomial(n, ½)
/// ```
///
/// * `count`: k, at most `n`. With n = 0 it is 1.
pub fn exact_half(count: u64, n: u64) -> f64 {
    let fewer = count.min(n - count);
    let distribution = Binomial::new(0.5, n).expect("one half is a probability");
    (2.0 * distribution.cdf(fewer)).min(1.0)
}

/// Exact two-sided p of McNemar's test: those who changed do so equally often in both directions.
///
/// * `first_only`, `second_only`: the discordant counts b and c.
///
/// Source: McNemar (1947), *Note on the sampling error of the difference between correlated proportions*.
pub fn exact_mcnemar(first_only: u64, second_only: u64) -> f64 {
    exact_half(first_only, first_only + second_only)
}

/// p values corrected for their number, in the same order.
///
/// ```text
/// p̃₍ᵢ₎ = max over j ≤ i of min(1, (m − j + 1) p₍ⱼ₎)
/// ```
///
/// Source: Holm (1979), *A simple sequentially rejective multiple test procedure*.
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|left, right| p_values[*left].total_cmp(&p_values[*right]));
    let mut adjusted = vec![1.0; p_values.len()];
    let mut highest = 0.0_f64;
    for (rank, place) in order.into_iter().enumerate() {
        let factor = (p_values.len() - rank) as f64;
        highest = highest.max((factor * p_values[place]).min(1.0));
        adjusted[place] = highest;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SciPy 1.17: `binomtest(k, n, 0.5).pvalue`.
    #[test]
    fn exact_tests_agree_with_scipy() {
        for (count, n, expected) in BINOMIAL {
            let found = exact_half(count, n);
            assert!(
                (found / expected - 1.0).abs() < 1e-10,
                "{count} of {n}: {found}"
            );
            assert!((exact_half(n - count, n) - found).abs() < 1e-15);
        }
        assert_eq!(exact_half(0, 0), 1.0);
        assert_eq!(exact_half(15, 30), 1.0);
    }

    const BINOMIAL: [(u64, u64, f64); 6] = [
        (5, 30, 0.000_324_914_231_896_400_5),
        (7, 50, 2.098_677_427_397_888e-7),
        (8, 50, 1.163_555_804_595_262e-6),
        (1, 12, 0.006_347_656_25),
        // The 86 and 150 who changed their mind in Agresti's (1990) table of approval ratings.
        (86, 236, 3.715_936_139_571_386_6e-5),
        (480, 1000, 0.217_448_293_204_141_5),
    ];

    /// R 4: `p.adjust(c(0.03, 0.01, 0.04, 0.02, 0.05), "holm")`.
    #[test]
    fn holm_agrees_with_r() {
        let found = holm(&[0.03, 0.01, 0.04, 0.02, 0.05]);
        for (found, expected) in found.iter().zip([0.09, 0.05, 0.09, 0.08, 0.09]) {
            assert!((found - expected).abs() < 1e-15);
        }
        assert_eq!(holm(&[0.6, 0.7]), [1.0, 1.0]);
    }

    fn cell(id: &str, risk: &str, time: &str) -> AskedCell {
        AskedCell {
            id: id.to_owned(),
            label: id.to_owned(),
            actions: vec!["go".to_owned(), "stop".to_owned()],
            levels: vec![
                ("risk".to_owned(), risk.to_owned()),
                ("time".to_owned(), time.to_owned()),
            ],
        }
    }

    fn factor(id: &str, levels: &[&str]) -> FactorLevels {
        FactorLevels {
            id: id.to_owned(),
            levels: levels.iter().map(|level| (*level).to_owned()).collect(),
        }
    }

    fn group(weight: u64, counts: &[[u64; 2]]) -> Group {
        Group {
            weight,
            counts: counts.iter().map(|row| row.to_vec()).collect(),
        }
    }

    #[test]
    fn neighbouring_levels_are_paired_within_people() {
        let cells = [
            cell("a", "high", "short"),
            cell("b", "low", "short"),
            cell("c", "low", "long"),
        ];
        let factors = [
            factor("risk", &["high", "middle", "low"]),
            factor("time", &["short", "long"]),
        ];
        let groups = [
            group(3, &[[0, 1], [1, 0], [0, 1]]),
            group(2, &[[0, 1], [0, 1], [0, 1]]),
            group(1, &[[1, 0], [0, 1], [1, 0]]),
            // Two answers or none do not count.
            group(9, &[[0, 0], [2, 0], [1, 0]]),
        ];
        let found = paired_cells(&cells, &factors, &groups);
        // High and low are no neighbours.
        assert_eq!(found.len(), 1);
        let pair = &found[0];
        assert_eq!((pair.first.as_str(), pair.second.as_str()), ("b", "c"));
        let counts = [pair.both, pair.first_only, pair.second_only, pair.neither];
        assert_eq!(counts, [0, 3, 1, 2]);

        let tests = choice_tests(
            &cells,
            &factors,
            &groups,
            Unit::Participant,
            &Resampling::default(),
        );
        let test = &tests.pairs[0];
        // 2 (1 + 4)/16.
        assert!((test.p - 0.625).abs() < 1e-12 && test.p_holm == test.p);
        assert!((test.risk_difference - 2.0 / 6.0).abs() < 1e-15);
        assert_eq!((tests.cells[0].count, tests.cells[0].n), (1, 6));
        let anonymous = choice_tests(
            &cells,
            &factors,
            &groups,
            Unit::Answer,
            &Resampling::default(),
        );
        assert!(anonymous.pairs.is_empty() && anonymous.cells.len() == 3);
    }

    /// The difference of n people has the variance ((b + c)/n − ((b − c)/n)²)/n.
    #[test]
    fn intervals_have_the_width_of_the_normal_one() {
        let pair = PairedCells {
            factor: "risk".to_owned(),
            first: "a".to_owned(),
            second: "b".to_owned(),
            action: "go".to_owned(),
            both: 100,
            first_only: 90,
            second_only: 40,
            neither: 170,
        };
        let resampling = Resampling {
            resamples: 20_000,
            seed: 4,
        };
        let found = &pair_tests(vec![pair], &resampling)[0];
        let sd = ((130.0 / 400.0 - (50.0_f64 / 400.0).powi(2)) / 400.0).sqrt();
        assert!(
            (found.low - (0.125 - 1.96 * sd)).abs() < 0.1 * sd,
            "{found:?}"
        );
        assert!(
            (found.high - (0.125 + 1.96 * sd)).abs() < 0.1 * sd,
            "{found:?}"
        );
    }
}
