//! NUTS as nuts-rs sets it up by default, one chain after the other on one core.

use anyhow::Context;
use nuts_rs::{
    Chain, CpuLogpFunc, CpuMath, CpuMathError, DiagNutsSettings, HasDims, LogpError, Settings,
};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use riskaware::inference::diagnostics::Convergence;

use crate::cpu_time::CpuTime;
use crate::density::Density;

/// Chains of one run.
const CHAINS: usize = 4;

/// One run of four chains.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// Largest R̂ over parameters and predicted probabilities.
    pub rhat: f64,
    /// Smallest bulk effective sample size.
    pub ess: f64,
    /// Divergences after tuning.
    pub divergences: usize,
    /// CPU seconds of the draws after tuning.
    pub seconds: f64,
}

impl Run {
    /// Effective draws per second, tuning not counted.
    pub fn rate(&self) -> f64 {
        self.ess / self.seconds
    }
}

/// Runs four chains of so many draws, with the default settings of `DiagNutsSettings`: 400 steps of tuning, target
/// acceptance 0.8, trees of depth 10 at most. Chains start at coordinates between −2 and 2, as Stan's do.
///
/// # Errors
/// When nuts-rs fails.
pub fn run(density: &Density, draws: usize, seed: u64) -> anyhow::Result<Run> {
    let settings = DiagNutsSettings::default();
    let mut columns: Vec<Vec<Vec<f64>>> = Vec::new();
    let (mut divergences, mut seconds) = (0, 0.0);
    for chain in 0..CHAINS {
        let mut rng = ChaCha12Rng::seed_from_u64(seed);
        rng.set_stream(chain as u64);
        let start: Vec<f64> = (0..density.dimension())
            .map(|_| rng.random_range(-2.0..2.0))
            .collect();
        let math = CpuMath::new(Target(density.clone()));
        let mut sampler = settings
            .new_chain(chain as u64, math, &mut rng)
            .context("nuts-rs refuses its default settings")?;
        sampler.set_position(&start)?;
        for _ in 0..settings.num_tune {
            sampler.draw()?;
        }
        let clock = CpuTime::start();
        let mut positions = Vec::with_capacity(draws);
        for _ in 0..draws {
            let (position, progress) = sampler.draw()?;
            divergences += usize::from(progress.diverging);
            positions.push(position);
        }
        seconds += clock.seconds();
        let mut density = density.clone();
        for position in positions {
            let quantities = density.quantities(&position);
            columns.resize(quantities.len(), vec![Vec::new(); CHAINS]);
            for (column, value) in columns.iter_mut().zip(quantities) {
                column[chain].push(value);
            }
        }
    }
    let (mut rhat, mut ess) = (1.0_f64, f64::INFINITY);
    for column in &columns {
        let chains: Vec<&[f64]> = column.iter().map(Vec::as_slice).collect();
        let found = Convergence::of(&chains);
        rhat = rhat.max(found.rhat);
        ess = ess.min(found.ess_bulk);
    }
    Ok(Run {
        rhat,
        ess,
        divergences,
        seconds,
    })
}

struct Target(Density);

/// The density has a value everywhere.
#[derive(Debug, thiserror::Error)]
#[error("the density is no number")]
struct NotANumber;

impl LogpError for NotANumber {
    fn is_recoverable(&self) -> bool {
        true
    }
}

impl HasDims for Target {
    fn dim_sizes(&self) -> std::collections::HashMap<String, u64> {
        [(
            "unconstrained_parameter".to_owned(),
            self.0.dimension() as u64,
        )]
        .into()
    }
}

impl CpuLogpFunc for Target {
    type LogpError = NotANumber;
    type FlowParameters = ();
    type ExpandedVector = Vec<f64>;

    fn dim(&self) -> usize {
        self.0.dimension()
    }

    fn logp(&mut self, position: &[f64], gradient: &mut [f64]) -> Result<f64, NotANumber> {
        let ln_density = self.0.evaluate(position, gradient);
        if ln_density.is_finite() {
            Ok(ln_density)
        } else {
            Err(NotANumber)
        }
    }

    fn expand_vector<R: Rng + ?Sized>(
        &mut self,
        _rng: &mut R,
        position: &[f64],
    ) -> Result<Vec<f64>, CpuMathError> {
        Ok(position.to_vec())
    }
}
