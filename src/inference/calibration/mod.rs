//! Simulation-based calibration: whether posteriors are what they claim to be.
//!
//! If parameters come from the prior and choices from these parameters, then the rank of the true parameters among
//! independent posterior draws is uniform, whatever the model. Anything else shows that prior, likelihood, sampler or
//! spacing of the draws is wrong: ranks that pile up in the middle come from posteriors that are too wide, ranks at
//! the ends from ones that are too narrow, ranks that lean to one side from biased ones.
//!
//! * [`Experiment`]: a design with a model; [`Experiment::replicate`] gives the ranks of one simulated study.
//! * [`UniformRanks`], [`Bands`]: whether ranks are uniform.
//! * [`judge`]: the same for all quantities of several experiments and seeds together.
//!
//! Source: Talts, Betancourt, Simpson, Vehtari & Gelman (2018), *Validating Bayesian inference algorithms with
//! simulation-based calibration*, arXiv 1804.06788, algorithm 1; Modrák et al. (2023) for the likelihood as a quantity
//! that notices what parameters alone do not.

mod judgement;
mod replicate;
mod uniformity;

pub use judgement::{Judgement, LEVEL, QuantityJudgement, RankSet, RankTest, judge};
pub use replicate::{Experiment, RankedQuantity, Replicate, rank};
pub use uniformity::{Bands, UniformRanks};
