//! What a fit says, ready for JSON.

use serde::{Deserialize, Deserializer, Serialize};

use super::accuracy::LnKl;
use super::diagnostics::Convergence;
use super::{LossAversion, Note, Priors};
use crate::model::{OrderedMap, RiskAwareOptions};

/// The summary of a fit. In JSON numbers that do not exist are `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FitSummary {
    /// The model's id.
    pub model: String,
    /// Whether every R̂ is under 1.01 and every effective sample size over 400.
    pub converged: bool,
    /// Whether the chains started from an earlier fit's, so that the draws depend on the fits before.
    #[serde(default)]
    pub provisional: bool,
    /// What the data say about the parameters, in the order in which they are reported.
    #[schema(value_type = Option<HashMap<String, ParameterSummary>>)]
    pub parameters: Option<OrderedMap<ParameterSummary>>,
    /// Highest ln L within the ranges of the parameters, without binomial coefficients.
    pub max_log_likelihood: Option<f64>,
    /// The parameters there; `null` for one that the choices say nothing about.
    #[schema(value_type = Option<HashMap<String, Option<f64>>>)]
    pub max_likelihood_parameters: Option<OrderedMap<Option<f64>>>,
    /// The parameters at the highest posterior density on the sampler's coordinates.
    #[schema(value_type = Option<HashMap<String, f64>>)]
    pub posterior_mode: Option<OrderedMap<f64>>,
    /// Loss aversion at the study's small, median and large amounts, where it depends on the amount.
    #[serde(default)]
    pub loss_aversion: Option<Vec<LossAversion>>,
    /// What limits the reading of this fit.
    #[serde(default)]
    pub notes: Vec<Note>,
    /// ln of the likelihood averaged over the prior.
    pub log_marginal_likelihood: Option<Estimate>,
    /// ln KL of each problem that has answers, over independent posterior samples.
    #[schema(value_type = Option<HashMap<String, LnKl>>)]
    pub log_kl: Option<OrderedMap<LnKl>>,
    /// Probability of each action of each problem.
    #[schema(value_type = Option<HashMap<String, HashMap<String, PredictedShare>>>)]
    pub predicted: Option<OrderedMap<OrderedMap<PredictedShare>>>,
    /// Convergence of each quantity, shown whether converged or not.
    pub diagnostics: Diagnostics,
    /// How many choices were fitted.
    pub n: u64,
    /// Random seed.
    pub seed: u64,
    /// Chains.
    pub chains: usize,
    /// Draws kept per chain.
    pub draws: usize,
    /// Steps of the kernel for each draw kept.
    pub steps_per_draw: usize,
    /// Share of proposals accepted.
    pub acceptance: Option<f64>,
    /// Signed reward that gives τ its unit.
    pub reference_reward: f64,
    /// Priors used.
    pub priors: Priors,
    /// Options used, those that the model asks for included.
    pub options: RiskAwareOptions,
}

impl FitSummary {
    /// The summary as it may be shown: without results if the chains have not converged.
    pub fn shown(&self) -> Self {
        if self.converged {
            return self.clone();
        }
        Self {
            parameters: None,
            max_log_likelihood: None,
            max_likelihood_parameters: None,
            posterior_mode: None,
            loss_aversion: None,
            notes: self
                .notes
                .iter()
                .filter(|note| note.is_diagnostic())
                .cloned()
                .collect(),
            log_marginal_likelihood: None,
            log_kl: None,
            predicted: None,
            ..self.clone()
        }
    }
}

/// The posterior of one quantity, beside its prior.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ParameterSummary {
    /// Posterior mean.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub mean: f64,
    /// Posterior standard deviation. Sensitivity has heavy tails: judge it by quantiles.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub sd: f64,
    /// 5 % quantile.
    pub q5: f64,
    /// Median.
    pub q50: f64,
    /// 95 % quantile.
    pub q95: f64,
    /// Rank-normalised split R̂.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub rhat: f64,
    /// Effective sample size for the middle.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub ess_bulk: f64,
    /// Effective sample size for the tails.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub ess_tail: f64,
    /// Monte-Carlo standard error of the mean.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub mcse_mean: f64,
    /// Monte-Carlo standard error of the median.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub mcse_q50: f64,
    /// 5 % quantile of the prior.
    pub prior_q5: f64,
    /// Median of the prior.
    pub prior_q50: f64,
    /// 95 % quantile of the prior.
    pub prior_q95: f64,
    /// 1 − Var(posterior)/Var(prior) on the unconstrained coordinate; negative if the data made it vaguer.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub contraction: f64,
    /// Whether the data said something about it: contraction of 0.1 or more, and not tied to the prior by structure.
    pub informed: bool,
    /// Whether the posterior is learned from choices, or the prior because no choice depends on it.
    pub source: Source,
}

/// Where a quantity's posterior comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// From choices.
    Choices,
    /// From the prior alone: no choice depends on it.
    Prior,
}

/// Convergence of everything that a fit reports.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Diagnostics {
    /// Of each parameter.
    #[schema(value_type = HashMap<String, QuantityDiagnostics>)]
    pub parameters: OrderedMap<QuantityDiagnostics>,
    /// Of the predicted probabilities of each problem, the worst action's.
    #[schema(value_type = HashMap<String, QuantityDiagnostics>)]
    pub predicted: OrderedMap<QuantityDiagnostics>,
}

impl Diagnostics {
    /// The largest R̂ over parameters and predictions; `None` where nothing moved.
    pub fn rhat_max(&self) -> Option<f64> {
        self.all(|quantity| quantity.rhat).max_by(f64::total_cmp)
    }

    /// The smallest effective sample size, bulk or tail, over parameters and predictions.
    pub fn ess_min(&self) -> Option<f64> {
        self.all(|quantity| quantity.ess_bulk.min(quantity.ess_tail))
            .min_by(f64::total_cmp)
    }

    fn all(&self, of: impl Fn(&QuantityDiagnostics) -> f64) -> impl Iterator<Item = f64> {
        self.parameters
            .iter()
            .chain(self.predicted.iter())
            .map(move |(_, quantity)| of(quantity))
            .filter(|value| value.is_finite())
    }
}

/// Convergence of one quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct QuantityDiagnostics {
    /// Rank-normalised split R̂; `null` if the quantity never moved.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub rhat: f64,
    /// Effective sample size for the middle.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub ess_bulk: f64,
    /// Effective sample size for the tails.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub ess_tail: f64,
}

impl From<Convergence> for QuantityDiagnostics {
    fn from(convergence: Convergence) -> Self {
        let Convergence {
            rhat,
            ess_bulk,
            ess_tail,
        } = convergence;
        Self {
            rhat,
            ess_bulk,
            ess_tail,
        }
    }
}

/// An action's probability.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PredictedShare {
    /// Posterior mean.
    pub mean: f64,
    /// 5 % quantile.
    pub q5: f64,
    /// 95 % quantile.
    pub q95: f64,
}

/// A number with its Monte-Carlo error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its standard error.
    pub se: f64,
}

/// JSON has no NaN: it is written as `null` and read back.
pub(super) fn null_as_nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}
