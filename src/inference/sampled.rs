//! Draws from a posterior until they can be trusted, and what is read off them.

use std::ops::{ControlFlow, Range};

use rand_chacha::ChaCha12Rng;

use super::accuracy::{CellAccuracy, ln_divergence};
use super::diagnostics::{self, Convergence, mean, quantile};
use super::likelihood::Predictor;
use super::posterior::Posterior;
use super::sampler::{Chains, Proposal, Watch, ln_evidence, random_stream, run_chains, warm_up};
use super::summary::{Diagnostics, Estimate, PredictedShare, QuantityDiagnostics};
use super::{ChoiceData, Draws, FitError, FitSettings, FittedProblem, Progress};
use crate::model::OrderedMap;

/// Steps of the kernel for each kept draw, in the first round; each further round doubles them.
const FIRST_STEPS: usize = 2;

/// Rounds after which a fit that has not converged is given up: 2 + 4 + … + 64 steps for each draw.
const MAX_ROUNDS: u32 = 6;

/// Below this share of accepted proposals the proposal is fitted again, even if the chains agree.
const LOW_ACCEPTANCE: f64 = 0.15;

/// Independent samples are at least this many integrated autocorrelation times apart.
const SAMPLE_SPACING: f64 = 3.0;

/// Points that a proposal is fitted to again.
const REFIT_POINTS: usize = 1000;

/// Random streams far above those of chains.
const INERT_STREAM: u64 = 1 << 40;
const EVIDENCE_STREAM: u64 = 1 << 41;

/// Draws with all that is read off them.
pub(super) struct Sampled {
    pub(super) draws: Draws,
    /// ln P(a) by draw for every action of every problem, problem after problem.
    ln_predicted: Vec<Vec<f64>>,
    /// Of each column of the draws.
    pub(super) convergence: Vec<Convergence>,
    /// Of each problem, the worst action's; nothing where the probabilities are the same for all parameters.
    predicted_convergence: Vec<Option<Convergence>>,
    pub(super) converged: bool,
    pub(super) sample_indices: Vec<usize>,
    pub(super) steps_per_draw: usize,
    pub(super) acceptance: Option<f64>,
    pub(super) ln_evidence: Option<Estimate>,
    /// Positions to climb from.
    pub(super) points: Vec<Vec<f64>>,
}

/// Warms up, runs chains, and runs them on until they have converged or the bound is reached.
pub(super) fn sample(
    posterior: &mut Posterior,
    predictor: &mut Predictor,
    data: &ChoiceData,
    settings: &FitSettings,
    watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Sampled, FitError> {
    let seed = settings.seed;
    let warm = warm_up(posterior, seed, &mut || watch(Progress::WarmingUp))?;
    let mut proposal = warm.proposal.clone();
    let mut starts = warm.starts(settings.chains);
    let mut steps = FIRST_STEPS;
    let mut round = 0;
    loop {
        let mut inner: Box<Watch<'_>> = Box::new(|| watch(Progress::Sampling { round: round + 1 }));
        let chains = run_chains(
            posterior,
            &proposal,
            &starts,
            seed,
            u64::from(round),
            settings.draws,
            steps,
            &mut inner,
        )?;
        drop(inner);
        let mut rng = random_stream(seed, INERT_STREAM + u64::from(round));
        let mut sampled = Sampled::of(
            posterior,
            predictor,
            data,
            settings,
            &chains.positions,
            &mut rng,
        );
        round += 1;
        let last = round == MAX_ROUNDS;
        if last || (sampled.converged && chains.acceptance >= LOW_ACCEPTANCE) {
            let mut rng = random_stream(seed, EVIDENCE_STREAM);
            let (value, se) = ln_evidence(
                posterior,
                &proposal,
                settings.chains * settings.draws,
                &mut rng,
            );
            sampled.ln_evidence =
                (value.is_finite() && se.is_finite()).then_some(Estimate { value, se });
            sampled.steps_per_draw = steps;
            sampled.acceptance = Some(chains.acceptance);
            sampled.points = thinned(&chains, REFIT_POINTS);
            return Ok(sampled);
        }
        // Warm-up points stay in: chains that miss a mode must not teach the proposal to miss it too.
        let mut points = warm.points.clone();
        points.extend(thinned(&chains, REFIT_POINTS));
        proposal = Proposal::fit(&points, 12, seed.wrapping_add(u64::from(round)));
        starts = chains
            .positions
            .iter()
            .map(|chain| chain[chain.len() - 1].clone())
            .collect();
        steps *= 2;
    }
}

fn thinned(chains: &Chains, count: usize) -> Vec<Vec<f64>> {
    let total: usize = chains.positions.iter().map(Vec::len).sum();
    chains
        .positions
        .iter()
        .flatten()
        .step_by((total / count).max(1))
        .cloned()
        .collect()
}

impl Sampled {
    /// When choices say nothing: independent draws from the prior.
    pub(super) fn prior(
        posterior: &mut Posterior,
        predictor: &mut Predictor,
        data: &ChoiceData,
        settings: &FitSettings,
    ) -> Self {
        let mut rng = random_stream(settings.seed, INERT_STREAM);
        let positions = vec![vec![Vec::new(); settings.draws]; settings.chains];
        let mut sampled = Self::of(posterior, predictor, data, settings, &positions, &mut rng);
        // Nothing depends on the parameters, the likelihood least of all.
        sampled.ln_evidence = Some(Estimate {
            value: posterior.ln_likelihood_at_random(),
            se: 0.0,
        });
        sampled
    }

    fn of(
        posterior: &mut Posterior,
        predictor: &mut Predictor,
        data: &ChoiceData,
        settings: &FitSettings,
        positions: &[Vec<Vec<f64>>],
        rng: &mut ChaCha12Rng,
    ) -> Self {
        let draws = posterior.draws(positions, rng);
        let actions = data
            .problems()
            .iter()
            .map(|problem| problem.problem.actions().len())
            .sum();
        let mut ln_predicted = vec![Vec::with_capacity(draws.len()); actions];
        for draw in 0..draws.len() {
            let ln_p = predictor.ln_probabilities(&draws.parameters(draw));
            for (column, ln_p) in ln_predicted.iter_mut().zip(ln_p) {
                column.push(ln_p);
            }
        }
        let convergence: Vec<Convergence> = draws
            .columns
            .iter()
            .map(|(_, values)| Convergence::of(&draws.by_chain(values)))
            .collect();
        let mut sampled = Self {
            draws,
            ln_predicted,
            convergence,
            predicted_convergence: Vec::new(),
            converged: false,
            sample_indices: Vec::new(),
            steps_per_draw: 1,
            acceptance: None,
            ln_evidence: None,
            points: Vec::new(),
        };
        sampled.predicted_convergence = (0..data.problems().len())
            .map(|problem| sampled.problem_convergence(predictor.range(problem)))
            .collect();
        let of_predicted = sampled.predicted_convergence.iter().flatten();
        let agree = sampled
            .convergence
            .iter()
            .chain(of_predicted)
            .all(Convergence::is_converged);
        sampled.sample_indices = sampled.spaced_samples(settings.samples);
        let spacing = settings.draws as f64 / settings.samples.div_ceil(settings.chains) as f64;
        sampled.converged = agree && spacing >= sampled.needed_spacing(data, predictor);
        sampled
    }

    /// The worst convergence of the probabilities of one problem's actions, but the last, which follows.
    fn problem_convergence(&self, range: Range<usize>) -> Option<Convergence> {
        self.ln_predicted[range.start..range.end - 1]
            .iter()
            .filter(|column| column.iter().any(|value| (value - column[0]).abs() > 1e-12))
            .map(|column| {
                // R̂ folds the values about their median, so that of ln P would be another one.
                let probabilities: Vec<f64> = column.iter().map(|ln_p| ln_p.exp()).collect();
                Convergence::of(&self.draws.by_chain(&probabilities))
            })
            .reduce(|left, right| Convergence {
                rhat: if left.rhat.is_nan() {
                    left.rhat
                } else {
                    left.rhat.max(right.rhat)
                },
                ess_bulk: left.ess_bulk.min(right.ess_bulk),
                ess_tail: left.ess_tail.min(right.ess_tail),
            })
    }

    /// Draws at equal distances within each chain, chains in turn.
    fn spaced_samples(&self, samples: usize) -> Vec<usize> {
        let per_chain = samples.div_ceil(self.draws.chains);
        let spacing = self.draws.per_chain / per_chain;
        let index = |sample: usize| {
            let (chain, place) = (sample % self.draws.chains, sample / self.draws.chains);
            chain * self.draws.per_chain + place * spacing + spacing / 2
        };
        (0..samples).map(index).collect()
    }

    /// Draws that samples must be apart: three times the longest autocorrelation time of parameters and ln KL.
    fn needed_spacing(&self, data: &ChoiceData, predictor: &Predictor) -> f64 {
        let mut longest = 1.0_f64;
        for (_, values) in &self.draws.columns {
            longest = longest.max(diagnostics::autocorrelation_time(
                &self.draws.by_chain(values),
            ));
        }
        for (problem, counts) in data.totals().iter().enumerate() {
            let n: u64 = counts.iter().sum();
            if n == 0 {
                continue;
            }
            let observed: Vec<f64> = counts
                .iter()
                .map(|count| *count as f64 / n as f64)
                .collect();
            let values: Vec<f64> = (0..self.draws.len())
                .map(|draw| {
                    let ln_kl = ln_divergence(
                        &observed,
                        &self.ln_predictions(draw, predictor.range(problem)),
                    );
                    // The floor keeps an exact hit finite: it is the square of the rounding error.
                    ln_kl.unwrap_or(-75.0).clamp(-75.0, 75.0)
                })
                .collect();
            longest = longest.max(diagnostics::autocorrelation_time(
                &self.draws.by_chain(&values),
            ));
        }
        SAMPLE_SPACING * longest
    }

    fn ln_predictions(&self, draw: usize, range: Range<usize>) -> Vec<f64> {
        self.ln_predicted[range]
            .iter()
            .map(|column| column[draw])
            .collect()
    }

    pub(super) fn accuracy(&self, data: &ChoiceData, predictor: &Predictor) -> Vec<CellAccuracy> {
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

    pub(super) fn predicted_shares(
        &self,
        data: &ChoiceData,
        predictor: &Predictor,
    ) -> OrderedMap<OrderedMap<PredictedShare>> {
        let share = |column: &Vec<f64>| {
            let mut values: Vec<f64> = column.iter().map(|ln_p| ln_p.exp()).collect();
            values.sort_by(f64::total_cmp);
            PredictedShare {
                mean: mean(&values),
                q5: quantile(&values, 0.05),
                q95: quantile(&values, 0.95),
            }
        };
        let of_problem = |(index, problem): (usize, &FittedProblem)| {
            let columns = &self.ln_predicted[predictor.range(index)];
            let names = problem.problem.names().map(str::to_owned);
            (
                problem.id.clone(),
                names.zip(columns.iter().map(share)).collect(),
            )
        };
        data.problems().iter().enumerate().map(of_problem).collect()
    }

    pub(super) fn diagnostics(&self, data: &ChoiceData) -> Diagnostics {
        let columns = self.draws.columns.iter().zip(&self.convergence);
        let problems = data.problems().iter().zip(&self.predicted_convergence);
        // A probability that is the same whatever the parameters needs no chain to converge.
        let certain = || {
            let draws = self.draws.len() as f64;
            QuantityDiagnostics {
                rhat: 1.0,
                ess_bulk: draws,
                ess_tail: draws,
            }
        };
        Diagnostics {
            parameters: columns
                .map(|((name, _), c)| (name.key().to_owned(), (*c).into()))
                .collect(),
            predicted: problems
                .map(|(problem, c)| {
                    (
                        problem.id.clone(),
                        c.map_or_else(certain, QuantityDiagnostics::from),
                    )
                })
                .collect(),
        }
    }
}
