//! One problem, every share of one of its actions.

use serde::Serialize;

use super::{
    Score, SimulatedCell, Simulation, SweepError, SweepHead, SweepScore, best_beside, counts_on,
    expected_rewards, is_unanimous, position,
};
use crate::inference::FittedProblem;
use crate::inference::accuracy::reference_level;
use crate::model::OrderedMap;

/// Simulated answers to one problem: k of n on one action, k = 0 … n, the rest on the best of the other actions.
///
/// With more than two actions nobody takes the remaining ones, so that at k = 0 people are optimal whatever their number.
#[derive(Debug, Clone, PartialEq)]
pub struct ShareSweep {
    problem: FittedProblem,
    action: usize,
    rest: usize,
    n: u64,
}

/// A finished share sweep.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct ShareSweepReport {
    /// The problem's id.
    pub problem: String,
    /// The action whose share runs.
    pub action: String,
    /// The action that the rest of the answers go to.
    pub rest: String,
    /// Expected reward of each action.
    #[schema(value_type = HashMap<String, f64>)]
    pub expected_rewards: OrderedMap<f64>,
    /// Answers at each point.
    pub n: u64,
    /// E[ln KL] of the true shares themselves against n answers on two actions; not for the ends.
    pub reference_level: f64,
    /// How it was made.
    #[serde(flatten)]
    pub head: SweepHead,
    /// From share 0 to share 1.
    pub points: Vec<SharePoint>,
}

/// One share.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct SharePoint {
    /// Answers on the action.
    pub count: u64,
    /// Their share.
    pub share: f64,
    /// Whether all answers are the same: scored against smoothed shares, drawn hollow.
    pub unanimous: bool,
    /// By model.
    #[schema(value_type = HashMap<String, SweepScore>)]
    pub models: OrderedMap<SweepScore>,
}

impl ShareSweep {
    /// A sweep of `action`, by default the one with the lowest expected reward (the first of several).
    ///
    /// * `n`: answers at each point, at least 2.
    ///
    /// # Errors
    /// When the problem has no such action, or none is named and all expected rewards are equal.
    pub fn new(problem: FittedProblem, action: Option<&str>, n: u64) -> Result<Self, SweepError> {
        if n < 2 {
            return Err(SweepError::TooFewAnswers { n });
        }
        let expected = expected_rewards(&problem);
        let action = match action {
            Some(name) => position(&problem, name)?,
            None => {
                let mut worst = 0;
                for (action, reward) in expected.iter().enumerate() {
                    if *reward < expected[worst] {
                        worst = action;
                    }
                }
                if expected[best_beside(&expected, worst)] == expected[worst] {
                    return Err(SweepError::NoSuboptimalAction {
                        problem: problem.id,
                    });
                }
                worst
            }
        };
        Ok(Self {
            rest: best_beside(&expected, action),
            problem,
            action,
            n,
        })
    }

    /// The cells to fit, from share 0 to share 1.
    pub fn cells(&self) -> Vec<SimulatedCell> {
        let cell = |count| SimulatedCell {
            problem: self.problem.clone(),
            counts: self.counts(count),
        };
        (0..=self.n).map(cell).collect()
    }

    /// The report of a simulation of [`cells`](Self::cells), from the scores of all its tasks in order.
    pub fn report(&self, simulation: &Simulation, scores: &[Score]) -> ShareSweepReport {
        let names: Vec<&str> = self.problem.problem.names().collect();
        let point = |(count, models)| SharePoint {
            count,
            share: count as f64 / self.n as f64,
            unanimous: is_unanimous(&self.counts(count)),
            models,
        };
        ShareSweepReport {
            problem: self.problem.id.clone(),
            action: names[self.action].to_owned(),
            rest: names[self.rest].to_owned(),
            expected_rewards: names
                .iter()
                .map(|name| (*name).to_owned())
                .zip(expected_rewards(&self.problem))
                .collect(),
            n: self.n,
            reference_level: reference_level(2, self.n),
            head: simulation.head(),
            points: (0..=self.n)
                .zip(simulation.by_cell(scores))
                .map(point)
                .collect(),
        }
    }

    fn counts(&self, count: u64) -> Vec<u64> {
        counts_on(
            self.problem.problem.actions().len(),
            [(self.action, count), (self.rest, self.n - count)],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{driving, scores, settings};
    use super::*;
    use crate::model::{ChoiceProblem, NOISY_RATIONAL, PAPER_MODELS, RISK_AWARE};

    fn three() -> FittedProblem {
        let actions = [
            ("middle", [(1.0, 2.0)]),
            ("best", [(1.0, 3.0)]),
            ("worst", [(1.0, 1.0)]),
        ];
        FittedProblem {
            id: "three".to_owned(),
            problem: ChoiceProblem::from_outcomes(actions).unwrap(),
        }
    }

    #[test]
    fn the_worst_action_runs_and_the_best_takes_the_rest() {
        let sweep = ShareSweep::new(three(), None, 4).unwrap();
        let counts: Vec<Vec<u64>> = sweep.cells().into_iter().map(|cell| cell.counts).collect();
        assert_eq!(
            counts,
            [[0, 4, 0], [0, 3, 1], [0, 2, 2], [0, 1, 3], [0, 0, 4]]
        );
        let sweep = ShareSweep::new(three(), Some("best"), 2).unwrap();
        assert_eq!(sweep.cells()[0].counts, [2, 0, 0]);
    }

    #[test]
    fn what_has_no_worse_action_is_refused() {
        let even = FittedProblem {
            id: "even".to_owned(),
            problem: ChoiceProblem::from_outcomes([
                ("a", vec![(1.0, 1.0)]),
                ("b", vec![(0.5, 2.0), (0.5, 0.0)]),
            ])
            .unwrap(),
        };
        let error = ShareSweep::new(even.clone(), None, 4).unwrap_err();
        assert!(error.to_string().contains("none is suboptimal"), "{error}");
        assert!(ShareSweep::new(even, Some("a"), 4).is_ok());
        let error = ShareSweep::new(three(), Some("other"), 4).unwrap_err();
        assert_eq!(
            error.to_string(),
            "`other` is no action of problem `three`, allowed are middle, best, worst"
        );
        assert_eq!(
            ShareSweep::new(three(), None, 1),
            Err(SweepError::TooFewAnswers { n: 1 })
        );
    }

    /// models.md, section 9: at 20 of 30 suboptimal about −4.2 (RA) against −2.4 (NR); near the optimal end the two meet.
    #[test]
    fn only_risk_aware_follows_where_people_are_not_optimal() {
        let sweep = ShareSweep::new(driving(0.95, false), None, 30).unwrap();
        let all = sweep.cells();
        let cells = vec![all[5].clone(), all[20].clone()];
        let simulation = Simulation::new(cells, PAPER_MODELS.to_vec(), 3, settings()).unwrap();
        let found = simulation.by_cell(&scores(&simulation));
        let score = |cell: usize, model: &str| found[cell].get(model).unwrap().clone();
        let mean = |cell, model| score(cell, model).ln_kl.mean.unwrap();
        let (noisy, aware) = (NOISY_RATIONAL.id, RISK_AWARE.id);
        // 90 samples with sd 2.2, and one of 0.3: standard errors 0.25 and 0.03.
        assert!((mean(1, noisy) - -2.4).abs() < 0.2, "{}", mean(1, noisy));
        assert!((mean(1, aware) - -4.2).abs() < 0.9, "{}", mean(1, aware));
        assert!((mean(0, noisy) - mean(0, aware)).abs() < 1.0);
    }
}
