//! What a person will do in a problem, given a fit.

use serde::{Deserialize, Serialize};

use super::Draws;
use super::diagnostics::{mean, quantile};
use super::likelihood::Predictor;
use crate::model::{ChoiceProblem, RiskAwareOptions};

/// How likely one action is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ActionPrediction {
    /// The action's name.
    pub action: String,
    /// Mean probability over posterior draws.
    pub mean: f64,
    /// Lower end of the 90 % interval.
    pub q5: f64,
    /// Upper end of the 90 % interval.
    pub q95: f64,
}

/// A prediction for one problem.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
    /// Every action, in the problem's order.
    pub actions: Vec<ActionPrediction>,
    /// The most likely action; the first of several that are equally likely.
    pub most_likely: String,
}

/// Predicts choices in a problem from posterior draws.
///
/// ```text
/// P(a) = mean over draws of P(a | draw)
/// ```
///
/// Draws under which the problem's decision weights vanish are left out; nothing if no draw remains.
pub fn predict_from_draws(
    problem: &ChoiceProblem,
    draws: &Draws,
    options: RiskAwareOptions,
) -> Option<Prediction> {
    let mut predictor = Predictor::new([problem], options);
    let mut columns: Vec<Vec<f64>> = vec![Vec::with_capacity(draws.len()); problem.actions().len()];
    for draw in 0..draws.len() {
        let ln_p = predictor.ln_probabilities(&draws.parameters(draw));
        if ln_p.iter().any(|ln_p| ln_p.is_nan()) {
            continue;
        }
        for (column, ln_p) in columns.iter_mut().zip(ln_p) {
            column.push(ln_p.exp());
        }
    }
    if columns[0].is_empty() {
        return None;
    }
    let names = problem.names();
    let actions: Vec<ActionPrediction> = names
        .zip(columns)
        .map(|(action, mut values)| {
            values.sort_by(f64::total_cmp);
            ActionPrediction {
                action: action.to_owned(),
                mean: mean(&values),
                q5: quantile(&values, 0.05),
                q95: quantile(&values, 0.95),
            }
        })
        .collect();
    let mut most_likely = &actions[0];
    for action in &actions {
        if action.mean > most_likely.mean {
            most_likely = action;
        }
    }
    Some(Prediction {
        most_likely: most_likely.action.clone(),
        actions,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::Quantity;
    use crate::model::Parameter;

    /// Two draws, θ = 0 and θ so large that the better action is certain: means ¾ and ¼.
    #[test]
    fn probabilities_are_averaged_over_draws() {
        let problem =
            ChoiceProblem::from_outcomes([("worse", [(1.0, 1.0)]), ("better", [(1.0, 2.0)])])
                .unwrap();
        let theta = Quantity::Parameter(Parameter::Theta);
        let draws = Draws {
            model: &crate::model::RISK_AWARE,
            chains: 1,
            per_chain: 2,
            columns: vec![(theta, vec![0.0, 1e6])],
        };
        let found = predict_from_draws(&problem, &draws, RiskAwareOptions::default()).unwrap();
        assert_eq!(found.most_likely, "better");
        assert_eq!((found.actions[0].mean, found.actions[1].mean), (0.25, 0.75));
        assert!((found.actions[1].q5 - 0.525).abs() < 1e-12);
    }
}
