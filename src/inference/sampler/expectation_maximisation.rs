//! Fitting the components of a mixture of t distributions to weighted points.

use rand::RngExt;

use super::proposal::{Component, DEGREES_OF_FREEDOM};
use super::triangle::Triangle;
use super::{Cloud, random_stream};
use crate::inference::lanes::{InstructionSet, Kernel};

/// Points at once.
const WIDTH: usize = 16;

/// A little of the whole cloud's covariance keeps a component from collapsing onto a few points.
const OVERALL_SHARE: f64 = 1e-3;

/// One round of expectation maximisation for t distributions with fixed degrees of freedom (Peel & McLachlan 2000).
///
/// * `centre`, `overall`: mean and covariance of all points.
pub(super) fn maximise_expectation(
    instructions: InstructionSet,
    points: &Cloud,
    fitted: Vec<Component>,
    centre: &[f64],
    overall: &[f64],
) -> Vec<Component> {
    let dimension = centre.len();
    let mut sums = vec![Sums::new(dimension); fitted.len()];
    instructions.run(Expect {
        points,
        centre,
        fitted: &fitted,
        sums: &mut sums,
    });
    let total: f64 = points.weights.iter().sum();
    let squares: f64 = points.weights.iter().map(|weight| weight * weight).sum();
    let effective = total / squares;
    let mut next = Vec::with_capacity(fitted.len());
    for sums in &sums {
        let count = added(&sums.count);
        // With fewer points than this a covariance says nothing.
        if count * effective < 2.0 * (dimension as f64 + 1.0) {
            continue;
        }
        let pull = added(&sums.pull);
        let shift: Vec<f64> = sums.first.iter().map(|sum| added(sum) / pull).collect();
        let mut covariance = Vec::with_capacity(overall.len());
        for row in 0..dimension {
            for column in 0..=row {
                let index = covariance.len();
                let about_shift = added(&sums.second[index]) - pull * shift[row] * shift[column];
                covariance.push(about_shift / count + OVERALL_SHARE * overall[index]);
            }
        }
        let moved = centre.iter().zip(&shift).map(|(c, s)| c + s).collect();
        let shape = Triangle::of(&covariance, dimension);
        next.push((count, moved, shape));
    }
    if next.is_empty() {
        return fitted;
    }
    let total: f64 = next.iter().map(|(count, _, _)| count).sum();
    next.into_iter()
        .map(|(count, centre, shape)| Component::new(count / total, centre, shape))
        .collect()
}

fn added(lanes: &[f64; WIDTH]) -> f64 {
    lanes.iter().sum()
}

/// What a component takes from the points.
#[derive(Debug, Clone)]
struct Sums {
    /// Σ share.
    count: [f64; WIDTH],
    /// Σ share · (ν + d)/(ν + δ): far points pull less.
    pull: [f64; WIDTH],
    first: Vec<[f64; WIDTH]>,
    second: Vec<[f64; WIDTH]>,
}

impl Sums {
    fn new(dimension: usize) -> Self {
        Self {
            count: [0.0; WIDTH],
            pull: [0.0; WIDTH],
            first: vec![[0.0; WIDTH]; dimension],
            second: vec![[0.0; WIDTH]; dimension * (dimension + 1) / 2],
        }
    }
}

struct Expect<'a> {
    points: &'a Cloud,
    centre: &'a [f64],
    fitted: &'a [Component],
    sums: &'a mut [Sums],
}

impl Kernel for Expect<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let dimension = self.centre.len();
        let count = self.points.len();
        let ratio = (DEGREES_OF_FREEDOM + dimension as f64) / DEGREES_OF_FREEDOM;
        let mut positions = vec![[0.0; WIDTH]; dimension];
        let mut heights = vec![[0.0; WIDTH]; self.fitted.len()];
        let mut inverses = heights.clone();
        for start in (0..count).step_by(WIDTH) {
            let end = (start + WIDTH).min(count);
            // Lanes beyond the last point stand on it with no weight.
            let mut weights = [0.0; WIDTH];
            weights[..end - start].copy_from_slice(&self.points.weights[start..end]);
            for (position, column) in positions.iter_mut().zip(&self.points.coordinates) {
                *position = [column[end - 1]; WIDTH];
                position[..end - start].copy_from_slice(&column[start..end]);
            }
            // Where all densities underflow, nobody gets a share.
            let mut total = [f64::MIN_POSITIVE; WIDTH];
            for (component, (height, inverse)) in self
                .fitted
                .iter()
                .zip(heights.iter_mut().zip(&mut inverses))
            {
                (*height, *inverse) = component.heights(&positions);
                for lane in 0..WIDTH {
                    total[lane] += height[lane];
                }
            }
            for lane in 0..WIDTH {
                total[lane] = weights[lane] / total[lane];
            }
            for (position, centre) in positions.iter_mut().zip(self.centre) {
                for x in position {
                    *x -= centre;
                }
            }
            for (sums, (height, inverse)) in self.sums.iter_mut().zip(heights.iter().zip(&inverses))
            {
                let mut pull = [0.0; WIDTH];
                for lane in 0..WIDTH {
                    let share = height[lane] * total[lane];
                    pull[lane] = share * ratio * inverse[lane];
                    sums.count[lane] += share;
                    sums.pull[lane] += pull[lane];
                }
                let mut second = sums.second.iter_mut();
                for (row, position) in positions.iter().enumerate() {
                    let mut pulled = [0.0; WIDTH];
                    for lane in 0..WIDTH {
                        pulled[lane] = pull[lane] * position[lane];
                        sums.first[row][lane] += pulled[lane];
                    }
                    for (other, sum) in positions[..=row].iter().zip(&mut second) {
                        for lane in 0..WIDTH {
                            sum[lane] += pulled[lane] * other[lane];
                        }
                    }
                }
            }
        }
    }
}

/// Points far apart from each other, each chosen with probability in proportion to its squared distance from those
/// before (Arthur & Vassilvitskii 2007).
pub(super) fn spread_centres(
    points: &Cloud,
    count: usize,
    whitening: &Triangle,
    seed: u64,
) -> Vec<usize> {
    let mut rng = random_stream(seed, u64::MAX);
    let whitened: Vec<Vec<f64>> = points
        .points()
        .iter()
        .map(|point| whitening.times(point))
        .collect();
    let mut chosen = vec![rng.random_range(0..points.len())];
    let mut nearest = vec![f64::INFINITY; points.len()];
    while chosen.len() < count {
        let latest = &whitened[chosen[chosen.len() - 1]];
        for ((distance, point), weight) in nearest.iter_mut().zip(&whitened).zip(&points.weights) {
            let squares = point.iter().zip(latest).map(|(x, y)| (x - y).powi(2));
            *distance = distance.min(weight * squares.sum::<f64>());
        }
        let mut at = rng.random::<f64>() * nearest.iter().sum::<f64>();
        let next = nearest.iter().position(|distance| {
            at -= distance;
            at < 0.0
        });
        chosen.push(next.unwrap_or(0));
    }
    chosen
}
