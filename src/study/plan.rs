//! What is fitted, with which settings, and the figures of the source paper that stand beside ours.

use super::{ActionLabel, FactorId, LevelId, ParseError, PartId, PlanId, parse};
use crate::model::{ChoiceModel, PAPER_MODELS, RiskAwareOptions};

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
    /// The models, each once, in the order in which results name them: from the plainest to the richest. At least one.
    pub models: Vec<&'static ChoiceModel>,
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
            models: PAPER_MODELS.to_vec(),
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

impl Priors {
    /// Parses a file of priors alone, with the keys that `[fit.priors]` has in a study file. `file_name` only serves
    /// error messages.
    ///
    /// # Errors
    /// The first thing that is wrong with the file: where it is, what was found and what is allowed.
    pub fn parse(file_name: &str, text: &str) -> Result<Self, ParseError> {
        parse::priors(file_name, text)
    }
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
    /// How many people took each action, where that is known.
    pub choices: Vec<(ActionLabel, u32)>,
    /// Where these counts come from, if not from the paper.
    pub source: Option<String>,
}

/// A mean with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanSd {
    /// The mean.
    pub mean: f64,
    /// The standard deviation.
    pub sd: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_priors_has_the_keys_of_a_study_file() {
        let text =
            "gamma = { uniform = [0.05, 1] }\ntau = { log_normal = { median = 2, log_sd = 3 } }\n";
        let read = Priors::parse("mine.toml", text).unwrap();
        let gamma = PriorChange::Uniform {
            low: 0.05,
            high: 1.0,
        };
        let tau = PriorChange::LogNormal {
            median: 2.0,
            log_sd: 3.0,
        };
        let expected = Priors {
            gamma: Some(gamma),
            tau: Some(tau),
            ..Priors::default()
        };
        assert_eq!(read, expected);
    }

    #[track_caller]
    fn check_refused(text: &str, expected: &str) {
        let error = Priors::parse("mine.toml", text).unwrap_err();
        assert_eq!(error.to_string(), expected);
    }

    #[test]
    fn what_is_wrong_with_priors_is_told_with_its_line() {
        check_refused(
            "alpha = { uniform = [0, 1] }\ngama = { uniform = [0, 1] }\n",
            "mine.toml, line 2, gama: found unknown key `gama`, did you mean `gamma`?; allowed: one of `alpha`, `beta`, \
             `gamma`, `delta`, `lambda`, `tau`, `eta_gain`, `eta_loss`",
        );
        check_refused(
            "\nbeta = { uniform = [0.5, 1.5] }\n",
            "mine.toml, line 2, beta.uniform: found [0.5, 1.5]; allowed: two numbers from 0 to 1, the smaller first",
        );
        check_refused(
            "alpha = { log_normal = { median = 1, log_sd = 1 } }\n",
            "mine.toml, line 1, alpha: found `log_normal` for a parameter that lies between 0 and 1; allowed: \
             `uniform = [a, b]`",
        );
    }
}
