//! riskaware's own sampler: fits through the functions that everybody calls, and its kernel by itself.

use std::hint::black_box;
use std::ops::ControlFlow;

use anyhow::ensure;
use riskaware::inference::diagnostics::Convergence;
use riskaware::inference::sampler::{Run, adapt, random_stream, run_chains, warm_up};
use riskaware::inference::{FitSummary, LnPosterior, fit, refit, uninterrupted};

use crate::cpu_time::CpuTime;
use crate::posteriors::Case;

/// Chains, one per lane.
const CHAINS: usize = 8;

/// What was measured of one posterior.
#[derive(Debug, Clone, Copy)]
pub struct Measured {
    /// Evaluations of the log-posterior per second, one position at a time.
    pub evaluations: f64,
    /// The same, eight positions at a time.
    pub lane_evaluations: f64,
    /// CPU seconds of a cold fit with default settings: finding the modes, chains, diagnostics, evidence, summaries.
    pub cold: f64,
    /// CPU seconds of a warm refit with default settings, everything included.
    pub warm: f64,
    /// Largest R̂ over parameters and predicted probabilities of the refits.
    pub refit_rhat: f64,
    /// Smallest effective sample size, bulk or tail, of the refits.
    pub refit_ess: f64,
    /// Largest R̂ of the long runs.
    pub rhat: f64,
    /// Effective draws per CPU second of a long run, warm-up not counted: median over seeds.
    pub rate: f64,
}

/// Measures one posterior: the least time of several fits of each kind, and long runs.
///
/// * `draws`: of a long run, per chain.
///
/// # Errors
/// When a fit fails.
pub fn measure(case: &Case, repeats: usize, draws: usize) -> anyhow::Result<Measured> {
    let (mut cold, mut warm) = (f64::INFINITY, f64::INFINITY);
    let (mut refit_rhat, mut refit_ess, mut rhat) = (1.0_f64, f64::INFINITY, 1.0_f64);
    let mut rates = Vec::new();
    for seed in 1..=repeats as u64 {
        let mut settings = case.settings.clone();
        settings.seed = seed;
        let clock = CpuTime::start();
        let first = fit(case.model, &case.data, &settings, &mut uninterrupted)?;
        cold = cold.min(clock.seconds());
        let mut earlier = first.warm_start;
        for _ in 0..repeats {
            let clock = CpuTime::start();
            let again = refit(
                &earlier,
                case.model,
                &case.data,
                &settings,
                &mut uninterrupted,
            )?;
            warm = warm.min(clock.seconds());
            ensure!(
                again.summary.converged,
                "{}: a refit with seed {seed} did not converge",
                case.name
            );
            let (found_rhat, found_ess) = worst(&again.summary);
            refit_rhat = refit_rhat.max(found_rhat);
            refit_ess = refit_ess.min(found_ess);
            earlier = again.warm_start;
        }
        let (found_rhat, rate) = long_run(case, seed, draws)?;
        rhat = rhat.max(found_rhat);
        rates.push(rate);
    }
    rates.sort_by(f64::total_cmp);
    let (evaluations, lane_evaluations) = evaluations(case)?;
    Ok(Measured {
        evaluations,
        lane_evaluations,
        cold,
        warm,
        refit_rhat,
        refit_ess,
        rhat,
        rate: rates[rates.len() / 2],
    })
}

/// The kernel of a fit by itself, as nuts-rs is measured: chains after warm-up, a step for each draw. R̂ and smallest bulk
/// ESS per second.
fn long_run(case: &Case, seed: u64, draws: usize) -> anyhow::Result<(f64, f64)> {
    let mut go_on = || ControlFlow::Continue(());
    let mut posterior = LnPosterior::new(case.model, &case.data, &case.settings)?;
    let warm = warm_up(&mut posterior, seed, &mut go_on)?;
    let mut rng = random_stream(seed, 1);
    let proposal = adapt(&mut posterior, warm.proposal.clone(), &mut rng, &mut go_on)?;
    let run = Run {
        seed,
        stream: 1 << 32,
        burn_in: 50,
        draws,
        steps: 1,
    };
    let starts = warm.starts(CHAINS);
    let clock = CpuTime::start();
    let chains = run_chains(&mut posterior, &proposal, &starts, run, &mut go_on)?;
    let seconds = clock.seconds();
    let draws = posterior.draws(&chains, seed);
    let predicted = posterior.ln_predicted(&draws);
    let columns = draws.columns.iter().map(|(_, values)| values);
    let (mut rhat, mut ess) = (1.0_f64, f64::INFINITY);
    for column in columns.chain(&predicted) {
        let found = Convergence::of(&draws.by_chain(column));
        rhat = rhat.max(found.rhat);
        ess = ess.min(found.ess_bulk);
    }
    Ok((rhat, ess / seconds))
}

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

/// Evaluations per second, one position and eight positions at a time.
fn evaluations(case: &Case) -> anyhow::Result<(f64, f64)> {
    const COUNT: usize = 20_000;
    const ROUNDS: usize = 20;
    let mut density = LnPosterior::new(case.model, &case.data, &case.settings)?;
    let mut position = vec![0.1; density.dimension()];
    let mut positions = vec![[0.1; CHAINS]; density.dimension()];
    let (mut alone, mut together) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..ROUNDS {
        let clock = CpuTime::start();
        for _ in 0..COUNT {
            // A new place each time: evaluations may remember the last one.
            for coordinate in &mut position {
                *coordinate = -*coordinate;
            }
            black_box(density.at(black_box(&position)));
        }
        alone = alone.min(clock.seconds());
        let clock = CpuTime::start();
        for _ in 0..COUNT {
            for lanes in &mut positions {
                *lanes = lanes.map(|coordinate| -coordinate);
            }
            black_box(density.at_lanes(black_box(&positions)));
        }
        together = together.min(clock.seconds());
    }
    Ok((COUNT as f64 / alone, (COUNT * CHAINS) as f64 / together))
}
