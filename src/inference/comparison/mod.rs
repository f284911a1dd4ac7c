//! Which model predicts better, and how sure that is.
//!
//! The questions differ, and so may the answers:
//!
//! * [`LeaveOneOut`]: how well a model, fitted to everybody else, predicts the answers of one more person;
//! * [`BayesFactor`]: how likely a model with its priors made the answers before any was seen.
//!
//! [`compare_models`] asks them all for one plan of one study, for any number of models. Like a fit it is a pure
//! function of its arguments.

mod bayes_factor;
mod leave_one_out;
pub mod pareto;
mod plan;
mod pointwise;
mod report;
mod score;

pub use bayes_factor::{BayesFactor, EvidenceWords, PriorChange, SensitivityRow};
pub use leave_one_out::{LEAST_DIFFERENCE, LEAST_UNITS, LeaveOneOut, LeaveOneOutDifference};
pub use plan::{Answers, Part, Pattern, PlanData, PlanError, Unit};
pub use pointwise::PartFit;
pub use report::{
    Comparison, ComparisonProgress, ComparisonSettings, KnownFit, ModelScores, Pair, compare_models,
};
pub use score::ScoreDifference;
