//! What a user waits for: one evaluation of a posterior, and one fit.

use divan::{Bencher, black_box};
use riskaware::inference::{
    ChoiceData, FitSettings, FittedProblem, LnPosterior, fit, uninterrupted,
};
use riskaware::model::{ChoiceModel, ChoiceProblem, MODELS, RISK_AWARE};

fn main() {
    divan::main();
}

/// The eight fitted cells of the driving study: low and high risk with a fine of 100, four times each.
fn driving() -> ChoiceData {
    let problem = |id: usize| {
        let risk = if id.is_multiple_of(2) { 0.05 } else { 0.95 };
        let accelerate = [(risk, -500.0), (1.0 - risk, 0.0)];
        let stop = [(1.0, -100.0)];
        let actions = [("accelerate", &accelerate[..]), ("stop", &stop[..])];
        let problem = ChoiceProblem::from_outcomes(actions).expect("the problem is valid");
        FittedProblem {
            id: format!("cell {id}"),
            problem,
        }
    };
    let counts = (0..8)
        .map(|id| {
            if id % 2 == 0 {
                vec![5, 25]
            } else {
                vec![2, 28]
            }
        })
        .collect();
    ChoiceData::from_counts((0..8).map(problem).collect(), counts).expect("the shapes agree")
}

#[divan::bench]
fn ln_posterior(bencher: Bencher<'_, '_>) {
    let data = driving();
    let settings = FitSettings::default();
    let mut density = LnPosterior::new(&RISK_AWARE, &data, &settings).expect("settings are valid");
    let mut position = vec![0.1; density.dimension()];
    bencher.bench_local(|| {
        // A new place each time: evaluations remember the last one.
        for coordinate in &mut position {
            *coordinate = -*coordinate;
        }
        density.at(black_box(&position))
    });
}

#[divan::bench(args = MODELS)]
fn one_fit(model: &&'static ChoiceModel) -> f64 {
    let settings = FitSettings::default();
    let fit = fit(model, &driving(), &settings, &mut uninterrupted).expect("settings are valid");
    fit.draws.columns[0].1[0]
}
