use super::chains::ChainPosition;
use super::*;
use crate::inference::choice_data::tests::{Cell, data};
use crate::inference::{Draws, FitSettings, Priors, fit, uninterrupted};
use crate::model::{
    CUMULATIVE_PROSPECT, ChoiceModel, NOISY_RATIONAL, OrderedMap, RISK_AWARE, RiskAwareOptions,
    ZeroOutcome, value,
};

const LOSSES: Cell<'static> = (
    "low",
    &[
        ("accelerate", &[(0.05, -500.0), (0.95, 0.0)]),
        ("stop", &[(1.0, -100.0)]),
    ],
    &[6, 24],
);
const GAINS: Cell<'static> = (
    "cups",
    &[
        ("stable", &[(1.0, 20.0)]),
        ("unstable", &[(0.2, 105.0), (0.8, 0.0)]),
    ],
    &[42, 8],
);
const MIXED: Cell<'static> = (
    "coin",
    &[
        ("take", &[(0.5, 40.0), (0.5, -20.0)]),
        ("leave", &[(1.0, 0.0)]),
    ],
    &[12, 18],
);

fn fitted(model: &'static ChoiceModel, cells: &[Cell<'_>], settings: &FitSettings) -> Fit {
    fit(model, &data(cells), settings, &mut uninterrupted).unwrap()
}

fn names(quantities: &[Quantity]) -> Vec<&'static str> {
    quantities.iter().map(|quantity| quantity.key()).collect()
}

fn of_design(model: &ChoiceModel, cells: &[Cell<'_>], options: RiskAwareOptions) -> Option<Note> {
    let data = data(cells);
    let problems = data.problems().iter().map(|problem| &problem.problem);
    design_note(model, problems, options)
}

#[test]
fn the_signs_of_rewards_say_what_cannot_be_learned() {
    let options = RiskAwareOptions::default();
    assert_eq!(of_design(&NOISY_RATIONAL, &[LOSSES], options), None);
    assert_eq!(of_design(&RISK_AWARE, &[LOSSES, GAINS], options), None);
    assert_eq!(of_design(&RISK_AWARE, &[MIXED], options), None);
    let losses = |options| match of_design(&RISK_AWARE, &[LOSSES], options) {
        Some(Note::LossesOnly {
            not_learned,
            product_only: true,
            gamma_through_normalisation,
        }) => (names(&not_learned), gamma_through_normalisation),
        other => panic!("{other:?}"),
    };
    assert_eq!(losses(options), (vec!["alpha"], true));
    let same_sign = RiskAwareOptions {
        zero: ZeroOutcome::SameSign,
        ..options
    };
    assert_eq!(losses(same_sign), (vec!["alpha", "gamma"], false));
    let plain = RiskAwareOptions {
        normalise: false,
        ..options
    };
    assert_eq!(losses(plain), (vec!["alpha", "gamma"], false));
    // One curvature bends losses too, and is learned from them.
    match of_design(&CUMULATIVE_PROSPECT, &[LOSSES], options) {
        Some(Note::LossesOnly { not_learned, .. }) => assert_eq!(not_learned, []),
        other => panic!("{other:?}"),
    }
    match of_design(&RISK_AWARE, &[GAINS], options) {
        Some(Note::GainsOnly { not_learned }) => {
            assert_eq!(names(&not_learned), ["beta", "delta", "lambda"]);
        }
        other => panic!("{other:?}"),
    }
}

/// What a design cannot tell must be marked so in the table, whichever reward gives τ its unit.
#[test]
fn parameters_that_the_design_leaves_open_are_not_informed() {
    for reference_reward in [None, Some(300.0)] {
        let settings = FitSettings {
            reference_reward,
            ..FitSettings::default()
        };
        let fit = fitted(&RISK_AWARE, &[LOSSES], &settings);
        let parameters = fit.summary.parameters.as_ref().unwrap();
        for name in ["alpha", "lambda", "theta"] {
            assert!(!parameters.get(name).unwrap().informed, "{name}");
        }
        if reference_reward.is_none() {
            let product = parameters.get("lambda_theta").unwrap();
            assert!(product.informed, "{product:?}");
        }
    }
    let fit = fitted(&RISK_AWARE, &[GAINS], &FitSettings::default());
    for name in ["beta", "delta", "lambda"] {
        let found = fit.summary.parameters.as_ref().unwrap().get(name).unwrap();
        assert_eq!(
            (found.informed, found.source),
            (false, Source::Prior),
            "{name}"
        );
    }
}

#[test]
fn a_bound_is_active_from_five_per_cent_of_the_draws_on() {
    let mut fit = fitted(&RISK_AWARE, &[GAINS], &FitSettings::default());
    let alpha = Quantity::Parameter(Parameter::Alpha);
    let mut with_share = |near: usize| {
        let column = fit
            .draws
            .columns
            .iter_mut()
            .find(|(name, _)| *name == alpha);
        let (_, values) = column.unwrap();
        let length = values.len();
        for (index, value) in values.iter_mut().enumerate() {
            *value = if index < near * length / 100 {
                0.995
            } else {
                0.5
            };
        }
        bounds::active_bounds(&fit, alpha)
    };
    assert_eq!(with_share(5), []);
    assert_eq!(
        with_share(6),
        [Note::BoundActive {
            quantity: alpha,
            end: End::High,
            bound: 1.0,
            share: 0.06
        }]
    );
}

#[test]
fn mass_without_monotony_is_told_where_the_prior_allows_it() {
    let wide = FitSettings {
        priors: Priors::with_weighting_floor(0.05),
        ..FitSettings::default()
    };
    let fit = fitted(&RISK_AWARE, &[LOSSES], &wide);
    let delta = Quantity::Parameter(Parameter::Delta);
    let draws = fit.draws.column(delta).unwrap();
    let counted = draws.iter().filter(|x| **x < 0.28).count() as f64 / draws.len() as f64;
    let found = fit.summary.notes.iter().find_map(|note| match note {
        Note::NotMonotone {
            quantity,
            share,
            prior_share,
            ..
        } if *quantity == delta => Some((*share, *prior_share)),
        _ => None,
    });
    let (share, prior_share) = found.unwrap();
    assert_eq!(share, counted);
    assert!((prior_share - 0.23 / 0.95).abs() < 1e-12, "{prior_share}");

    let monotone = fitted(&RISK_AWARE, &[LOSSES], &FitSettings::default());
    let notes = &monotone.summary.notes;
    assert!(
        !notes
            .iter()
            .any(|note| matches!(note, Note::NotMonotone { .. }))
    );
}

#[test]
fn loss_aversion_is_that_of_the_value_function() {
    let fit = fitted(&RISK_AWARE, &[MIXED, GAINS], &FitSettings::default());
    let found = fit.summary.loss_aversion.as_ref().unwrap();
    let amounts: Vec<f64> = found.iter().map(|at| at.amount).collect();
    assert_eq!(amounts, [20.0, 40.0, 105.0]);
    for at in found {
        let mut sum = 0.0;
        for draw in 0..fit.draws.len() {
            let drawn = fit.draws.parameters(draw);
            let [alpha, beta, lambda] =
                [Parameter::Alpha, Parameter::Beta, Parameter::Lambda].map(|name| drawn.get(name));
            let felt = |reward| value(reward, alpha, beta, lambda);
            sum += -felt(-at.amount) / felt(at.amount);
        }
        let expected = sum / fit.draws.len() as f64;
        assert!((at.mean / expected - 1.0).abs() < 1e-9, "{at:?} {expected}");
        assert!(at.q5 < at.q50 && at.q50 < at.q95);
    }
    let losses = fitted(&RISK_AWARE, &[LOSSES], &FitSettings::default());
    assert_eq!(losses.summary.loss_aversion, None);
}

/// Four chains of a spread pattern, the first as told by `change`.
fn chains(change: impl Fn(usize, f64) -> f64) -> (Draws, OrderedMap<ParameterSummary>) {
    let lambda = Quantity::Parameter(Parameter::Lambda);
    let fit = fitted(&RISK_AWARE, &[MIXED], &FitSettings::default());
    let mut summary = fit
        .summary
        .parameters
        .unwrap()
        .get("lambda")
        .unwrap()
        .clone();
    summary.rhat = 1.2;
    let place = |index: usize| (index as f64 * 0.618_034).fract();
    let values = (0..400)
        .map(|index| {
            if index < 100 {
                change(index, place(index))
            } else {
                place(index)
            }
        })
        .collect();
    let draws = Draws {
        model: fit.model,
        chains: 4,
        per_chain: 100,
        columns: vec![(lambda, values)],
    };
    (draws, OrderedMap(vec![("lambda".to_owned(), summary)]))
}

#[test]
fn chains_that_stand_still_or_apart_are_named() {
    let apart = |change: &dyn Fn(usize, f64) -> f64| -> Vec<Note> {
        let (draws, parameters) = chains(change);
        chains::notes(&draws, &parameters)
    };
    let positions = |notes: &[Note]| -> Vec<ChainPosition> {
        match notes.last() {
            Some(Note::DisagreeingChains { apart, .. }) => apart.clone(),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(positions(&apart(&|_, x| x)), []);
    let above = positions(&apart(&|_, x| x + 0.8));
    assert_eq!(above.len(), 1);
    assert!(above[0].chain == 1 && above[0].rank > 0.7, "{above:?}");
    let narrow = positions(&apart(&|_, x| 0.5 + 0.1 * (x - 0.5)));
    assert_eq!(narrow.len(), 1);
    assert!((narrow[0].rank - 0.5).abs() < 0.05, "{narrow:?}");
    assert!(narrow[0].spread_rank < 0.3, "{narrow:?}");
    let stuck = apart(&|_, _| 0.3);
    assert_eq!(
        stuck[0],
        Note::StuckChains {
            chains: vec![1],
            of: 4
        }
    );
}

#[test]
fn an_unconverged_fit_keeps_only_the_notes_on_its_chains() {
    let mut fit = fitted(&RISK_AWARE, &[LOSSES], &FitSettings::default());
    fit.summary.notes.push(Note::StuckChains {
        chains: vec![2],
        of: 8,
    });
    fit.summary.converged = false;
    let shown = fit.summary.shown();
    assert_eq!(shown.notes.len(), 1);
    assert!(fit.summary.notes.len() > 1);
}

#[test]
fn notes_read_as_sentences() {
    let check = |note: Note, expected: &str| {
        assert_eq!(note.to_string(), expected);
        let json = serde_json::to_string(&note).unwrap();
        assert_eq!(serde_json::from_str::<Note>(&json).unwrap(), note, "{json}");
    };
    let [alpha, gamma] = [Parameter::Alpha, Parameter::Gamma].map(Quantity::Parameter);
    check(
        Note::NotInformed {
            quantities: vec![alpha, gamma],
        },
        "These choices say next to nothing about α (curvature of gains) and γ (weighting of gains): they took less \
         than a tenth of the prior’s variance away.",
    );
    check(
        Note::BoundActive {
            quantity: alpha,
            end: End::High,
            bound: 1.0,
            share: 0.314,
        },
        "31 % of the draws of α lie within 1 % of the upper end of its prior, 1: there the prior, not the choices, \
         ends the posterior.",
    );
    check(
        Note::DisagreeingChains {
            quantity: gamma,
            rhat: Some(1.0834),
            apart: vec![ChainPosition {
                chain: 3,
                rank: 0.22,
                spread_rank: 0.5,
            }],
        },
        "The chains disagree about γ (R̂ 1.083): a draw of chain 3 lies below 78 % of all draws on average.",
    );
    check(
        Note::StuckChains {
            chains: vec![2, 5, 7],
            of: 8,
        },
        "Chains 2, 5 and 7 of 8 hardly moved: nothing that these draws say can be used.",
    );
}
