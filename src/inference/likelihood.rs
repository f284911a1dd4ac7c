//! How likely choices are: counts per distinct problem times log-probabilities.

use std::array;
use std::cmp::Ordering;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use super::lanes::{InstructionSet, Kernel, LANES, exp, ln, ln_1p_of_share};
use super::utility_table::{ParameterLanes, UtilityTable, lanes_of};
use super::{ChoiceData, Draws, Quantity};
use crate::model::{ChoiceProblem, Curvature, Parameter, Parameters, Prospect, RiskAwareOptions};

/// Counts of choices over problems, in a form that does not depend on the order or the names in the data.
///
/// ```text
/// ln L = Σ_problems Σ_a n(problem, a) ln P(a | problem)
/// ```
///
/// Problems with the same prospects are one; those that nobody answered are left out. Binomial coefficients are too.
/// All is computed for as many parameter vectors at once as there are lanes.
#[derive(Debug, Clone)]
pub(super) struct Likelihood {
    table: UtilityTable,
    pairs: Vec<CountedPair>,
    others: Vec<CountedProblem>,
    answers: f64,
}

/// A problem with two actions, which needs no softmax.
#[derive(Debug, Clone, Copy)]
struct CountedPair {
    /// Which prospects of the table the actions have.
    prospects: [u32; 2],
    counts: [f64; 2],
}

#[derive(Debug, Clone)]
struct CountedProblem {
    prospects: Vec<u32>,
    counts: Vec<f64>,
    answers: f64,
}

impl Likelihood {
    pub(super) fn new(data: &ChoiceData, options: RiskAwareOptions) -> Self {
        let answered = || {
            data.problems()
                .iter()
                .zip(data.totals())
                .filter(|(_, counts)| counts.iter().any(|n| *n > 0))
        };
        let mut prospects: Vec<&Prospect> = answered()
            .flat_map(|(problem, _)| problem.problem.actions())
            .map(|action| &action.prospect)
            .collect();
        prospects.sort_by(|left, right| canonical_order(left, right));
        prospects.dedup();
        let position = |prospect: &Prospect| {
            // Every prospect was put there above.
            prospects
                .binary_search_by(|known| canonical_order(known, prospect))
                .unwrap_or_else(|place| place) as u32
        };
        let mut merged: BTreeMap<Vec<u32>, Vec<u64>> = BTreeMap::new();
        for (problem, counts) in answered() {
            let actions = problem.problem.actions().iter();
            let mut pairs: Vec<(u32, u64)> = actions
                .zip(counts)
                .map(|(action, count)| (position(&action.prospect), *count))
                .collect();
            pairs.sort_unstable();
            let (key, counts): (Vec<u32>, Vec<u64>) = pairs.into_iter().unzip();
            let sums = merged.entry(key).or_insert_with(|| vec![0; counts.len()]);
            for (sum, count) in sums.iter_mut().zip(counts) {
                *sum += count;
            }
        }
        let mut likelihood = Self {
            table: UtilityTable::new(prospects.iter().copied(), options),
            pairs: Vec::new(),
            others: Vec::new(),
            answers: merged.values().flatten().sum::<u64>() as f64,
        };
        for (prospects, counts) in merged {
            let counts: Vec<f64> = counts.into_iter().map(|count| count as f64).collect();
            if let (Ok(prospects), Ok(counts)) = (
                prospects.as_slice().try_into(),
                counts.as_slice().try_into(),
            ) {
                likelihood.pairs.push(CountedPair { prospects, counts });
            } else {
                likelihood.others.push(CountedProblem {
                    prospects,
                    answers: counts.iter().sum(),
                    counts,
                });
            }
        }
        likelihood
    }

    /// Σ n d² / Σ n over the problems, d the spread max U − min U of each; 0 without answers.
    #[inline(always)]
    pub(super) fn mean_squared_spread<const W: usize>(
        &mut self,
        parameters: &ParameterLanes<W>,
    ) -> [f64; W] {
        let utilities = self.table.utilities(parameters);
        mean_squared_spread(&self.pairs, &self.others, self.answers, utilities)
    }

    /// ln L; −∞ where decision weights vanish or a choice that was made is impossible.
    ///
    /// * `sensitivity`: θ, given the [mean squared spread](Self::mean_squared_spread) at the other parameters.
    #[inline(always)]
    pub(super) fn ln_likelihood<const W: usize>(
        &mut self,
        parameters: &ParameterLanes<W>,
        sensitivity: impl FnOnce(&[f64; W]) -> [f64; W],
    ) -> [f64; W] {
        let utilities = self.table.utilities(parameters);
        let theta = sensitivity(&mean_squared_spread(
            &self.pairs,
            &self.others,
            self.answers,
            utilities,
        ));
        let mut sum = [0.0; W];
        for pair in &self.pairs {
            let [first, second] = pair.prospects.map(|index| &utilities[index as usize]);
            let [first_count, second_count] = pair.counts;
            let answers = first_count + second_count;
            for lane in 0..W {
                let gap = first[lane] - second[lane];
                let against = if gap >= 0.0 {
                    second_count
                } else {
                    first_count
                };
                let distance = theta[lane] * gap.abs();
                // No sensitivity, no distance, however large the gap.
                let distance = if theta[lane] == 0.0 { 0.0 } else { distance };
                // Without such choices an infinite distance costs nothing.
                let lost = if against > 0.0 {
                    against * distance
                } else {
                    0.0
                };
                let lost = if distance.is_nan() { f64::NAN } else { lost };
                sum[lane] -= answers * ln_1p_of_share(exp(-distance)) + lost;
            }
        }
        for problem in &self.others {
            let (highest, _) = extremes(utilities, &problem.prospects);
            let mut total = [0.0; W];
            for index in &problem.prospects {
                let utility = &utilities[*index as usize];
                for lane in 0..W {
                    total[lane] += exp(-behind(highest[lane], utility[lane], theta[lane]));
                }
            }
            for lane in 0..W {
                sum[lane] -= problem.answers * ln(total[lane]);
            }
            for (index, count) in problem.prospects.iter().zip(&problem.counts) {
                if *count > 0.0 {
                    let utility = &utilities[*index as usize];
                    for lane in 0..W {
                        sum[lane] -= count * behind(highest[lane], utility[lane], theta[lane]);
                    }
                }
            }
        }
        for sum in &mut sum {
            *sum = if sum.is_nan() {
                f64::NEG_INFINITY
            } else {
                *sum
            };
        }
        sum
    }

    /// The utility gaps of all actions to the first of their problem, problem after problem.
    pub(super) fn gaps<const W: usize>(&mut self, parameters: &ParameterLanes<W>) -> Vec<[f64; W]> {
        let utilities = self.table.utilities(parameters);
        let pairs = self.pairs.iter().map(|pair| pair.prospects.as_slice());
        let others = self.others.iter().map(|other| other.prospects.as_slice());
        let mut gaps = Vec::new();
        for prospects in pairs.chain(others) {
            let first = &utilities[prospects[0] as usize];
            for index in &prospects[1..] {
                let other = &utilities[*index as usize];
                gaps.push(array::from_fn(|lane| other[lane] - first[lane]));
            }
        }
        gaps
    }
}

#[inline(always)]
fn mean_squared_spread<const W: usize>(
    pairs: &[CountedPair],
    others: &[CountedProblem],
    answers: f64,
    utilities: &[[f64; W]],
) -> [f64; W] {
    let mut squares = [0.0; W];
    for pair in pairs {
        let [first, second] = pair.prospects.map(|index| &utilities[index as usize]);
        let answers = pair.counts[0] + pair.counts[1];
        for lane in 0..W {
            let gap = first[lane] - second[lane];
            squares[lane] += answers * (gap * gap);
        }
    }
    for problem in others {
        let (highest, lowest) = extremes(utilities, &problem.prospects);
        for lane in 0..W {
            let spread = highest[lane] - lowest[lane];
            squares[lane] += problem.answers * (spread * spread);
        }
    }
    let share = if answers > 0.0 { 1.0 / answers } else { 0.0 };
    for square in &mut squares {
        *square *= share;
    }
    squares
}

/// The highest and the lowest utility of a problem; NaN where one of them is.
#[inline(always)]
fn extremes<const W: usize>(utilities: &[[f64; W]], prospects: &[u32]) -> ([f64; W], [f64; W]) {
    let mut highest = utilities[prospects[0] as usize];
    let mut lowest = highest;
    for index in &prospects[1..] {
        let utility = &utilities[*index as usize];
        for lane in 0..W {
            let (high, low, now) = (highest[lane], lowest[lane], utility[lane]);
            highest[lane] = if now > high || now.is_nan() {
                now
            } else {
                high
            };
            lowest[lane] = if now < low || now.is_nan() { now } else { low };
        }
    }
    (highest, lowest)
}

/// How far an action is behind the best one, in logits; NaN where a utility is.
#[inline(always)]
fn behind(highest: f64, utility: f64, theta: f64) -> f64 {
    let gap = highest - utility;
    if theta == 0.0 && !gap.is_nan() {
        0.0
    } else {
        theta * gap
    }
}

/// ln P(a) for the actions of many problems at once, equal problems once.
#[derive(Debug, Clone)]
pub(super) struct Predictor {
    table: UtilityTable,
    /// Which prospects of the table the actions have, distinct problem after distinct problem.
    prospects: Vec<u32>,
    /// Where each distinct problem's actions begin and end among them.
    ends: Vec<usize>,
    /// Which distinct problem each problem is: the same prospects in the same order.
    distinct: Vec<usize>,
}

impl Predictor {
    pub(super) fn new<'a>(
        problems: impl IntoIterator<Item = &'a ChoiceProblem>,
        options: RiskAwareOptions,
    ) -> Self {
        let mut known_prospects: HashMap<Vec<u64>, u32> = HashMap::new();
        let mut known_problems: HashMap<Vec<u32>, usize> = HashMap::new();
        let mut tabled = Vec::new();
        let mut prospects = Vec::new();
        let mut ends = vec![0];
        let mut distinct = Vec::new();
        for problem in problems {
            let actions = problem.actions().iter().map(|action| {
                let key = key(&action.prospect)
                    .into_iter()
                    .map(f64::to_bits)
                    .collect();
                *known_prospects.entry(key).or_insert_with(|| {
                    tabled.push(&action.prospect);
                    tabled.len() as u32 - 1
                })
            });
            let actions: Vec<u32> = actions.collect();
            let next = known_problems.len();
            let place = *known_problems.entry(actions).or_insert_with_key(|actions| {
                prospects.extend_from_slice(actions);
                ends.push(prospects.len());
                next
            });
            distinct.push(place);
        }
        Self {
            table: UtilityTable::new(tabled, options),
            prospects,
            ends,
            distinct,
        }
    }

    /// ln P(a) per problem and action, problem after problem; NaN where decision weights vanish.
    pub(super) fn ln_probabilities(&mut self, parameters: &Parameters) -> Vec<f64> {
        let mut found = vec![[0.0; 1]; self.prospects.len()];
        self.of_lanes(&lanes_of(parameters), &mut found);
        let problems = 0..self.problems();
        problems
            .flat_map(|problem| &found[self.range(problem)])
            .map(|[ln_p]| *ln_p)
            .collect()
    }

    /// ln P(a) for all draws: a column for each action of each distinct problem, which [`range`](Self::range) finds.
    pub(super) fn of_draws(&mut self, draws: &Draws) -> Vec<Vec<f64>> {
        const W: usize = 4 * LANES;
        let mut columns = vec![vec![0.0; draws.len()]; self.prospects.len()];
        let mut found = vec![[0.0; W]; self.prospects.len()];
        for start in (0..draws.len()).step_by(W) {
            let end = (start + W).min(draws.len());
            let mut parameters: ParameterLanes<W> = lanes_of(&Parameters::ONES);
            for (quantity, values) in &draws.columns {
                if let Quantity::Parameter(name) = quantity {
                    // The last block ends with copies of the last draw.
                    let lanes = &mut parameters[*name as usize];
                    *lanes = [values[end - 1]; W];
                    lanes[..end - start].copy_from_slice(&values[start..end]);
                }
            }
            if draws.model.curvature == Curvature::Shared {
                parameters[Parameter::Beta as usize] = parameters[Parameter::Alpha as usize];
            }
            InstructionSet::widest().run(Predict {
                predictor: self,
                parameters: &parameters,
                found: &mut found,
            });
            for (column, values) in columns.iter_mut().zip(&found) {
                column[start..end].copy_from_slice(&values[..end - start]);
            }
        }
        columns
    }

    #[inline(always)]
    fn of_lanes<const W: usize>(
        &mut self,
        parameters: &ParameterLanes<W>,
        ln_probabilities: &mut [[f64; W]],
    ) {
        let theta = &parameters[Parameter::Theta as usize];
        let utilities = self.table.utilities(parameters);
        for pair in self.ends.windows(2) {
            let prospects = &self.prospects[pair[0]..pair[1]];
            let results = &mut ln_probabilities[pair[0]..pair[1]];
            let (highest, _) = extremes(utilities, prospects);
            // Of the others beside a best one, so that a probability near 1 keeps its digits.
            let mut total = [0.0; W];
            let mut best = [false; W];
            for (result, index) in results.iter_mut().zip(prospects) {
                let utility = &utilities[*index as usize];
                for lane in 0..W {
                    let behind = behind(highest[lane], utility[lane], theta[lane]);
                    result[lane] = -behind;
                    let is_best = utility[lane] == highest[lane] && !best[lane];
                    best[lane] |= is_best;
                    total[lane] += if is_best { 0.0 } else { exp(-behind) };
                }
            }
            let mut ln_total = [0.0; W];
            for lane in 0..W {
                // More than two actions may sum to more than a share.
                let sum = 1.0 + total[lane];
                ln_total[lane] = ln(sum) + (total[lane] - (sum - 1.0)) / sum;
            }
            for result in results {
                for lane in 0..W {
                    result[lane] -= ln_total[lane];
                }
            }
        }
    }

    /// How many problems there are.
    pub(super) fn problems(&self) -> usize {
        self.distinct.len()
    }

    /// Which distinct problem a problem is, counted from 0 as they first come.
    pub(super) fn distinct(&self, problem: usize) -> usize {
        self.distinct[problem]
    }

    /// Where the actions of each distinct problem stand among all columns.
    pub(super) fn distinct_ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        self.ends.windows(2).map(|pair| pair[0]..pair[1])
    }

    /// Where the actions of a problem stand among all columns.
    pub(super) fn range(&self, problem: usize) -> Range<usize> {
        let distinct = self.distinct[problem];
        self.ends[distinct]..self.ends[distinct + 1]
    }
}

/// A block of draws at once.
struct Predict<'a, const W: usize> {
    predictor: &'a mut Predictor,
    parameters: &'a ParameterLanes<W>,
    found: &'a mut [[f64; W]],
}

impl<const W: usize> Kernel for Predict<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.predictor.of_lanes(self.parameters, self.found);
    }
}

/// The outcomes in one list: two prospects with the same list are the same.
pub(super) fn key(prospect: &Prospect) -> Vec<f64> {
    prospect
        .outcomes()
        .iter()
        .flat_map(|outcome| [outcome.reward, outcome.probability])
        .collect()
}

fn canonical_order(left: &Prospect, right: &Prospect) -> Ordering {
    let (left, right) = (key(left), key(right));
    let differing = left
        .iter()
        .zip(&right)
        .map(|(l, r)| l.total_cmp(r))
        .find(|order| order.is_ne());
    differing.unwrap_or(left.len().cmp(&right.len()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::choice_data::tests::data;
    use crate::model::{RISK_AWARE, ln_probabilities};

    const STABLE: &[(f64, f64)] = &[(1.0, 20.0)];
    const UNSTABLE: &[(f64, f64)] = &[(0.2, 105.0), (0.8, 0.0)];
    const THIRD: &[(f64, f64)] = &[(0.5, 30.0), (0.5, -5.0)];

    fn at(likelihood: &mut Likelihood, parameters: &Parameters) -> f64 {
        let theta = parameters.get(Parameter::Theta);
        likelihood.ln_likelihood(&lanes_of(parameters), |_| [theta])[0]
    }

    fn chooser() -> Parameters {
        let values = [0.8, 0.7, 0.6, 0.5, 2.0, 0.1];
        let entries = RISK_AWARE
            .parameters
            .iter()
            .zip(values)
            .map(|(name, value)| (name.key(), value));
        RISK_AWARE.parameters_from(entries).unwrap()
    }

    #[test]
    fn it_is_the_sum_of_counts_times_log_probabilities() {
        let data = data(&[
            ("two", &[("a", STABLE), ("b", UNSTABLE)], &[3, 5]),
            (
                "three",
                &[("a", STABLE), ("b", UNSTABLE), ("c", THIRD)],
                &[2, 0, 7],
            ),
        ]);
        let options = RiskAwareOptions::default();
        let mut expected = 0.0;
        for (problem, counts) in data.problems().iter().zip(data.totals()) {
            let ln_p = ln_probabilities(&problem.problem, &chooser(), options).unwrap();
            expected += counts
                .iter()
                .zip(ln_p)
                .map(|(n, ln_p)| *n as f64 * ln_p)
                .sum::<f64>();
        }
        let found = at(&mut Likelihood::new(&data, options), &chooser());
        assert!((found - expected).abs() < 1e-10);
    }

    #[test]
    fn order_names_and_cells_nobody_answered_do_not_matter() {
        let one = data(&[
            ("x", &[("a", STABLE), ("b", UNSTABLE)], &[3, 5]),
            ("y", &[("a", STABLE), ("b", UNSTABLE)], &[1, 1]),
            ("z", &[("a", STABLE), ("c", THIRD)], &[4, 2]),
        ]);
        let other = data(&[
            ("empty", &[("a", STABLE), ("c", &[(1.0, 1e6)])], &[0, 0]),
            ("zz", &[("d", THIRD), ("a", STABLE)], &[2, 4]),
            ("xx", &[("e", UNSTABLE), ("a", STABLE)], &[6, 4]),
        ]);
        let options = RiskAwareOptions::default();
        let found = at(&mut Likelihood::new(&one, options), &chooser());
        assert_eq!(found, at(&mut Likelihood::new(&other, options), &chooser()));
        assert_eq!(Likelihood::new(&one, options).pairs.len(), 2);
    }

    #[test]
    fn impossible_choices_have_no_likelihood() {
        let data = data(&[("x", &[("a", STABLE), ("b", UNSTABLE)], &[3, 0])]);
        let mut likelihood = Likelihood::new(&data, RiskAwareOptions::default());
        let sharp = Parameters::ONES.with(Parameter::Theta, f64::MAX).unwrap();
        assert_eq!(at(&mut likelihood, &sharp), f64::NEG_INFINITY);
        let blunt = Parameters::ONES.with(Parameter::Theta, 0.0).unwrap();
        assert!((at(&mut likelihood, &blunt) - 3.0 * 0.5_f64.ln()).abs() < 1e-12);
    }
}
