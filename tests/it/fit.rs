//! Fits of real, simulated and constructed choices, against values computed elsewhere.

use riskaware::inference::{
    ChoiceData, Fit, FitError, FitSettings, FittedProblem, ParameterSummary, Quantity, fit,
    uninterrupted,
};
use riskaware::model::{ChoiceModel, ChoiceProblem, NOISY_RATIONAL, OrderedMap, RISK_AWARE};

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
    let started = std::time::Instant::now();
    let fit = fit(model, data, settings, &mut uninterrupted).unwrap();
    eprintln!(
        "{} {:?} steps {} acc {:?} conv {}",
        model.id,
        started.elapsed(),
        fit.summary.steps_per_draw,
        fit.summary.acceptance,
        fit.summary.converged
    );
    fit
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

#[test]
fn zz() {
    let _ = FitError::Stopped;
}
