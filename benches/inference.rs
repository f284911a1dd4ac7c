//! What a user waits for: one evaluation of a posterior, and one fit.

use divan::{Bencher, black_box};
use riskaware::inference::{LnPosterior, fit, uninterrupted};

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

#[divan::bench(args = cases())]
fn cold_fit(case: &Case) -> f64 {
    let fit = fit(case.model, &case.data, &case.settings, &mut uninterrupted)
        .expect("settings are valid");
    fit.draws.columns[0].1[0]
}
