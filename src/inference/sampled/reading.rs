//! What is read off draws: convergence, samples at a distance, accuracy, predicted shares.

use std::collections::HashSet;
use std::ops::Range;

use super::Sampled;
use crate::inference::accuracy::CellAccuracy;
use crate::inference::diagnostics::{Convergence, NormalScores, Workspace, mean, quantile};
use crate::inference::lanes::{InstructionSet, Kernel, ln};
use crate::inference::likelihood::Predictor;
use crate::inference::summary::{Diagnostics, PredictedShare};
use crate::inference::{ChoiceData, FittedProblem, Quantity};
use crate::model::OrderedMap;

/// Independent samples are at least this many integrated autocorrelation times apart.
const SAMPLE_SPACING: f64 = 3.0;

/// ln KL of each draw, good to a thousandth: enough for its autocorrelation.
struct LnDivergences<'a> {
    observed: &'a [f64],
    ln_predicted: &'a [Vec<f64>],
    predicted: &'a [Vec<f64>],
}

impl Kernel for LnDivergences<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run(self) -> Vec<f64> {
        let mut divergences = vec![0.0; self.ln_predicted[0].len()];
        let columns = self.ln_predicted.iter().zip(self.predicted);
        for (share, (ln_predicted, predicted)) in self.observed.iter().zip(columns) {
            let ln_share = ln(*share);
            let draws = ln_predicted.iter().zip(predicted);
            for (sum, (ln_p, p)) in divergences.iter_mut().zip(draws) {
                // Σ f (x − ln(1 + x)) with x = (p − f)/f, as in the accuracy's own formula.
                let x = (p - share) / share;
                let term = if x.abs() < 1e-4 {
                    x * x * (0.5 - x / 3.0)
                } else {
                    x - (ln_p - ln_share)
                };
                *sum += if *share > 0.0 { share * term } else { *p };
            }
        }
        for value in &mut divergences {
            // The floor keeps an exact hit finite: it is the square of the rounding error.
            let ln_kl = ln(*value);
            *value = if ln_kl > -75.0 { ln_kl } else { -75.0 };
        }
        divergences
    }
}

impl Sampled {
    /// Finds out the convergence of draws straight from the prior, which no chain had to bring about.
    pub(super) fn measure_prior_draws(&mut self, workspace: &mut Workspace, scores: &NormalScores) {
        for index in std::mem::take(&mut self.unmeasured) {
            let (_, values) = &self.draws.columns[index];
            let chains = self.draws.by_chain(values);
            let found = workspace.order(&chains).convergence(scores);
            self.converged &= found.is_converged();
            self.convergence[index] = found;
        }
    }

    /// The worst convergence of the probabilities of one problem's actions. The likeliest of them follows from the others,
    /// whatever the order of actions; what is the same in all draws needs no chain to converge.
    pub(super) fn problem_convergence(
        &self,
        scores: &NormalScores,
        workspace: &mut Workspace,
        range: Range<usize>,
    ) -> Convergence {
        let means = self.ln_predicted[range.clone()]
            .iter()
            .map(|ln_p| mean(ln_p));
        let likeliest = means
            .enumerate()
            .max_by(|left, right| left.1.total_cmp(&right.1))
            .map(|(index, _)| index);
        // R̂ folds the values about their median, so that of ln P would be another one.
        let others = self.predicted[range].iter().enumerate();
        others
            .filter(|(index, _)| Some(*index) != likeliest)
            .filter_map(|(_, probabilities)| {
                if probabilities.iter().any(|p| p.is_nan()) {
                    return Some(Convergence::NONE);
                }
                let first = probabilities[0];
                let moves = |p: &f64| (p - first).abs() > 1e-12 * first;
                let moves = probabilities.iter().any(moves);
                moves.then(|| {
                    workspace
                        .order(&self.draws.by_chain(probabilities))
                        .convergence(scores)
                })
            })
            .reduce(Convergence::worse)
            .unwrap_or(Convergence::of_constant(self.draws.len()))
    }

    /// Draws at equal distances within each chain, chains in turn.
    pub(super) fn spaced_samples(&self, samples: usize) -> Vec<usize> {
        let per_chain = samples.div_ceil(self.draws.chains);
        let spacing = self.draws.per_chain / per_chain;
        let index = |sample: usize| {
            let (chain, place) = (sample % self.draws.chains, sample / self.draws.chains);
            chain * self.draws.per_chain + place * spacing + spacing / 2
        };
        (0..samples).map(index).collect()
    }

    /// Draws that samples must be apart: three times the longest autocorrelation time of parameters and ln KL.
    pub(super) fn needed_spacing(
        &self,
        workspace: &mut Workspace,
        moves: impl Fn(Quantity) -> bool,
        data: &ChoiceData,
        predictor: &Predictor,
    ) -> f64 {
        let mut longest = 1.0_f64;
        let columns = self.draws.columns.iter();
        for (_, values) in columns.filter(|(quantity, _)| moves(*quantity)) {
            longest = longest.max(workspace.autocorrelation_time(&self.draws.by_chain(values)));
        }
        let totals = data.totals();
        // Equal problems with equal counts have the same ln KL, draw by draw.
        let mut seen = HashSet::new();
        for (problem, counts) in totals.iter().enumerate() {
            if !seen.insert((predictor.distinct(problem), counts)) {
                continue;
            }
            let n: u64 = counts.iter().sum();
            if n == 0 {
                continue;
            }
            let observed: Vec<f64> = counts
                .iter()
                .map(|count| *count as f64 / n as f64)
                .collect();
            let range = predictor.range(problem);
            let values = InstructionSet::widest().run(LnDivergences {
                observed: &observed,
                ln_predicted: &self.ln_predicted[range.clone()],
                predicted: &self.predicted[range],
            });
            longest = longest.max(workspace.autocorrelation_time(&self.draws.by_chain(&values)));
        }
        SAMPLE_SPACING * longest
    }

    fn ln_predictions(&self, draw: usize, range: Range<usize>) -> Vec<f64> {
        self.ln_predicted[range]
            .iter()
            .map(|column| column[draw])
            .collect()
    }

    pub(in crate::inference) fn accuracy(
        &self,
        data: &ChoiceData,
        predictor: &Predictor,
    ) -> Vec<CellAccuracy> {
        let cells = data.problems().iter().zip(data.totals()).enumerate();
        cells
            .filter_map(|(index, (problem, counts))| {
                let range = predictor.range(index);
                let predictions: Vec<Vec<f64>> = self
                    .sample_indices
                    .iter()
                    .map(|draw| self.ln_predictions(*draw, range.clone()))
                    .collect();
                let slices: Vec<&[f64]> = predictions.iter().map(Vec::as_slice).collect();
                CellAccuracy::of(&problem.id, counts, &slices)
            })
            .collect()
    }

    pub(in crate::inference) fn predicted_shares(
        &self,
        workspace: &mut Workspace,
        data: &ChoiceData,
        predictor: &Predictor,
    ) -> OrderedMap<OrderedMap<PredictedShare>> {
        let mut share = |column: &Vec<f64>| {
            let chains = self.draws.by_chain(column);
            let ordered = workspace.order(&chains);
            let values = ordered.values();
            PredictedShare {
                mean: mean(values),
                q5: quantile(values, 0.05),
                q95: quantile(values, 0.95),
            }
        };
        let shares: Vec<PredictedShare> = self.predicted.iter().map(&mut share).collect();
        let of_problem = |(index, problem): (usize, &FittedProblem)| {
            let names = problem.problem.names().map(str::to_owned);
            let shares = shares[predictor.range(index)].iter().cloned();
            (problem.id.clone(), names.zip(shares).collect())
        };
        data.problems().iter().enumerate().map(of_problem).collect()
    }

    pub(in crate::inference) fn diagnostics(
        &self,
        data: &ChoiceData,
        predictor: &Predictor,
    ) -> Diagnostics {
        let columns = self.draws.columns.iter().zip(&self.convergence);
        let problems = data.problems().iter().enumerate();
        Diagnostics {
            parameters: columns
                .map(|((name, _), found)| (name.key().to_owned(), (*found).into()))
                .collect(),
            predicted: problems
                .map(|(index, problem)| {
                    let found = self.predicted_convergence[predictor.distinct(index)];
                    (problem.id.clone(), found.into())
                })
                .collect(),
        }
    }
}
