//! What choices say about the parameters of a model.
//!
//! In reading order:
//!
//! * data and priors: [`ChoiceData`], [`Priors`], [`default_reference_reward`];
//! * machinery that knows no model: [`sampler`] (with its [`LogDensity`](sampler::LogDensity)), [`optimum`] and
//!   [`diagnostics`];
//! * [`fit`]: a posterior by Metropolis–Hastings, with its [`Draws`] and its [`FitSummary`];
//! * [`comparison`]: which of several models predicts better;
//! * [`sequential`]: how the evidence grew, and when it was enough;
//! * what is read off a fit: [`accuracy`], [`curves`], [`predict_from_draws`], [`wilson_interval`].
//!
//! A fit is a pure function of counts, settings and seed: no clock, no global randomness, no input or output.

pub mod accuracy;
mod choice_data;
pub mod comparison;
pub mod curves;
pub mod diagnostics;
mod draws;
mod fit;
mod likelihood;
mod maximum_likelihood;
pub mod optimum;
mod posterior;
mod prediction;
mod priors;
mod proportion;
mod reference_reward;
mod sampled;
pub mod sampler;
pub mod sequential;
mod summary;
mod utility_table;

pub use choice_data::{ChoiceData, ChoiceDataError, FittedProblem, Group};
pub use draws::{Draws, Quantity};
pub use fit::{Fit, FitError, FitSettings, Progress, WarmStart, fit, refit, uninterrupted};
pub use maximum_likelihood::MaximumLikelihood;
pub use posterior::LnPosterior;
pub use prediction::{ActionPrediction, Prediction, predict_from_draws};
pub use priors::{PAPER_RANGE_FLOOR, Prior, PriorError, Priors, WEIGHTING_FLOOR};
pub use proportion::wilson_interval;
pub use reference_reward::{ReferenceRewardError, default_reference_reward};
pub use summary::{
    Diagnostics, Estimate, FitSummary, ParameterSummary, PredictedShare, QuantityDiagnostics,
    Source,
};
