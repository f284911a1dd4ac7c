//! What a user waits for: one evaluation of a posterior, and one fit.

use divan::{Bencher, black_box};
use riskaware::inference::{LnPosterior, fit, refit, uninterrupted};

mod posteriors;

use posteriors::{Case, cases};

fn main() {
    divan::main();
}

#[divan::bench(args = cases())]
fn ln_posterior(bencher: Bencher<'_, '_>, case: &Case) {
    let mut density =
        LnPosterior::new(case.model, &case.data, &case.settings).expect("settings are valid");
    let mut position = vec![0.1; density.dimension()];
    bencher.bench_local(|| {
        // A new place each time: evaluations remember the last one.
        for coordinate in &mut position {
            *coordinate = -*coordinate;
        }
        density.at(black_box(&position))
    });
}

/// 32 positions at once.
#[divan::bench(args = cases())]
fn ln_posterior_in_lanes(bencher: Bencher<'_, '_>, case: &Case) {
    let mut density =
        LnPosterior::new(case.model, &case.data, &case.settings).expect("settings are valid");
    let mut positions = vec![[0.1; 32]; density.dimension()];
    bencher.bench_local(|| {
        for coordinate in positions.iter_mut().flatten() {
            *coordinate = -*coordinate;
        }
        density.at_lanes(black_box(&positions))
    });
}

#[divan::bench(args = cases())]
fn warm_refit(bencher: Bencher<'_, '_>, case: &Case) {
    let first = fit(case.model, &case.data, &case.settings, &mut uninterrupted)
        .expect("settings are valid");
    bencher.bench_local(|| {
        refit(
            &first.warm_start,
            case.model,
            &case.data,
            &case.settings,
            &mut uninterrupted,
        )
    });
}

#[divan::bench(args = cases())]
fn cold_fit(case: &Case) -> f64 {
    let fit = fit(case.model, &case.data, &case.settings, &mut uninterrupted)
        .expect("settings are valid");
    fit.draws.columns[0].1[0]
}
