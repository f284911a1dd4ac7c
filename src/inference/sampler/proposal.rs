//! Where the chains may jump: a mixture of multivariate t distributions, and random walks of its overall shape.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rand_distr::{ChiSquared, Distribution, StandardNormal};

use super::random_stream;

/// Degrees of freedom of every component: tails heavier than those of a posterior, so that none of it is hard to reach.
const DEGREES_OF_FREEDOM: f64 = 5.0;

/// Weight of the wide component that covers what the others miss.
const SAFETY_WEIGHT: f64 = 0.06;

/// How much wider the wide component is than the whole population.
const SAFETY_SCALE: f64 = 2.0;

/// Rounds of the expectation-maximisation algorithm.
const EM_ROUNDS: usize = 25;

/// A fixed distribution of proposals.
#[derive(Debug, Clone)]
pub struct Proposal {
    components: Vec<Component>,
    walk: RandomWalk,
}

/// Symmetric steps of a population's shape.
#[derive(Debug, Clone)]
pub(super) struct RandomWalk(Cholesky);

impl RandomWalk {
    /// A step whose standard deviations are `scale` times those of the population.
    pub(super) fn walk(&self, from: &[f64], scale: f64, rng: &mut ChaCha12Rng) -> Vec<f64> {
        self.0.step(from, scale, rng)
    }
}

#[derive(Debug, Clone)]
struct Component {
    weight: f64,
    centre: Vec<f64>,
    shape: Cholesky,
    /// ln weight and the density's constants.
    ln_constant: f64,
}

impl Proposal {
    /// Fits a proposal to points by expectation maximisation from random points as centres.
    ///
    /// * `points`: at least two, each finite.
    /// * `components`: how many t distributions to start with, beside the wide one; those that fade are dropped.
    /// * `seed`: of the random centres.
    pub fn fit(points: &[Vec<f64>], components: usize, seed: u64) -> Self {
        let (centre, covariance) = moments(points, &vec![1.0; points.len()]);
        let walk = Cholesky::of(&covariance);
        let wide: Vec<f64> = covariance
            .iter()
            .map(|c| c * SAFETY_SCALE * SAFETY_SCALE)
            .collect();
        let mut fitted: Vec<Component> = spread_centres(points, components, &walk, seed)
            .into_iter()
            .map(|index| {
                Component::new(1.0 / components as f64, points[index].clone(), walk.clone())
            })
            .collect();
        for _ in 0..EM_ROUNDS {
            fitted = em_round(points, &fitted, &covariance);
        }
        for component in &mut fitted {
            component.reweigh(component.weight * (1.0 - SAFETY_WEIGHT));
        }
        fitted.push(Component::new(SAFETY_WEIGHT, centre, Cholesky::of(&wide)));
        Self {
            components: fitted,
            walk: RandomWalk(walk),
        }
    }

    /// The random walk of a population's shape alone.
    pub(super) fn shape_of(points: &[Vec<f64>]) -> RandomWalk {
        RandomWalk(Cholesky::of(&moments(points, &vec![1.0; points.len()]).1))
    }

    /// A position from the mixture.
    pub fn draw(&self, rng: &mut ChaCha12Rng) -> Vec<f64> {
        let mut at = rng.random::<f64>();
        let chosen = self.components.iter().find(|component| {
            at -= component.weight;
            at < 0.0
        });
        // Rounding may leave a sliver behind the last component.
        let component = chosen.unwrap_or(&self.components[0]);
        let chi_squared =
            ChiSquared::new(DEGREES_OF_FREEDOM).expect("degrees of freedom are positive");
        let stretch = (DEGREES_OF_FREEDOM / chi_squared.sample(rng)).sqrt();
        component.shape.step(&component.centre, stretch, rng)
    }

    /// The logarithm of the mixture's density, its constants included.
    pub fn ln_density(&self, position: &[f64]) -> f64 {
        let mut highest = f64::NEG_INFINITY;
        let mut sum = 0.0;
        for component in &self.components {
            let term = component.ln_term(position);
            if term > highest {
                sum = sum * (highest - term).exp() + 1.0;
                highest = term;
            } else {
                sum += (term - highest).exp();
            }
        }
        highest + sum.ln()
    }

    /// A step of a symmetric random walk whose standard deviations are `scale` times those of the population.
    pub fn walk(&self, from: &[f64], scale: f64, rng: &mut ChaCha12Rng) -> Vec<f64> {
        self.walk.walk(from, scale, rng)
    }
}

impl Component {
    fn new(weight: f64, centre: Vec<f64>, shape: Cholesky) -> Self {
        let mut component = Self {
            weight,
            centre,
            shape,
            ln_constant: 0.0,
        };
        component.reweigh(weight);
        component
    }

    fn reweigh(&mut self, weight: f64) {
        use statrs::function::gamma::ln_gamma;
        let dimension = self.centre.len() as f64;
        self.weight = weight;
        self.ln_constant = weight.ln() + ln_gamma((DEGREES_OF_FREEDOM + dimension) / 2.0)
            - ln_gamma(DEGREES_OF_FREEDOM / 2.0)
            - dimension / 2.0 * (DEGREES_OF_FREEDOM * std::f64::consts::PI).ln()
            - self.shape.ln_determinant();
    }

    /// ln of weight × density.
    fn ln_term(&self, position: &[f64]) -> f64 {
        self.ln_term_at(
            self.shape.squared_distance(position, &self.centre),
            position.len(),
        )
    }

    fn ln_term_at(&self, squared_distance: f64, dimension: usize) -> f64 {
        let exponent = (DEGREES_OF_FREEDOM + dimension as f64) / 2.0;
        self.ln_constant - exponent * (squared_distance / DEGREES_OF_FREEDOM).ln_1p()
    }
}

/// One round of expectation maximisation for a mixture of t distributions (Peel & McLachlan 2000).
fn em_round(points: &[Vec<f64>], fitted: &[Component], overall: &[f64]) -> Vec<Component> {
    let dimension = points[0].len();
    let mut shares = vec![vec![0.0; points.len()]; fitted.len()];
    let mut pulls = shares.clone();
    let mut distances = vec![0.0; fitted.len()];
    let mut terms = vec![0.0; fitted.len()];
    for (index, point) in points.iter().enumerate() {
        for (component, (distance, term)) in fitted.iter().zip(distances.iter_mut().zip(&mut terms))
        {
            *distance = component.shape.squared_distance(point, &component.centre);
            *term = component.ln_term_at(*distance, dimension);
        }
        let highest = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = terms.iter().map(|term| (term - highest).exp()).sum();
        for (component, (distance, term)) in distances.iter().zip(&terms).enumerate() {
            let share = (term - highest).exp() / sum;
            shares[component][index] = share;
            pulls[component][index] =
                share * (DEGREES_OF_FREEDOM + dimension as f64) / (DEGREES_OF_FREEDOM + distance);
        }
    }
    let mut next = Vec::with_capacity(fitted.len());
    for (share, pull) in shares.iter().zip(&pulls) {
        let count: f64 = share.iter().sum();
        // With fewer points than this a covariance says nothing.
        if count < 2.0 * (dimension as f64 + 1.0) {
            continue;
        }
        let (centre, mut covariance) = moments(points, pull);
        let rescale = pull.iter().sum::<f64>() / count;
        for (entry, whole) in covariance.iter_mut().zip(overall) {
            // A little of the whole keeps a component from collapsing onto a few points.
            *entry = *entry * rescale + 1e-3 * whole;
        }
        next.push(Component::new(count, centre, Cholesky::of(&covariance)));
    }
    let total: f64 = next.iter().map(|component| component.weight).sum();
    for component in &mut next {
        component.reweigh(component.weight / total);
    }
    if next.is_empty() {
        fitted.to_vec()
    } else {
        next
    }
}

/// Points far apart from each other, each chosen with probability in proportion to its squared distance from those
/// before (Arthur & Vassilvitskii 2007).
fn spread_centres(points: &[Vec<f64>], count: usize, shape: &Cholesky, seed: u64) -> Vec<usize> {
    let mut rng = random_stream(seed, u64::MAX);
    let mut chosen = vec![rng.random_range(0..points.len())];
    let mut nearest = vec![f64::INFINITY; points.len()];
    while chosen.len() < count {
        let latest = &points[chosen[chosen.len() - 1]];
        for (distance, point) in nearest.iter_mut().zip(points) {
            *distance = distance.min(shape.squared_distance(point, latest));
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

/// Weighted mean and covariance (row by row) of points.
fn moments(points: &[Vec<f64>], weights: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let dimension = points[0].len();
    let total: f64 = weights.iter().sum();
    let mut centre = vec![0.0; dimension];
    for (point, weight) in points.iter().zip(weights) {
        for (sum, x) in centre.iter_mut().zip(point) {
            *sum += weight * x / total;
        }
    }
    let mut covariance = vec![0.0; dimension * dimension];
    for (point, weight) in points.iter().zip(weights) {
        for row in 0..dimension {
            let left = weight / total * (point[row] - centre[row]);
            for column in 0..=row {
                covariance[row * dimension + column] += left * (point[column] - centre[column]);
            }
        }
    }
    for row in 0..dimension {
        for column in 0..row {
            covariance[column * dimension + row] = covariance[row * dimension + column];
        }
    }
    (centre, covariance)
}

/// The lower triangle L of a covariance L Lᵀ, row by row.
#[derive(Debug, Clone)]
struct Cholesky {
    dimension: usize,
    lower: Vec<f64>,
}

impl Cholesky {
    /// Factors a covariance; where it has no extent, a tiny one is put in its place.
    fn of(covariance: &[f64]) -> Self {
        let dimension = covariance.len().isqrt();
        let mut lower = vec![0.0; covariance.len()];
        for row in 0..dimension {
            for column in 0..=row {
                let dot: f64 = (0..column)
                    .map(|k| lower[row * dimension + k] * lower[column * dimension + k])
                    .sum();
                let rest = covariance[row * dimension + column] - dot;
                lower[row * dimension + column] = if row == column {
                    rest.max(1e-10 * covariance[row * dimension + row])
                        .max(1e-20)
                        .sqrt()
                } else {
                    rest / lower[column * dimension + column]
                };
            }
        }
        Self { dimension, lower }
    }

    /// `from` + `scale` · L z with z standard normal.
    fn step(&self, from: &[f64], scale: f64, rng: &mut ChaCha12Rng) -> Vec<f64> {
        let normals: Vec<f64> = (0..self.dimension)
            .map(|_| rng.sample(StandardNormal))
            .collect();
        let moved = |row: usize| -> f64 {
            let entries = &self.lower[row * self.dimension..=row * self.dimension + row];
            entries
                .iter()
                .zip(&normals)
                .map(|(entry, z)| entry * z)
                .sum()
        };
        from.iter()
            .enumerate()
            .map(|(row, x)| x + scale * moved(row))
            .collect()
    }

    /// (x − c)ᵀ Σ⁻¹ (x − c) by forward substitution.
    fn squared_distance(&self, position: &[f64], centre: &[f64]) -> f64 {
        let mut solved = [0.0; MAX_DIMENSION];
        let mut sum = 0.0;
        for row in 0..self.dimension {
            let entries = &self.lower[row * self.dimension..=row * self.dimension + row];
            let mut rest = position[row] - centre[row];
            for (entry, value) in entries[..row].iter().zip(&solved) {
                rest -= entry * value;
            }
            solved[row] = rest / entries[row];
            sum += solved[row] * solved[row];
        }
        sum
    }

    /// ln det L, half the logarithm of the covariance's determinant.
    fn ln_determinant(&self) -> f64 {
        (0..self.dimension)
            .map(|row| self.lower[row * self.dimension + row].ln())
            .sum()
    }
}

/// More coordinates than any model here has; a fixed bound keeps the inner loop off the heap.
const MAX_DIMENSION: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    /// A mixture fitted to two clouds has a density that integrates to 1 and covers both.
    #[test]
    fn the_density_is_normalised_and_belongs_to_the_draws() {
        let mut rng = random_stream(1, 0);
        let points: Vec<Vec<f64>> = (0..400)
            .map(|i| {
                vec![rng.sample::<f64, _>(StandardNormal) + if i % 4 == 0 { 9.0 } else { 0.0 }]
            })
            .collect();
        let proposal = Proposal::fit(&points, 3, 2);
        let step = 0.01;
        let nodes = || (-40_000..40_000).map(|i| (f64::from(i) + 0.5) * step);
        let total: f64 = nodes()
            .map(|x| step * proposal.ln_density(&[x]).exp())
            .sum();
        assert!((total - 1.0).abs() < 1e-4, "{total}");
        let right: f64 = nodes()
            .filter(|x| *x > 5.0)
            .map(|x| step * proposal.ln_density(&[x]).exp())
            .sum();
        let drawn = (0..4000)
            .filter(|_| proposal.draw(&mut rng)[0] > 5.0)
            .count() as f64
            / 4000.0;
        assert!((right - 0.25).abs() < 0.05, "{right}");
        assert!(
            (drawn - right).abs() < 4.0 * (0.25 * 0.75 / 4000.0_f64).sqrt(),
            "{drawn} {right}"
        );
    }

    #[test]
    fn cholesky_factors_give_the_distance_of_the_covariance() {
        let factor = Cholesky::of(&[4.0, 2.0, 2.0, 3.0]);
        // Inverse of [[4, 2], [2, 3]] is [[3, -2], [-2, 4]] / 8.
        let distance = factor.squared_distance(&[1.0, 2.0], &[0.0, 0.0]);
        assert!((distance - (3.0 - 8.0 + 16.0) / 8.0).abs() < 1e-12);
        assert!((factor.ln_determinant() - 8.0_f64.ln() / 2.0).abs() < 1e-12);
    }
}
