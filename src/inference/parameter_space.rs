//! The parameters of a model on the coordinates that the sampler moves.

use std::array;

use super::coordinate::Coordinate;
use super::lanes::{exp, ln};
use super::utility_table::{ParameterLanes, lanes_of};
use super::{Prior, Priors, Quantity};
use crate::model::{ChoiceModel, Curvature, Parameter, Parameters};

/// Keeps the sensitivity's coordinate finite where utilities do not differ (models' funnel, see [`Posterior`]).
const SPREAD_FLOOR: f64 = 0.02;

/// Which parameters move, on which coordinates, and where the others stand.
#[derive(Debug, Clone)]
pub(super) struct ParameterSpace {
    pub(super) model: &'static ChoiceModel,
    pub(super) priors: Priors,
    pub(super) reference_reward: f64,
    ln_reference: f64,
    /// θ stands for τ.
    pub(super) moved: Vec<Parameter>,
    pub(super) inert: Vec<Parameter>,
    /// Of the moved parameters, in their order.
    pub(super) coordinates: Vec<Coordinate>,
    /// Those that do not move, at their prior's median; θ plays no part.
    pub(super) rest: Parameters,
    /// τ if it does not move.
    pub(super) rest_tau: f64,
}

impl ParameterSpace {
    /// The space in which every parameter of the model moves.
    pub(super) fn new(model: &'static ChoiceModel, priors: Priors, reference_reward: f64) -> Self {
        let mut space = Self {
            model,
            priors,
            reference_reward,
            ln_reference: reference_reward.abs().ln(),
            moved: Vec::new(),
            inert: Vec::new(),
            coordinates: Vec::new(),
            rest: Parameters::ONES,
            rest_tau: priors.tau.quantile(0.5),
        };
        space.fix(Vec::new());
        space
    }

    /// Lets these parameters stand still and the others move.
    pub(super) fn fix(&mut self, inert: Vec<Parameter>) {
        let is_moved = |name: &Parameter| !inert.contains(name);
        self.moved = self
            .model
            .parameters
            .iter()
            .copied()
            .filter(is_moved)
            .collect();
        let coordinate = |name: &Parameter| Coordinate::of(self.priors.of(*name));
        self.coordinates = self.moved.iter().map(coordinate).collect();
        self.rest = Parameters::ONES;
        for name in &inert {
            if *name != Parameter::Theta {
                self.rest = with(self.rest, *name, self.priors.of(*name).quantile(0.5));
            }
        }
        self.rest = self.complete(self.rest);
        self.inert = inert;
    }

    /// The parameters with those set that follow from others.
    pub(super) fn complete(&self, parameters: Parameters) -> Parameters {
        self.model.complete(parameters)
    }

    /// |v(R_ref)| at these parameters.
    pub(super) fn reference_value(&self, parameters: &Parameters) -> f64 {
        self.reference_lanes::<1>(&lanes_of(parameters))[0]
    }

    pub(super) fn has_funnel(&self) -> bool {
        matches!(self.priors.tau, Prior::LogNormal { .. })
    }

    /// Sets the parameters that move, but θ; returns the logarithm of their prior density.
    ///
    /// ```text
    /// ln σ(x) + ln σ(−x) = −|x| − 2 ln(1 + e^−|x|)
    /// ```
    ///
    /// A product under one logarithm serves all bounded parameters.
    #[inline(always)]
    pub(super) fn place<const W: usize>(
        &self,
        positions: &[[f64; W]],
        parameters: &mut ParameterLanes<W>,
    ) -> [f64; W] {
        let mut prior = [0.0; W];
        let mut product = [1.0; W];
        let named = self.moved.iter().zip(&self.coordinates);
        for ((name, coordinate), position) in named.zip(positions) {
            if *name != Parameter::Theta {
                coordinate.place(
                    position,
                    &mut parameters[*name as usize],
                    &mut prior,
                    &mut product,
                );
            }
        }
        for lane in 0..W {
            prior[lane] -= 2.0 * ln(product[lane]);
        }
        if self.model.curvature == Curvature::Shared {
            parameters[Parameter::Beta as usize] = parameters[Parameter::Alpha as usize];
        }
        prior
    }

    /// |v(R_ref)|.
    #[inline(always)]
    pub(super) fn reference_lanes<const W: usize>(
        &self,
        parameters: &ParameterLanes<W>,
    ) -> [f64; W] {
        let size = self.reference_reward.abs();
        let ln_size = self.ln_reference;
        let (curvature, aversion) = if self.reference_reward < 0.0 {
            (Parameter::Beta, &parameters[Parameter::Lambda as usize])
        } else {
            (Parameter::Alpha, &[1.0; W])
        };
        let exponent = &parameters[curvature as usize];
        let mut reference = [0.0; W];
        for lane in 0..W {
            let power = exp(exponent[lane] * ln_size);
            let power = if exponent[lane] == 1.0 { size } else { power };
            reference[lane] = power * aversion[lane];
        }
        reference
    }

    /// τ and the logarithm of its prior density at its coordinate.
    #[inline(always)]
    pub(super) fn tau_lanes<const W: usize>(
        &self,
        coordinate: &[f64; W],
        squares: &[f64; W],
        reference: &[f64; W],
    ) -> ([f64; W], [f64; W]) {
        let mut at = *coordinate;
        if self.has_funnel() {
            let shift = funnel_lanes(squares, reference);
            for lane in 0..W {
                at[lane] -= shift[lane];
            }
        }
        let (mut tau, mut prior, mut product) = ([0.0; W], [0.0; W], [1.0; W]);
        // θ is the last parameter of every model, and so τ the last coordinate.
        self.coordinates[self.coordinates.len() - 1].place(&at, &mut tau, &mut prior, &mut product);
        if !self.has_funnel() {
            for lane in 0..W {
                prior[lane] -= 2.0 * ln(product[lane]);
            }
        }
        (tau, prior)
    }

    pub(super) fn moves_tau(&self) -> bool {
        self.moved.last() == Some(&Parameter::Theta)
    }

    /// A lattice over the prior of the model's parameters.
    pub(super) fn prior_points(&self, count: usize) -> impl Iterator<Item = Point> + '_ {
        let dimension = self.model.parameters.len();
        // The root of x^(d+1) = x + 1 gives the most evenly spread lattice in d dimensions.
        let golden = (0..64).fold(2.0_f64, |x, _| {
            (1.0 + x).powf(1.0 / (dimension as f64 + 1.0))
        });
        (0..count).map(move |index| {
            let mut parameters = Parameters::ONES;
            let mut tau = 1.0;
            let mut slope = 1.0;
            for parameter in self.model.parameters {
                slope /= golden;
                let at = (0.5 + (index as f64 + 1.0) * slope).fract();
                let value = self
                    .priors
                    .of(*parameter)
                    .quantile(at.clamp(1e-12, 1.0 - 1e-12));
                if *parameter == Parameter::Theta {
                    tau = value;
                } else {
                    parameters = with(parameters, *parameter, value.max(f64::MIN_POSITIVE));
                }
            }
            let parameters = self.complete(parameters);
            let theta = (tau / self.reference_value(&parameters)).min(f64::MAX);
            Point {
                parameters: with(parameters, Parameter::Theta, theta),
                tau,
            }
        })
    }
}

/// ½ ln(0.02² + Σ n d² / Σ n), d in units of the reference.
#[inline(always)]
pub(super) fn funnel_lanes<const W: usize>(squares: &[f64; W], reference: &[f64; W]) -> [f64; W] {
    let mut shift = [0.0; W];
    for lane in 0..W {
        let squared = squares[lane] / (reference[lane] * reference[lane]);
        let squared = if squared < f64::INFINITY {
            squared
        } else {
            0.0
        };
        shift[lane] = 0.5 * ln(SPREAD_FLOOR * SPREAD_FLOOR + squared);
    }
    shift
}

/// θ = τ / |v(R_ref)|, finite.
#[inline(always)]
pub(super) fn theta_lanes<const W: usize>(tau: &[f64; W], reference: &[f64; W]) -> [f64; W] {
    let mut theta = [0.0; W];
    for lane in 0..W {
        let ratio = tau[lane] / reference[lane];
        theta[lane] = if ratio > f64::MAX { f64::MAX } else { ratio };
    }
    theta
}

/// One point of the parameter space.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub(super) parameters: Parameters,
    pub(super) tau: f64,
}

impl Point {
    pub(super) fn get(&self, quantity: Quantity) -> f64 {
        match quantity {
            Quantity::Parameter(parameter) => self.parameters.get(parameter),
            Quantity::Tau => self.tau,
            Quantity::LambdaTheta => {
                self.parameters.get(Parameter::Lambda) * self.parameters.get(Parameter::Theta)
            }
        }
    }
}

/// As many points of the parameter space as there are lanes.
pub(super) struct LanePoint<const W: usize> {
    pub(super) parameters: ParameterLanes<W>,
    pub(super) tau: [f64; W],
}

impl<const W: usize> LanePoint<W> {
    pub(super) fn get(&self, quantity: Quantity) -> [f64; W] {
        let of = |name: Parameter| &self.parameters[name as usize];
        match quantity {
            Quantity::Parameter(parameter) => *of(parameter),
            Quantity::Tau => self.tau,
            Quantity::LambdaTheta => {
                let (lambda, theta) = (of(Parameter::Lambda), of(Parameter::Theta));
                array::from_fn(|lane| lambda[lane] * theta[lane])
            }
        }
    }
}

/// The parameters with one of them changed to a value from its prior, which [`Priors::check`] keeps in range.
pub(super) fn with(parameters: Parameters, parameter: Parameter, value: f64) -> Parameters {
    parameters
        .with(parameter, value)
        .expect("priors stay within the range of their parameter")
}
