//! How well a model predicts a person from everybody else.
//!
//! Source: Vehtari, Gelman & Gabry (2017), *Practical Bayesian model evaluation using leave-one-out cross-validation and
//! WAIC*, Statistics and Computing 27.

use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use super::pareto::{ln_sum_exp, shape_threshold, smooth};
use super::plan::{Part, Pattern, PlanData};
use super::pointwise::PartFit;
use super::score::{ScoreDifference, Weighted, sum_and_se};
use crate::inference::diagnostics::ess_mean;
use crate::inference::summary::null_as_nan;
use crate::inference::{ChoiceData, FitError, fit};

/// Differences smaller than this, in nats, are not told apart.
pub const LEAST_DIFFERENCE: f64 = 4.0;

/// With fewer units than this the standard error of a difference is not to be trusted.
pub const LEAST_UNITS: u64 = 30;

/// Expected log score of units that were left out, one at a time.
///
/// ```text
/// elpd = Σᵢ ln p(yᵢ | y₋ᵢ)
/// ```
///
/// * yᵢ: all answers of unit i in the plan; y₋ᵢ: those of all other units.
///
/// Where parts are fitted apart, a unit's score is the sum over its parts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LeaveOneOut {
    /// elpd in nats.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub elpd: f64,
    /// Its standard error √(N·Var elpdᵢ); missing for fewer than two units.
    pub se: Option<f64>,
    /// p_loo: by how much the score of the same answers is higher if they are not left out.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub effective_parameters: f64,
    /// N, how many units.
    pub units: u64,
    /// The largest k̂ among estimates that were kept; missing if every one was refitted or needs none.
    pub worst_shape: Option<f64>,
    /// k̂ above which a unit is left out by a fit of its own.
    pub threshold: f64,
    /// How many units were scored by such a fit, in at least one part.
    pub refitted: u64,
    /// For how many of them that fit did not converge: if any, the score is not to be trusted.
    pub unconverged: u64,
}

/// The difference between two models when units are left out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LeaveOneOutDifference {
    /// Over units.
    #[serde(flatten)]
    pub difference: ScoreDifference,
    /// Whether |Δ| ≥ 4 and N ≥ 30, and no refit failed: otherwise the models are not distinguishable.
    pub distinguishable: bool,
}

/// A model's score with what each pattern of the plan contributes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Scored {
    pub(super) report: LeaveOneOut,
    pub(super) units: Vec<Weighted>,
}

impl Scored {
    /// First minus second.
    pub(super) fn minus(&self, other: &Self) -> LeaveOneOutDifference {
        let difference = ScoreDifference::of(&self.units, &other.units);
        LeaveOneOutDifference {
            difference,
            distinguishable: difference.value.abs() >= LEAST_DIFFERENCE
                && difference.units >= LEAST_UNITS
                && self.report.unconverged + other.report.unconverged == 0,
        }
    }
}

/// The score of one pattern of answers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PatternScore {
    left_out: f64,
    /// ln of the mean likelihood over draws of the fit with everybody.
    with_everybody: f64,
    shape: f64,
    refit: Option<Refit>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Refit {
    Converged,
    Unconverged,
}

/// Leaves out each unit of a plan in turn.
///
/// * `fits`: one per part, in the plan's order.
pub(super) fn leave_one_out(
    plan: &PlanData,
    fits: &[PartFit],
    watch: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Scored, FitError> {
    let mut by_part = Vec::with_capacity(fits.len());
    for (part, fit) in plan.parts().iter().zip(fits) {
        by_part.push(pattern_scores(part, fit, watch)?);
    }
    let patterns = plan.patterns();
    let scores_of = |pattern: usize| {
        let parts = plan.parts().iter().zip(&by_part);
        parts.filter_map(move |(part, scores)| part.membership()[pattern].map(|own| scores[own]))
    };
    let sums = |score: fn(PatternScore) -> f64| -> Vec<Weighted> {
        let places = patterns.iter().enumerate();
        places
            .map(|(place, pattern)| (pattern.weight, scores_of(place).map(score).sum()))
            .collect()
    };
    let units = sums(|score| score.left_out);
    let (everybody, _) = sum_and_se(&sums(|score| score.with_everybody));
    let weight_where = |condition: &dyn Fn(&PatternScore) -> bool| -> u64 {
        let places = patterns.iter().enumerate();
        places
            .filter(|(place, _)| scores_of(*place).any(|score| condition(&score)))
            .map(|(_, pattern)| pattern.weight)
            .sum()
    };
    let (elpd, se) = sum_and_se(&units);
    let kept = by_part
        .iter()
        .flatten()
        .filter(|score| score.refit.is_none() && score.shape.is_finite());
    let draws = fits.iter().map(|fit| fit.draws.len()).min().unwrap_or(2);
    let report = LeaveOneOut {
        elpd,
        se,
        effective_parameters: everybody - elpd,
        units: plan.units(),
        worst_shape: kept.map(|score| score.shape).reduce(f64::max),
        threshold: shape_threshold(draws),
        refitted: weight_where(&|score| score.refit.is_some()),
        unconverged: weight_where(&|score| score.refit == Some(Refit::Unconverged)),
    };
    Ok(Scored { report, units })
}

/// The scores of a part's patterns: by weighted draws where those can be trusted, else by a fit without the person.
fn pattern_scores(
    part: &Part,
    fit: &PartFit,
    watch: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Vec<PatternScore>, FitError> {
    let data = part.data();
    let threshold = shape_threshold(fit.draws.len());
    let columns = fit.ln_likelihoods(data.problems(), part.patterns());
    let mut scores = Vec::with_capacity(columns.len());
    for (pattern, column) in part.patterns().iter().zip(&columns) {
        if watch().is_break() {
            return Err(FitError::Stopped);
        }
        let (left_out, shape) = smoothed_score(column, relative_efficiency(fit, column));
        let mut score = PatternScore {
            left_out,
            with_everybody: ln_mean_exp(column),
            shape,
            refit: None,
        };
        if !(shape <= threshold && left_out.is_finite()) {
            let (left_out, refit) = refitted_score(data, pattern, fit, watch)?;
            score.left_out = left_out;
            score.refit = Some(refit);
        }
        scores.push(score);
    }
    Ok(scores)
}

/// ln p(yᵢ | y₋ᵢ) from draws given all answers, and k̂.
///
/// ```text
/// ln Σ_s w_s p(yᵢ | s),   w_s ∝ 1/p(yᵢ | s), smoothed
/// ```
fn smoothed_score(ln_likelihood: &[f64], relative_efficiency: f64) -> (f64, f64) {
    if ln_likelihood.iter().any(|value| !value.is_finite()) {
        return (f64::NAN, f64::INFINITY);
    }
    let ratios: Vec<f64> = ln_likelihood.iter().map(|value| -value).collect();
    let smoothed = smooth(&ratios, relative_efficiency);
    let products: Vec<f64> = smoothed
        .ln_weights
        .iter()
        .zip(ln_likelihood)
        .map(|(ln_weight, ln_l)| ln_weight + ln_l)
        .collect();
    (ln_sum_exp(&products), smoothed.shape)
}

/// Effective draws per draw for the mean of a unit's likelihood, or of other ratios given by their logarithms.
pub(super) fn relative_efficiency(fit: &PartFit, ln_likelihood: &[f64]) -> f64 {
    let highest = ln_likelihood
        .iter()
        .copied()
        .fold(f64::NEG_INFINITY, f64::max);
    let likelihoods: Vec<f64> = ln_likelihood
        .iter()
        .map(|value| (value - highest).exp())
        .collect();
    let efficiency = ess_mean(&fit.draws.by_chain(&likelihoods)) / likelihoods.len().max(1) as f64;
    if efficiency.is_finite() && efficiency > 0.0 {
        efficiency
    } else {
        1.0
    }
}

fn ln_mean_exp(values: &[f64]) -> f64 {
    ln_sum_exp(values) - (values.len() as f64).ln()
}

/// The score of one unit under a fit to all others.
fn refitted_score(
    data: &ChoiceData,
    unit: &Pattern,
    known: &PartFit,
    watch: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<(f64, Refit), FitError> {
    let others = without(data, unit);
    let refit: PartFit = fit(known.model, &others, &known.settings(), &mut |_| watch())?.into();
    let column = &refit.ln_likelihoods(data.problems(), std::slice::from_ref(unit))[0];
    let state = if refit.summary.converged {
        Refit::Converged
    } else {
        Refit::Unconverged
    };
    Ok((ln_mean_exp(column), state))
}

/// The data without one unit of a pattern.
fn without(data: &ChoiceData, unit: &Pattern) -> ChoiceData {
    let mut counts = data.totals().to_vec();
    for answers in &unit.answers {
        counts[answers.problem][answers.action] -= answers.count;
    }
    ChoiceData::from_counts(data.problems().to_vec(), counts)
        .expect("fewer answers leave data valid")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Deserialize)]
    struct Vector {
        relative_efficiency: f64,
        ln_likelihood: Vec<Vec<f64>>,
        elpd: f64,
        se: f64,
        effective_parameters: f64,
        pointwise: Vec<f64>,
        shapes: Vec<f64>,
    }

    #[derive(Deserialize)]
    struct Vectors {
        leave_one_out: Vector,
    }

    #[test]
    fn scores_agree_with_arviz() {
        let vectors: Vectors =
            serde_json::from_str(include_str!("../../../tests/data/psis.json")).unwrap();
        let vector = vectors.leave_one_out;
        let mut units = Vec::new();
        let mut everybody = 0.0;
        for (index, column) in vector.ln_likelihood.iter().enumerate() {
            let (score, shape) = smoothed_score(column, vector.relative_efficiency);
            assert!((score - vector.pointwise[index]).abs() < 1e-6, "{index}");
            assert!((shape - vector.shapes[index]).abs() < 1e-6, "{index}");
            units.push((1, score));
            everybody += ln_mean_exp(column);
        }
        let (elpd, se) = sum_and_se(&units);
        assert!((elpd - vector.elpd).abs() < 1e-6);
        // ArviZ divides the variance by n, not n − 1.
        let n = units.len() as f64;
        assert!((se.unwrap() * ((n - 1.0) / n).sqrt() - vector.se).abs() < 1e-6);
        assert!((everybody - elpd - vector.effective_parameters).abs() < 1e-6);
    }
}
