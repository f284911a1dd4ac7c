//! From the prior to the posterior: a population of points through tempered densities.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::{LnDensity, LogDensity, Proposal, Stopped, Watch, random_stream};

/// Points in the population.
const POPULATION: usize = 1000;

/// Random-walk steps of each point at each temperature.
const STEPS: usize = 5;

/// The next temperature leaves this share of the population effective.
const EFFECTIVE_SHARE: f64 = 0.5;

/// Chains start from the last population at or below this temperature.
const START_TEMPERATURE: f64 = 0.3;

/// Components of the fitted proposal.
const COMPONENTS: usize = 8;

/// Sizes of random-walk steps in units of 2.38/√d, the best one for a normal target (Roberts, Gelman & Gilks 1997).
const STEP_SCALES: [f64; 3] = [1.0, 0.5, 0.15];

/// What the warm-up leaves behind.
#[derive(Debug, Clone)]
pub struct WarmUp {
    /// A proposal fitted to the posterior.
    pub proposal: Proposal,
    /// Points that are about distributed as the posterior.
    pub points: Vec<Vec<f64>>,
    /// Points of a tempered density, more widely spread.
    pub dispersed: Vec<Vec<f64>>,
}

impl WarmUp {
    /// Starts for chains: dispersed points, no two from the same place if there are enough.
    pub fn starts(&self, chains: usize) -> Vec<Vec<f64>> {
        let stride = (self.dispersed.len() / chains).max(1);
        (0..chains)
            .map(|chain| self.dispersed[chain * stride % self.dispersed.len()].clone())
            .collect()
    }
}

#[derive(Clone)]
struct Point {
    position: Vec<f64>,
    density: LnDensity,
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
    let mut points: Vec<Point> = (0..POPULATION)
        .map(|_| {
            let position = density.draw_prior(&mut rng);
            let density = density.evaluate(&position);
            Point { position, density }
        })
        .collect();
    let mut temperature = 0.0;
    let mut dispersed = positions(&points);
    while temperature < 1.0 {
        if watch().is_break() {
            return Err(Stopped);
        }
        let (next, weights) = next_temperature(&points, temperature);
        temperature = next;
        points = resample(&points, &weights, &mut rng);
        move_points(density, &mut points, temperature, &mut rng);
        if temperature <= START_TEMPERATURE {
            dispersed = positions(&points);
        }
    }
    let points = positions(&points);
    let components = if points[0].len() == 1 { 3 } else { COMPONENTS };
    Ok(WarmUp {
        proposal: Proposal::fit(&points, components, seed),
        points,
        dispersed,
    })
}

fn positions(points: &[Point]) -> Vec<Vec<f64>> {
    points.iter().map(|point| point.position.clone()).collect()
}

/// The next temperature and the weights that go with it.
fn next_temperature(points: &[Point], temperature: f64) -> (f64, Vec<f64>) {
    let highest = points
        .iter()
        .map(|point| point.density.likelihood)
        .fold(f64::NEG_INFINITY, f64::max);
    let weights = |next: f64| -> Vec<f64> {
        let weight = |point: &Point| {
            let gap = point.density.likelihood - highest;
            // Where no point has any likelihood, all weigh the same and the walk goes on.
            if gap.is_nan() {
                1.0
            } else {
                ((next - temperature) * gap).exp()
            }
        };
        points.iter().map(weight).collect()
    };
    let enough = |weights: &[f64]| {
        let sum: f64 = weights.iter().sum();
        let squares: f64 = weights.iter().map(|weight| weight * weight).sum();
        sum * sum >= EFFECTIVE_SHARE * squares * points.len() as f64
    };
    let whole = weights(1.0);
    if enough(&whole) {
        return (1.0, whole);
    }
    let (mut low, mut high) = (temperature, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if enough(&weights(middle)) {
            low = middle;
        } else {
            high = middle;
        }
    }
    // The upper end: it is above the current temperature even if the lower one never moved.
    (high, weights(high))
}

/// Systematic resampling: as many copies of each point as its weight deserves, but for rounding.
fn resample(points: &[Point], weights: &[f64], rng: &mut ChaCha12Rng) -> Vec<Point> {
    let total: f64 = weights.iter().sum();
    let offset = rng.random::<f64>();
    let mut drawn = Vec::with_capacity(points.len());
    let mut index = 0;
    let mut cumulative = weights[0];
    for slot in 0..points.len() {
        let at = (slot as f64 + offset) / points.len() as f64 * total;
        while cumulative < at && index + 1 < points.len() {
            index += 1;
            cumulative += weights[index];
        }
        drawn.push(points[index].clone());
    }
    drawn
}

/// Random-walk Metropolis steps for the density at this temperature; half of them along the difference of two other
/// points, which follows ridges and bends that a covariance does not know (ter Braak 2006).
fn move_points<D: LogDensity>(
    density: &mut D,
    points: &mut [Point],
    temperature: f64,
    rng: &mut ChaCha12Rng,
) {
    let population = positions(points);
    let shape = Proposal::shape_of(&population);
    let dimension = population[0].len() as f64;
    for step in 0..STEPS {
        for point in points.iter_mut() {
            let scale =
                STEP_SCALES[rng.random_range(0..STEP_SCALES.len())] * 2.38 / dimension.sqrt();
            let position = if step % 2 == 0 {
                shape.walk(&point.position, scale, rng)
            } else {
                let left = &population[rng.random_range(0..population.len())];
                let right = &population[rng.random_range(0..population.len())];
                let stretch = scale / std::f64::consts::SQRT_2;
                let ends = left.iter().zip(right);
                point
                    .position
                    .iter()
                    .zip(ends)
                    .map(|(x, (l, r))| x + stretch * (l - r))
                    .collect()
            };
            let proposed = density.evaluate(&position);
            let gain = proposed.tempered(temperature) - point.density.tempered(temperature);
            // From one impossible place to another (−∞ − −∞) counts as a move.
            if gain.is_nan() || rng.random::<f64>().ln() < gain {
                *point = Point {
                    position,
                    density: proposed,
                };
            }
        }
    }
}
