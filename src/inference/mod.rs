//! What choices say about the parameters of a model.
//!
//! In reading order:
//!
//! * data and priors: [`ChoiceData`], [`Priors`], [`default_reference_reward`];
//! * machinery that knows no model: [`sampler`] (with its [`LogDensity`](sampler::LogDensity)), [`optimum`] and
//!   [`diagnostics`];
//! * [`fit`]: a posterior by Metropolis–Hastings, with its [`Draws`] and its [`FitSummary`];
//! * [`comparison`]: which of several models predicts better;
//! * [`factor`]: whether groups of people choose differently;
//! * [`sequential`]: how the evidence grew, and when it was enough;
//! * what is read off a fit: [`accuracy`], [`curves`], [`predictive_check`], [`predict_from_draws`], [`wilson_interval`];
//! * [`DrawsExport`]: the draws for other programs;
//! * whether fits are to be believed, and what a study would find: [`calibration`] and [`recovery`], on
//!   [simulated people](SimulatedPerson);
//! * [`sweep`]: models fitted to simulated answers.
//!
//! A fit is a pure function of counts, settings and seed: no clock, no global randomness, no input or output.

pub mod accuracy;
pub mod calibration;
mod choice_data;
pub mod comparison;
mod coordinate;
pub mod curves;
pub mod diagnostics;
mod draws;
mod export;
pub mod factor;
mod fit;
pub mod lanes;
mod likelihood;
mod ln_posterior;
mod maximum_likelihood;
mod notes;
pub mod optimum;
mod parameter_space;
mod posterior;
mod prediction;
pub mod predictive_check;
mod priors;
mod proportion;
pub mod recovery;
mod reference_reward;
mod sampled;
pub mod sampler;
pub mod sequential;
mod simulated;
mod summary;
pub mod sweep;
mod utility_table;

pub use choice_data::{ChoiceData, ChoiceDataError, FittedProblem, Group};
pub use draws::{Draws, Quantity};
pub use export::{DrawsExport, ExportError};
pub use fit::{Fit, FitError, FitSettings, Progress, WarmStart, fit, refit, uninterrupted};
pub use ln_posterior::LnPosterior;
pub use maximum_likelihood::MaximumLikelihood;
pub use notes::{ChainPosition, End, LossAversion, Note, design_note};
pub use prediction::{ActionPrediction, Prediction, predict_from_draws};
pub use priors::{PAPER_RANGE_FLOOR, Prior, PriorError, Priors, WEIGHTING_FLOOR};
pub use proportion::wilson_interval;
pub use reference_reward::{ReferenceRewardError, default_reference_reward};
pub use simulated::{SimulatedFitError, SimulatedPerson, SimulationError, draw_action};
pub use summary::{
    Diagnostics, Estimate, FitSummary, ParameterSummary, PredictedShare, QuantityDiagnostics,
    Source,
};
