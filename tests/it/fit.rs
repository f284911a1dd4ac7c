//! Fits of real, simulated and constructed choices, against values computed elsewhere.

use std::ops::ControlFlow;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use riskaware::inference::accuracy::{Shares, compare, pooled};
use riskaware::inference::curves::{Band, Curves, curves};
use riskaware::inference::{
    ChoiceData, Fit, FitError, FitSettings, FitSummary, FittedProblem, ParameterSummary, Prior,
    Priors, Progress, Quantity, Source, fit, predict_from_draws, refit, uninterrupted,
};
use riskaware::model::{
    CUMULATIVE_PROSPECT, ChoiceModel, ChoiceProblem, EXPECTED_UTILITY, MODELS, NOISY_RATIONAL,
    OrderedMap, Parameter, Parameters, RISK_AWARE, RISK_AWARE_PRELEC, RISK_AWARE_PRELEC_ELEVATION,
    RISK_AWARE_SAME_SIGN, RISK_AWARE_UNNORMALISED, RiskAwareOptions, probabilities,
};

type Outcomes<'a> = &'a [(f64, f64)];

/// A problem's id, its actions and how often each was chosen.
type Cell<'a> = (&'a str, &'a [(&'a str, Outcomes<'a>)], &'a [u64]);

fn cells(cells: &[Cell<'_>]) -> ChoiceData {
    let problem = |(id, actions, _): &Cell<'_>| FittedProblem {
        id: (*id).to_owned(),
        problem: ChoiceProblem::from_outcomes(actions.iter().copied()).unwrap(),
    };
    let counts = cells.iter().map(|(_, _, counts)| counts.to_vec()).collect();
    ChoiceData::from_counts(cells.iter().map(problem).collect(), counts).unwrap()
}

fn fitted(model: &'static ChoiceModel, data: &ChoiceData, settings: &FitSettings) -> Fit {
    fit(model, data, settings, &mut uninterrupted).unwrap()
}

fn kahneman_tversky() -> ChoiceData {
    let problems: OrderedMap<ChoiceProblem> = serde_json::from_str(include_str!(
        "../../examples/kahneman-tversky-1979/problems.json"
    ))
    .unwrap();
    let mut counts: Vec<Vec<u64>> = problems.iter().map(|_| vec![0, 0]).collect();
    let choices = include_str!("../../examples/kahneman-tversky-1979/choices.csv");
    for row in choices.lines().skip(1) {
        let fields: Vec<&str> = row.split(',').collect();
        let (place, (_, problem)) = problems
            .iter()
            .enumerate()
            .find(|(_, (id, _))| *id == fields[0])
            .unwrap();
        counts[place][problem.position(fields[1]).unwrap()] += fields[2].parse::<u64>().unwrap();
    }
    let problems = problems
        .0
        .into_iter()
        .map(|(id, problem)| FittedProblem { id, problem })
        .collect();
    ChoiceData::from_counts(problems, counts).unwrap()
}

/// Pooled maximum likelihoods computed with scipy from the published counts (Kahneman & Tversky 1979): no better than
/// chance for expected rewards.
#[test]
fn kahneman_and_tversky_reject_expected_rewards() {
    let data = kahneman_tversky();
    let nr = fitted(&NOISY_RATIONAL, &data, &FitSettings::default());
    let ra = fitted(&RISK_AWARE, &data, &FitSettings::default());
    for (fit, expected) in [(&nr, -737.5086), (&ra, -593.9208)] {
        assert!(fit.summary.converged, "{:#?}", fit.summary.diagnostics);
        let found = fit.summary.max_log_likelihood.unwrap();
        assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    }
    let at = |fit: &Fit, name: &str| {
        fit.summary
            .max_likelihood_parameters
            .as_ref()
            .unwrap()
            .get(name)
            .copied()
            .flatten()
            .unwrap()
    };
    assert_eq!(at(&nr, "theta"), 0.0);
    for (name, expected) in [
        ("alpha", 0.8336),
        ("beta", 0.7907),
        ("gamma", 0.8698),
        ("delta", 0.3460),
        ("lambda", 0.3212),
        ("theta", 0.05510),
    ] {
        let found = at(&ra, name);
        assert!(
            (found / expected - 1.0).abs() < 0.02,
            "{name}: {found}, expected {expected}"
        );
    }
}

/// Each model that holds another one reaches at least its likelihood; and every member of the family converges.
#[test]
fn the_family_fits_and_its_ladder_climbs() {
    let data = kahneman_tversky();
    let highest: Vec<f64> = MODELS
        .into_iter()
        .map(|model| {
            let fit = fitted(model, &data, &FitSettings::default());
            assert!(
                fit.summary.converged,
                "{model}: {:#?}",
                fit.summary.diagnostics
            );
            fit.summary.max_log_likelihood.unwrap()
        })
        .collect();
    let of =
        |model: &ChoiceModel| highest[MODELS.iter().position(|known| *known == model).unwrap()];
    let ladders: [&[&ChoiceModel]; 2] = [
        &[
            &NOISY_RATIONAL,
            &EXPECTED_UTILITY,
            &CUMULATIVE_PROSPECT,
            &RISK_AWARE,
        ],
        &[&RISK_AWARE_PRELEC, &RISK_AWARE_PRELEC_ELEVATION],
    ];
    for pair in ladders.iter().flat_map(|ladder| ladder.windows(2)) {
        assert!(of(pair[0]) <= of(pair[1]) + 1e-6, "{} {}", pair[0], pair[1]);
    }
    // The forms are other models, not other names.
    for form in [
        &RISK_AWARE_UNNORMALISED,
        &RISK_AWARE_SAME_SIGN,
        &RISK_AWARE_PRELEC,
    ] {
        assert!((of(form) - of(&RISK_AWARE)).abs() > 1e-3, "{form}");
    }
}

const ACCELERATE_100: Outcomes = &[(0.05, -500.0), (0.95, 0.0)];
const STOP_100: Outcomes = &[(1.0, -100.0)];

fn parameter<'a>(fit: &'a Fit, name: &str) -> &'a ParameterSummary {
    fit.summary.parameters.as_ref().unwrap().get(name).unwrap()
}

/// Reference posteriors by importance sampling over scrambled Sobol sets, checked by quadrature (P1: Noisy Rational,
/// cups, 43 of 50 stable; P3: Risk-Aware, one driving cell, 25 of 30 stop), weighting floor 0.28.
#[test]
fn reference_posteriors_are_reproduced() {
    let cups = cells(&[(
        "cups",
        &[
            ("stable", &[(1.0, 20.0)]),
            ("unstable", &[(0.2, 105.0), (0.8, 0.0)]),
        ],
        &[43, 7],
    )]);
    let driving = cells(&[(
        "low",
        &[("accelerate", ACCELERATE_100), ("stop", STOP_100)],
        &[5, 25],
    )]);
    let settings = FitSettings {
        draws: 2000,
        ..FitSettings::default()
    };
    let p1 = fitted(&NOISY_RATIONAL, &cups, &settings);
    let p3 = fitted(&RISK_AWARE, &driving, &settings);
    let check = |fit: &Fit, name: &str, mean: f64, sd: f64, q5: f64, q50: f64, q95: f64| {
        let found = parameter(fit, name);
        let error = 4.0 * sd / found.ess_bulk.sqrt();
        // The error of a tail quantile is larger than that of the median by less than this factor of sd.
        let tail = 4.0 * 3.0 * sd / found.ess_tail.sqrt();
        assert!(
            (found.mean - mean).abs() < error,
            "{name}: mean {} {mean}",
            found.mean
        );
        assert!(
            (found.q50 - q50).abs() < 1.5 * error,
            "{name}: median {} {q50}",
            found.q50
        );
        assert!(
            (found.q5 - q5).abs() < tail,
            "{name}: 5 % {} {q5}",
            found.q5
        );
        assert!(
            (found.q95 - q95).abs() < tail,
            "{name}: 95 % {} {q95}",
            found.q95
        );
    };
    assert!(p1.summary.converged && p3.summary.converged);
    check(&p1, "tau", 2.756171, 2.931959, 0.242652, 1.799297, 8.538610);
    check(
        &p3, "beta", 0.905440, 0.082542, 0.763266, 0.924151, 0.993796,
    );
    check(
        &p3, "gamma", 0.322773, 0.061606, 0.282252, 0.308846, 0.387706,
    );
    check(
        &p3, "delta", 0.468590, 0.110217, 0.312368, 0.455706, 0.665976,
    );
    check(
        &p3, "alpha", 0.500037, 0.288672, 0.049925, 0.500032, 0.949961,
    );
    check(
        &p3, "lambda", 1.986776, 1.725922, 0.436737, 1.499530, 5.147654,
    );
    let ln_tau: Vec<f64> = p3
        .draws
        .column(Quantity::Tau)
        .unwrap()
        .iter()
        .map(|tau| tau.ln())
        .collect();
    let mean = ln_tau.iter().sum::<f64>() / ln_tau.len() as f64;
    let error = 4.0 * 0.951926 / parameter(&p3, "tau").ess_bulk.sqrt();
    assert!((mean - 3.048596).abs() < error, "{mean}");
    let stop = p3
        .summary
        .predicted
        .as_ref()
        .unwrap()
        .get("low")
        .unwrap()
        .get("stop")
        .unwrap()
        .mean;
    let ess = p3
        .summary
        .diagnostics
        .predicted
        .get("low")
        .unwrap()
        .ess_bulk;
    assert!(
        (stop - 0.779153).abs() < 4.0 * 0.094288 / ess.sqrt(),
        "{stop}"
    );

    for (fit, expected) in [(&p1, -35.5117), (&p3, -19.9510)] {
        let evidence = fit.summary.log_marginal_likelihood.unwrap();
        assert!(
            (evidence.value - expected).abs() < (4.0 * evidence.se).min(0.05),
            "{evidence:?}"
        );
        assert!(evidence.se < 0.02);
    }
}

const ACCELERATE_LOW: Outcomes = &[(0.05, -500.0), (0.95, 0.0)];
const ACCELERATE_HIGH: Outcomes = &[(0.95, -500.0), (0.05, 0.0)];
const STOP_50: Outcomes = &[(1.0, -50.0)];

/// 25 of 30 people stop in every cell: the driving study's pattern with a fine of 50. Under low risk Noisy Rational
/// cannot follow, since stopping has the lower expected reward; Risk-Aware comes as close as 30 answers allow.
#[test]
fn accuracy_of_the_papers_pattern() {
    let settings = FitSettings {
        draws: 1000,
        samples: 400,
        ..FitSettings::default()
    };
    let mut found = Vec::new();
    for (id, accelerate) in [("low", ACCELERATE_LOW), ("high", ACCELERATE_HIGH)] {
        let data = cells(&[(
            id,
            &[("accelerate", accelerate), ("stop", STOP_50)],
            &[5, 25],
        )]);
        for model in [&NOISY_RATIONAL, &RISK_AWARE] {
            let fit = fitted(model, &data, &settings);
            assert!(fit.summary.converged);
            found.push(fit.accuracy[0].clone());
        }
    }
    let expected = [(-1.33, 0.08), (-5.0, 2.2), (-5.3, 2.2), (-5.3, 2.2)];
    for (cell, (mean, sd)) in found.iter().zip(expected) {
        let ln_kl = &cell.ln_kl;
        // The Monte-Carlo error of a mean over 400 samples, and the rounding of the expected figures.
        assert!(
            (ln_kl.mean.unwrap() - mean).abs() < 4.0 * sd / 20.0 + 0.06,
            "{ln_kl:?}"
        );
        assert!(
            (ln_kl.sd.unwrap() - sd).abs() < 0.2 * sd + 0.02,
            "{ln_kl:?}"
        );
    }
    let noisy_rational = pooled(&[&found[0], &found[2]], Shares::Observed);
    let risk_aware = pooled(&[&found[1], &found[3]], Shares::Observed);
    assert!(
        (noisy_rational.mean.unwrap() - -3.3).abs() < 0.4,
        "{noisy_rational:?}"
    );
    assert!(
        (risk_aware.mean.unwrap() - -5.2).abs() < 0.4,
        "{risk_aware:?}"
    );
    let pairs = [(&found[0], &found[1]), (&found[2], &found[3])];
    let comparison = compare(&pairs, Shares::Observed).unwrap();
    assert_eq!(comparison.paired.unwrap().df, 799.0);
    assert!(comparison.paired.unwrap().p < 1e-6 && comparison.mean_difference > 0.0);
}

/// With losses only α plays no part, and λ only together with θ.
#[test]
fn what_no_choice_depends_on_keeps_its_prior() {
    let data = cells(&[(
        "low",
        &[("accelerate", ACCELERATE_100), ("stop", STOP_100)],
        &[5, 25],
    )]);
    let fit = fitted(&RISK_AWARE, &data, &FitSettings::default());
    let alpha = parameter(&fit, "alpha");
    let sd = (1.0_f64 / 12.0).sqrt();
    assert_eq!((alpha.source, alpha.informed), (Source::Prior, false));
    assert!((alpha.mean - 0.5).abs() < 4.0 * sd / alpha.ess_bulk.sqrt());
    assert!((alpha.sd / sd - 1.0).abs() < 0.06, "{}", alpha.sd);
    assert!(alpha.contraction.abs() < 0.1);
    let ln_lambda: Vec<f64> = fit
        .draws
        .column(Quantity::Parameter(Parameter::Lambda))
        .unwrap()
        .iter()
        .map(|lambda| (lambda / 1.5).ln() / 0.75)
        .collect();
    let n = ln_lambda.len() as f64;
    let mean = ln_lambda.iter().sum::<f64>() / n;
    let square = ln_lambda.iter().map(|z| z * z).sum::<f64>() / n;
    assert!(mean.abs() < 4.0 / n.sqrt() && (square - 1.0).abs() < 4.0 * (2.0 / n).sqrt());
    for name in ["lambda", "theta"] {
        assert_eq!(parameter(&fit, name).source, Source::Prior, "{name}");
    }
    let product = parameter(&fit, "lambda_theta");
    assert!(product.source == Source::Choices && product.informed);
    assert_eq!(parameter(&fit, "beta").source, Source::Choices);
}

const STABLE: Outcomes = &[(1.0, 20.0)];
const UNSTABLE: Outcomes = &[(0.8, 0.0), (0.2, 105.0)];

/// 42 of 50 build the stable tower: the cup study's pattern. There are only gains, so nothing is learned of losses.
#[test]
fn accuracy_of_the_cup_study_and_what_it_leaves_open() {
    let settings = FitSettings {
        samples: 1_300,
        ..FitSettings::default()
    };
    let data = cells(&[(
        "untimed",
        &[("stable", STABLE), ("unstable", UNSTABLE)],
        &[42, 8],
    )]);
    let noisy_rational = fitted(&NOISY_RATIONAL, &data, &settings);
    let ln_kl = &noisy_rational.accuracy[0].ln_kl;
    assert!((ln_kl.mean.unwrap() - -1.34).abs() < 0.01, "{ln_kl:?}");
    assert!((ln_kl.sd.unwrap() - 0.04).abs() < 0.02, "{ln_kl:?}");

    let risk_aware = fitted(&RISK_AWARE, &data, &settings);
    let ln_kl = &risk_aware.accuracy[0].ln_kl;
    assert!(ln_kl.samples >= 1_000, "{ln_kl:?}");
    assert!((-6.1..=-5.5).contains(&ln_kl.mean.unwrap()), "{ln_kl:?}");
    assert!((ln_kl.sd.unwrap() - 2.2).abs() < 0.3, "{ln_kl:?}");

    // Four Monte-Carlo errors of a mean and of a variance, on a scale where the prior has mean 0 and variance 1: uniform
    // (kurtosis 1.8) or normal (3).
    let standard = [
        (Parameter::Beta, 1.8),
        (Parameter::Delta, 1.8),
        (Parameter::Lambda, 3.0),
    ];
    let standardised = |name: Parameter, value: f64| match name {
        Parameter::Beta => (value - 0.5) * 12_f64.sqrt(),
        Parameter::Delta => (value - 0.64) / 0.72 * 12_f64.sqrt(),
        Parameter::Lambda => (value / 1.5).ln() / 0.75,
        other => panic!("{other:?} is learned here"),
    };
    for (name, kurtosis) in standard {
        let found = parameter(&risk_aware, name.key());
        assert_eq!((found.source, found.informed), (Source::Prior, false));
        let draws: Vec<f64> = risk_aware
            .draws
            .column(Quantity::Parameter(name))
            .unwrap()
            .iter()
            .map(|value| standardised(name, *value))
            .collect();
        let n = found.ess_bulk.min(draws.len() as f64);
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let square = draws.iter().map(|z| z * z).sum::<f64>() / draws.len() as f64;
        assert!(mean.abs() < 4.0 / n.sqrt(), "{}: {mean}", name.key());
        assert!(
            (square - 1.0).abs() < 4.0 * ((kurtosis - 1.0) / n).sqrt(),
            "{}: {square}",
            name.key()
        );
    }
    for name in ["alpha", "gamma"] {
        assert_eq!(parameter(&risk_aware, name).source, Source::Choices);
    }
}

/// Without an answer there is nothing but the prior.
#[test]
fn without_answers_the_posterior_is_the_prior() {
    let data = cells(&[(
        "low",
        &[("accelerate", ACCELERATE_100), ("stop", STOP_100)],
        &[0, 0],
    )]);
    let fit = fitted(&RISK_AWARE, &data, &FitSettings::default());
    assert!(fit.summary.converged && fit.accuracy.is_empty());
    for (name, found) in fit.summary.parameters.as_ref().unwrap().iter() {
        assert_eq!(found.source, Source::Prior, "{name}");
        let width = found.prior_q95 - found.prior_q5;
        assert!((found.q50 - found.prior_q50).abs() < 0.08 * width, "{name}");
    }
    assert_eq!(fit.summary.log_marginal_likelihood.unwrap().value, 0.0);
}

/// Everybody stops: the likelihood has no highest point at finite sensitivity, the posterior still converges.
#[test]
fn unanimous_cells_converge_and_are_marked() {
    let data = cells(&[(
        "low",
        &[("accelerate", ACCELERATE_100), ("stop", STOP_100)],
        &[0, 30],
    )]);
    for model in [&NOISY_RATIONAL, &RISK_AWARE] {
        let fit = fitted(model, &data, &FitSettings::default());
        assert!(fit.summary.converged, "{:#?}", fit.summary.diagnostics);
        assert!(fit.accuracy[0].unanimous && fit.accuracy[0].smoothed.mean.is_some());
        let json = serde_json::to_string(&fit.summary).unwrap();
        let read: FitSummary = serde_json::from_str(&json).unwrap();
        assert_eq!(read, fit.summary);
    }
}

#[test]
fn parameters_of_simulated_people_are_recovered() {
    let truth = [0.7, 0.8, 0.6, 0.7, 1.8, 0.04];
    let entries = RISK_AWARE
        .parameters
        .iter()
        .map(|name| name.key())
        .zip(truth);
    let person = RISK_AWARE.parameters_from(entries).unwrap();
    let template = kahneman_tversky();
    let mut problems = template.problems().to_vec();
    // Problems with both signs and of several sizes, without which λ and the curvatures are one.
    for (index, (gain, loss)) in [(500.0, -200.0), (3000.0, -1000.0), (100.0, -90.0)]
        .iter()
        .enumerate()
    {
        let mixed = [(0.5, *gain), (0.5, *loss)];
        let nothing = [(1.0, 0.0)];
        problems.push(FittedProblem {
            id: format!("mixed {index}"),
            problem: ChoiceProblem::from_outcomes([("play", &mixed[..]), ("pass", &nothing[..])])
                .unwrap(),
        });
    }
    let mut rng = ChaCha12Rng::seed_from_u64(20);
    let simulate = |person: &Parameters, rng: &mut ChaCha12Rng| -> Vec<Vec<u64>> {
        let of_problem = |problem: &FittedProblem| {
            let first =
                probabilities(&problem.problem, person, RiskAwareOptions::default()).unwrap()[0];
            let count = (0..400).filter(|_| rng.random::<f64>() < first).count() as u64;
            vec![count, 400 - count]
        };
        problems.iter().map(of_problem).collect()
    };
    let counts = simulate(&person, &mut rng);
    let data = ChoiceData::from_counts(problems.clone(), counts).unwrap();
    let fit = fitted(&RISK_AWARE, &data, &FitSettings::default());
    assert!(fit.summary.converged);
    for (name, expected) in RISK_AWARE.parameters.iter().zip(truth) {
        let found = parameter(&fit, name.key());
        assert!(
            (found.mean - expected).abs() < 3.5 * found.sd,
            "{name}: {found:?}"
        );
        assert!(found.informed, "{name}: {found:?}");
    }
    let prediction = predict_from_draws(
        &problems[2].problem,
        &fit.draws,
        RiskAwareOptions::default(),
    )
    .unwrap();
    let shares = fit
        .summary
        .predicted
        .as_ref()
        .unwrap()
        .get(&problems[2].id)
        .unwrap();
    for action in &prediction.actions {
        assert!((action.mean - shares.get(&action.action).unwrap().mean).abs() < 1e-12);
    }

    let rational = Parameters::ONES.with(Parameter::Theta, 0.001).unwrap();
    let counts = simulate(&rational, &mut rng);
    let data = ChoiceData::from_counts(problems, counts).unwrap();
    let fit = fitted(&NOISY_RATIONAL, &data, &FitSettings::default());
    let found = parameter(&fit, "theta");
    assert!((found.mean - 0.001).abs() < 3.5 * found.sd, "{found:?}");
}

#[test]
fn the_same_seed_gives_the_same_draws_bit_for_bit_whatever_the_order_of_problems() {
    let low: Cell<'_> = (
        "low",
        &[("accelerate", ACCELERATE_100), ("stop", STOP_100)],
        &[5, 25],
    );
    let high: Cell<'_> = (
        "high",
        &[("accelerate", ACCELERATE_HIGH), ("stop", STOP_100)],
        &[2, 28],
    );
    let settings = FitSettings {
        seed: 42,
        ..FitSettings::default()
    };
    let one = fitted(&RISK_AWARE, &cells(&[low, high]), &settings);
    let again = fitted(&RISK_AWARE, &cells(&[high, low]), &settings);
    assert_eq!(one.draws, again.draws);
    let other = fitted(
        &RISK_AWARE,
        &cells(&[low, high]),
        &FitSettings {
            seed: 43,
            ..settings
        },
    );
    assert_ne!(one.draws, other.draws);
}

/// A choice so hopeless that its probability is 0 in every draw does not move, whichever action comes first.
#[test]
fn hopeless_actions_need_no_chain_to_converge() {
    let small: Cell<'_> = (
        "small",
        &[("a", &[(1.0, 10.0)]), ("b", &[(1.0, 12.0)])],
        &[300, 700],
    );
    let low: (&str, Outcomes<'_>) = ("low", &[(1.0, 100.0)]);
    let high: (&str, Outcomes<'_>) = ("high", &[(1.0, 5000.0)]);
    for actions in [[low, high], [high, low]] {
        let counts = if actions[0].0 == "high" {
            [50, 0]
        } else {
            [0, 50]
        };
        let data = cells(&[small, ("large", &actions, &counts)]);
        let fit = fitted(&NOISY_RATIONAL, &data, &FitSettings::default());
        assert!(fit.summary.converged, "{:#?}", fit.summary.diagnostics);
    }
}

#[test]
fn independent_samples_are_spread_over_all_chains() {
    let fit = fitted(
        &NOISY_RATIONAL,
        &kahneman_tversky(),
        &FitSettings::default(),
    );
    assert_eq!(fit.sample_indices.len(), 30);
    let per_chain = fit.draws.per_chain;
    for chain in 0..fit.draws.chains {
        let of_chain: Vec<usize> = fit
            .sample_indices
            .iter()
            .copied()
            .filter(|index| index / per_chain == chain)
            .collect();
        assert!((3..=4).contains(&of_chain.len()));
        assert!(of_chain.windows(2).all(|pair| pair[1] - pair[0] >= 100));
    }
}

#[test]
fn curves_show_the_posterior_beside_the_prior() {
    let data = cells(&[(
        "low",
        &[("accelerate", ACCELERATE_100), ("stop", STOP_100)],
        &[5, 25],
    )]);
    let risk_aware = fitted(&RISK_AWARE, &data, &FitSettings::default());
    let found = curves(data.problems(), &[&risk_aware], None).unwrap();
    assert!(found.gains_through_normalisation_only);
    let gains = found.weighting_gains.as_ref().unwrap();
    let mean = |index: usize| gains.bands[index].unwrap().mean;
    assert_eq!((mean(0), mean(100)), (0.0, 1.0));
    assert!(
        gains
            .bands
            .iter()
            .flatten()
            .all(|band| band.q5 <= band.q25 && band.q75 <= band.q95)
    );
    // A rare loss weighs more than its probability; most people stop, so more than the prior says.
    let weight = &found.risky_weights[0];
    assert_eq!((weight.reward, weight.otherwise), (-500.0, 0.0));
    assert_eq!(weight.probabilities, [0.05]);
    let band = weight.curve.bands[5].unwrap();
    assert!(band.mean > band.prior.unwrap());
    // By construction every draw is at −1 where the reward is the reference.
    let at_reference = found.value_shape.bands[0].unwrap();
    assert!((at_reference.q5 + 1.0).abs() < 1e-12 && (at_reference.q95 + 1.0).abs() < 1e-12);
    // The gap in logits is what the predicted share says.
    let gap = &found.gaps[0];
    assert_eq!(
        (gap.action.as_str(), gap.than.as_str()),
        ("accelerate", "stop")
    );
    let logits = gap.logits.unwrap();
    assert!(logits.q95 < 0.0 && logits.q5 > -4.0, "{gap:?}");

    let rational = fitted(&NOISY_RATIONAL, &data, &FitSettings::default());
    let found = curves(data.problems(), &[&rational], None).unwrap();
    assert!(found.weighting_gains.is_none());
    let weight = &found.risky_weights[0].curve;
    assert!(
        weight
            .x
            .iter()
            .zip(&weight.bands)
            .all(|(p, band)| (band.as_ref().unwrap().mean - p).abs() < 1e-12)
    );
}

/// The prior does not move with answers, so a refit's curves take it over; all else is their own.
#[test]
fn curves_of_a_refit_keep_the_prior_of_the_fit_before() {
    let of = |stop: u64| {
        cells(&[(
            "low",
            &[("accelerate", ACCELERATE_100), ("stop", STOP_100)],
            &[5, stop],
        )])
    };
    let (before, after) = (of(25), of(26));
    let settings = FitSettings::default();
    let first = fitted(&RISK_AWARE, &before, &settings);
    let earlier = curves(before.problems(), &[&first], None).unwrap();
    let second = refit(
        &first.warm_start,
        &RISK_AWARE,
        &after,
        &settings,
        &mut uninterrupted,
    )
    .unwrap();
    assert!(second.summary.provisional);
    let anew = curves(after.problems(), &[&second], None).unwrap();
    let since = curves(after.problems(), &[&second], Some(&earlier)).unwrap();
    let all = |curves: &Curves| -> Vec<Option<Band>> {
        let named = [&curves.value_logits, &curves.value_shape];
        let weighting = curves
            .weighting_gains
            .iter()
            .chain(&curves.weighting_losses);
        let risky = curves.risky_weights.iter().map(|risky| &risky.curve);
        let bands = named.into_iter().chain(weighting).chain(risky);
        let gaps = curves.gaps.iter().map(|gap| gap.logits);
        bands
            .flat_map(|curve| curve.bands.iter().copied())
            .chain(gaps)
            .collect()
    };
    let [earlier, anew, since] = [&earlier, &anew, &since].map(all);
    assert_eq!(since.len(), anew.len());
    for ((since, anew), earlier) in since.iter().zip(&anew).zip(&earlier) {
        let expected = anew.map(|band| Band {
            prior: earlier.map_or(band.prior, |earlier| earlier.prior),
            ..band
        });
        assert_eq!(*since, expected);
    }
    assert_ne!(since, earlier);
}

/// Few draws cannot reach an effective sample size of 400: the results are withheld, the diagnostics are not.
#[test]
fn an_unconverged_fit_shows_diagnostics_only() {
    let data = cells(&[(
        "low",
        &[("accelerate", ACCELERATE_100), ("stop", STOP_100)],
        &[5, 25],
    )]);
    let settings = FitSettings {
        chains: 2,
        draws: 100,
        samples: 4,
        ..FitSettings::default()
    };
    let fit = fitted(&RISK_AWARE, &data, &settings);
    assert!(!fit.summary.converged);
    let shown = serde_json::to_value(fit.summary.shown()).unwrap();
    for key in [
        "parameters",
        "max_log_likelihood",
        "log_kl",
        "predicted",
        "log_marginal_likelihood",
    ] {
        assert!(shown[key].is_null(), "{key}");
    }
    assert!(shown["diagnostics"]["parameters"]["beta"]["rhat"].is_number());
}

#[test]
fn a_fit_stops_when_asked_and_refuses_nonsense() {
    let data = kahneman_tversky();
    let mut stop_when_sampling = |progress| match progress {
        Progress::WarmingUp | Progress::Climbing => ControlFlow::Continue(()),
        Progress::Sampling { .. } => ControlFlow::Break(()),
    };
    let stopped = fit(
        &RISK_AWARE,
        &data,
        &FitSettings::default(),
        &mut stop_when_sampling,
    );
    assert_eq!(stopped.unwrap_err(), FitError::Stopped);

    let refused = |settings: FitSettings| {
        fit(&RISK_AWARE, &data, &settings, &mut uninterrupted)
            .unwrap_err()
            .to_string()
    };
    let one_chain = FitSettings {
        chains: 1,
        ..FitSettings::default()
    };
    assert_eq!(refused(one_chain), "chains is 1, allowed is 2 to 64");
    let zero = FitSettings {
        reference_reward: Some(0.0),
        ..FitSettings::default()
    };
    assert!(refused(zero).contains("reference reward is 0"));
    let priors = Priors {
        gamma: Prior::Uniform {
            low: 0.5,
            high: 0.5,
        },
        ..Priors::default()
    };
    assert!(
        refused(FitSettings {
            priors,
            ..FitSettings::default()
        })
        .contains("`gamma`")
    );
}

fn driving(risk: f64, counts: &[u64; 2]) -> ChoiceData {
    let accelerate = [(risk, -500.0), (1.0 - risk, 0.0)];
    cells(&[(
        "driving",
        &[("accelerate", &accelerate[..]), ("stop", STOP_100)],
        counts,
    )])
}

/// A fit that starts from one of fewer answers draws from the same posterior as one that knows nothing.
#[test]
fn a_warm_refit_agrees_with_a_cold_fit() {
    for model in [&NOISY_RATIONAL, &RISK_AWARE] {
        let settings = FitSettings::default();
        let before = fitted(model, &driving(0.05, &[5, 24]), &settings);
        let data = driving(0.05, &[5, 25]);
        let cold = fitted(model, &data, &settings);
        let again = |data: &ChoiceData, settings: &FitSettings| {
            refit(
                &before.warm_start,
                model,
                data,
                settings,
                &mut uninterrupted,
            )
            .unwrap()
        };
        let warm = again(&data, &settings);
        assert!(warm.summary.converged && warm.summary.provisional);
        assert!(!cold.summary.provisional);
        assert_ne!(warm.draws, cold.draws);
        assert_eq!(warm.draws, again(&data, &settings).draws);
        for (name, one) in warm.summary.parameters.as_ref().unwrap().iter() {
            let other = parameter(&cold, name);
            for (one, other, errors) in [
                (one.mean, other.mean, [one.mcse_mean, other.mcse_mean]),
                (one.q50, other.q50, [one.mcse_q50, other.mcse_q50]),
            ] {
                let error = errors[0].hypot(errors[1]);
                assert!(
                    (one - other).abs() < 4.0 * error,
                    "{model} {name}: {one}, cold {other}, error {error}"
                );
            }
        }
        let highest = |fit: &Fit| fit.summary.max_log_likelihood.unwrap();
        assert!(
            (highest(&warm) - highest(&cold)).abs() < 1e-6,
            "{model}: {} and cold {}",
            highest(&warm),
            highest(&cold)
        );
        let evidence = |fit: &Fit| fit.summary.log_marginal_likelihood.unwrap();
        let (one, other) = (evidence(&warm), evidence(&cold));
        assert!((one.value - other.value).abs() < 4.0 * one.se.hypot(other.se));

        // Another problem, another seed: as if there had been no earlier fit.
        let elsewhere = driving(0.10, &[5, 25]);
        let reseeded = FitSettings {
            seed: 2,
            ..settings.clone()
        };
        for (data, settings) in [(&elsewhere, &settings), (&data, &reseeded)] {
            let found = again(data, settings);
            assert!(!found.summary.provisional);
            let anew = fitted(model, data, settings);
            assert_eq!(found.draws, anew.draws);
            assert_eq!(found.summary, anew.summary);
        }
    }
}

/// Sure rewards against gambles of every size and sign, with all kinds of shares.
#[test]
#[ignore = "2,000 cold fits: some ten seconds of processor time"]
fn noisy_rational_converges_on_generated_problems() {
    const FITS: usize = 2000;
    let mut rng = ChaCha12Rng::seed_from_u64(3);
    for _ in 0..FITS {
        let size = 10.0_f64.powf(rng.random_range(0.0..4.0));
        let mut reward = || size * rng.random_range(-1.0..1.0_f64);
        let (high, low, sure) = (reward(), reward(), reward());
        let p = rng.random_range(0.01..0.99);
        let gamble = [(p, high), (1.0 - p, low)];
        let n = rng.random_range(1..=100);
        let gambled = rng.random_range(0..=n);
        let counts = [gambled, n - gambled];
        let data = cells(&[(
            "generated",
            &[("gamble", &gamble[..]), ("sure", &[(1.0, sure)])],
            &counts,
        )]);
        let fit = fitted(&NOISY_RATIONAL, &data, &FitSettings::default());
        assert!(
            fit.summary.converged,
            "{gamble:?} {sure} {counts:?}: {:#?}",
            fit.summary.diagnostics
        );
    }
}
