//! Effective draws per second of CPU time on P1 to P4: `cargo bench --bench sampling`.
//!
//! The rate is the least rank-normalised bulk effective sample size over parameters and predicted probabilities, of
//! 8 × 25,000 draws one step apart, per second of one core; the best of five seeds, since others use this machine too.

use std::ops::ControlFlow;

use riskaware::inference::LnPosterior;
use riskaware::inference::diagnostics::{NormalScores, Workspace};
use riskaware::inference::sampler::{Run, adapt, random_stream, run_chains, warm_up};

mod cpu_time;
mod posteriors;

use cpu_time::CpuTime;
use posteriors::{Case, cases};

const CHAINS: usize = 8;
const DRAWS: usize = 25_000;

fn main() {
    println!("posterior  draws ESS/s  with warm-up  ns/step  accepted  worst R-hat");
    for case in cases() {
        let runs = (1..=5).map(|seed| measure(&case, seed));
        let best = runs.max_by(|left, right| left.rate.total_cmp(&right.rate));
        let best = best.expect("there are five seeds");
        println!(
            "{:9}  {:>11.0}  {:>12.0}  {:>7.1}  {:>8.3}  {:>11.4}",
            case.name,
            best.rate,
            best.rate_with_warm_up,
            best.nanoseconds,
            best.acceptance,
            best.rhat
        );
    }
}

struct Measured {
    rate: f64,
    rate_with_warm_up: f64,
    nanoseconds: f64,
    acceptance: f64,
    rhat: f64,
}

fn measure(case: &Case, seed: u64) -> Measured {
    let mut density =
        LnPosterior::new(case.model, &case.data, &case.settings).expect("settings are valid");
    let mut watch = || ControlFlow::Continue(());
    let clock = CpuTime::start();
    let warm = warm_up(&mut density, seed, &mut watch).expect("nothing stops it");
    let mut rng = random_stream(seed, u64::MAX - 1);
    let proposal =
        adapt(&mut density, warm.proposal.clone(), &mut rng, &mut watch).expect("nothing stops it");
    let warmed = clock.seconds();
    let run = Run {
        seed,
        stream: 1,
        burn_in: 50,
        draws: DRAWS,
        steps: 1,
    };
    let chains = run_chains(
        &mut density,
        &proposal,
        &warm.starts(CHAINS),
        run,
        &mut watch,
    )
    .expect("nothing stops it");
    let end = clock.seconds();

    let draws = density.draws(&chains, seed);
    let predicted = density.ln_predicted(&draws);
    let columns = draws.columns.iter().map(|(_, values)| values);
    let scores = NormalScores::new(CHAINS * DRAWS);
    let mut workspace = Workspace::default();
    let (mut ess, mut rhat) = (f64::INFINITY, 0.0_f64);
    for column in columns.chain(&predicted) {
        let found = workspace
            .order(&draws.by_chain(column))
            .convergence(&scores);
        ess = ess.min(found.ess_bulk);
        rhat = rhat.max(found.rhat);
    }
    Measured {
        rate: ess / (end - warmed),
        rate_with_warm_up: ess / end,
        nanoseconds: (end - warmed) * 1e9 / (CHAINS * DRAWS) as f64,
        acceptance: chains.acceptance,
        rhat,
    }
}
