//! What the rewards of a design leave open, whatever people choose.

use super::Note;
use crate::inference::Quantity;
use crate::model::{
    ChoiceModel, ChoiceProblem, Curvature, Outcome, Parameter, RiskAwareOptions, ZeroOutcome,
};

/// What a model cannot learn from these problems because all their rewards have one sign; `None` where it can learn all
/// of its parameters, or where both signs occur.
///
/// * With losses only, α has nothing to bend, λ and θ scale the same utilities, and γ is left with the weight of the
///   outcome 0, which decides about choices only where weights are normalised and 0 counts as a gain.
/// * With gains only, β, δ and λ have nothing to act on.
pub fn design_note<'a>(
    model: &ChoiceModel,
    problems: impl Iterator<Item = &'a ChoiceProblem>,
    options: RiskAwareOptions,
) -> Option<Note> {
    let outcomes: Vec<&Outcome> = outcomes(problems).collect();
    let has_gains = outcomes.iter().any(|outcome| outcome.reward > 0.0);
    let has_losses = outcomes.iter().any(|outcome| outcome.reward < 0.0);
    let free = |parameters: &[Parameter]| -> Vec<Quantity> {
        let free = parameters.iter().filter(|name| model.is_free(**name));
        free.map(|name| Quantity::Parameter(*name)).collect()
    };
    let options = model.options(options);
    if has_losses && !has_gains {
        let is_uncertain_nothing = |outcome: &&Outcome| {
            outcome.reward == 0.0 && outcome.probability > 0.0 && outcome.probability < 1.0
        };
        let gamma_through_normalisation = model.is_free(Parameter::Gamma)
            && options.normalise
            && options.zero == ZeroOutcome::Gain
            && outcomes.iter().any(is_uncertain_nothing);
        let mut not_learned = Vec::new();
        // A model with one curvature bends losses by it too.
        if model.curvature == Curvature::Separate {
            not_learned.extend(free(&[Parameter::Alpha]));
        }
        if !gamma_through_normalisation {
            not_learned.extend(free(&[Parameter::Gamma, Parameter::EtaGain]));
        }
        let product_only = model.is_free(Parameter::Lambda);
        let is_limited = product_only || gamma_through_normalisation || !not_learned.is_empty();
        is_limited.then_some(Note::LossesOnly {
            not_learned,
            product_only,
            gamma_through_normalisation,
        })
    } else if has_gains && !has_losses {
        let not_learned = free(&[
            Parameter::Beta,
            Parameter::Delta,
            Parameter::EtaLoss,
            Parameter::Lambda,
        ]);
        (!not_learned.is_empty()).then_some(Note::GainsOnly { not_learned })
    } else {
        None
    }
}

/// The distinct amounts that can be won or lost, without signs and without 0, in increasing order; none where all
/// rewards have one sign.
pub(super) fn mixed_amounts<'a>(problems: impl Iterator<Item = &'a ChoiceProblem>) -> Vec<f64> {
    let rewards: Vec<f64> = outcomes(problems).map(|outcome| outcome.reward).collect();
    let is_mixed =
        rewards.iter().any(|reward| *reward > 0.0) && rewards.iter().any(|reward| *reward < 0.0);
    if !is_mixed {
        return Vec::new();
    }
    let mut amounts: Vec<f64> = rewards.iter().map(|reward| reward.abs()).collect();
    amounts.retain(|amount| *amount > 0.0);
    amounts.sort_by(f64::total_cmp);
    amounts.dedup();
    amounts
}

fn outcomes<'a>(
    problems: impl Iterator<Item = &'a ChoiceProblem>,
) -> impl Iterator<Item = &'a Outcome> {
    problems
        .flat_map(|problem| problem.actions())
        .flat_map(|action| action.prospect.outcomes())
}
