//! The posterior of a model's parameters on the coordinates that the sampler moves.

use std::array;

use rand_chacha::ChaCha12Rng;

use super::coordinate::Coordinate;
use super::lanes::{InstructionSet, Kernel, LaneRandom};
use super::likelihood::Likelihood;
use super::parameter_space::{LanePoint, ParameterSpace, Point, funnel_lanes, theta_lanes, with};
use super::sampler::{BLOCK, Chains, LnDensities, LogDensity};
use super::utility_table::{ParameterLanes, lanes_of};
use super::{ChoiceData, Draws, Priors, Quantity};
use crate::model::{ChoiceModel, Curvature, Parameter, Parameters, RiskAwareOptions};

/// Utility gaps that differ by less than this, relative to their size, do not depend on a parameter.
const INERT_TOLERANCE: f64 = 1e-10;

/// Points of the prior at which dependence is looked for.
const PROBES: usize = 24;

/// Posterior density of a model given choices.
///
/// Coordinates are the prior's unconstrained ones (logit over bounds, or logarithm), Jacobian included. Sensitivity is
/// moved as
///
/// ```text
/// s = ln τ + ½ ln(0.02² + Σ n d² / Σ n),   d = max U − min U at τ = 1
/// ```
///
/// * n: answers to a problem; d: its spread of utilities when the reference reward is worth one logit.
///
/// for choices tell about τ d and not about τ: without this the posterior is a funnel. The change is a shift for given
/// other parameters, so its Jacobian is 1. A τ with bounds keeps the coordinate of its prior.
///
/// Parameters that no utility gap of an answered problem depends on are *inert*: choices say nothing about them, so
/// they are drawn from the prior and not moved.
#[derive(Debug, Clone)]
pub(super) struct Posterior {
    space: ParameterSpace,
    likelihood: Likelihood,
    instructions: InstructionSet,
}

impl Posterior {
    pub(super) fn new(
        model: &'static ChoiceModel,
        data: &ChoiceData,
        priors: Priors,
        options: RiskAwareOptions,
        reference_reward: f64,
    ) -> Self {
        let mut posterior = Self {
            space: ParameterSpace::new(model, priors, reference_reward),
            likelihood: Likelihood::new(data, model.options(options)),
            instructions: InstructionSet::widest(),
        };
        let inert = posterior.find_inert();
        posterior.space.fix(inert);
        posterior
    }

    /// Signed reward that gives τ its unit.
    pub(super) fn reference_reward(&self) -> f64 {
        self.space.reference_reward
    }

    /// The parameters that choices can tell about; θ stands for τ.
    pub(super) fn moved(&self) -> &[Parameter] {
        &self.space.moved
    }

    /// Whether choices say nothing about a quantity, so that its posterior is its prior.
    pub(super) fn is_prior(&self, quantity: Quantity) -> bool {
        let is_theta = quantity == Quantity::Parameter(Parameter::Theta);
        self.is_drawn_from_prior(quantity) || is_theta && self.is_losses_only()
    }

    /// Whether draws of a quantity come straight from the prior, each independent of all others: they depend on no chain.
    pub(super) fn is_drawn_from_prior(&self, quantity: Quantity) -> bool {
        let inert = |parameter| self.space.inert.contains(&parameter);
        match quantity {
            Quantity::Parameter(parameter) => inert(parameter),
            Quantity::Tau | Quantity::LambdaTheta => inert(Parameter::Theta),
        }
    }

    /// Whether only losses count: λ cannot be told from θ, only their product is learned.
    pub(super) fn is_losses_only(&self) -> bool {
        self.space.reference_reward < 0.0 && self.space.inert.contains(&Parameter::Lambda)
    }

    /// What is reported, in order.
    pub(super) fn quantities(&self) -> Vec<Quantity> {
        let mut quantities: Vec<Quantity> = self
            .space
            .model
            .parameters
            .iter()
            .copied()
            .map(Quantity::Parameter)
            .collect();
        quantities.push(Quantity::Tau);
        if self.is_losses_only() {
            quantities.push(Quantity::LambdaTheta);
        }
        quantities
    }

    /// Draws of all quantities from the positions of chains and a random stream for what is inert.
    pub(super) fn draws(&mut self, chains: &Chains, rng: &mut ChaCha12Rng) -> Draws {
        let quantities = self.quantities();
        let mut columns: Vec<(Quantity, Vec<f64>)> = quantities
            .into_iter()
            .map(|quantity| (quantity, vec![0.0; chains.len()]))
            .collect();
        let mut random = LaneRandom::new(rng);
        let mut positions = vec![[0.0; BLOCK]; self.dimension()];
        for start in (0..chains.len()).step_by(BLOCK) {
            chains.block(start, &mut positions);
            let point = self.instructions.run(Locate {
                posterior: self,
                positions: &positions,
                random: &mut random,
            });
            let end = (start + BLOCK).min(chains.len());
            for (quantity, values) in &mut columns {
                values[start..end].copy_from_slice(&point.get(*quantity)[..end - start]);
            }
        }
        Draws {
            model: self.space.model,
            chains: chains.chains,
            per_chain: chains.per_chain,
            columns,
        }
    }

    /// Evenly spread draws from the prior: a lattice of the generalised golden ratio (Roberts 2018), no random numbers.
    pub(super) fn prior_draws(&self, count: usize) -> Draws {
        let mut columns: Vec<(Quantity, Vec<f64>)> = self
            .quantities()
            .into_iter()
            .map(|quantity| (quantity, Vec::new()))
            .collect();
        for point in self.space.prior_points(count) {
            for (quantity, values) in &mut columns {
                values.push(point.get(*quantity));
            }
        }
        Draws {
            model: self.space.model,
            chains: 1,
            per_chain: count,
            columns,
        }
    }

    /// The prior's variance of the coordinate on which a quantity's contraction is measured.
    pub(super) fn prior_coordinate_variance(&self, quantity: Quantity) -> f64 {
        let tau = self.space.priors.tau.ln_variance();
        let bends_apart = self.space.model.curvature == Curvature::Separate;
        let curvature = if self.space.reference_reward < 0.0 && bends_apart {
            Parameter::Beta
        } else {
            Parameter::Alpha
        };
        // ln θ = ln τ − ln |v(R_ref)|, and ln |v(R_ref)| = β ln |R_ref| + ln λ for a loss.
        let ln_size = self.space.reference_reward.abs().ln();
        let bend = if self.space.model.is_free(curvature) {
            ln_size * ln_size * self.space.priors.of(curvature).variance()
        } else {
            0.0
        };
        let aversion =
            if self.space.reference_reward < 0.0 && self.space.model.is_free(Parameter::Lambda) {
                self.space.priors.lambda.ln_variance()
            } else {
                0.0
            };
        match quantity {
            Quantity::Parameter(Parameter::Theta) => tau + bend + aversion,
            Quantity::LambdaTheta => tau + bend,
            Quantity::Parameter(parameter) => self.space.priors.of(parameter).coordinate_variance(),
            Quantity::Tau => self.space.priors.tau.coordinate_variance(),
        }
    }

    /// A value of a quantity on the coordinate on which its contraction is measured.
    pub(super) fn coordinate(&self, quantity: Quantity, value: f64) -> f64 {
        let coordinate = match quantity {
            Quantity::Parameter(Parameter::Theta) | Quantity::LambdaTheta => value.ln(),
            Quantity::Parameter(parameter) => self.space.priors.of(parameter).coordinate(value),
            Quantity::Tau => self.space.priors.tau.coordinate(value),
        };
        // A value that rounding put on a bound lies somewhere beyond 36, where the logit ends.
        coordinate.clamp(-700.0, 700.0)
    }

    /// The parameters with those set that follow from others.
    pub(super) fn complete(&self, parameters: Parameters) -> Parameters {
        self.space.complete(parameters)
    }

    /// |v(R_ref)| at these parameters.
    pub(super) fn reference_value(&self, parameters: &Parameters) -> f64 {
        self.space.reference_value(parameters)
    }

    /// ln L at any parameters.
    pub(super) fn ln_likelihood(&mut self, parameters: &Parameters) -> f64 {
        let theta = parameters.get(Parameter::Theta);
        self.likelihood
            .ln_likelihood(&lanes_of(parameters), |_| [theta])[0]
    }

    /// ln L when all actions are equally likely.
    pub(super) fn ln_likelihood_at_random(&mut self) -> f64 {
        self.ln_likelihood(&with(Parameters::ONES, Parameter::Theta, 0.0))
    }

    /// ln posterior density at one position.
    pub(super) fn ln_density(&mut self, position: &[f64]) -> f64 {
        let positions: Vec<[f64; 1]> = position.iter().map(|x| [*x]).collect();
        self.evaluate(&positions).posterior()[0]
    }

    /// The shift s − ln τ at these parameters.
    pub(super) fn funnel(&mut self, parameters: &Parameters) -> f64 {
        let parameters: ParameterLanes<1> = lanes_of(parameters);
        let reference = self.space.reference_lanes(&parameters);
        let squares = self.likelihood.mean_squared_spread(&parameters);
        funnel_lanes(&squares, &reference)[0]
    }

    /// The parameters and τ at a position; inert ones have the prior's median.
    pub(super) fn point(&mut self, position: &[f64]) -> Point {
        let positions: Vec<[f64; 1]> = position.iter().map(|x| [*x]).collect();
        let mut parameters = lanes_of(&self.space.rest);
        self.space.place(&positions, &mut parameters);
        let point = self.complete_lanes(&positions, parameters, [self.space.rest_tau]);
        let mut found = Parameters::ONES;
        for (name, values) in Parameter::ALL.into_iter().zip(point.parameters) {
            found = with(found, name, values[0]);
        }
        Point {
            parameters: found,
            tau: point.tau[0],
        }
    }

    /// The point at these positions, whose parameters but θ are there already.
    #[inline(always)]
    fn complete_lanes<const W: usize>(
        &mut self,
        positions: &[[f64; W]],
        mut parameters: ParameterLanes<W>,
        mut tau: [f64; W],
    ) -> LanePoint<W> {
        let reference = self.space.reference_lanes(&parameters);
        if self.space.moves_tau() {
            let squares = self.likelihood.mean_squared_spread(&parameters);
            tau = self
                .space
                .tau_lanes(&positions[positions.len() - 1], &squares, &reference)
                .0;
        }
        parameters[Parameter::Theta as usize] = theta_lanes(&tau, &reference);
        LanePoint { parameters, tau }
    }

    /// The parameters that no utility gap, with the reference reward worth one logit, depends on; θ if there is no gap
    /// at all.
    fn find_inert(&mut self) -> Vec<Parameter> {
        let points: Vec<Parameters> = self
            .space
            .prior_points(PROBES + 1)
            .map(|point| point.parameters)
            .collect();
        let here: ParameterLanes<PROBES> =
            Parameter::ALL.map(|name| array::from_fn(|probe| points[probe].get(name)));
        let gaps = self.unit_gaps(&here);
        let mut sizes = [0.0_f64; PROBES];
        for gap in &gaps {
            sizes = array::from_fn(|probe| sizes[probe].max(gap[probe].abs()));
        }
        let mut inert = Vec::new();
        for name in self.space.model.parameters {
            let depends = if *name == Parameter::Theta {
                sizes.iter().any(|size| *size > INERT_TOLERANCE)
            } else {
                let mut there = here;
                there[*name as usize] = array::from_fn(|probe| points[probe + 1].get(*name));
                if self.space.model.curvature == Curvature::Shared {
                    there[Parameter::Beta as usize] = there[Parameter::Alpha as usize];
                }
                let moved = self.unit_gaps(&there);
                let same = |before: &[f64; PROBES], after: &[f64; PROBES]| {
                    (0..PROBES).all(|probe| {
                        let change = (before[probe] - after[probe]).abs();
                        change <= INERT_TOLERANCE * (1.0 + sizes[probe])
                    })
                };
                !gaps
                    .iter()
                    .zip(&moved)
                    .all(|(before, after)| same(before, after))
            };
            if !depends {
                inert.push(*name);
            }
        }
        inert
    }

    fn unit_gaps(&mut self, parameters: &ParameterLanes<PROBES>) -> Vec<[f64; PROBES]> {
        let reference = self.space.reference_lanes(parameters);
        let mut gaps = self.likelihood.gaps(parameters);
        for gap in &mut gaps {
            *gap = array::from_fn(|probe| gap[probe] / reference[probe]);
        }
        gaps
    }
}

impl LogDensity for Posterior {
    fn dimension(&self) -> usize {
        self.space.moved.len()
    }

    #[inline]
    fn evaluate<const W: usize>(&mut self, positions: &[[f64; W]]) -> LnDensities<W> {
        self.instructions.run(Evaluate {
            posterior: self,
            positions,
        })
    }

    fn draw_prior<const W: usize>(&mut self, random: &mut LaneRandom, positions: &mut [[f64; W]]) {
        for (coordinate, position) in self.space.coordinates.iter().zip(positions.iter_mut()) {
            coordinate.draw(random, position);
        }
        if self.space.moves_tau() && self.space.has_funnel() {
            let mut parameters = lanes_of(&self.space.rest);
            self.space.place(positions, &mut parameters);
            let reference = self.space.reference_lanes(&parameters);
            let squares = self.likelihood.mean_squared_spread(&parameters);
            let shift = funnel_lanes(&squares, &reference);
            let last = positions.len() - 1;
            for lane in 0..W {
                positions[last][lane] += shift[lane];
            }
        }
    }
}

/// The posterior density at a block of positions.
struct Evaluate<'a, const W: usize> {
    posterior: &'a mut Posterior,
    positions: &'a [[f64; W]],
}

impl<const W: usize> Kernel for Evaluate<'_, W> {
    type Output = LnDensities<W>;

    #[inline(always)]
    fn run(self) -> LnDensities<W> {
        let Self {
            posterior,
            positions,
        } = self;
        let mut parameters = lanes_of(&posterior.space.rest);
        let mut prior = posterior.space.place(positions, &mut parameters);
        let reference = posterior.space.reference_lanes(&parameters);
        let space = &posterior.space;
        let likelihood = posterior.likelihood.ln_likelihood(
            &parameters,
            #[inline(always)]
            |squares: &[f64; W]| {
                let mut tau = [space.rest_tau; W];
                if space.moves_tau() {
                    let last = &positions[positions.len() - 1];
                    let (moved, density) = space.tau_lanes(last, squares, &reference);
                    tau = moved;
                    for lane in 0..W {
                        prior[lane] += density[lane];
                    }
                }
                theta_lanes(&tau, &reference)
            },
        );
        LnDensities { prior, likelihood }
    }
}

/// The parameters at a block of positions, with inert ones drawn from their prior.
struct Locate<'a> {
    posterior: &'a mut Posterior,
    positions: &'a [[f64; BLOCK]],
    random: &'a mut LaneRandom,
}

impl Kernel for Locate<'_> {
    type Output = LanePoint<BLOCK>;

    #[inline(always)]
    fn run(self) -> LanePoint<BLOCK> {
        let Self {
            posterior,
            positions,
            random,
        } = self;
        let mut parameters = lanes_of(&posterior.space.rest);
        let mut tau = [posterior.space.rest_tau; BLOCK];
        for name in &posterior.space.inert {
            let coordinate = Coordinate::of(posterior.space.priors.of(*name));
            let values = if *name == Parameter::Theta {
                &mut tau
            } else {
                &mut parameters[*name as usize]
            };
            coordinate.draw_values(random, values);
        }
        posterior.space.place(positions, &mut parameters);
        posterior.complete_lanes(positions, parameters, tau)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::inference::choice_data::tests::data;
    use crate::model::{MODELS, ln_probabilities};

    fn choices() -> ChoiceData {
        data(&[
            (
                "cups",
                &[("a", &[(1.0, 20.0)]), ("b", &[(0.2, 105.0), (0.8, 0.0)])],
                &[43, 7],
            ),
            (
                "losses",
                &[
                    ("a", &[(1.0, -100.0)]),
                    ("b", &[(0.05, -500.0), (0.95, 0.0)]),
                ],
                &[9, 4],
            ),
            (
                "mixed",
                &[
                    ("a", &[(0.5, 30.0), (0.5, -20.0)]),
                    ("b", &[(1.0, 0.0)]),
                    ("c", &[(0.3, 50.0), (0.3, 10.0), (0.4, -40.0)]),
                ],
                &[5, 8, 0],
            ),
        ])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        /// Every model of the family, against the choice rule itself; whatever the lanes and the instructions.
        #[test]
        fn the_likelihood_is_that_of_the_choice_rule(
            positions in prop::collection::vec(prop::array::uniform8(-4.0..4.0), 8)
        ) {
            let data = choices();
            for model in MODELS {
                let options = model.options(RiskAwareOptions::default());
                let mut posterior = Posterior::new(model, &data, Priors::default(), options, 105.0);
                let positions = &positions[..posterior.dimension()];
                let mut densities = Vec::new();
                for set in InstructionSet::available() {
                    posterior.instructions = set;
                    densities.push(posterior.evaluate(positions));
                }
                for density in &densities {
                    prop_assert_eq!(density, &densities[0]);
                }
                for lane in 0..8 {
                    let position: Vec<[f64; 1]> = positions.iter().map(|x| [x[lane]]).collect();
                    let alone = posterior.evaluate(&position);
                    prop_assert_eq!(alone.prior[0], densities[0].prior[lane]);
                    prop_assert_eq!(alone.likelihood[0], densities[0].likelihood[lane]);
                    let position: Vec<f64> = position.iter().map(|x| x[0]).collect();
                    let parameters = posterior.point(&position).parameters;
                    let mut expected = 0.0;
                    for (problem, counts) in data.problems().iter().zip(data.totals()) {
                        let ln_p = ln_probabilities(&problem.problem, &parameters, options).unwrap();
                        let terms = counts.iter().zip(ln_p).filter(|(count, _)| **count > 0);
                        expected += terms.map(|(count, ln_p)| *count as f64 * ln_p).sum::<f64>();
                    }
                    let found = alone.likelihood[0];
                    prop_assert!((found - expected).abs() < 1e-10 * (1.0 + expected.abs()));
                }
            }
        }
    }
}
