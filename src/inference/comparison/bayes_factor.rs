//! Bayes factors, and how far they hang on the priors.

use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use super::plan::PlanData;
use super::pointwise::PartFit;
use crate::inference::{
    Estimate, FitError, PAPER_RANGE_FLOOR, Prior, Priors, WEIGHTING_FLOOR, fit,
};
use crate::model::{ChoiceModel, Parameter};

/// How much more likely one model makes the answers than another, both averaged over their priors.
///
/// ```text
/// ln BF = Σ_parts ln Z(first, part) − ln Z(second, part),   Z = ∫ L · prior
/// ```
///
/// It depends on the priors, and should never be shown without saying so. Binomial coefficients are left out, which
/// changes nothing: both models have the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct BayesFactor {
    /// ln BF with its Monte-Carlo error: above 0 the first model makes the answers likelier.
    pub ln: Estimate,
    /// The same under other priors; missing if it was not asked for.
    pub sensitivity: Option<Vec<SensitivityRow>>,
    /// In words, after the weakest row; missing if rows differ in sign, are within two errors of 0, or are missing.
    pub words: Option<EvidenceWords>,
}

/// The Bayes factor under changed priors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct SensitivityRow {
    /// What was changed.
    pub change: PriorChange,
    /// Its value.
    pub value: f64,
    /// Whether the change is none: the row of the priors in use.
    pub in_use: bool,
    /// ln BF; missing if a fit did not converge.
    pub ln: Option<Estimate>,
}

/// A change of the priors of both models.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PriorChange {
    /// The log-sd of the sensitivity τ.
    TauLogSd,
    /// The lower end of γ and δ.
    WeightingFloor,
    /// The log-sd of loss aversion λ.
    LambdaLogSd,
}

/// Verbal grades of a Bayes factor, whichever model it favours.
///
/// Source: Lee & Wagenmakers (2013), *Bayesian cognitive modeling*, table 7.1, after Jeffreys (1961).
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, utoipa::ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum EvidenceWords {
    /// Up to 3.
    Anecdotal,
    /// 3 to 10.
    Moderate,
    /// 10 to 30.
    Strong,
    /// 30 to 100.
    VeryStrong,
    /// Above 100.
    Extreme,
}

impl EvidenceWords {
    /// The grade in words.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Anecdotal => "anecdotal",
            Self::Moderate => "moderate",
            Self::Strong => "strong",
            Self::VeryStrong => "very strong",
            Self::Extreme => "extreme",
        }
    }

    fn of(ln_bayes_factor: f64) -> Self {
        let factor = ln_bayes_factor.abs();
        let bounds = [
            (3.0_f64, Self::Anecdotal),
            (10.0, Self::Moderate),
            (30.0, Self::Strong),
            (100.0, Self::VeryStrong),
        ];
        bounds
            .into_iter()
            .find(|(bound, _)| factor <= bound.ln())
            .map_or(Self::Extreme, |(_, words)| words)
    }
}

impl BayesFactor {
    /// ln BF of the first model against the second; nothing where a fit has no marginal likelihood.
    pub fn of(first: &[PartFit], second: &[PartFit]) -> Option<Self> {
        let ln = difference(ln_evidence(first)?, ln_evidence(second)?);
        Some(Self {
            ln,
            sensitivity: None,
            words: None,
        })
    }

    /// The same with the rows of two sensitivity tables.
    pub(super) fn with_sensitivity(self, first: &[EvidenceRow], second: &[EvidenceRow]) -> Self {
        let rows: Vec<SensitivityRow> = first
            .iter()
            .zip(second)
            .map(|(first, second)| SensitivityRow {
                change: first.change,
                value: first.value,
                in_use: first.in_use,
                ln: first
                    .ln_evidence
                    .zip(second.ln_evidence)
                    .map(|(first, second)| difference(first, second)),
            })
            .collect();
        let words = words(self.ln, &rows);
        Self {
            sensitivity: Some(rows),
            words,
            ..self
        }
    }

    /// Which sign every row shares; nothing if they differ, one is within two errors of 0, or there is no table.
    pub fn common_sign(&self) -> Option<f64> {
        common_sign(self.ln, self.sensitivity.as_ref()?)
    }
}

fn difference(first: Estimate, second: Estimate) -> Estimate {
    Estimate {
        value: first.value - second.value,
        se: first.se.hypot(second.se),
    }
}

/// Σ over parts of ln Z, with its error.
pub(super) fn ln_evidence(fits: &[PartFit]) -> Option<Estimate> {
    let mut sum = Estimate {
        value: 0.0,
        se: 0.0,
    };
    for fit in fits {
        let part = fit.summary.log_marginal_likelihood?;
        if !fit.summary.converged {
            return None;
        }
        sum.value += part.value;
        sum.se = sum.se.hypot(part.se);
    }
    Some(sum)
}

fn common_sign(ln: Estimate, rows: &[SensitivityRow]) -> Option<f64> {
    let mut all = vec![ln];
    for row in rows {
        all.push(row.ln?);
    }
    let clear = all.iter().all(|row| row.value.abs() > 2.0 * row.se);
    let sign = ln.value.signum();
    (clear && all.iter().all(|row| row.value.signum() == sign)).then_some(sign)
}

fn words(ln: Estimate, rows: &[SensitivityRow]) -> Option<EvidenceWords> {
    common_sign(ln, rows)?;
    let weakest = rows
        .iter()
        .filter_map(|row| row.ln)
        .chain([ln])
        .map(|row| row.value.abs())
        .fold(f64::INFINITY, f64::min);
    Some(EvidenceWords::of(weakest))
}

/// One model's marginal likelihood under changed priors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EvidenceRow {
    change: PriorChange,
    value: f64,
    in_use: bool,
    ln_evidence: Option<Estimate>,
}

/// A model's marginal likelihoods under τ log-sd 0.75, 1.5 and 3, a weighting floor of 0.05 and 0.28, and λ log-sd halved
/// and doubled.
///
/// * `fits`: under the priors in use, one per part.
///
/// Priors of another kind than the change speaks of (a uniform τ) have no such row.
pub(super) fn sensitivity(
    plan: &PlanData,
    fits: &[PartFit],
    watch: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Vec<EvidenceRow>, FitError> {
    let Some(first) = fits.first() else {
        return Ok(Vec::new());
    };
    let mut rows = Vec::new();
    for (change, value, priors) in changes(first.summary.priors) {
        let in_use = priors == first.summary.priors;
        let untouched = in_use || !change.concerns(first.model);
        let ln_evidence = if untouched {
            ln_evidence(fits)
        } else {
            let mut changed = Vec::with_capacity(fits.len());
            for (part, known) in plan.parts().iter().zip(fits) {
                let settings = crate::inference::FitSettings {
                    priors,
                    ..known.settings()
                };
                let refit = fit(known.model, part.data(), &settings, &mut |_| watch())?;
                changed.push(PartFit::from(refit));
            }
            ln_evidence(&changed)
        };
        rows.push(EvidenceRow {
            change,
            value,
            in_use,
            ln_evidence,
        });
    }
    Ok(rows)
}

impl PriorChange {
    /// Whether the model learns a parameter whose prior changes.
    fn concerns(self, model: &ChoiceModel) -> bool {
        match self {
            Self::TauLogSd => model.is_free(Parameter::Theta),
            Self::WeightingFloor => {
                model.is_free(Parameter::Gamma) || model.is_free(Parameter::Delta)
            }
            Self::LambdaLogSd => model.is_free(Parameter::Lambda),
        }
    }
}

/// The changed priors of each row.
fn changes(base: Priors) -> Vec<(PriorChange, f64, Priors)> {
    let mut rows = Vec::new();
    if let Prior::LogNormal { median, .. } = base.tau {
        for log_sd in [0.75, 1.5, 3.0] {
            let tau = Prior::LogNormal { median, log_sd };
            rows.push((PriorChange::TauLogSd, log_sd, Priors { tau, ..base }));
        }
    }
    for floor in [PAPER_RANGE_FLOOR, WEIGHTING_FLOOR] {
        let from_floor = |prior: Prior| match prior {
            Prior::Uniform { high, .. } if floor < high => {
                Some(Prior::Uniform { low: floor, high })
            }
            Prior::Uniform { .. } | Prior::LogNormal { .. } => None,
        };
        if let (Some(gamma), Some(delta)) = (from_floor(base.gamma), from_floor(base.delta)) {
            let priors = Priors {
                gamma,
                delta,
                ..base
            };
            rows.push((PriorChange::WeightingFloor, floor, priors));
        }
    }
    if let Prior::LogNormal { median, log_sd } = base.lambda {
        for factor in [0.5, 2.0] {
            let lambda = Prior::LogNormal {
                median,
                log_sd: factor * log_sd,
            };
            let priors = Priors { lambda, ..base };
            rows.push((PriorChange::LambdaLogSd, factor * log_sd, priors));
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(value: f64, se: f64) -> SensitivityRow {
        SensitivityRow {
            change: PriorChange::TauLogSd,
            value: 1.5,
            in_use: false,
            ln: Some(Estimate { value, se }),
        }
    }

    #[test]
    fn words_need_one_sign_in_every_row_and_follow_the_weakest() {
        let ln = Estimate {
            value: 6.0,
            se: 0.01,
        };
        let found = words(ln, &[row(3.0, 0.01), row(5.0, 0.01)]);
        assert_eq!(found, Some(EvidenceWords::Strong));
        assert_eq!(words(ln, &[row(3.0, 0.01), row(-0.5, 0.01)]), None);
        assert_eq!(words(ln, &[row(3.0, 2.0)]), None);
        let missing = SensitivityRow {
            ln: None,
            ..row(3.0, 0.01)
        };
        assert_eq!(words(ln, &[missing]), None);
    }

    #[test]
    fn grades_have_the_published_bounds() {
        for (factor, expected) in [
            (2.9_f64, EvidenceWords::Anecdotal),
            (3.1, EvidenceWords::Moderate),
            (29.0, EvidenceWords::Strong),
            (99.0, EvidenceWords::VeryStrong),
            (101.0, EvidenceWords::Extreme),
        ] {
            assert_eq!(EvidenceWords::of(factor.ln()), expected);
            assert_eq!(EvidenceWords::of(-factor.ln()), expected);
        }
    }

    #[test]
    fn the_table_has_seven_rows_two_of_which_are_in_use() {
        let base = Priors::default();
        let rows = changes(base);
        assert_eq!(rows.len(), 7);
        let same = rows.iter().filter(|(_, _, priors)| *priors == base);
        assert_eq!(same.count(), 2);
        let uniform = Priors {
            tau: Prior::Uniform {
                low: 0.0,
                high: 9.0,
            },
            ..base
        };
        assert_eq!(changes(uniform).len(), 4);
    }
}
