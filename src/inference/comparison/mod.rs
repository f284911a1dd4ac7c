//! Which model predicts better, and how sure that is.
//!
//! The questions differ, and so may the answers:
//!
//! * [`LeaveOneOut`]: how well a model, fitted to everybody else, predicts the answers of one more person;
//! * [`HeldOut`]: how well a model, fitted to other problems, predicts one more;
//! * [`BayesFactor`]: how likely a model with its priors made the answers before any was seen;
//! * [`ChoiceTests`]: what the choices say without a model.
//!
//! [`LadderStep`] says what each richer model gains, [`Bootstrap`] how estimates vary with the people who took part, and
//! [`Verdict`] what all of it means for a hypothesis.
//!
//! [`compare_models`] asks them all for one plan of one study, for any number of models. Like a fit it is a pure
//! function of its arguments.

mod bayes_factor;
mod bootstrap;
mod choice_tests;
mod held_out;
mod ladder;
mod leave_one_out;
pub mod pareto;
mod plan;
mod pointwise;
mod report;
mod score;
mod verdict;

pub use bayes_factor::{BayesFactor, EvidenceWords, PriorChange, SensitivityRow};
pub use bootstrap::{Bootstrap, BootstrapSettings, ResampledInterval, participant_bootstrap};
pub use choice_tests::{
    AskedCell, ChoiceTests, FactorLevels, HalfTest, PairTest, PairedCells, Resampling,
    choice_tests, exact_half, exact_mcnemar, holm, pair_tests, paired_cells,
};
pub use held_out::{
    HeldOut, HeldOutPrediction, HeldOutProblem, HeldOutScore, HeldOutSettings, LEAST_PROBLEMS,
    OBSERVED_SHARE, RANDOM,
};
pub use ladder::{LadderStep, StepScore};
pub use leave_one_out::{LEAST_DIFFERENCE, LEAST_UNITS, LeaveOneOut, LeaveOneOutDifference};
pub use plan::{Answers, Part, Pattern, PlanData, PlanError, Unit};
pub use pointwise::PartFit;
pub use report::{
    Comparison, ComparisonProgress, ComparisonSettings, KnownFit, ModelScores, Pair, compare_models,
};
pub use score::ScoreDifference;
pub use verdict::{Criterion, Hypothesis, Leaning, Outcome, Question, Verdict};
