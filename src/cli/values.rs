//! Values of options that several commands take.

use crate::inference::{Prior, Priors};
use crate::model::{ChoiceModel, model_named};

pub(super) fn model(text: &str) -> Result<&'static ChoiceModel, String> {
    model_named(text.trim()).map_err(|error| error.to_string())
}

/// A parameter with its value, such as `alpha=0.88`.
pub(super) fn parameter(text: &str) -> Result<(String, f64), String> {
    let wanted = || "allowed is NAME=VALUE, such as alpha=0.88".to_owned();
    let (name, value) = text.split_once('=').ok_or_else(wanted)?;
    let value = value.trim().parse().map_err(|_| wanted())?;
    Ok((name.trim().to_owned(), value))
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
