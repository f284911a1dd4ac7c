//! What is fitted, with which settings, and the figures of the source paper that stand beside ours.

use super::{FactorId, LevelId, PartId, PlanId};
use crate::model::RiskAwareOptions;

/// A way to split the fitted cells: each part gets its own fit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FitPlan {
    /// The plan's id, such as `risk`.
    pub id: PlanId,
    /// Its text on pages.
    pub label: String,
    /// The parts, in the order in which their cells stand in the file. Each fitted cell is in exactly one of them.
    pub parts: Vec<PlanPart>,
}

/// Cells that are fitted together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlanPart {
    /// The levels that its cells share, joined by `/` in factor order; `all` where the plan splits by nothing.
    pub id: PartId,
    /// The same as text for people.
    pub label: String,
    /// Positions in [`Study::cells`](super::Study::cells).
    pub cells: Vec<usize>,
}

/// How the models of a study are fitted (models.md, sections 2 and 4).
#[derive(Debug, Clone, PartialEq)]
pub struct FitSettings {
    /// How many independent posterior samples accuracy is reported over: 30 in the paper.
    pub samples: usize,
    /// The range that the prior of the weighting parameters allows.
    pub weighting: Weighting,
    /// What the Risk-Aware model assumes beside its parameters.
    pub options: RiskAwareOptions,
    /// Priors that the study changes.
    pub priors: Priors,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            samples: 30,
            weighting: Weighting::Monotone,
            options: RiskAwareOptions::default(),
            priors: Priors::default(),
        }
    }
}

/// The default prior of γ and δ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weighting {
    /// Uniform(0.28, 1): the weighting function rises everywhere.
    Monotone,
    /// Uniform(0.05, 1): the paper's wider range.
    PaperRange,
}

/// Priors that a study changes; `None` keeps the default of models.md, section 4.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Priors {
    /// Curvature of gains, in (0, 1].
    pub alpha: Option<PriorChange>,
    /// Curvature of losses, in (0, 1].
    pub beta: Option<PriorChange>,
    /// Weighting of gains, in (0, 1].
    pub gamma: Option<PriorChange>,
    /// Weighting of losses, in (0, 1].
    pub delta: Option<PriorChange>,
    /// Loss aversion, 0 or more.
    pub lambda: Option<PriorChange>,
    /// Sensitivity in logits at the reference reward, 0 or more.
    pub tau: Option<PriorChange>,
    /// η⁺ of Prelec's weighting with elevation.
    pub eta_gain: Option<PriorChange>,
    /// η⁻ of Prelec's weighting with elevation.
    pub eta_loss: Option<PriorChange>,
}

/// The prior of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PriorChange {
    /// Uniform between two bounds, `low < high`.
    Uniform {
        /// The lower bound.
        low: f64,
        /// The upper bound.
        high: f64,
    },
    /// Log-normal.
    LogNormal {
        /// The median, above 0.
        median: f64,
        /// The standard deviation of the logarithm, above 0.
        log_sd: f64,
    },
}

/// A row of the source paper's results.
#[derive(Debug, Clone, PartialEq)]
pub struct PaperFigure {
    /// What the row is about.
    pub label: String,
    /// The levels that its cells share; empty for all cells together.
    pub levels: Vec<(FactorId, LevelId)>,
    /// ln KL of the Risk-Aware model.
    pub risk_aware: Option<MeanSd>,
    /// ln KL of the Noisy Rational model.
    pub noisy_rational: Option<MeanSd>,
    /// The t statistic of the paired difference.
    pub t: Option<f64>,
    /// Its degrees of freedom.
    pub df: Option<u32>,
    /// Its p value as printed, such as `< .001`.
    pub p: Option<String>,
    /// How many people took part.
    pub n: Option<u32>,
}

/// A mean with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanSd {
    /// The mean.
    pub mean: f64,
    /// The standard deviation.
    pub sd: f64,
}
