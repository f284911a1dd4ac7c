//! What a simulated person chooses.

use rand::{Rng, RngExt};

use crate::inference::draw_action;
use crate::model::{ChoiceError, ChoiceProblem, Parameters, RiskAwareOptions};

/// The id of an action: drawn with the model's probabilities, or tossed up where the question withholds what the model would
/// have to weigh.
///
/// * `actions`: the ids of the actions that a person without a problem tosses up between.
pub(super) fn choice(
    problem: Option<&ChoiceProblem>,
    actions: &[String],
    parameters: &Parameters,
    options: RiskAwareOptions,
    rng: &mut impl Rng,
) -> Result<String, ChoiceError> {
    if let Some(problem) = problem {
        let chosen = draw_action(problem, parameters, options, rng)?;
        return Ok(problem.actions()[chosen].name.clone());
    }
    let toss = rng.random_range(0..actions.len().max(1));
    Ok(actions.get(toss).cloned().unwrap_or_default())
}
