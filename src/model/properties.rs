//! Properties that every model keeps, whatever the problem and the parameters.

use proptest::prelude::*;

use super::{
    ChoiceProblem, Parameter, Parameters, RISK_AWARE, RiskAwareOptions, WeightingFunction,
    ZeroOutcome, ln_probabilities, probabilities, utilities,
};

type Actions = Vec<(String, Vec<(f64, f64)>)>;

fn outcomes() -> impl Strategy<Value = Vec<(f64, f64)>> {
    let reward = prop_oneof![
        Just(0.0),
        -1000.0..1000.0,
        -5.0..5.0,
        Just(-500.0),
        Just(105.0)
    ];
    prop::collection::vec((0.01..1.0, reward), 1..5).prop_map(|raw| {
        let sum: f64 = raw.iter().map(|(weight, _)| weight).sum();
        raw.into_iter()
            .map(|(weight, reward)| (weight / sum, reward))
            .collect()
    })
}

fn actions() -> impl Strategy<Value = Actions> {
    prop::collection::vec(outcomes(), 2..4).prop_map(|prospects| {
        prospects
            .into_iter()
            .enumerate()
            .map(|(index, p)| (format!("action {index}"), p))
            .collect()
    })
}

fn parameters() -> impl Strategy<Value = Parameters> {
    (
        0.05..=1.0,
        0.05..=1.0,
        0.1..=1.0,
        0.1..=1.0,
        0.0..5.0,
        0.0..3.0,
    )
        .prop_map(|(alpha, beta, gamma, delta, lambda, theta)| {
            let values = [alpha, beta, gamma, delta, lambda, theta];
            let entries = RISK_AWARE.parameters.iter().zip(values);
            RISK_AWARE
                .parameters_from(entries.map(|(name, value)| (name.key(), value)))
                .unwrap()
        })
}

fn options() -> impl Strategy<Value = RiskAwareOptions> {
    let zero = prop_oneof![Just(ZeroOutcome::Gain), Just(ZeroOutcome::SameSign)];
    let function = prop_oneof![
        Just(WeightingFunction::TverskyKahneman),
        Just(WeightingFunction::Prelec)
    ];
    (any::<bool>(), zero, function).prop_map(|(normalise, zero, weighting_function)| {
        RiskAwareOptions {
            normalise,
            zero,
            weighting_function,
        }
    })
}

fn problem(actions: &Actions) -> ChoiceProblem {
    ChoiceProblem::from_outcomes(actions.clone()).unwrap()
}

fn close(left: f64, right: f64) -> bool {
    (left - right).abs() <= 1e-9 * (1.0 + left.abs().max(right.abs()))
}

proptest! {
    #[test]
    fn probabilities_sum_to_one(actions in actions(), parameters in parameters(), options in options()) {
        let found = probabilities(&problem(&actions), &parameters, options).unwrap();
        prop_assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        prop_assert!(found.iter().all(|p| (0.0..=1.0).contains(p)));
    }

    #[test]
    fn logarithms_are_never_nan(actions in actions(), parameters in parameters(), theta in 0.0..1e300, options in options()) {
        let extreme = parameters.with(Parameter::Theta, theta).unwrap();
        let found = ln_probabilities(&problem(&actions), &extreme, options).unwrap();
        prop_assert!(found.iter().all(|ln_p| *ln_p <= 0.0));
    }

    #[test]
    fn splitting_an_outcome_changes_nothing(
        actions in actions(), parameters in parameters(), options in options(), share in 0.1..0.9, index in 0usize..16,
    ) {
        let mut split = actions.clone();
        let outcomes = &mut split[0].1;
        let index = index % outcomes.len();
        let (probability, reward) = outcomes[index];
        outcomes[index].0 = probability * share;
        outcomes.push((probability * (1.0 - share), reward));
        let whole = utilities(&problem(&actions), &parameters, options).unwrap();
        let parts = utilities(&problem(&split), &parameters, options).unwrap();
        prop_assert!(close(whole[0], parts[0]), "{whole:?} {parts:?}");
    }

    #[test]
    fn renaming_and_reordering_actions_moves_their_probabilities_along(
        actions in actions(), parameters in parameters(), options in options(),
    ) {
        let mut turned: Actions = actions.clone();
        turned.rotate_left(1);
        for (name, _) in &mut turned {
            *name = format!("new {name}");
        }
        let mut before = probabilities(&problem(&actions), &parameters, options).unwrap();
        let after = probabilities(&problem(&turned), &parameters, options).unwrap();
        before.rotate_left(1);
        prop_assert!(before.iter().zip(&after).all(|(left, right)| close(*left, *right)));
    }

    #[test]
    fn the_best_action_gains_with_sensitivity(
        actions in actions(), parameters in parameters(), options in options(), more in 0.0..5.0,
    ) {
        let problem = problem(&actions);
        let utilities = utilities(&problem, &parameters, options).unwrap();
        let best = (0..utilities.len()).max_by(|&i, &j| utilities[i].total_cmp(&utilities[j])).unwrap();
        let theta = parameters.get(Parameter::Theta);
        let keener = parameters.with(Parameter::Theta, theta + more).unwrap();
        let before = probabilities(&problem, &parameters, options).unwrap();
        let after = probabilities(&problem, &keener, options).unwrap();
        prop_assert!(after[best] >= before[best] - 1e-12);
    }

    #[test]
    fn all_ones_is_the_expected_reward(actions in actions(), options in options()) {
        let problem = problem(&actions);
        let found = utilities(&problem, &Parameters::ONES, options).unwrap();
        for (utility, action) in found.iter().zip(problem.actions()) {
            prop_assert!(close(*utility, action.prospect.expected_reward()));
        }
        // Close to 1 the general path is taken: it must lead to the same place.
        let nearly = Parameters::ONES.with(Parameter::Gamma, 1.0 - 1e-12).unwrap();
        let general = utilities(&problem, &nearly, options).unwrap();
        prop_assert!(found.iter().zip(&general).all(|(left, right)| close(*left, *right)));
    }

    #[test]
    fn indifference_where_nothing_matters(actions in actions(), parameters in parameters(), options in options()) {
        let blind = parameters.with(Parameter::Theta, 0.0).unwrap();
        let found = probabilities(&problem(&actions), &blind, options).unwrap();
        prop_assert!(found.iter().all(|p| close(*p, 1.0 / found.len() as f64)));
    }
}
