//! From the prior to the posterior: a population of points through tempered densities.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::proposal::RandomWalk;
use super::{BLOCK, Cloud, LnDensities, LogDensity, Proposal, Stopped, Watch, random_stream};
use crate::inference::lanes::{InstructionSet, Kernel, LaneRandom, exp, ln};

/// Points in the population.
const POPULATION: usize = 32 * BLOCK;

/// Random-walk steps of each point at each temperature.
const STEPS: usize = 5;

/// The next temperature leaves this share of the population effective.
const EFFECTIVE_SHARE: f64 = 0.5;

/// Chains start from the last population at or below this temperature.
const START_TEMPERATURE: f64 = 0.3;

/// Components of the fitted proposal.
const COMPONENTS: usize = 12;

/// Sizes of random-walk steps in units of 2.38/√d, the best one for a normal target (Roberts, Gelman & Gilks 1997).
const STEP_SCALES: [f64; 3] = [1.0, 0.5, 0.15];

/// Rounds of adaptation, and what each draws.
const ADAPTATIONS: usize = 3;
const ADAPTATION_DRAWS: usize = 128 * BLOCK;

/// Rounds of expectation maximisation after each.
const ADAPTATION_ROUNDS: usize = 8;

/// What the warm-up leaves behind.
#[derive(Debug, Clone)]
pub struct WarmUp {
    /// A proposal fitted to the posterior.
    pub proposal: Proposal,
    /// Points that are about distributed as the posterior.
    pub points: Cloud,
    /// Points of a tempered density, more widely spread.
    pub dispersed: Cloud,
}

impl WarmUp {
    /// Starts for chains: dispersed points, no two from the same place if there are enough.
    pub fn starts(&self, chains: usize) -> Vec<Vec<f64>> {
        let stride = (self.dispersed.len() / chains).max(1);
        (0..chains)
            .map(|chain| self.dispersed.point(chain * stride % self.dispersed.len()))
            .collect()
    }
}

/// The population in blocks.
#[derive(Clone)]
struct Population {
    /// `positions[block][coordinate][lane]`.
    positions: Vec<Vec<[f64; BLOCK]>>,
    densities: Vec<LnDensities<BLOCK>>,
}

impl Population {
    fn likelihoods(&self) -> impl Iterator<Item = f64> + '_ {
        self.densities.iter().flat_map(|block| block.likelihood)
    }

    fn cloud(&self) -> Cloud {
        let column = |coordinate: usize| {
            let blocks = self.positions.iter();
            blocks.flat_map(|block| block[coordinate]).collect()
        };
        Cloud::new((0..self.positions[0].len()).map(column).collect())
    }

    /// The points with these numbers.
    fn select(&self, indices: &[usize]) -> Self {
        let mut chosen = self.clone();
        for (index, from) in indices.iter().enumerate() {
            let (block, lane) = (index / BLOCK, index % BLOCK);
            let (old_block, old_lane) = (from / BLOCK, from % BLOCK);
            let old = self.positions[old_block].iter();
            for (x, old) in chosen.positions[block].iter_mut().zip(old) {
                x[lane] = old[old_lane];
            }
            let old = &self.densities[old_block];
            chosen.densities[block].prior[lane] = old.prior[old_lane];
            chosen.densities[block].likelihood[lane] = old.likelihood[old_lane];
        }
        chosen
    }
}

/// Carries a population from the prior to the posterior and fits a proposal to where it ends.
///
/// Each temperature is the largest that leaves half of the population effective; then points are drawn again in
/// proportion to their weights and moved by random-walk Metropolis steps of the population's shape.
///
/// # Errors
/// When `watch` says so.
pub fn warm_up<D: LogDensity>(
    density: &mut D,
    seed: u64,
    watch: &mut Watch<'_>,
) -> Result<WarmUp, Stopped> {
    let mut rng = random_stream(seed, 0);
    let mut random = LaneRandom::new(&mut rng);
    let dimension = density.dimension();
    let mut population = Population {
        positions: vec![vec![[0.0; BLOCK]; dimension]; POPULATION / BLOCK],
        densities: Vec::with_capacity(POPULATION / BLOCK),
    };
    for block in &mut population.positions {
        density.draw_prior(&mut random, block);
        population.densities.push(density.evaluate(block));
    }
    let mut temperature = 0.0;
    let mut dispersed = population.cloud();
    while temperature < 1.0 {
        let (next, weights) = next_temperature(&population, temperature);
        temperature = next;
        population = population.select(&resample(&weights, &mut rng));
        move_points(density, &mut population, temperature, &mut random, watch)?;
        if temperature <= START_TEMPERATURE {
            dispersed = population.cloud();
        }
    }
    let points = population.cloud();
    let components = if dimension == 1 { 4 } else { COMPONENTS };
    Ok(WarmUp {
        proposal: Proposal::fit(&points, components, seed),
        points,
        dispersed,
    })
}

/// Improves a proposal by importance sampling from it: its draws, weighted by posterior over proposal, are points of the
/// posterior that it is fitted to again.
///
/// Weights are cut at √n times their mean, which bounds the say of any one draw (Ionides 2008).
///
/// # Errors
/// When `watch` says so.
pub fn adapt<D: LogDensity>(
    density: &mut D,
    mut proposal: Proposal,
    rng: &mut ChaCha12Rng,
    watch: &mut Watch<'_>,
) -> Result<Proposal, Stopped> {
    let mut random = LaneRandom::new(rng);
    let dimension = density.dimension();
    for _ in 0..ADAPTATIONS {
        let mut cloud = Cloud {
            coordinates: vec![Vec::with_capacity(ADAPTATION_DRAWS); dimension],
            weights: Vec::with_capacity(ADAPTATION_DRAWS),
        };
        let mut positions = vec![[0.0; BLOCK]; dimension];
        for _ in 0..ADAPTATION_DRAWS / BLOCK {
            if watch().is_break() {
                return Err(Stopped);
            }
            let ln_proposal = proposal.propose(&mut random, &mut positions);
            let ln_posterior = density.evaluate(&positions).posterior();
            for (column, position) in cloud.coordinates.iter_mut().zip(&positions) {
                column.extend_from_slice(position);
            }
            let ln_weights = ln_posterior.iter().zip(ln_proposal).map(|(p, q)| p - q);
            cloud.weights.extend(ln_weights);
        }
        let highest = cloud
            .weights
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        if !highest.is_finite() {
            return Ok(proposal);
        }
        for weight in &mut cloud.weights {
            *weight = exp(*weight - highest);
        }
        let mean = cloud.weights.iter().sum::<f64>() / ADAPTATION_DRAWS as f64;
        let most = mean * (ADAPTATION_DRAWS as f64).sqrt();
        for weight in &mut cloud.weights {
            *weight = if *weight > most { most } else { *weight };
        }
        proposal = proposal.refit(&cloud, ADAPTATION_ROUNDS);
    }
    Ok(proposal)
}

/// The next temperature and the weights that go with it.
fn next_temperature(population: &Population, temperature: f64) -> (f64, Vec<f64>) {
    let highest = population.likelihoods().fold(f64::NEG_INFINITY, f64::max);
    let gaps: Vec<f64> = population
        .likelihoods()
        .map(|ln_l| ln_l - highest)
        .collect();
    let weights = |next: f64| -> Vec<f64> {
        // Where no point has any likelihood, all weigh the same and the walk goes on.
        let weight = |gap: &f64| {
            if gap.is_nan() {
                1.0
            } else {
                exp((next - temperature) * gap)
            }
        };
        gaps.iter().map(weight).collect()
    };
    let enough = |weights: &[f64]| {
        let sum: f64 = weights.iter().sum();
        let squares: f64 = weights.iter().map(|weight| weight * weight).sum();
        sum * sum >= EFFECTIVE_SHARE * squares * gaps.len() as f64
    };
    let whole = weights(1.0);
    if enough(&whole) {
        return (1.0, whole);
    }
    let (mut low, mut high) = (temperature, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if enough(&weights(middle)) {
            low = middle;
        } else {
            high = middle;
        }
        if high - low < 1e-3 * (high - temperature) {
            break;
        }
    }
    // The upper end: it is above the current temperature even if the lower one never moved.
    (high, weights(high))
}

/// Systematic resampling: as many copies of each point as its weight deserves, but for rounding.
fn resample(weights: &[f64], rng: &mut ChaCha12Rng) -> Vec<usize> {
    let total: f64 = weights.iter().sum();
    let offset = rng.random::<f64>();
    let mut index = 0;
    let mut cumulative = weights[0];
    (0..weights.len())
        .map(|slot| {
            let at = (slot as f64 + offset) / weights.len() as f64 * total;
            while cumulative < at && index + 1 < weights.len() {
                index += 1;
                cumulative += weights[index];
            }
            index
        })
        .collect()
}

/// Random-walk Metropolis steps for the density at this temperature; half of them along the difference of two other
/// points, which follows ridges and bends that a covariance does not know (ter Braak 2006).
fn move_points<D: LogDensity>(
    density: &mut D,
    population: &mut Population,
    temperature: f64,
    random: &mut LaneRandom,
    watch: &mut Watch<'_>,
) -> Result<(), Stopped> {
    let before = population.cloud();
    let shape = RandomWalk::of(&before);
    let unit = 2.38 / (before.coordinates.len() as f64).sqrt();
    let instructions = InstructionSet::widest();
    let mut shares = [0.0; BLOCK];
    for step in 0..STEPS {
        if watch().is_break() {
            return Err(Stopped);
        }
        let blocks = population.positions.iter_mut();
        for (block, here) in blocks.zip(&mut population.densities) {
            random.fill_uniform(&mut shares);
            let third = |share: f64| ((share * STEP_SCALES.len() as f64) as usize).min(2);
            let scales = shares.map(|share| unit * STEP_SCALES[third(share)]);
            let mut proposed = block.clone();
            if step % 2 == 0 {
                shape.walk(random, &scales, &mut proposed);
            } else {
                random.fill_uniform(&mut shares);
                let left = shares;
                random.fill_uniform(&mut shares);
                for lane in 0..BLOCK {
                    let number = |share: f64| ((1.0 - share) * POPULATION as f64) as usize;
                    let (left, right) = (number(left[lane]), number(shares[lane]));
                    let stretch = scales[lane] / std::f64::consts::SQRT_2;
                    for (x, column) in proposed.iter_mut().zip(&before.coordinates) {
                        x[lane] += stretch * (column[left] - column[right]);
                    }
                }
            }
            let there = density.evaluate(&proposed);
            random.fill_uniform(&mut shares);
            instructions.run(Move {
                temperature,
                shares: &shares,
                proposed: &proposed,
                there: &there,
                block,
                here,
            });
        }
    }
    Ok(())
}

/// Accepts or rejects one tempered step in each lane.
struct Move<'a> {
    temperature: f64,
    shares: &'a [f64; BLOCK],
    proposed: &'a [[f64; BLOCK]],
    there: &'a LnDensities<BLOCK>,
    block: &'a mut [[f64; BLOCK]],
    here: &'a mut LnDensities<BLOCK>,
}

impl Kernel for Move<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut is_accepted = [false; BLOCK];
        for lane in 0..BLOCK {
            let gain = (self.there.prior[lane] + self.temperature * self.there.likelihood[lane])
                - (self.here.prior[lane] + self.temperature * self.here.likelihood[lane]);
            // From one impossible place to another (−∞ − −∞) counts as a move.
            let is_move = gain.is_nan() | (ln(self.shares[lane]) < gain);
            is_accepted[lane] = is_move;
            for (old, new) in [
                (&mut self.here.prior, &self.there.prior),
                (&mut self.here.likelihood, &self.there.likelihood),
            ] {
                old[lane] = if is_move { new[lane] } else { old[lane] };
            }
        }
        for (old, new) in self.block.iter_mut().zip(self.proposed) {
            for lane in 0..BLOCK {
                old[lane] = if is_accepted[lane] {
                    new[lane]
                } else {
                    old[lane]
                };
            }
        }
    }
}
