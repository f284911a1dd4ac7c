//! A fit: the posterior of one model given choices.

use std::ops::ControlFlow;

use rand_chacha::ChaCha12Rng;

use super::accuracy::{CellAccuracy, ln_divergence};
use super::diagnostics::{self, Convergence, mean, quantile, variance};
use super::likelihood::Predictor;
use super::maximum_likelihood::{maximum_likelihood, posterior_mode};
use super::posterior::Posterior;
use super::reference_reward::check_reference_reward;
use super::sampler::{
    Chains, LogDensity, Proposal, Stopped, Watch, ln_evidence, random_stream, run_chains, warm_up,
};
use super::summary::{
    Diagnostics, Estimate, FitSummary, ParameterSummary, PredictedShare, QuantityDiagnostics,
    Source,
};
use super::{
    ChoiceData, Draws, PriorError, Priors, Quantity, ReferenceRewardError, default_reference_reward,
};
use crate::model::{ChoiceModel, OrderedMap, RiskAwareOptions};

/// Steps of the kernel for each kept draw, in the first round; each further round doubles them.
const FIRST_STEPS: usize = 2;

/// Rounds after which a fit that has not converged is given up: 2 + 4 + … + 64 steps for each draw.
const MAX_ROUNDS: u32 = 6;

/// Below this share of accepted proposals the proposal is fitted again, even if the chains agree.
const LOW_ACCEPTANCE: f64 = 0.15;

/// Independent samples are at least this many integrated autocorrelation times apart.
const SAMPLE_SPACING: f64 = 3.0;

/// Draws of the prior for its quantiles and curves.
const PRIOR_DRAWS: usize = 4096;

/// Points that a proposal is fitted to again.
const REFIT_POINTS: usize = 1000;

/// Random streams far above those of chains.
const INERT_STREAM: u64 = 1 << 40;
const EVIDENCE_STREAM: u64 = 1 << 41;

/// Everything that a fit depends on beside model and data.
#[derive(Debug, Clone, PartialEq)]
pub struct FitSettings {
    /// Priors of the parameters.
    pub priors: Priors,
    /// Options of the Risk-Aware model.
    pub options: RiskAwareOptions,
    /// Signed reward that gives τ its unit; the default rule over the problems if left out.
    pub reference_reward: Option<f64>,
    /// Chains, from 2 to 64. Eight, so that a chain in a mode of its own stands out.
    pub chains: usize,
    /// Draws kept per chain, from 100 to 100 000. 500 × 8 draws give quantiles to about 2 % of an sd.
    pub draws: usize,
    /// Independent samples for ln KL and t-tests; the paper has 30.
    pub samples: usize,
    /// Random seed.
    pub seed: u64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            priors: Priors::default(),
            options: RiskAwareOptions::default(),
            reference_reward: None,
            chains: 8,
            draws: 500,
            samples: 30,
            seed: 1,
        }
    }
}

impl FitSettings {
    fn check(&self) -> Result<(), FitError> {
        let setting = |name, value: usize, low: usize, high: usize| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(FitError::Setting {
                    name,
                    value,
                    low,
                    high,
                })
            }
        };
        self.priors.check()?;
        setting("chains", self.chains, 2, 64)?;
        setting("draws", self.draws, 100, 100_000)?;
        setting("samples", self.samples, 2, self.chains * self.draws / 3)
    }

    /// The posterior that these settings ask for.
    pub(super) fn posterior(
        &self,
        model: &'static ChoiceModel,
        data: &ChoiceData,
    ) -> Result<Posterior, FitError> {
        self.check()?;
        let reference_reward = match self.reference_reward {
            Some(reward) => check_reference_reward(reward)?,
            None => default_reference_reward(data.problems())?,
        };
        Ok(Posterior::new(
            model,
            data,
            self.priors,
            self.options,
            reference_reward,
        ))
    }
}

/// The posterior of one model given choices.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The model.
    pub model: &'static ChoiceModel,
    /// What it was fitted with.
    pub settings: FitSettings,
    /// Signed reward that gives τ its unit.
    pub reference_reward: f64,
    /// Draws from the posterior.
    pub draws: Draws,
    /// Evenly spread draws from the prior.
    pub prior_draws: Draws,
    /// Which draws make up the independent samples, spaced by three autocorrelation times or more.
    pub sample_indices: Vec<usize>,
    /// How well each problem that has answers is predicted, over the independent samples.
    pub accuracy: Vec<CellAccuracy>,
    /// What it says.
    pub summary: FitSummary,
}

/// How far a fit has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Points move from the prior to the posterior.
    WarmingUp,
    /// Chains run; rounds count from 1, each twice as long as the one before.
    Sampling {
        /// Which round.
        round: u32,
    },
    /// The highest likelihood is looked for.
    Climbing,
}

/// Takes note of progress and lets the fit go on.
pub fn uninterrupted(_: Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Fits a model to choices.
///
/// The result is a pure function of the counts (whatever the order of problems and people), the settings and the seed:
/// the same draws bit for bit with the same program on the same machine. `watch` hears of progress many times a second
/// and stops the work by answering `Break`.
///
/// Chains that have not converged run on with more steps for each draw, up to a bound; a fit that still has not is
/// returned with `summary.converged` false, for its diagnostics.
///
/// # Errors
/// When settings are out of range, no reward differs from 0, or `watch` stopped it.
pub fn fit(
    model: &'static ChoiceModel,
    data: &ChoiceData,
    settings: &FitSettings,
    watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Fit, FitError> {
    let mut posterior = settings.posterior(model, data)?;
    let reference_reward = posterior.reference_reward();
    let mut predictor = Predictor::new(
        data.problems().iter().map(|problem| &problem.problem),
        settings.options,
    );

    let sampled = if posterior.dimension() == 0 {
        Sampled::prior(&mut posterior, &mut predictor, data, settings)
    } else {
        sample(&mut posterior, &mut predictor, data, settings, watch)?
    };
    if watch(Progress::Climbing).is_break() {
        return Err(FitError::Stopped);
    }
    let highest = maximum_likelihood(model, &mut posterior, &sampled.points);
    let mode = posterior_mode(&mut posterior, &sampled.points).map(|mode| {
        let point = posterior.point(&mode.position, &mut |_| 0.5);
        let moved = posterior.moved().iter();
        moved
            .map(|name| (name.key().to_owned(), point.parameters.get(*name)))
            .collect()
    });
    let prior_draws = posterior.prior_draws(PRIOR_DRAWS);
    let accuracy = sampled.accuracy(data, &predictor);

    let entries = |sampled: &Sampled| -> OrderedMap<ParameterSummary> {
        let columns = sampled.draws.columns.iter().zip(&sampled.convergence);
        let summarise =
            |((quantity, values), convergence): (&(Quantity, Vec<f64>), &Convergence)| {
                let prior = prior_draws.column(*quantity).unwrap_or_default();
                let summary = parameter_summary(
                    &posterior,
                    *quantity,
                    &sampled.draws.by_chain(values),
                    prior,
                    *convergence,
                );
                (quantity.key().to_owned(), summary)
            };
        columns.map(summarise).collect()
    };
    let summary = FitSummary {
        model: model.id.to_owned(),
        converged: sampled.converged,
        parameters: Some(entries(&sampled)),
        max_log_likelihood: Some(highest.ln_likelihood),
        max_likelihood_parameters: Some(
            model
                .parameters
                .iter()
                .map(|name| {
                    let known = highest.parameters.iter().find(|(known, _)| known == name);
                    (name.key().to_owned(), known.map(|(_, value)| *value))
                })
                .collect(),
        ),
        posterior_mode: mode,
        log_marginal_likelihood: sampled.ln_evidence,
        log_kl: Some(
            accuracy
                .iter()
                .map(|cell| (cell.problem.clone(), cell.ln_kl.clone()))
                .collect(),
        ),
        predicted: Some(sampled.predicted_shares(data, &predictor)),
        diagnostics: sampled.diagnostics(data),
        n: data.n(),
        seed: settings.seed,
        chains: settings.chains,
        draws: settings.draws,
        steps_per_draw: sampled.steps_per_draw,
        acceptance: sampled.acceptance,
        reference_reward,
        priors: settings.priors,
        options: settings.options,
    };
    Ok(Fit {
        model,
        settings: settings.clone(),
        reference_reward,
        draws: sampled.draws,
        prior_draws,
        sample_indices: sampled.sample_indices,
        accuracy,
        summary,
    })
}

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// A setting is out of range.
    #[error("{name} is {value}, allowed is {low} to {high}")]
    Setting {
        /// Which one.
        name: &'static str,
        /// What was found.
        value: usize,
        /// Least.
        low: usize,
        /// Most.
        high: usize,
    },
    /// A prior is not possible.
    #[error(transparent)]
    Prior(#[from] PriorError),
    /// There is no reference reward.
    #[error(transparent)]
    ReferenceReward(#[from] ReferenceRewardError),
    /// The caller stopped it.
    #[error("the fit was stopped")]
    Stopped,
}

impl From<Stopped> for FitError {
    fn from(Stopped: Stopped) -> Self {
        Self::Stopped
    }
}

/// Draws with all that is read off them.
struct Sampled {
    draws: Draws,
    /// ln P(a) by draw for every action of every problem, problem after problem.
    ln_predicted: Vec<Vec<f64>>,
    /// Of each column of the draws.
    convergence: Vec<Convergence>,
    /// Of each problem, the worst action's; nothing where the probabilities are the same for all parameters.
    predicted_convergence: Vec<Option<Convergence>>,
    converged: bool,
    sample_indices: Vec<usize>,
    steps_per_draw: usize,
    acceptance: Option<f64>,
    ln_evidence: Option<Estimate>,
    /// Positions to climb from.
    points: Vec<Vec<f64>>,
}

fn sample(
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
    fn prior(
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
    fn problem_convergence(&self, range: std::ops::Range<usize>) -> Option<Convergence> {
        self.ln_predicted[range.start..range.end - 1]
            .iter()
            .filter(|column| column.iter().any(|value| (value - column[0]).abs() > 1e-12))
            .map(|column| Convergence::of(&self.draws.by_chain(column)))
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

    fn ln_predictions(&self, draw: usize, range: std::ops::Range<usize>) -> Vec<f64> {
        self.ln_predicted[range]
            .iter()
            .map(|column| column[draw])
            .collect()
    }

    fn accuracy(&self, data: &ChoiceData, predictor: &Predictor) -> Vec<CellAccuracy> {
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

    fn predicted_shares(
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
        let of_problem = |(index, problem): (usize, &super::FittedProblem)| {
            let columns = &self.ln_predicted[predictor.range(index)];
            let names = problem.problem.names().map(str::to_owned);
            (
                problem.id.clone(),
                names.zip(columns.iter().map(share)).collect(),
            )
        };
        data.problems().iter().enumerate().map(of_problem).collect()
    }

    fn diagnostics(&self, data: &ChoiceData) -> Diagnostics {
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

fn parameter_summary(
    posterior: &Posterior,
    quantity: Quantity,
    chains: &[&[f64]],
    prior: &[f64],
    convergence: Convergence,
) -> ParameterSummary {
    let mut values = chains.concat();
    let coordinates: Vec<f64> = values
        .iter()
        .map(|value| posterior.coordinate(quantity, *value))
        .collect();
    let contraction = 1.0 - variance(&coordinates) / posterior.prior_coordinate_variance(quantity);
    values.sort_by(f64::total_cmp);
    let mut prior = prior.to_vec();
    prior.sort_by(f64::total_cmp);
    let from_prior = posterior.is_prior(quantity);
    ParameterSummary {
        mean: mean(&values),
        sd: variance(&values).sqrt(),
        q5: quantile(&values, 0.05),
        q50: quantile(&values, 0.5),
        q95: quantile(&values, 0.95),
        rhat: convergence.rhat,
        ess_bulk: convergence.ess_bulk,
        ess_tail: convergence.ess_tail,
        mcse_mean: diagnostics::mcse_mean(chains),
        mcse_q50: diagnostics::mcse_quantile(chains, 0.5),
        prior_q5: quantile(&prior, 0.05),
        prior_q50: quantile(&prior, 0.5),
        prior_q95: quantile(&prior, 0.95),
        contraction,
        informed: !from_prior && contraction >= INFORMED_CONTRACTION,
        source: if from_prior {
            Source::Prior
        } else {
            Source::Choices
        },
    }
}

/// Contraction under which a parameter counts as not informed.
const INFORMED_CONTRACTION: f64 = 0.1;
