//! riskaware's own sampler, measured through the functions that everybody calls.

use std::hint::black_box;

use anyhow::ensure;
use riskaware::inference::{FitSummary, LnPosterior, fit, refit, uninterrupted};

use crate::cpu_time::CpuTime;
use crate::posteriors::Case;

/// What was measured of one posterior.
#[derive(Debug, Clone, Copy)]
pub struct Measured {
    /// Evaluations of the log-posterior per second.
    pub evaluations: f64,
    /// CPU seconds of a cold fit with default settings: finding the modes, chains, diagnostics, evidence, summaries.
    pub cold: f64,
    /// CPU seconds of a warm refit with default settings, everything included.
    pub warm: f64,
    /// Largest R̂ over parameters and predicted probabilities of the refit.
    pub rhat: f64,
    /// Smallest bulk effective sample size of the refit.
    pub ess: f64,
    /// Effective draws of a refit per CPU second of all of it.
    pub rate: f64,
}

/// Measures one posterior: the least of several runs of each kind, and the median rate of refits.
///
/// # Errors
/// When a fit fails.
pub fn measure(case: &Case, repeats: usize) -> anyhow::Result<Measured> {
    let fitted = |seed| {
        let mut settings = case.settings.clone();
        settings.seed = seed;
        let clock = CpuTime::start();
        let found = fit(case.model, &case.data, &settings, &mut uninterrupted)?;
        anyhow::Ok((found, settings, clock.seconds()))
    };
    let mut cold = f64::INFINITY;
    let mut warm = f64::INFINITY;
    let mut rates = Vec::new();
    let (mut rhat, mut ess) = (1.0_f64, f64::INFINITY);
    for seed in 1..=repeats as u64 {
        let (first, settings, seconds) = fitted(seed)?;
        cold = cold.min(seconds);
        let clock = CpuTime::start();
        let second = refit(
            &first.warm_start,
            case.model,
            &case.data,
            &settings,
            &mut uninterrupted,
        )?;
        let seconds = clock.seconds();
        ensure!(
            second.summary.converged,
            "{}: the refit with seed {seed} did not converge",
            case.name
        );
        warm = warm.min(seconds);
        let (found_rhat, found_ess) = worst(&second.summary);
        rhat = rhat.max(found_rhat);
        ess = ess.min(found_ess);
        rates.push(found_ess / seconds);
    }
    rates.sort_by(f64::total_cmp);
    Ok(Measured {
        evaluations: evaluations(case)?,
        cold,
        warm,
        rhat,
        ess,
        rate: rates[rates.len() / 2],
    })
}

fn worst(summary: &FitSummary) -> (f64, f64) {
    let diagnostics = &summary.diagnostics;
    let all = diagnostics
        .parameters
        .iter()
        .chain(diagnostics.predicted.iter());
    all.fold((1.0, f64::INFINITY), |(rhat, ess), (_, found)| {
        (found.rhat.max(rhat), found.ess_bulk.min(ess))
    })
}

fn evaluations(case: &Case) -> anyhow::Result<f64> {
    const COUNT: usize = 20_000;
    const ROUNDS: usize = 20;
    let mut density = LnPosterior::new(case.model, &case.data, &case.settings)?;
    let mut position = vec![0.1; density.dimension()];
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let clock = CpuTime::start();
        for _ in 0..COUNT {
            // A new place each time: evaluations remember the last one.
            for coordinate in &mut position {
                *coordinate = -*coordinate;
            }
            black_box(density.at(black_box(&position)));
        }
        best = best.min(clock.seconds());
    }
    Ok(COUNT as f64 / best)
}
