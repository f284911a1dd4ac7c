//! Where a prior, and not the choices, decides where a posterior ends.

use serde::{Deserialize, Serialize};

use super::Note;
use crate::inference::{Fit, Prior, Quantity, WEIGHTING_FLOOR};
use crate::model::{Parameter, WeightingFunction};

/// A draw lies at a bound if it is this share of the prior's range away from it, or less.
const NEAR: f64 = 0.01;

/// A bound is active if more than this share of the draws lies at it. Of a flat posterior it is 0.01.
const ACTIVE: f64 = 0.05;

/// An end of a prior.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = PriorEnd)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// The lower one.
    Low,
    /// The upper one.
    High,
}

/// The ends of a quantity's prior at which more than 5 % of its draws lie.
pub(super) fn active_bounds(fit: &Fit, quantity: Quantity) -> Vec<Note> {
    let (Some(Prior::Uniform { low, high }), Some(draws)) =
        (prior(fit, quantity), fit.draws.column(quantity))
    else {
        return Vec::new();
    };
    let near = NEAR * (high - low);
    let ends = [
        (End::Low, low, share(draws, |x| x - low <= near)),
        (End::High, high, share(draws, |x| high - x <= near)),
    ];
    ends.into_iter()
        .filter(|(_, _, share)| *share > ACTIVE)
        .map(|(end, bound, share)| Note::BoundActive {
            quantity,
            end,
            bound,
            share,
        })
        .collect()
}

/// How much of a weighting parameter's posterior lies where its function is not monotone, if its prior allows any.
pub(super) fn not_monotone(fit: &Fit, quantity: Quantity) -> Option<Note> {
    if !matches!(
        quantity,
        Quantity::Parameter(Parameter::Gamma | Parameter::Delta)
    ) {
        return None;
    }
    match fit.model.options(fit.settings.options).weighting_function {
        WeightingFunction::TverskyKahneman => {}
        WeightingFunction::Prelec => return None,
    }
    let Some(Prior::Uniform { low, high }) = prior(fit, quantity) else {
        return None;
    };
    if low >= WEIGHTING_FLOOR {
        return None;
    }
    Some(Note::NotMonotone {
        quantity,
        below: WEIGHTING_FLOOR,
        prior_low: low,
        share: share(fit.draws.column(quantity)?, |x| x < WEIGHTING_FLOOR),
        prior_share: (WEIGHTING_FLOOR - low) / (high - low),
    })
}

/// What a quantity is drawn from; θ and λ·θ follow from τ and have none of their own.
fn prior(fit: &Fit, quantity: Quantity) -> Option<Prior> {
    match quantity {
        Quantity::Parameter(Parameter::Theta) | Quantity::LambdaTheta => None,
        Quantity::Parameter(parameter) => Some(fit.settings.priors.of(parameter)),
        Quantity::Tau => Some(fit.settings.priors.tau),
    }
}

fn share(draws: &[f64], wanted: impl Fn(f64) -> bool) -> f64 {
    draws.iter().filter(|x| wanted(**x)).count() as f64 / draws.len() as f64
}
