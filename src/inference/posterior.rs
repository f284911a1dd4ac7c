//! The posterior of a model's parameters on the coordinates that the sampler moves.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::likelihood::Likelihood;
use super::sampler::{LnDensity, LogDensity};
use super::{ChoiceData, Draws, FitError, FitSettings, Prior, Priors, Quantity};
use crate::model::{ChoiceModel, Curvature, Parameter, Parameters, RiskAwareOptions, value};

/// Keeps the sensitivity's coordinate finite where utilities do not differ (models' funnel, see [`Posterior`]).
const SPREAD_FLOOR: f64 = 0.02;

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
    model: &'static ChoiceModel,
    priors: Priors,
    reference_reward: f64,
    likelihood: Likelihood,
    /// θ stands for τ.
    moved: Vec<Parameter>,
    inert: Vec<Parameter>,
}

impl Posterior {
    pub(super) fn new(
        model: &'static ChoiceModel,
        data: &ChoiceData,
        priors: Priors,
        options: RiskAwareOptions,
        reference_reward: f64,
    ) -> Self {
        let likelihood = Likelihood::new(data, model.options(options));
        let mut posterior = Self {
            model,
            priors,
            reference_reward,
            likelihood,
            moved: Vec::new(),
            inert: Vec::new(),
        };
        let (inert, moved) = model
            .parameters
            .iter()
            .partition(|name| posterior.is_inert(**name));
        posterior.inert = inert;
        posterior.moved = moved;
        posterior
    }

    /// Signed reward that gives τ its unit.
    pub(super) fn reference_reward(&self) -> f64 {
        self.reference_reward
    }

    /// The parameters that choices can tell about; θ stands for τ.
    pub(super) fn moved(&self) -> &[Parameter] {
        &self.moved
    }

    /// Whether choices say nothing about a quantity, so that its posterior is its prior.
    pub(super) fn is_prior(&self, quantity: Quantity) -> bool {
        let inert = |parameter| self.inert.contains(&parameter);
        match quantity {
            Quantity::Parameter(Parameter::Theta) => {
                inert(Parameter::Theta) || self.is_losses_only()
            }
            Quantity::Parameter(parameter) => inert(parameter),
            Quantity::Tau | Quantity::LambdaTheta => inert(Parameter::Theta),
        }
    }

    /// Whether only losses count: λ cannot be told from θ, only their product is learned.
    pub(super) fn is_losses_only(&self) -> bool {
        self.reference_reward < 0.0 && self.inert.contains(&Parameter::Lambda)
    }

    /// What is reported, in order.
    pub(super) fn quantities(&self) -> Vec<Quantity> {
        let mut quantities: Vec<Quantity> = self
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

    /// Draws of all quantities from positions `[chain][draw]` and a random stream for what is inert.
    pub(super) fn draws(&mut self, positions: &[Vec<Vec<f64>>], rng: &mut ChaCha12Rng) -> Draws {
        let mut inert = |_| rng.random::<f64>();
        let quantities = self.quantities();
        let mut columns: Vec<(Quantity, Vec<f64>)> = quantities
            .into_iter()
            .map(|quantity| (quantity, Vec::new()))
            .collect();
        for position in positions.iter().flatten() {
            let point = self.point(position, &mut inert);
            for (quantity, values) in &mut columns {
                values.push(point.get(*quantity));
            }
        }
        Draws {
            model: self.model,
            chains: positions.len(),
            per_chain: positions[0].len(),
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
        for index in 0..count {
            let point = self.prior_point(index);
            for (quantity, values) in &mut columns {
                values.push(point.get(*quantity));
            }
        }
        Draws {
            model: self.model,
            chains: 1,
            per_chain: count,
            columns,
        }
    }

    /// The prior's variance of the coordinate on which a quantity's contraction is measured.
    pub(super) fn prior_coordinate_variance(&self, quantity: Quantity) -> f64 {
        let tau = self.priors.tau.ln_variance();
        let bends_apart = self.model.curvature == Curvature::Separate;
        let curvature = if self.reference_reward < 0.0 && bends_apart {
            Parameter::Beta
        } else {
            Parameter::Alpha
        };
        // ln θ = ln τ − ln |v(R_ref)|, and ln |v(R_ref)| = β ln |R_ref| + ln λ for a loss.
        let ln_size = self.reference_reward.abs().ln();
        let bend = if self.model.is_free(curvature) {
            ln_size * ln_size * self.priors.of(curvature).variance()
        } else {
            0.0
        };
        let aversion = if self.reference_reward < 0.0 && self.model.is_free(Parameter::Lambda) {
            self.priors.lambda.ln_variance()
        } else {
            0.0
        };
        match quantity {
            Quantity::Parameter(Parameter::Theta) => tau + bend + aversion,
            Quantity::LambdaTheta => tau + bend,
            Quantity::Parameter(parameter) => self.priors.of(parameter).coordinate_variance(),
            Quantity::Tau => self.priors.tau.coordinate_variance(),
        }
    }

    /// A value of a quantity on the coordinate on which its contraction is measured.
    pub(super) fn coordinate(&self, quantity: Quantity, value: f64) -> f64 {
        let coordinate = match quantity {
            Quantity::Parameter(Parameter::Theta) | Quantity::LambdaTheta => value.ln(),
            Quantity::Parameter(parameter) => self.priors.of(parameter).coordinate(value),
            Quantity::Tau => self.priors.tau.coordinate(value),
        };
        // A value that rounding put on a bound lies somewhere beyond 36, where the logit ends.
        coordinate.clamp(-700.0, 700.0)
    }

    /// The parameters with those set that follow from others.
    pub(super) fn complete(&self, parameters: Parameters) -> Parameters {
        self.model.complete(parameters)
    }

    /// ln L at any parameters.
    pub(super) fn ln_likelihood(&mut self, parameters: &Parameters) -> f64 {
        self.likelihood.ln_likelihood(parameters)
    }

    /// ln L when all actions are equally likely.
    pub(super) fn ln_likelihood_at_random(&mut self) -> f64 {
        let blind = with(Parameters::ONES, Parameter::Theta, 0.0);
        self.likelihood.ln_likelihood(&blind)
    }

    /// The shift s − ln τ at these parameters.
    pub(super) fn funnel(&mut self, parameters: &Parameters) -> f64 {
        let reference = self.reference_value(parameters);
        let squared = self.likelihood.mean_squared_spread(parameters) / (reference * reference);
        let squared = if squared.is_finite() { squared } else { 0.0 };
        0.5 * (SPREAD_FLOOR * SPREAD_FLOOR + squared).ln()
    }

    /// |v(R_ref)| at these parameters.
    pub(super) fn reference_value(&self, parameters: &Parameters) -> f64 {
        let [alpha, beta, lambda] =
            [Parameter::Alpha, Parameter::Beta, Parameter::Lambda].map(|name| parameters.get(name));
        value(self.reference_reward, alpha, beta, lambda).abs()
    }

    /// The parameters and τ at a position; inert ones have the prior's quantile that `inert` gives for each.
    pub(super) fn point(
        &mut self,
        position: &[f64],
        inert: &mut dyn FnMut(Parameter) -> f64,
    ) -> Point {
        let mut parameters = Parameters::ONES;
        let mut tau = None;
        for index in 0..self.inert.len() {
            let parameter = self.inert[index];
            let value = self
                .priors
                .of(parameter)
                .quantile(inert(parameter).max(f64::MIN_POSITIVE));
            if parameter == Parameter::Theta {
                tau = Some(value);
            } else {
                parameters = with(parameters, parameter, value);
            }
        }
        for (parameter, coordinate) in self.moved.iter().zip(position) {
            if *parameter != Parameter::Theta {
                let value = self.priors.of(*parameter).value(*coordinate);
                parameters = with(parameters, *parameter, value);
            }
        }
        let parameters = self.complete(parameters);
        let tau = match tau {
            Some(tau) => tau,
            None => {
                // θ is the last parameter of every model, and so τ the last coordinate.
                let shift = if self.has_funnel() {
                    self.funnel(&parameters)
                } else {
                    0.0
                };
                self.priors.tau.value(position[position.len() - 1] - shift)
            }
        };
        let theta = (tau / self.reference_value(&parameters)).min(f64::MAX);
        Point {
            parameters: with(parameters, Parameter::Theta, theta),
            tau,
        }
    }

    fn has_funnel(&self) -> bool {
        matches!(self.priors.tau, Prior::LogNormal { .. })
    }

    /// Point `index` of a lattice over the prior of the model's parameters.
    fn prior_point(&self, index: usize) -> Point {
        let count = self.model.parameters.len();
        // The root of x^(d+1) = x + 1 gives the most evenly spread lattice in d dimensions.
        let golden = (0..64).fold(2.0_f64, |x, _| (1.0 + x).powf(1.0 / (count as f64 + 1.0)));
        let mut parameters = Parameters::ONES;
        let mut tau = 1.0;
        for (position, parameter) in self.model.parameters.iter().enumerate() {
            let slope = golden.powi(-(position as i32 + 1));
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
    }

    /// Whether no utility gap, with the reference reward worth one logit, depends on the parameter. For θ: whether
    /// there is no gap at all.
    fn is_inert(&mut self, parameter: Parameter) -> bool {
        for probe in 0..PROBES {
            let here = self.prior_point(probe).parameters;
            let gaps = self.unit_gaps(&here);
            let size = gaps.iter().fold(0.0_f64, |size, gap| size.max(gap.abs()));
            if parameter == Parameter::Theta {
                if size > INERT_TOLERANCE {
                    return false;
                }
                continue;
            }
            let other = self.prior_point(probe + 1).parameters.get(parameter);
            let moved = self.unit_gaps(&self.complete(with(here, parameter, other)));
            let same = gaps
                .iter()
                .zip(&moved)
                .all(|(before, after)| (before - after).abs() <= INERT_TOLERANCE * (1.0 + size));
            if !same {
                return false;
            }
        }
        true
    }

    fn unit_gaps(&mut self, parameters: &Parameters) -> Vec<f64> {
        let reference = self.reference_value(parameters);
        self.likelihood
            .gaps(parameters)
            .into_iter()
            .map(|gap| gap / reference)
            .collect()
    }
}

impl LogDensity for Posterior {
    fn dimension(&self) -> usize {
        self.moved.len()
    }

    fn evaluate(&mut self, position: &[f64]) -> LnDensity {
        let point = self.point(position, &mut |_| 0.5);
        let mut prior = 0.0;
        for (parameter, coordinate) in self.moved.iter().zip(position) {
            // Without a funnel τ's coordinate is its prior's, like that of the others.
            prior += if *parameter == Parameter::Theta && self.has_funnel() {
                self.priors.tau.ln_density(point.tau.ln())
            } else {
                self.priors.of(*parameter).ln_density(*coordinate)
            };
        }
        LnDensity {
            prior,
            likelihood: self.likelihood.ln_likelihood(&point.parameters),
        }
    }

    fn draw_prior(&mut self, rng: &mut ChaCha12Rng) -> Vec<f64> {
        let mut position = Vec::with_capacity(self.moved.len());
        let mut parameters = Parameters::ONES;
        for parameter in &self.inert {
            if *parameter != Parameter::Theta {
                parameters = with(
                    parameters,
                    *parameter,
                    self.priors.of(*parameter).quantile(0.5),
                );
            }
        }
        for index in 0..self.moved.len() {
            let parameter = self.moved[index];
            let prior = self.priors.of(parameter);
            let at: f64 = rng.random();
            let value = prior.quantile(at.clamp(1e-15, 1.0 - 1e-15));
            let mut coordinate = prior.coordinate(value);
            if parameter != Parameter::Theta {
                parameters = with(parameters, parameter, prior.value(coordinate));
            } else if self.has_funnel() {
                coordinate += self.funnel(&self.complete(parameters));
            }
            position.push(coordinate);
        }
        position
    }
}

/// The posterior density of a model on the coordinates that a fit moves, for measurements and checks.
#[derive(Debug, Clone)]
pub struct LnPosterior(Posterior);

impl LnPosterior {
    /// The posterior that [`fit`](super::fit()) draws from.
    ///
    /// # Errors
    /// As [`fit`](super::fit()).
    pub fn new(
        model: &'static ChoiceModel,
        data: &ChoiceData,
        settings: &FitSettings,
    ) -> Result<Self, FitError> {
        settings.posterior(model, data).map(Self)
    }

    /// How many coordinates there are: inert parameters have none.
    pub fn dimension(&self) -> usize {
        self.0.dimension()
    }

    /// ln posterior density at a position, without the marginal likelihood.
    pub fn at(&mut self, position: &[f64]) -> f64 {
        self.0.evaluate(position).posterior()
    }
}

/// One point of the parameter space.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub(super) parameters: Parameters,
    pub(super) tau: f64,
}

impl Point {
    fn get(&self, quantity: Quantity) -> f64 {
        match quantity {
            Quantity::Parameter(parameter) => self.parameters.get(parameter),
            Quantity::Tau => self.tau,
            Quantity::LambdaTheta => {
                self.parameters.get(Parameter::Lambda) * self.parameters.get(Parameter::Theta)
            }
        }
    }
}

/// The parameters with one of them changed to a value from its prior, which [`Priors::check`] keeps in range.
fn with(parameters: Parameters, parameter: Parameter, value: f64) -> Parameters {
    parameters
        .with(parameter, value)
        .expect("priors stay within the range of their parameter")
}
