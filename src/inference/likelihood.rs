//! How likely choices are: counts per distinct problem times log-probabilities.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use super::ChoiceData;
use super::utility_table::UtilityTable;
use crate::model::{ChoiceProblem, Parameters, Prospect, RiskAwareOptions, ln_softmax_into};

/// Counts of choices over problems, in a form that does not depend on the order or the names in the data.
///
/// ```text
/// ln L = Σ_problems Σ_a n(problem, a) ln P(a | problem)
/// ```
///
/// Problems with the same prospects are one; those that nobody answered are left out. Binomial coefficients are too.
#[derive(Debug, Clone)]
pub(super) struct Likelihood {
    table: UtilityTable,
    problems: Vec<CountedProblem>,
    answers: f64,
    scratch: Vec<f64>,
}

#[derive(Debug, Clone)]
struct CountedProblem {
    /// Which prospects of the table the actions have.
    prospects: Vec<usize>,
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
        let mut prospects: Vec<Prospect> = answered()
            .flat_map(|(problem, _)| problem.problem.actions())
            .map(|action| action.prospect.clone())
            .collect();
        prospects.sort_by(canonical_order);
        prospects.dedup();
        let position = |prospect: &Prospect| {
            // Every prospect was put there above.
            prospects
                .binary_search_by(|known| canonical_order(known, prospect))
                .unwrap_or_else(|place| place)
        };
        let mut merged: BTreeMap<Vec<usize>, Vec<u64>> = BTreeMap::new();
        for (problem, counts) in answered() {
            let actions = problem.problem.actions().iter();
            let mut pairs: Vec<(usize, u64)> = actions
                .zip(counts)
                .map(|(action, count)| (position(&action.prospect), *count))
                .collect();
            pairs.sort_unstable();
            let (key, counts): (Vec<usize>, Vec<u64>) = pairs.into_iter().unzip();
            let sums = merged.entry(key).or_insert_with(|| vec![0; counts.len()]);
            for (sum, count) in sums.iter_mut().zip(counts) {
                *sum += count;
            }
        }
        let problems: Vec<CountedProblem> = merged
            .into_iter()
            .map(|(prospects, counts)| CountedProblem {
                prospects,
                answers: counts.iter().sum::<u64>() as f64,
                counts: counts.into_iter().map(|count| count as f64).collect(),
            })
            .collect();
        Self {
            table: UtilityTable::new(&prospects, options),
            answers: problems.iter().map(|problem| problem.answers).sum(),
            problems,
            scratch: Vec::new(),
        }
    }

    /// Σ n d² / Σ n over the problems, d the spread max U − min U of each; 0 without answers.
    pub(super) fn mean_squared_spread(&mut self, parameters: &Parameters) -> f64 {
        let utilities = self.table.utilities(parameters);
        let mut sum = 0.0;
        for problem in &self.problems {
            let of_actions = || problem.prospects.iter().map(|index| utilities[*index]);
            let spread = of_actions().fold(f64::NEG_INFINITY, f64::max)
                - of_actions().fold(f64::INFINITY, f64::min);
            sum += problem.answers * spread * spread;
        }
        if self.answers > 0.0 {
            sum / self.answers
        } else {
            0.0
        }
    }

    /// ln L at these parameters; −∞ where decision weights vanish or a choice that was made is impossible.
    pub(super) fn ln_likelihood(&mut self, parameters: &Parameters) -> f64 {
        let theta = parameters.get(crate::model::Parameter::Theta);
        let utilities = self.table.utilities(parameters);
        let mut sum = 0.0;
        for problem in &self.problems {
            sum += if let ([first, second], [first_count, second_count]) =
                (problem.prospects.as_slice(), problem.counts.as_slice())
            {
                let gap = utilities[*first] - utilities[*second];
                let (favoured, other) = if gap >= 0.0 {
                    (first_count, second_count)
                } else {
                    (second_count, first_count)
                };
                let distance = if theta == 0.0 { 0.0 } else { theta * gap.abs() };
                let odds = (-distance).exp().ln_1p();
                // Without such choices an infinite distance costs nothing.
                let lost = if *other > 0.0 {
                    other * (distance + odds)
                } else {
                    0.0
                };
                -(favoured * odds + lost)
            } else {
                self.scratch.clear();
                self.scratch
                    .extend(problem.prospects.iter().map(|index| utilities[*index]));
                ln_softmax_into(theta, &mut self.scratch);
                let pairs = problem.counts.iter().zip(&self.scratch);
                pairs
                    .filter(|(count, _)| **count > 0.0)
                    .map(|(count, ln_p)| count * ln_p)
                    .sum()
            };
        }
        if sum.is_nan() { f64::NEG_INFINITY } else { sum }
    }

    /// The utility gaps of all actions to the first of their problem, problem after problem.
    pub(super) fn gaps(&mut self, parameters: &Parameters) -> Vec<f64> {
        let utilities = self.table.utilities(parameters);
        let of_problem = |problem: &CountedProblem| -> Vec<f64> {
            let first = utilities[problem.prospects[0]];
            problem.prospects[1..]
                .iter()
                .map(|index| utilities[*index] - first)
                .collect()
        };
        self.problems.iter().flat_map(of_problem).collect()
    }
}

/// ln P(a) for the actions of many problems at once.
#[derive(Debug, Clone)]
pub(super) struct Predictor {
    table: UtilityTable,
    /// Where each problem's actions begin and end among the table's prospects.
    ends: Vec<usize>,
}

impl Predictor {
    pub(super) fn new<'a>(
        problems: impl IntoIterator<Item = &'a ChoiceProblem>,
        options: RiskAwareOptions,
    ) -> Self {
        let mut prospects = Vec::new();
        let mut ends = vec![0];
        for problem in problems {
            prospects.extend(
                problem
                    .actions()
                    .iter()
                    .map(|action| action.prospect.clone()),
            );
            ends.push(prospects.len());
        }
        Self {
            table: UtilityTable::new(&prospects, options),
            ends,
        }
    }

    /// ln P(a) per problem and action, problem after problem; NaN where decision weights vanish.
    pub(super) fn ln_probabilities(&mut self, parameters: &Parameters) -> Vec<f64> {
        let mut values = self.table.utilities(parameters).to_vec();
        let theta = parameters.get(crate::model::Parameter::Theta);
        for pair in self.ends.windows(2) {
            ln_softmax_into(theta, &mut values[pair[0]..pair[1]]);
        }
        values
    }

    /// Where the actions of a problem stand among [`ln_probabilities`](Self::ln_probabilities).
    pub(super) fn range(&self, problem: usize) -> std::ops::Range<usize> {
        self.ends[problem]..self.ends[problem + 1]
    }
}

fn canonical_order(left: &Prospect, right: &Prospect) -> Ordering {
    let key = |prospect: &Prospect| -> Vec<f64> {
        prospect
            .outcomes()
            .iter()
            .flat_map(|outcome| [outcome.reward, outcome.probability])
            .collect()
    };
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
    use crate::model::{Parameter, RISK_AWARE, ln_probabilities};

    const STABLE: &[(f64, f64)] = &[(1.0, 20.0)];
    const UNSTABLE: &[(f64, f64)] = &[(0.2, 105.0), (0.8, 0.0)];
    const THIRD: &[(f64, f64)] = &[(0.5, 30.0), (0.5, -5.0)];

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
        let found = Likelihood::new(&data, options).ln_likelihood(&chooser());
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
        let found = Likelihood::new(&one, options).ln_likelihood(&chooser());
        assert_eq!(
            found,
            Likelihood::new(&other, options).ln_likelihood(&chooser())
        );
        assert_eq!(Likelihood::new(&one, options).problems.len(), 2);
    }

    #[test]
    fn impossible_choices_have_no_likelihood() {
        let data = data(&[("x", &[("a", STABLE), ("b", UNSTABLE)], &[3, 0])]);
        let mut likelihood = Likelihood::new(&data, RiskAwareOptions::default());
        let sharp = Parameters::ONES.with(Parameter::Theta, f64::MAX).unwrap();
        assert_eq!(likelihood.ln_likelihood(&sharp), f64::NEG_INFINITY);
        let blunt = Parameters::ONES.with(Parameter::Theta, 0.0).unwrap();
        assert!((likelihood.ln_likelihood(&blunt) - 3.0 * 0.5_f64.ln()).abs() < 1e-12);
    }
}
