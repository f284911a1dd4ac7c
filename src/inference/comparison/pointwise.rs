//! What each draw of a fit says about answers: the one place where comparisons ask a model.

use super::plan::{Answers, Pattern};
use crate::inference::likelihood::Predictor;
use crate::inference::{Draws, Fit, FitSettings, FitSummary, FittedProblem};
use crate::model::ChoiceModel;

/// A fit of one model to one part, as far as comparisons need it: what is stored of a fit is enough.
#[derive(Debug, Clone, PartialEq)]
pub struct PartFit {
    /// The model.
    pub model: &'static ChoiceModel,
    /// Draws from its posterior.
    pub draws: Draws,
    /// What the fit says.
    pub summary: FitSummary,
}

impl From<Fit> for PartFit {
    fn from(fit: Fit) -> Self {
        Self {
            model: fit.model,
            draws: fit.draws,
            summary: fit.summary,
        }
    }
}

impl PartFit {
    /// What another fit of the same kind is made with. Of its draws nothing but the posterior is used, so two
    /// independent samples are enough.
    pub(super) fn settings(&self) -> FitSettings {
        let summary = &self.summary;
        FitSettings {
            priors: summary.priors,
            options: summary.options,
            reference_reward: Some(summary.reference_reward),
            chains: summary.chains,
            draws: summary.draws,
            samples: 2,
            seed: summary.seed,
        }
    }

    fn predictor(&self, problems: &[FittedProblem]) -> Predictor {
        let problems = problems.iter().map(|problem| &problem.problem);
        Predictor::new(problems, self.summary.options)
    }

    /// ln p(y | draw) of each pattern's answers: one list over draws per pattern.
    ///
    /// ```text
    /// ln p(y | draw) = Σ_problems Σ_a n(problem, a) ln P(a | problem, draw)
    /// ```
    pub(super) fn ln_likelihoods(
        &self,
        problems: &[FittedProblem],
        patterns: &[Pattern],
    ) -> Vec<Vec<f64>> {
        let mut predictor = self.predictor(problems);
        let places: Vec<Vec<(usize, f64)>> = patterns
            .iter()
            .map(|pattern| {
                let place = |answers: &Answers| {
                    let start = predictor.range(answers.problem).start;
                    (start + answers.action, answers.count as f64)
                };
                pattern.answers.iter().map(place).collect()
            })
            .collect();
        let mut columns = vec![Vec::with_capacity(self.draws.len()); patterns.len()];
        for draw in 0..self.draws.len() {
            let ln_p = predictor.ln_probabilities(&self.draws.parameters(draw));
            for (column, places) in columns.iter_mut().zip(&places) {
                let terms = places.iter().map(|(place, count)| count * ln_p[*place]);
                let sum: f64 = terms.sum();
                // Where decision weights vanish nothing can be chosen.
                column.push(if sum.is_nan() { f64::NEG_INFINITY } else { sum });
            }
        }
        columns
    }

    /// P(a) of each problem's actions, averaged over draws; draws under which decision weights vanish are left out.
    pub(super) fn mean_probabilities(&self, problems: &[FittedProblem]) -> Vec<Vec<f64>> {
        self.weighted_probabilities(problems, &vec![1.0; self.draws.len()])
    }

    /// The same averaged with a weight for each draw.
    pub(super) fn weighted_probabilities(
        &self,
        problems: &[FittedProblem],
        weights: &[f64],
    ) -> Vec<Vec<f64>> {
        let mut predictor = self.predictor(problems);
        let mut sums: Vec<Vec<f64>> = problems
            .iter()
            .map(|problem| vec![0.0; problem.problem.actions().len()])
            .collect();
        let mut used = vec![0.0; problems.len()];
        for (draw, weight) in weights.iter().enumerate() {
            let ln_p = predictor.ln_probabilities(&self.draws.parameters(draw));
            for (problem, sums) in sums.iter_mut().enumerate() {
                let ln_p = &ln_p[predictor.range(problem)];
                if ln_p.iter().any(|ln_p| ln_p.is_nan()) {
                    continue;
                }
                used[problem] += weight;
                for (sum, ln_p) in sums.iter_mut().zip(ln_p) {
                    *sum += weight * ln_p.exp();
                }
            }
        }
        for (sums, used) in sums.iter_mut().zip(used) {
            for sum in sums {
                *sum /= used;
            }
        }
        sums
    }
}
