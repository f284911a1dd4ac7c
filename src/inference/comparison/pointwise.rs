//! What each draw of a fit says about answers: the one place where comparisons ask a model.

use super::plan::Pattern;
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

    /// Hands over ln P(a | draw) for the problems, block after block: a predictor over the block, the position of its first
    /// problem, and a column over draws for each action. NaN where decision weights vanish.
    fn by_block(
        &self,
        problems: &[FittedProblem],
        visit: &mut dyn FnMut(&Predictor, usize, &[Vec<f64>]),
    ) {
        // All columns of many thousand problems would not fit into memory.
        const BLOCK: usize = 256;
        for (place, block) in problems.chunks(BLOCK).enumerate() {
            let of_block = block.iter().map(|problem| &problem.problem);
            let mut predictor = Predictor::new(of_block, self.summary.options);
            let columns = predictor.of_draws(&self.draws);
            visit(&predictor, place * BLOCK, &columns);
        }
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
        let mut sums = vec![vec![0.0; self.draws.len()]; patterns.len()];
        self.by_block(problems, &mut |predictor, first, columns| {
            let block = first..first + predictor.problems();
            for (sums, pattern) in sums.iter_mut().zip(patterns) {
                let answers = pattern.answers.iter();
                for answers in answers.filter(|answers| block.contains(&answers.problem)) {
                    let start = predictor.range(answers.problem - first).start;
                    let column = &columns[start + answers.action];
                    for (sum, ln_p) in sums.iter_mut().zip(column) {
                        *sum += answers.count as f64 * ln_p;
                    }
                }
            }
        });
        // Where decision weights vanish nothing can be chosen.
        for sum in sums.iter_mut().flatten().filter(|sum| sum.is_nan()) {
            *sum = f64::NEG_INFINITY;
        }
        sums
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
        let mut found = Vec::with_capacity(problems.len());
        self.by_block(problems, &mut |predictor, _, columns| {
            for problem in 0..predictor.problems() {
                let columns = &columns[predictor.range(problem)];
                let mut sums = vec![0.0; columns.len()];
                let mut used = 0.0;
                for (draw, weight) in weights.iter().enumerate() {
                    if columns.iter().any(|column| column[draw].is_nan()) {
                        continue;
                    }
                    used += weight;
                    for (sum, column) in sums.iter_mut().zip(columns) {
                        *sum += weight * column[draw].exp();
                    }
                }
                found.push(sums.into_iter().map(|sum| sum / used).collect());
            }
        });
        found
    }
}
