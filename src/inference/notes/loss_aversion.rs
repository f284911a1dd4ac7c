//! Loss aversion at an amount.

use serde::{Deserialize, Serialize};

use super::rewards::mixed_amounts;
use crate::inference::diagnostics::{mean, quantile};
use crate::inference::{Fit, Quantity};
use crate::model::{ChoiceProblem, Parameter};

/// How much worse it is to lose an amount than it is good to win it.
///
/// ```text
/// −v(−x) / v(x) = λ x^(β − α)
/// ```
///
/// * x: the amount, above 0, in the unit of rewards.
///
/// Where α = β this is λ for every amount; elsewhere λ is the value at an amount of 1, which depends on the unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LossAversion {
    /// The amount x.
    pub amount: f64,
    /// Posterior mean.
    pub mean: f64,
    /// 5 % quantile.
    pub q5: f64,
    /// Median.
    pub q50: f64,
    /// 95 % quantile.
    pub q95: f64,
}

/// Loss aversion at the smallest, the median and the largest amount (fewer where these are the same); `None` where all
/// rewards have one sign, or where λ does not depend on the unit.
pub(super) fn loss_aversion<'a>(
    fit: &Fit,
    problems: impl Iterator<Item = &'a ChoiceProblem>,
) -> Option<Vec<LossAversion>> {
    let column = |parameter| fit.draws.column(Quantity::Parameter(parameter));
    let (alpha, beta, lambda) = (
        column(Parameter::Alpha)?,
        column(Parameter::Beta)?,
        column(Parameter::Lambda)?,
    );
    let amounts = mixed_amounts(problems);
    let (small, large) = (*amounts.first()?, *amounts.last()?);
    let mut chosen = vec![small, amounts[(amounts.len() - 1) / 2], large];
    chosen.dedup();
    let at = |amount: f64| {
        let ln_amount = amount.ln();
        let mut values: Vec<f64> = alpha
            .iter()
            .zip(beta)
            .zip(lambda)
            .map(|((alpha, beta), lambda)| lambda * ((beta - alpha) * ln_amount).exp())
            .collect();
        values.sort_unstable_by(f64::total_cmp);
        LossAversion {
            amount,
            mean: mean(&values),
            q5: quantile(&values, 0.05),
            q50: quantile(&values, 0.5),
            q95: quantile(&values, 0.95),
        }
    };
    Some(chosen.into_iter().map(at).collect())
}
