//! Chains of one fixed kernel.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::{LogDensity, Proposal, Stopped, Watch, random_stream};

/// Share of steps that propose independently of where the chain is.
const INDEPENDENCE_SHARE: f64 = 0.75;

/// Sizes of random-walk steps in units of 2.38/√d: large ones to travel, small ones for corners.
const STEP_SCALES: [f64; 3] = [1.0, 0.4, 0.1];

/// Steps at the start of each chain that are not kept, in kept draws.
const BURN_IN_DRAWS: usize = 100;

/// How many draws pass between two looks at the watch.
const WATCH_INTERVAL: usize = 64;

/// Draws of several chains.
#[derive(Debug, Clone)]
pub struct Chains {
    /// `positions[chain][draw]`.
    pub positions: Vec<Vec<Vec<f64>>>,
    /// Share of proposals accepted.
    pub acceptance: f64,
}

/// Runs one chain from each start with one kernel that was fixed before.
///
/// At each step, whatever the position, the kernel proposes from the mixture (a Metropolis–Hastings step) or walks at
/// random (a Metropolis step): each of these is reversible with respect to the posterior, so their mixture is.
///
/// * `round`: tells apart the random streams of repeated runs.
/// * `draws`: kept per chain; `steps`: steps of the kernel for each.
///
/// # Errors
/// When `watch` says so.
#[expect(
    clippy::too_many_arguments,
    reason = "each is one independent part of a run, and there is one caller"
)]
pub fn run_chains<D: LogDensity>(
    density: &mut D,
    proposal: &Proposal,
    starts: &[Vec<f64>],
    seed: u64,
    round: u64,
    draws: usize,
    steps: usize,
    watch: &mut Watch<'_>,
) -> Result<Chains, Stopped> {
    let mut positions = Vec::with_capacity(starts.len());
    let mut accepted = 0_usize;
    for (index, start) in starts.iter().enumerate() {
        let stream = 1 + round * starts.len() as u64 + index as u64;
        let mut chain = Chain::new(density, proposal, start, random_stream(seed, stream));
        let mut kept = Vec::with_capacity(draws);
        for draw in 0..BURN_IN_DRAWS + draws {
            if draw % WATCH_INTERVAL == 0 && watch().is_break() {
                return Err(Stopped);
            }
            for _ in 0..steps {
                chain.step(density, proposal);
            }
            if draw + 1 == BURN_IN_DRAWS {
                chain.accepted = 0;
            }
            if draw >= BURN_IN_DRAWS {
                kept.push(chain.position.clone());
            }
        }
        accepted += chain.accepted;
        positions.push(kept);
    }
    let proposed = starts.len() * draws * steps;
    Ok(Chains {
        positions,
        acceptance: accepted as f64 / proposed as f64,
    })
}

struct Chain {
    position: Vec<f64>,
    ln_posterior: f64,
    /// The proposal's density at the position.
    ln_proposal: f64,
    accepted: usize,
    rng: ChaCha12Rng,
}

impl Chain {
    fn new<D: LogDensity>(
        density: &mut D,
        proposal: &Proposal,
        start: &[f64],
        rng: ChaCha12Rng,
    ) -> Self {
        Self {
            position: start.to_vec(),
            ln_posterior: density.evaluate(start).posterior(),
            ln_proposal: proposal.ln_density(start),
            accepted: 0,
            rng,
        }
    }

    fn step<D: LogDensity>(&mut self, density: &mut D, proposal: &Proposal) {
        let independent = self.rng.random::<f64>() < INDEPENDENCE_SHARE;
        let position = if independent {
            proposal.draw(&mut self.rng)
        } else {
            let scale = STEP_SCALES[self.rng.random_range(0..STEP_SCALES.len())];
            let scale = scale * 2.38 / (self.position.len() as f64).sqrt();
            proposal.walk(&self.position, scale, &mut self.rng)
        };
        let ln_posterior = density.evaluate(&position).posterior();
        let ln_proposal = proposal.ln_density(&position);
        let mut ln_ratio = ln_posterior - self.ln_posterior;
        if independent {
            ln_ratio += self.ln_proposal - ln_proposal;
        }
        if self.rng.random::<f64>().ln() < ln_ratio {
            self.position = position;
            self.ln_posterior = ln_posterior;
            self.ln_proposal = ln_proposal;
            self.accepted += 1;
        }
    }
}
