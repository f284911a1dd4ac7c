//! Posterior predictive checks: would people who choose as the model says leave such counts?
//!
//! Source: Gelman, Meng & Stern (1996), *Posterior predictive assessment of model fitness via realized discrepancies*.

use rand::Rng;
use rand_distr::{Binomial, Distribution};
use serde::{Deserialize, Serialize};

use super::diagnostics::quantile;
use super::sampler::{random_stream, streams};
use super::{Draws, Fit, FittedProblem};
use crate::model::{RiskAwareOptions, ln_probabilities};

/// Posterior draws that are replicated at most, evenly spaced: p-values are then known to about 0.016.
const REPLICATIONS: usize = 1000;

/// The same of a provisional fit, which is soon replaced: p-values to about 0.035.
const PROVISIONAL_REPLICATIONS: usize = 200;

/// One cell's answers beside answers replicated from the posterior.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PredictiveCheck {
    /// The cell's problem id.
    pub problem: String,
    /// Answers, as many in each replication.
    pub n: u64,
    /// How many replications, one per draw.
    pub replications: usize,
    /// How often the χ² discrepancy of replicated answers exceeds that of the observed ones, ties counted half; near 0 the
    /// observed shares lie further from the model's than chance explains.
    pub discrepancy_p: f64,
    /// Each action in the problem's order.
    pub actions: Vec<ActionCheck>,
}

/// One action's count beside replicated counts, as shares of n.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ActionCheck {
    /// The action.
    pub action: String,
    /// Observed share.
    pub observed: f64,
    /// 5 % quantile of the replicated share.
    pub q5: f64,
    /// 25 % quantile.
    pub q25: f64,
    /// Median.
    pub q50: f64,
    /// 75 % quantile.
    pub q75: f64,
    /// 95 % quantile.
    pub q95: f64,
    /// Mid-p that a replicated count exceeds the observed one: P(more) + ½ P(as many). Near 0 or 1 the model misses.
    pub p: f64,
}

/// The checks of a fit against the counts it was fitted to. The fit's seed also seeds the replications, in a stream of
/// their own, so that the checks are a function of the fit.
pub fn checks_of_fit(
    fit: &Fit,
    problems: &[FittedProblem],
    counts: &[Vec<u64>],
) -> Vec<PredictiveCheck> {
    let mut rng = random_stream(fit.settings.seed, streams::PREDICTIVE_CHECKS);
    let most = if fit.summary.provisional {
        PROVISIONAL_REPLICATIONS
    } else {
        REPLICATIONS
    };
    predictive_checks(
        problems,
        counts,
        &fit.draws,
        most,
        fit.settings.options,
        &mut rng,
    )
}

/// Replicates each cell's answers from posterior draws.
///
/// ```text
/// y_rep | draw ~ Multinomial(n, P(· | draw)),   D(y, draw) = Σ_a (y_a − n P_a)² / (n P_a)
/// mid-p = P(T(y_rep) > T(y)) + ½ P(T(y_rep) = T(y))
/// ```
///
/// T is the count of an action, or the discrepancy D of the cell. The answers were used in the fit, so p crowds around ½ and
/// not evenly over (0, 1): a small p speaks against the model, a middling one says little for it.
///
/// * `most`: how many draws are replicated at most, evenly spaced.
///
/// Cells without answers have no check, and draws under which decision weights vanish are left out.
fn predictive_checks(
    problems: &[FittedProblem],
    counts: &[Vec<u64>],
    draws: &Draws,
    most: usize,
    options: RiskAwareOptions,
    rng: &mut impl Rng,
) -> Vec<PredictiveCheck> {
    let cells = problems.iter().zip(counts);
    cells
        .filter_map(|(problem, counts)| check(problem, counts, draws, most, options, rng))
        .collect()
}

fn check(
    problem: &FittedProblem,
    counts: &[u64],
    draws: &Draws,
    most: usize,
    options: RiskAwareOptions,
    rng: &mut impl Rng,
) -> Option<PredictiveCheck> {
    let n: u64 = counts.iter().sum();
    if n == 0 {
        return None;
    }
    let options = draws.model.options(options);
    let used = draws.len().min(most);
    let mut replicated: Vec<Vec<u64>> = vec![Vec::with_capacity(used); counts.len()];
    let mut further = 0.0;
    for index in 0..used {
        let parameters = draws.parameters(index * draws.len() / used);
        let Ok(ln_p) = ln_probabilities(&problem.problem, &parameters, options) else {
            continue;
        };
        let probabilities: Vec<f64> = ln_p.iter().map(|ln_p| ln_p.exp()).collect();
        let answers = multinomial(n, &probabilities, rng);
        further += mid(
            discrepancy(&answers, &probabilities, n),
            discrepancy(counts, &probabilities, n),
        );
        for (column, count) in replicated.iter_mut().zip(answers) {
            column.push(count);
        }
    }
    let replications = replicated[0].len();
    if replications == 0 {
        return None;
    }
    let share = |count: u64| count as f64 / n as f64;
    let actions = problem.problem.names().zip(counts).zip(replicated);
    let actions = actions.map(|((name, observed), replicated)| {
        let above: f64 = replicated
            .iter()
            .map(|count| mid(*count as f64, *observed as f64))
            .sum();
        let mut shares: Vec<f64> = replicated.into_iter().map(share).collect();
        shares.sort_by(f64::total_cmp);
        ActionCheck {
            action: name.to_owned(),
            observed: share(*observed),
            q5: quantile(&shares, 0.05),
            q25: quantile(&shares, 0.25),
            q50: quantile(&shares, 0.5),
            q75: quantile(&shares, 0.75),
            q95: quantile(&shares, 0.95),
            p: above / replications as f64,
        }
    });
    Some(PredictiveCheck {
        problem: problem.id.clone(),
        n,
        replications,
        discrepancy_p: further / replications as f64,
        actions: actions.collect(),
    })
}

/// 1 if the replicated statistic exceeds the observed one, ½ if they are equal, else 0.
fn mid(replicated: f64, observed: f64) -> f64 {
    if replicated > observed {
        1.0
    } else if replicated == observed {
        0.5
    } else {
        0.0
    }
}

/// Σ (y − n p)² / (n p); an impossible action that was chosen is infinitely far, one that was not costs nothing.
fn discrepancy(counts: &[u64], probabilities: &[f64], n: u64) -> f64 {
    let pairs = counts.iter().zip(probabilities);
    pairs
        .filter(|(count, p)| **count > 0 || **p > 0.0)
        .map(|(count, p)| {
            let expected = n as f64 * p;
            (*count as f64 - expected).powi(2) / expected
        })
        .sum()
}

/// Counts of n answers, action after action from the binomial of what is left.
fn multinomial(n: u64, probabilities: &[f64], rng: &mut impl Rng) -> Vec<u64> {
    let (mut left, mut mass) = (n, 1.0_f64);
    let last = probabilities.len() - 1;
    let count = |(index, p): (usize, &f64)| {
        let count = if index == last {
            left
        } else {
            let share = if mass > 0.0 {
                (p / mass).clamp(0.0, 1.0)
            } else {
                0.0
            };
            // A share from 0 to 1 always makes a binomial.
            Binomial::new(left, share).map_or(0, |binomial| binomial.sample(rng))
        };
        left -= count;
        mass -= p;
        count
    };
    probabilities.iter().enumerate().map(count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::Quantity;
    use crate::model::{ChoiceProblem, Parameter, RISK_AWARE};

    fn two() -> FittedProblem {
        let actions = [("a", [(1.0, 1.0)]), ("b", [(1.0, 0.0)])];
        FittedProblem {
            id: "two".to_owned(),
            problem: ChoiceProblem::from_outcomes(actions).unwrap(),
        }
    }

    /// Draws of θ alone: P(a) = 1/(1 + e^−θ).
    fn draws(theta: f64) -> Draws {
        Draws {
            model: &RISK_AWARE,
            chains: 1,
            per_chain: 4000,
            columns: vec![(Quantity::Parameter(Parameter::Theta), vec![theta; 4000])],
        }
    }

    fn found(theta: f64, counts: [u64; 2]) -> PredictiveCheck {
        let mut rng = random_stream(1, 0);
        let options = RiskAwareOptions::default();
        let checks = predictive_checks(
            &[two()],
            &[counts.to_vec()],
            &draws(theta),
            REPLICATIONS,
            options,
            &mut rng,
        );
        checks.into_iter().next().unwrap()
    }

    /// Against a known P the replicated counts are binomial: n = 20, P = ½ has 5 % and 95 % quantiles 6 and 14.
    #[test]
    fn replications_of_a_known_probability_are_binomial() {
        let check = found(0.0, [10, 10]);
        assert_eq!((check.n, check.replications), (20, REPLICATIONS));
        let a = &check.actions[0];
        assert_eq!((a.q5, a.q50, a.q95), (0.3, 0.5, 0.7));
        // By symmetry mid-p is ½ exactly; 1000 replications know it to 0.016.
        assert!((a.p - 0.5).abs() < 0.06, "{}", a.p);
        assert!((a.p + check.actions[1].p - 1.0).abs() < 1e-12);
        // Nothing lies closer than the observed counts: the other 82.4 % and half of the 17.6 % that tie.
        assert!((check.discrepancy_p - 0.912).abs() < 0.03);
    }

    #[test]
    fn counts_that_the_model_misses_have_extreme_p() {
        // P(a) = 0.88, and 1 of 20 chose it.
        let check = found(2.0, [1, 19]);
        let a = &check.actions[0];
        assert!(a.p > 0.99 && a.q5 > a.observed, "{a:?}");
        assert!(check.discrepancy_p < 0.01);
    }

    /// All mass on one action: every replication repeats the observed answers.
    #[test]
    fn certainty_is_checked_without_division_by_zero() {
        let check = found(1e9, [7, 0]);
        assert_eq!((check.actions[0].p, check.actions[1].p), (0.5, 0.5));
        assert_eq!(check.discrepancy_p, 0.5);
        let impossible = found(1e9, [0, 7]);
        assert_eq!(impossible.discrepancy_p, 0.0);
    }

    #[test]
    fn shares_of_several_actions_sum_to_one_and_cells_without_answers_have_no_check() {
        let actions = [
            ("a", [(1.0, 1.0)]),
            ("b", [(1.0, 0.5)]),
            ("c", [(1.0, 0.0)]),
        ];
        let three = FittedProblem {
            id: "three".to_owned(),
            problem: ChoiceProblem::from_outcomes(actions).unwrap(),
        };
        let mut rng = random_stream(2, 0);
        let options = RiskAwareOptions::default();
        let problems = [two(), three];
        let counts = [vec![0, 0], vec![5, 4, 3]];
        let checks = predictive_checks(
            &problems,
            &counts,
            &draws(0.5),
            REPLICATIONS,
            options,
            &mut rng,
        );
        assert_eq!(checks.len(), 1);
        assert_eq!(checks[0].actions.len(), 3);
        assert!(
            checks[0]
                .actions
                .iter()
                .all(|action| action.q5 <= action.q50 && action.q50 <= action.q95)
        );
        for _ in 0..100 {
            assert_eq!(
                multinomial(12, &[0.2, 0.3, 0.5], &mut rng)
                    .iter()
                    .sum::<u64>(),
                12
            );
        }
    }
}
