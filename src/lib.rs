//! riskaware hosts risky-choice studies and fits models of the people who answer, while they answer.
//!
//! Modules in reading order:
//!
//! * [`model`]: prospects, choice problems and the models that turn them into choice probabilities.
//! * [`inference`]: what choices say about a model's parameters: posterior, diagnostics, accuracy, curves.
//! * [`study`]: study files, the steps of a run, and the rules of time limits.
//! * [`cli`]: the commands of the `riskaware` binary.

pub mod cli;
pub mod inference;
pub mod model;
pub mod study;
