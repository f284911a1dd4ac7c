//! Where the chains may jump: a mixture of multivariate t distributions, and random walks of its overall shape.

use super::Cloud;
use super::expectation_maximisation::{maximise_expectation, spread_centres};
use super::triangle::Triangle;
use crate::inference::lanes::{InstructionSet, Kernel, LaneRandom, fill_normals, ln};

/// Degrees of freedom of every component: tails heavier than those of a posterior, so that none of it is hard to reach.
/// With 4 the density needs no exponential, and a χ² is −2 ln of the product of two uniform numbers.
pub(super) const DEGREES_OF_FREEDOM: f64 = 4.0;

/// Weight of the wide component that covers what the others miss.
const SAFETY_WEIGHT: f64 = 0.06;

/// How much wider the wide component is than the whole population.
const SAFETY_SCALE: f64 = 2.0;

/// Rounds of expectation maximisation when nothing is known before.
const FIRST_ROUNDS: usize = 25;

/// More coordinates than any model has; a fixed bound keeps inner loops off the heap.
const MAX_DIMENSION: usize = 10;

/// Most posteriors have no more; room for them is emptied much faster.
const FEW_DIMENSIONS: usize = 4;

/// Numbers that place a component: its centre and a lower triangle.
const fn placing_size(dimension: usize) -> usize {
    dimension * (dimension + 3) / 2
}

/// A fixed distribution of proposals.
#[derive(Debug, Clone)]
pub struct Proposal {
    /// The wide one last.
    components: Vec<Component>,
    /// Upper ends of the shares of (0, 1] that choose each component but the last.
    thresholds: Vec<f64>,
    walk: RandomWalk,
    dimension: usize,
    instructions: InstructionSet,
}

/// Symmetric steps of a population's shape.
#[derive(Debug, Clone)]
pub(super) struct RandomWalk {
    lower: Triangle,
    instructions: InstructionSet,
}

impl RandomWalk {
    pub(super) fn of(points: &Cloud) -> Self {
        Self {
            lower: Triangle::of(&points.moments().1, points.coordinates.len()),
            instructions: InstructionSet::widest(),
        }
    }

    /// Moves positions by steps whose standard deviations are `scales` times those of the population.
    pub(super) fn walk<const W: usize>(
        &self,
        random: &mut LaneRandom,
        scales: &[f64; W],
        positions: &mut [[f64; W]],
    ) {
        self.instructions.run(Walk {
            lower: &self.lower,
            random,
            scales,
            positions,
        });
    }
}

/// A multivariate t distribution with centre c and shape L Lᵀ.
#[derive(Debug, Clone)]
pub(super) struct Component {
    weight: f64,
    /// The centre, then L.
    placing: Vec<f64>,
    /// L⁻¹/√ν.
    whitening: Triangle,
    /// L⁻¹ c/√ν.
    offset: Vec<f64>,
    /// Weight times the density at the centre.
    height: f64,
    density: f64,
}

impl Component {
    pub(super) fn new(weight: f64, centre: Vec<f64>, shape: Triangle) -> Self {
        let dimension = centre.len();
        let whitening = shape.inverse().scaled(1.0 / DEGREES_OF_FREEDOM.sqrt());
        let offset = whitening.times(&centre);
        let mut placing = centre;
        placing.extend_from_slice(&shape.entries);
        let density = density_at_centre(dimension) / shape.determinant();
        Self {
            weight,
            placing,
            whitening,
            offset,
            height: weight * density,
            density,
        }
    }

    fn reweigh(&mut self, weight: f64) {
        self.weight = weight;
        self.height = weight * self.density;
    }

    /// Weight times density, and 1/(1 + δ/ν) with δ the squared distance from the centre.
    #[inline(always)]
    pub(super) fn heights<const W: usize>(&self, positions: &[[f64; W]]) -> ([f64; W], [f64; W]) {
        let mut squares = [1.0; W];
        let mut start = 0;
        for (row, offset) in self.offset.iter().enumerate() {
            let entries = &self.whitening.entries[start..=start + row];
            start += row + 1;
            let mut whitened = [-*offset; W];
            for (entry, position) in entries.iter().zip(positions) {
                for lane in 0..W {
                    whitened[lane] += entry * position[lane];
                }
            }
            for lane in 0..W {
                squares[lane] += whitened[lane] * whitened[lane];
            }
        }
        let mut inverse = [0.0; W];
        for lane in 0..W {
            inverse[lane] = 1.0 / squares[lane];
        }
        // (1 + δ/ν)^(−(ν + d)/2)
        let mut height = [0.0; W];
        for lane in 0..W {
            height[lane] = self.height * (inverse[lane] * inverse[lane]);
        }
        for _ in 0..positions.len() / 2 {
            for lane in 0..W {
                height[lane] *= inverse[lane];
            }
        }
        if positions.len() % 2 == 1 {
            for lane in 0..W {
                height[lane] *= inverse[lane].sqrt();
            }
        }
        (height, inverse)
    }
}

/// Γ((ν + d)/2) / (Γ(ν/2) (ν π)^(d/2)) for ν = 4, by Γ(x + 1) = x Γ(x).
fn density_at_centre(dimension: usize) -> f64 {
    let half = dimension as f64 / 2.0;
    let (mut gamma, mut at) = if dimension.is_multiple_of(2) {
        (1.0, 1.0)
    } else {
        (std::f64::consts::PI.sqrt(), 0.5)
    };
    while at < 2.0 + half - 0.25 {
        gamma *= at;
        at += 1.0;
    }
    gamma / (DEGREES_OF_FREEDOM * std::f64::consts::PI).powf(half)
}

impl Proposal {
    /// Fits a proposal to points by expectation maximisation from points far apart as centres.
    ///
    /// * `points`: at least two, each finite.
    /// * `components`: how many t distributions to start with, beside the wide one; those that fade are dropped.
    /// * `seed`: of the random centres.
    pub fn fit(points: &Cloud, components: usize, seed: u64) -> Self {
        let (_, covariance) = points.moments();
        let walk = Triangle::of(&covariance, points.coordinates.len());
        let fitted: Vec<Component> = spread_centres(points, components, &walk.inverse(), seed)
            .into_iter()
            .map(|index| Component::new(1.0 / components as f64, points.point(index), walk.clone()))
            .collect();
        Self::refined(fitted, points, FIRST_ROUNDS)
    }

    /// This proposal after some more rounds of expectation maximisation over other points.
    pub fn refit(&self, points: &Cloud, rounds: usize) -> Self {
        let (_, known) = self.components.split_last().expect("the wide one is there");
        let mut known = known.to_vec();
        for component in &mut known {
            component.reweigh(component.weight / (1.0 - SAFETY_WEIGHT));
        }
        Self::refined(known, points, rounds)
    }

    fn refined(mut fitted: Vec<Component>, points: &Cloud, rounds: usize) -> Self {
        let instructions = InstructionSet::widest();
        let dimension = points.coordinates.len();
        assert!(
            dimension <= MAX_DIMENSION,
            "there are at most {MAX_DIMENSION} coordinates"
        );
        let (centre, covariance) = points.moments();
        for _ in 0..rounds {
            fitted = maximise_expectation(instructions, points, fitted, &centre, &covariance);
        }
        for component in &mut fitted {
            component.reweigh(component.weight * (1.0 - SAFETY_WEIGHT));
        }
        let walk = Triangle::of(&covariance, dimension);
        let wide = walk.clone().scaled(SAFETY_SCALE);
        fitted.push(Component::new(SAFETY_WEIGHT, centre, wide));
        let mut end = 0.0;
        let thresholds = fitted[..fitted.len() - 1]
            .iter()
            .map(|component| {
                end += component.weight;
                end
            })
            .collect();
        Self {
            components: fitted,
            thresholds,
            walk: RandomWalk {
                lower: walk,
                instructions,
            },
            dimension,
            instructions,
        }
    }

    /// Positions from the mixture, and the logarithm of its density there.
    pub fn propose<const W: usize>(
        &self,
        random: &mut LaneRandom,
        positions: &mut [[f64; W]],
    ) -> [f64; W] {
        self.instructions.run(Propose {
            proposal: self,
            random,
            positions,
        })
    }

    /// The logarithm of the mixture's density, its constants included.
    pub fn ln_density<const W: usize>(&self, positions: &[[f64; W]]) -> [f64; W] {
        self.instructions.run(Weigh {
            proposal: self,
            positions,
        })
    }

    /// The random walk of the points' shape.
    pub(super) fn walk(&self) -> &RandomWalk {
        &self.walk
    }
}

struct Weigh<'a, const W: usize> {
    proposal: &'a Proposal,
    positions: &'a [[f64; W]],
}

impl<const W: usize> Kernel for Weigh<'_, W> {
    type Output = [f64; W];

    #[inline(always)]
    fn run(self) -> [f64; W] {
        let mut sum = [0.0; W];
        for component in &self.proposal.components {
            let (heights, _) = component.heights(self.positions);
            for lane in 0..W {
                sum[lane] += heights[lane];
            }
        }
        for density in &mut sum {
            *density = ln(*density);
        }
        sum
    }
}

struct Propose<'a, const W: usize> {
    proposal: &'a Proposal,
    random: &'a mut LaneRandom,
    positions: &'a mut [[f64; W]],
}

impl<const W: usize> Kernel for Propose<'_, W> {
    type Output = [f64; W];

    #[inline(always)]
    fn run(self) -> [f64; W] {
        if self.proposal.dimension <= FEW_DIMENSIONS {
            self.propose::<{ placing_size(FEW_DIMENSIONS) }>()
        } else {
            self.propose::<{ placing_size(MAX_DIMENSION) }>()
        }
    }
}

impl<const W: usize> Propose<'_, W> {
    /// * `P`: at least [`placing_size`] of the dimension.
    #[inline(always)]
    fn propose<const P: usize>(self) -> [f64; W] {
        let Self {
            proposal,
            random,
            positions,
        } = self;
        let dimension = proposal.dimension;
        let mut shares = [0.0; W];
        random.fill_uniform(&mut shares);
        let mut chosen = [0.0; W];
        for threshold in &proposal.thresholds {
            for lane in 0..W {
                chosen[lane] += if shares[lane] > *threshold { 1.0 } else { 0.0 };
            }
        }
        let mut placing = [[0.0; W]; P];
        for (lane, chosen) in chosen.iter().enumerate() {
            let component = &proposal.components[*chosen as usize];
            for (entries, entry) in placing.iter_mut().zip(&component.placing) {
                entries[lane] = *entry;
            }
        }
        // √(ν/χ²)
        let mut other = [0.0; W];
        random.fill_uniform(&mut shares);
        random.fill_uniform(&mut other);
        let mut stretch = [0.0; W];
        for lane in 0..W {
            let chi_squared = -2.0 * ln(shares[lane] * other[lane]);
            stretch[lane] = (DEGREES_OF_FREEDOM / chi_squared).sqrt();
        }
        let mut normals = [[0.0; W]; MAX_DIMENSION];
        let normals = &mut normals[..dimension];
        fill_normals(random, normals);
        let (centres, mut rows) = placing.split_at(dimension);
        for (row, (position, centre)) in positions.iter_mut().zip(centres).enumerate() {
            let (entries, rest) = rows.split_at(row + 1);
            rows = rest;
            let mut step = [0.0; W];
            for (entry, normal) in entries.iter().zip(normals.iter()) {
                for lane in 0..W {
                    step[lane] += entry[lane] * normal[lane];
                }
            }
            for lane in 0..W {
                position[lane] = centre[lane] + stretch[lane] * step[lane];
            }
        }
        Weigh {
            proposal,
            positions,
        }
        .run()
    }
}

struct Walk<'a, const W: usize> {
    lower: &'a Triangle,
    random: &'a mut LaneRandom,
    scales: &'a [f64; W],
    positions: &'a mut [[f64; W]],
}

impl<const W: usize> Kernel for Walk<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut normals = [[0.0; W]; MAX_DIMENSION];
        let normals = &mut normals[..self.positions.len()];
        fill_normals(self.random, normals);
        let mut start = 0;
        for (row, position) in self.positions.iter_mut().enumerate() {
            let entries = &self.lower.entries[start..=start + row];
            start += row + 1;
            for (entry, normal) in entries.iter().zip(normals.iter()) {
                for lane in 0..W {
                    position[lane] += self.scales[lane] * (entry * normal[lane]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::lanes::LANES;
    use crate::inference::sampler::random_stream;

    /// A mixture fitted to two clouds has a density that integrates to 1 and covers both.
    #[test]
    fn the_density_is_normalised_and_belongs_to_the_draws() {
        let mut random = LaneRandom::new(&mut random_stream(1, 0));
        let mut normals = vec![[0.0; LANES]; 50];
        fill_normals(&mut random, &mut normals);
        let points = normals
            .as_flattened()
            .iter()
            .enumerate()
            .map(|(i, z)| z + if i % 4 == 0 { 9.0 } else { 0.0 })
            .collect();
        let proposal = Proposal::fit(&Cloud::new(vec![points]), 3, 2);
        let step = 0.01;
        let nodes = || (-40_000..40_000).map(|i| (f64::from(i) + 0.5) * step);
        let mass = |x: f64| step * proposal.ln_density(&[[x]])[0].exp();
        let total: f64 = nodes().map(mass).sum();
        assert!((total - 1.0).abs() < 1e-4, "{total}");
        let right: f64 = nodes().filter(|x| *x > 5.0).map(mass).sum();
        let mut drawn = Vec::new();
        for _ in 0..500 {
            let mut positions = [[0.0; LANES]];
            let ln_density = proposal.propose(&mut random, &mut positions);
            assert_eq!(ln_density, proposal.ln_density(&positions));
            drawn.extend(positions[0]);
        }
        let drawn = drawn.iter().filter(|x| **x > 5.0).count() as f64 / 4000.0;
        assert!((right - 0.25).abs() < 0.05, "{right}");
        assert!(
            (drawn - right).abs() < 4.0 * (0.25 * 0.75 / 4000.0_f64).sqrt(),
            "{drawn} {right}"
        );
    }

    /// In two dimensions, by a sum over a grid whose remainder outside is about 2 %.
    #[test]
    fn densities_of_several_dimensions_are_normalised() {
        for dimension in 2..=3 {
            let mut random = LaneRandom::new(&mut random_stream(3, 0));
            let mut normals = vec![[0.0; 64]; dimension];
            fill_normals(&mut random, &mut normals);
            let points = normals.iter().map(|column| column.to_vec()).collect();
            let proposal = Proposal::fit(&Cloud::new(points), 1, 2);
            // Importance sampling from a normal distribution three times as wide.
            let mut total = 0.0;
            for _ in 0..4000 {
                let mut positions = vec![[0.0; LANES]; dimension];
                proposal.propose(&mut random, &mut positions);
                let inside = |lane: usize| positions.iter().all(|x| x[lane].abs() < 2.0);
                total += (0..LANES).filter(|lane| inside(*lane)).count() as f64 / 32_000.0;
            }
            let nodes: Vec<f64> = (0..40).map(|i| -2.0 + 0.1 * (f64::from(i) + 0.5)).collect();
            let mut mass = 0.0;
            for index in 0..nodes.len().pow(dimension as u32) {
                let mut rest = index;
                let position: Vec<[f64; 1]> = (0..dimension)
                    .map(|_| {
                        let x = nodes[rest % nodes.len()];
                        rest /= nodes.len();
                        [x]
                    })
                    .collect();
                mass += proposal.ln_density(&position)[0].exp() * 0.1_f64.powi(dimension as i32);
            }
            assert!((total - mass).abs() < 0.015, "{total} {mass}");
        }
    }
}
