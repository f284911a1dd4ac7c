//! CPU time of warm refits of P1 to P4: `cargo bench --bench refits`.
//!
//! Medians over refits, each from the one before with 0, 1 or 2 answers more than the first fit had. "to convergence" ends where
//! [`refit`] announces [`Progress::Climbing`]: R̂ and both effective sample sizes of all that was sampled are known and
//! suffice. Draws straight from the prior, independent by construction, are measured after that.

use std::ops::ControlFlow;

use riskaware::inference::{ChoiceData, FitSummary, Progress, fit, refit, uninterrupted};

mod cpu_time;
mod posteriors;

use cpu_time::CpuTime;
use posteriors::{Case, cases};

const REFITS: u64 = 90;

fn main() {
    println!("posterior  to convergence, ms  all, ms  accepted  largest R-hat  least ESS");
    for case in cases() {
        let refits = measure(&case);
        let median = |of: fn(&Refit) -> f64| {
            let mut values: Vec<f64> = refits.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let rhats = refits.iter().map(|refit| refit.rhat);
        let sizes = refits.iter().map(|refit| refit.ess);
        println!(
            "{:9}  {:>18.3}  {:>7.3}  {:>8.3}  {:>13.4}  {:>9.0}",
            case.name,
            1e3 * median(|refit| refit.to_convergence),
            1e3 * median(|refit| refit.all),
            median(|refit| refit.acceptance),
            rhats.fold(1.0, f64::max),
            sizes.fold(f64::INFINITY, f64::min),
        );
    }
}

struct Refit {
    to_convergence: f64,
    all: f64,
    acceptance: f64,
    /// Largest over parameters and predicted probabilities.
    rhat: f64,
    /// Least of bulk and tail over the same.
    ess: f64,
}

fn measure(case: &Case) -> Vec<Refit> {
    let first = fit(case.model, &case.data, &case.settings, &mut uninterrupted)
        .expect("settings are valid");
    let mut earlier = first.warm_start;
    let refits = (1..=REFITS).map(|number| {
        let data = with_more_answers(&case.data, number % 3);
        let clock = CpuTime::start();
        let mut to_convergence = None;
        let mut watch = |progress| {
            if progress == Progress::Climbing {
                to_convergence = Some(clock.seconds());
            }
            ControlFlow::Continue(())
        };
        let found = refit(&earlier, case.model, &data, &case.settings, &mut watch)
            .expect("settings are valid");
        let all = clock.seconds();
        assert!(
            found.summary.converged && found.summary.provisional,
            "refit {number} of {case} is not a warm one that converged"
        );
        let (rhat, ess) = worst(&found.summary);
        earlier = found.warm_start;
        Refit {
            to_convergence: to_convergence.expect("every fit announces it"),
            all,
            acceptance: found.summary.acceptance.expect("parameters move"),
            rhat,
            ess,
        }
    });
    refits.collect()
}

/// The more usual action of the first problem chosen some more times.
fn with_more_answers(data: &ChoiceData, more: u64) -> ChoiceData {
    let mut counts = data.totals().to_vec();
    let usual = counts[0].iter_mut().max().expect("there are actions");
    *usual += more;
    ChoiceData::from_counts(data.problems().to_vec(), counts).expect("the shapes agree")
}

/// The largest R̂ and the least effective sample size of a fit.
fn worst(summary: &FitSummary) -> (f64, f64) {
    let diagnostics = &summary.diagnostics;
    let all = diagnostics
        .parameters
        .iter()
        .chain(diagnostics.predicted.iter());
    all.fold((1.0, f64::INFINITY), |(rhat, ess), (_, found)| {
        (
            found.rhat.max(rhat),
            found.ess_bulk.min(found.ess_tail).min(ess),
        )
    })
}
