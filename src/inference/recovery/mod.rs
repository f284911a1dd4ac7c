//! Parameter recovery and power: what a study of a given size would find if people followed a given model.
//!
//! * [`Scenario`]: problems, people and two models; [`Scenario::replicate`] simulates one study and fits both models.
//! * [`Recovery`]: bias, coverage and width of each parameter, and how often the right and the wrong model win, each
//!   with its Monte-Carlo error.

mod scenario;
mod summary;

pub use scenario::{RecoveredQuantity, Replicate, Scenario, ScoreGap, Truth};
pub use summary::{QuantityRecovery, Recovery, Scale};
