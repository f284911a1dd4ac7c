//! Choice models: from a choice problem and parameters to choice probabilities.
//!
//! * [`Prospect`], [`ChoiceProblem`]: what a person can choose from.
//! * [`Parameters`], [`ChoiceModel`]: what a model assumes about the person.
//! * [`weighting`], [`value`]: the two functions of cumulative prospect theory.
//! * [`decision_weights`], [`utilities`], [`ln_probabilities`], [`probabilities`]: a model's answer.
//!
//! Nothing here knows how parameters are learned.
//!
//! Sources: Kwon, Biyik, Talati, Bhasin, Losey & Sadigh, *When Humans Aren't Optimal* (HRI 2020), "the paper";
//! Tversky & Kahneman, *Advances in Prospect Theory* (1992).

mod choice_model;
mod choice_problem;
mod choice_rule;
mod ordered_map;
mod parameters;
#[cfg(test)]
mod properties;
mod prospect;
mod psychophysics;

pub use choice_model::{
    CUMULATIVE_PROSPECT, ChoiceModel, Curvature, EXPECTED_UTILITY, MODELS, ModelError,
    NOISY_RATIONAL, PAPER_MODELS, RISK_AWARE, RISK_AWARE_PRELEC, RISK_AWARE_PRELEC_ELEVATION,
    RISK_AWARE_SAME_SIGN, RISK_AWARE_UNNORMALISED, model_named,
};
pub use choice_problem::{ActionProspect, ChoiceProblem, ChoiceProblemError};
pub use choice_rule::{
    ChoiceError, RiskAwareOptions, ZeroOutcome, decision_weights, ln_probabilities,
    ln_softmax_into, probabilities, utilities,
};
pub(crate) use choice_rule::{Cumulative, weight_spans, weights_of_spans};
pub use ordered_map::OrderedMap;
pub use parameters::{Parameter, ParameterError, Parameters};
pub use prospect::{Outcome, Prospect, ProspectError};
pub use psychophysics::{WeightingFunction, value, weighting};
