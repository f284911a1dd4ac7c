//! Values of options that several commands take.

use crate::inference::{Prior, Priors};
use crate::model::{ChoiceModel, model_named};

pub(super) fn model(text: &str) -> Result<&'static ChoiceModel, String> {
    model_named(text.trim()).map_err(|error| error.to_string())
}

pub(super) fn weighting_floor(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(floor) if (0.0..1.0).contains(&floor) => Ok(floor),
        _ => Err("allowed is a number from 0 to below 1".to_owned()),
    }
}

/// The priors with γ and δ uniform from `low` to 1, all others as they are.
pub(super) fn with_floor(priors: Priors, low: f64) -> Priors {
    let weighting = Prior::Uniform { low, high: 1.0 };
    Priors {
        gamma: weighting,
        delta: weighting,
        ..priors
    }
}
