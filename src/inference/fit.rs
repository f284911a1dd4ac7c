//! A fit: the posterior of one model given choices.

use std::ops::ControlFlow;

use serde::Serialize;

use super::accuracy::CellAccuracy;
use super::diagnostics::{Convergence, Workspace, mean, quantile, variance};
use super::likelihood::Predictor;
use super::maximum_likelihood::Optima;
use super::notes::annotate;
use super::posterior::Posterior;
use super::reference_reward::check_reference_reward;
use super::sampled::{Sampling, Warm};
use super::sampler::{LogDensity, Stopped};
use super::summary::{FitSummary, ParameterSummary, Source};
use super::{
    ChoiceData, Draws, FittedProblem, PriorError, Priors, Quantity, ReferenceRewardError,
    default_reference_reward,
};
use crate::model::{ChoiceModel, OrderedMap, Parameter, RiskAwareOptions};

/// Draws of the prior for its quantiles and curves.
const PRIOR_DRAWS: usize = 4096;

/// Everything that a fit depends on beside model and data.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
    /// What [`refit`] needs of it.
    pub warm_start: WarmStart,
}

/// What one fit leaves for the next of the same problems: where the posterior was. See [`refit`].
#[derive(Debug, Clone)]
pub struct WarmStart {
    model: &'static ChoiceModel,
    settings: FitSettings,
    problems: Vec<FittedProblem>,
    moved: Vec<Parameter>,
    /// Nothing where the earlier fit did not converge, or had nothing to move.
    warm: Option<Warm>,
    /// They depend on model, settings and problems alone.
    prior_draws: Draws,
    prior_sorted: Vec<Vec<f64>>,
    optima: Optima,
}

impl WarmStart {
    /// Whether a fit of this model, these problems and these settings may start from here.
    fn serves(
        &self,
        model: &'static ChoiceModel,
        data: &ChoiceData,
        settings: &FitSettings,
    ) -> bool {
        self.model == model && self.settings == *settings && self.problems == data.problems()
    }
}

/// Fits a model to choices that changed since an earlier fit, starting where that one ended.
///
/// A warm fit is marked as [`provisional`](FitSummary::provisional): its draws are from the same posterior as a cold
/// fit's, but depend on the fits before; the mode and the highest likelihood are climbed to from those of the earlier
/// fit and from the best draws only. Where the model, the problems or the settings differ, or where the
/// warm chains do not converge, it is a cold fit and not provisional.
///
/// # Errors
/// As [`fit`].
pub fn refit(
    previous: &WarmStart,
    model: &'static ChoiceModel,
    data: &ChoiceData,
    settings: &FitSettings,
    watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Fit, FitError> {
    let previous = previous.serves(model, data, settings).then_some(previous);
    fit_from(previous, model, data, settings, watch)
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
    /// Convergence is settled; the evidence and the highest likelihood are looked for.
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
    fit_from(None, model, data, settings, watch)
}

/// Fits warm if there is an earlier fit that serves and that suffices, else cold.
fn fit_from(
    previous: Option<&WarmStart>,
    model: &'static ChoiceModel,
    data: &ChoiceData,
    settings: &FitSettings,
    watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Fit, FitError> {
    let mut posterior = settings.posterior(model, data)?;
    let reference_reward = posterior.reference_reward();
    let options = model.options(settings.options);
    let mut predictor = Predictor::new(
        data.problems().iter().map(|problem| &problem.problem),
        options,
    );

    let earlier = previous
        .filter(|previous| previous.moved == posterior.moved())
        .and_then(|previous| previous.warm.as_ref());
    let is_fixed = posterior.dimension() == 0;
    let mut sampling = Sampling {
        posterior: &mut posterior,
        predictor: &mut predictor,
        data,
        settings,
        generation: 0,
        workspace: Workspace::default(),
    };
    let warm = match earlier {
        Some(earlier) => sampling.warm(earlier, watch)?,
        None => None,
    };
    let provisional = warm.is_some();
    let judged = match warm {
        Some(judged) => Some(judged),
        None if is_fixed => None,
        None => Some(sampling.cold(watch)?),
    };
    // From here on it is known whether what was sampled may be used. Draws straight from the prior are independent by
    // construction; they are measured with the rest.
    if watch(Progress::Climbing).is_break() {
        return Err(FitError::Stopped);
    }
    let sampled = match judged {
        Some(judged) => sampling.finish(judged),
        None => sampling.prior(),
    };
    let mut workspace = sampling.workspace;
    let optima = match previous.filter(|_| provisional) {
        Some(previous) => Optima::near(&mut posterior, &previous.optima, &sampled.points),
        None => Optima::anywhere(&mut posterior, &sampled.points.points()),
    };
    let highest = optima.maximum_likelihood(model, &mut posterior);
    let mode = optima.mode.as_ref().map(|mode| {
        let point = posterior.point(&mode.position);
        let moved = posterior.moved().iter();
        moved
            .map(|name| (name.key().to_owned(), point.parameters.get(*name)))
            .collect()
    });
    let (prior_draws, prior_sorted) = match previous {
        Some(previous) => (previous.prior_draws.clone(), previous.prior_sorted.clone()),
        None => prior(&posterior),
    };
    let accuracy = sampled.accuracy(data, &predictor);

    let columns = sampled.draws.columns.iter().enumerate();
    let parameters: OrderedMap<ParameterSummary> = columns
        .map(|(index, (quantity, values))| {
            let summary = parameter_summary(
                &mut workspace,
                &posterior,
                *quantity,
                &sampled.draws.by_chain(values),
                &prior_sorted[index],
                sampled.convergence[index],
            );
            (quantity.key().to_owned(), summary)
        })
        .collect();
    let predicted = sampled.predicted_shares(&mut workspace, data, &predictor);
    let summary = FitSummary {
        model: model.id.to_owned(),
        converged: sampled.converged,
        provisional,
        parameters: Some(parameters),
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
        loss_aversion: None,
        notes: Vec::new(),
        log_marginal_likelihood: sampled.ln_evidence,
        log_kl: Some(
            accuracy
                .iter()
                .map(|cell| (cell.problem.clone(), cell.ln_kl.clone()))
                .collect(),
        ),
        predicted: Some(predicted),
        diagnostics: sampled.diagnostics(data, &predictor),
        n: data.n(),
        seed: settings.seed,
        chains: settings.chains,
        draws: settings.draws,
        steps_per_draw: sampled.steps_per_draw,
        acceptance: sampled.acceptance,
        reference_reward,
        priors: settings.priors,
        options,
    };
    let mut fitted = Fit {
        model,
        settings: settings.clone(),
        reference_reward,
        draws: sampled.draws,
        prior_draws: prior_draws.clone(),
        sample_indices: sampled.sample_indices,
        accuracy,
        summary,
        warm_start: WarmStart {
            model,
            settings: settings.clone(),
            problems: data.problems().to_vec(),
            moved: posterior.moved().to_vec(),
            warm: sampled.warm.filter(|_| sampled.converged),
            prior_draws,
            prior_sorted,
            optima,
        },
    };
    annotate(&mut fitted, data);
    Ok(fitted)
}

/// Evenly spread draws of the prior, and each column of them in increasing order.
fn prior(posterior: &Posterior) -> (Draws, Vec<Vec<f64>>) {
    let draws = posterior.prior_draws(PRIOR_DRAWS);
    let sorted = |(_, values): &(Quantity, Vec<f64>)| {
        let mut values = values.clone();
        values.sort_by(f64::total_cmp);
        values
    };
    let columns = draws.columns.iter().map(sorted).collect();
    (draws, columns)
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

fn parameter_summary(
    workspace: &mut Workspace,
    posterior: &Posterior,
    quantity: Quantity,
    chains: &[&[f64]],
    prior: &[f64],
    convergence: Convergence,
) -> ParameterSummary {
    let mut ordered = workspace.order(chains);
    let coordinates: Vec<f64> = ordered
        .values()
        .iter()
        .map(|value| posterior.coordinate(quantity, *value))
        .collect();
    let contraction = 1.0 - variance(&coordinates) / posterior.prior_coordinate_variance(quantity);
    let from_prior = posterior.is_prior(quantity);
    ParameterSummary {
        mean: mean(ordered.values()),
        sd: variance(ordered.values()).sqrt(),
        q5: quantile(ordered.values(), 0.05),
        q50: quantile(ordered.values(), 0.5),
        q95: quantile(ordered.values(), 0.95),
        rhat: convergence.rhat,
        ess_bulk: convergence.ess_bulk,
        ess_tail: convergence.ess_tail,
        mcse_mean: ordered.mcse_mean(),
        mcse_q50: ordered.mcse_quantile(0.5),
        prior_q5: quantile(prior, 0.05),
        prior_q50: quantile(prior, 0.5),
        prior_q95: quantile(prior, 0.95),
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
