//! Chains of fixed kernels, eight at a time in lanes.

use super::{BLOCK, Cloud, LANES, LogDensity, Proposal, Stopped, Watch, random_stream};
use crate::inference::lanes::{InstructionSet, Kernel, LaneRandom, ln};

/// Blocks of independence steps between two random-walk steps.
const BLOCKS: usize = 4;

/// Steps of a chain in a block.
const BLOCK_STEPS: usize = BLOCK / LANES;

/// Sizes of random-walk steps in units of 2.38/√d: large ones to travel, small ones for corners.
const STEP_SCALES: [f64; 3] = [1.0, 0.4, 0.1];

/// How many cycles pass between two looks at the watch.
const WATCH_INTERVAL: usize = 64;

/// Draws of several chains.
#[derive(Debug, Clone, PartialEq)]
pub struct Chains {
    /// How many chains.
    pub chains: usize,
    /// Draws kept of each.
    pub per_chain: usize,
    /// `coordinates[coordinate]`: chain after chain.
    pub coordinates: Vec<Vec<f64>>,
    /// Share of independence proposals accepted.
    pub acceptance: f64,
}

impl Chains {
    /// How many draws there are.
    pub fn len(&self) -> usize {
        self.chains * self.per_chain
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values of one coordinate by chain.
    pub fn by_chain(&self, coordinate: usize) -> Vec<&[f64]> {
        self.coordinates[coordinate]
            .chunks_exact(self.per_chain)
            .collect()
    }

    /// The draws from number `start` on, as many as there are lanes; the last one again where there are fewer.
    pub fn block<const W: usize>(&self, start: usize, positions: &mut [[f64; W]]) {
        let end = (start + W).min(self.len());
        for (position, column) in positions.iter_mut().zip(&self.coordinates) {
            position[..end - start].copy_from_slice(&column[start..end]);
            position[end - start..].fill(column[end - 1]);
        }
    }

    /// About `count` of the draws, evenly over all chains.
    pub fn thinned(&self, count: usize) -> Cloud {
        let stride = (self.len() / count).max(1);
        let column = |column: &Vec<f64>| column.iter().step_by(stride).copied().collect();
        Cloud::new(self.coordinates.iter().map(column).collect())
    }

    /// Where each chain ended.
    pub fn ends(&self) -> Vec<Vec<f64>> {
        let end = |chain: usize| (chain + 1) * self.per_chain - 1;
        (0..self.chains)
            .map(|chain| self.coordinates.iter().map(|x| x[end(chain)]).collect())
            .collect()
    }
}

/// How long chains run, and with which random numbers.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// The seed.
    pub seed: u64,
    /// The first of the random streams of these chains, one for eight of them.
    pub stream: u64,
    /// Draws at the start of each chain that are not kept.
    pub burn_in: usize,
    /// Draws kept of each chain.
    pub draws: usize,
    /// Steps of a chain for each draw.
    pub steps: usize,
}

/// Runs one chain from each start with kernels that were fixed before.
///
/// Sixteen independence steps, which propose from the mixture wherever the chain is (Metropolis–Hastings), and one
/// random-walk step (Metropolis) take turns. Each of these is reversible with respect to the posterior, and whose turn
/// it is does not depend on where the chain is.
///
/// # Errors
/// When `watch` says so.
pub fn run_chains<D: LogDensity>(
    density: &mut D,
    proposal: &Proposal,
    starts: &[Vec<f64>],
    run: Run,
    watch: &mut Watch<'_>,
) -> Result<Chains, Stopped> {
    let mut kept = Chains {
        chains: starts.len(),
        per_chain: run.draws,
        coordinates: vec![vec![0.0; starts.len() * run.draws]; density.dimension()],
        acceptance: 0.0,
    };
    let mut accepted = 0.0;
    let mut proposed = 0.0;
    for (set, starts) in starts.chunks(LANES).enumerate() {
        let mut random = LaneRandom::new(&mut random_stream(run.seed, run.stream + set as u64));
        let mut lanes = Lanes::new(density, proposal, starts);
        let mut schedule = Schedule {
            until_kept: (run.burn_in + 1) * run.steps,
            steps: run.steps,
            draw: 0,
            draws: run.draws,
            first_chain: set * LANES,
            chains: starts.len(),
        };
        let mut cycle = 0;
        while !schedule.is_done() {
            if cycle % WATCH_INTERVAL == 0 && watch().is_break() {
                return Err(Stopped);
            }
            cycle += 1;
            for _ in 0..BLOCKS {
                lanes.independence_steps(density, proposal, &mut random, &mut schedule, &mut kept);
            }
            lanes.walk(density, proposal, &mut random);
            schedule.step(&lanes.position, &mut kept);
        }
        accepted += lanes.accepted[..starts.len()].iter().sum::<f64>();
        proposed += (cycle * BLOCKS * BLOCK_STEPS * starts.len()) as f64;
    }
    kept.acceptance = accepted / proposed;
    Ok(kept)
}

/// Which steps are kept, and where.
struct Schedule {
    until_kept: usize,
    steps: usize,
    draw: usize,
    draws: usize,
    first_chain: usize,
    chains: usize,
}

impl Schedule {
    fn is_done(&self) -> bool {
        self.draw == self.draws
    }

    /// After a step of each chain.
    #[inline(always)]
    fn step(&mut self, position: &[[f64; LANES]], kept: &mut Chains) {
        self.until_kept -= 1;
        if self.until_kept > 0 {
            return;
        }
        self.until_kept = self.steps;
        if self.is_done() {
            return;
        }
        for (column, lanes) in kept.coordinates.iter_mut().zip(position) {
            let first = self.first_chain * self.draws + self.draw;
            for (chain, x) in lanes[..self.chains].iter().enumerate() {
                column[first + chain * self.draws] = *x;
            }
        }
        self.draw += 1;
    }
}

/// The states of eight chains.
struct Lanes {
    position: Vec<[f64; LANES]>,
    ln_posterior: [f64; LANES],
    /// ln posterior − ln proposal.
    ln_weight: [f64; LANES],
    accepted: [f64; LANES],
    proposals: Vec<[f64; BLOCK]>,
    walked: Vec<[f64; LANES]>,
    instructions: InstructionSet,
}

impl Lanes {
    /// Lanes without a start repeat the last one.
    fn new<D: LogDensity>(density: &mut D, proposal: &Proposal, starts: &[Vec<f64>]) -> Self {
        let start = |lane: usize| &starts[lane.min(starts.len() - 1)];
        let position: Vec<[f64; LANES]> = (0..density.dimension())
            .map(|coordinate| std::array::from_fn(|lane| start(lane)[coordinate]))
            .collect();
        let ln_posterior = density.evaluate(&position).posterior();
        let ln_proposal = proposal.ln_density(&position);
        Self {
            ln_posterior,
            ln_weight: std::array::from_fn(|lane| ln_posterior[lane] - ln_proposal[lane]),
            accepted: [0.0; LANES],
            proposals: vec![[0.0; BLOCK]; position.len()],
            walked: position.clone(),
            position,
            instructions: InstructionSet::widest(),
        }
    }

    fn independence_steps<D: LogDensity>(
        &mut self,
        density: &mut D,
        proposal: &Proposal,
        random: &mut LaneRandom,
        schedule: &mut Schedule,
        kept: &mut Chains,
    ) {
        let ln_proposal = proposal.propose(random, &mut self.proposals);
        let ln_posterior = density.evaluate(&self.proposals).posterior();
        self.instructions.run(Decide {
            random,
            ln_proposal: &ln_proposal,
            ln_posterior: &ln_posterior,
            schedule,
            kept,
            lanes: self,
        });
    }

    fn walk<D: LogDensity>(
        &mut self,
        density: &mut D,
        proposal: &Proposal,
        random: &mut LaneRandom,
    ) {
        let mut shares = [0.0; LANES];
        random.fill_uniform(&mut shares);
        let unit = 2.38 / (self.position.len() as f64).sqrt();
        let third = |share: f64| ((share * STEP_SCALES.len() as f64) as usize).min(2);
        let scales = shares.map(|share| unit * STEP_SCALES[third(share)]);
        self.walked.copy_from_slice(&self.position);
        proposal.walk().walk(random, &scales, &mut self.walked);
        let ln_posterior = density.evaluate(&self.walked).posterior();
        let ln_proposal = proposal.ln_density(&self.walked);
        random.fill_uniform(&mut shares);
        for lane in 0..LANES {
            if ln(shares[lane]) < ln_posterior[lane] - self.ln_posterior[lane] {
                self.ln_posterior[lane] = ln_posterior[lane];
                self.ln_weight[lane] = ln_posterior[lane] - ln_proposal[lane];
                for (x, new) in self.position.iter_mut().zip(&self.walked) {
                    x[lane] = new[lane];
                }
            }
        }
    }
}

/// Accepts or rejects a block of independence proposals, step after step.
struct Decide<'a> {
    random: &'a mut LaneRandom,
    ln_proposal: &'a [f64; BLOCK],
    ln_posterior: &'a [f64; BLOCK],
    schedule: &'a mut Schedule,
    kept: &'a mut Chains,
    lanes: &'a mut Lanes,
}

impl Kernel for Decide<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut shares = [0.0; BLOCK];
        self.random.fill_uniform(&mut shares);
        let mut ln_weights = [0.0; BLOCK];
        for index in 0..BLOCK {
            ln_weights[index] = self.ln_posterior[index] - self.ln_proposal[index];
            shares[index] = ln(shares[index]);
        }
        let lanes = self.lanes;
        for step in 0..BLOCK_STEPS {
            let first = step * LANES;
            let mut is_accepted = [false; LANES];
            for lane in 0..LANES {
                let ln_weight = ln_weights[first + lane];
                let is_better = shares[first + lane] < ln_weight - lanes.ln_weight[lane];
                is_accepted[lane] = is_better;
                lanes.accepted[lane] += if is_better { 1.0 } else { 0.0 };
                lanes.ln_weight[lane] = if is_better {
                    ln_weight
                } else {
                    lanes.ln_weight[lane]
                };
                lanes.ln_posterior[lane] = if is_better {
                    self.ln_posterior[first + lane]
                } else {
                    lanes.ln_posterior[lane]
                };
            }
            for (position, proposal) in lanes.position.iter_mut().zip(&lanes.proposals) {
                for lane in 0..LANES {
                    position[lane] = if is_accepted[lane] {
                        proposal[first + lane]
                    } else {
                        position[lane]
                    };
                }
            }
            self.schedule.step(&lanes.position, self.kept);
        }
    }
}
