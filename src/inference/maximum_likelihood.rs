//! The parameters under which the choices are most likely.

use super::optimum::{Optimum, maximise};
use super::posterior::Posterior;
use super::sampler::{BLOCK, Cloud, LogDensity};
use crate::model::{ChoiceModel, Parameter, Parameters};

/// How many of the likeliest points of each kind are climbed from.
const CLIMBS: usize = 8;

/// Points spread over the whole parameter space, beside those of the posterior.
const SPREAD_POINTS: usize = 400;

/// Smallest exponent tried: below it decision weights vanish anyway.
const SMALLEST_EXPONENT: f64 = 1e-3;

/// Edge of the simplex at the start of a climb.
const STEP: f64 = 0.3;

/// ln L may lose this much to an end of a range that is reported exactly.
const SNAP_LOSS: f64 = 1e-9;

/// The highest likelihood within the ranges of the parameters (α, β, γ, δ in (0, 1], λ ≥ 0, θ ≥ 0).
#[derive(Debug, Clone, PartialEq)]
pub struct MaximumLikelihood {
    /// ln L there, without binomial coefficients.
    pub ln_likelihood: f64,
    /// The parameters there; those that choices cannot tell about are missing.
    pub parameters: Vec<(Parameter, f64)>,
}

/// The highest points of the likelihood and of the posterior, where a fit of some more choices may look again.
#[derive(Debug, Clone)]
pub(super) struct Optima {
    /// Of the likelihood, on the coordinates of the climb; nothing where no parameter moves.
    likelihood: Option<Optimum>,
    /// Of the posterior density, on the sampler's coordinates.
    pub(super) mode: Option<Optimum>,
}

impl Optima {
    /// Climbs from the best of `points` (positions of the posterior) and from a spread over the whole range.
    pub(super) fn anywhere(posterior: &mut Posterior, points: &[Vec<f64>]) -> Self {
        if posterior.dimension() == 0 {
            return Self {
                likelihood: None,
                mode: None,
            };
        }
        Self {
            likelihood: Some(highest_likelihood(posterior, points)),
            mode: posterior_mode(posterior, points),
        }
    }

    /// Climbs from the optima of an earlier fit with the same coordinates and from the best of `points`.
    pub(super) fn near(posterior: &mut Posterior, earlier: &Self, points: &Cloud) -> Self {
        let moved = posterior.moved().to_vec();
        let (likeliest, densest) = best_points(posterior, points);
        let mut starts = vec![coordinates(&moved, posterior, &likeliest)];
        starts.extend(earlier.likelihood.iter().map(|best| best.position.clone()));
        let likelihood = climb_likelihood(posterior, &moved, &starts);
        let mut starts = vec![densest];
        starts.extend(earlier.mode.iter().map(|best| best.position.clone()));
        let mut density = |position: &[f64]| posterior.ln_density(position);
        Self {
            likelihood: Some(likelihood),
            mode: Some(maximise(&mut density, &starts, STEP)),
        }
    }

    /// The parameters where the likelihood is highest.
    pub(super) fn maximum_likelihood(
        &self,
        model: &'static ChoiceModel,
        posterior: &mut Posterior,
    ) -> MaximumLikelihood {
        match &self.likelihood {
            Some(best) => snapped(model, posterior, best),
            None => MaximumLikelihood {
                ln_likelihood: posterior.ln_likelihood_at_random(),
                parameters: Vec::new(),
            },
        }
    }
}

/// The points with the highest likelihood and with the highest posterior density.
fn best_points(posterior: &mut Posterior, points: &Cloud) -> (Vec<f64>, Vec<f64>) {
    let mut best = [(f64::NEG_INFINITY, 0); 2];
    for start in (0..points.len()).step_by(BLOCK) {
        let positions = points.block::<BLOCK>(start);
        let densities = posterior.evaluate(&positions);
        let lanes = densities.likelihood.iter().zip(densities.posterior());
        for (lane, (likelihood, density)) in lanes.enumerate() {
            for (best, value) in best.iter_mut().zip([*likelihood, density]) {
                if value > best.0 {
                    *best = (value, (start + lane).min(points.len() - 1));
                }
            }
        }
    }
    (points.point(best[0].1), points.point(best[1].1))
}

/// Climbs from the likeliest of `points` (positions of the posterior) and of a spread over the whole range.
///
/// Bounded parameters are climbed on as sin² of a coordinate, so that a bound is a place like any other; sensitivity
/// on ln τ + the posterior's funnel, along which the likelihood has no ridge.
fn highest_likelihood(posterior: &mut Posterior, points: &[Vec<f64>]) -> Optimum {
    let moved = posterior.moved().to_vec();
    let mut candidates: Vec<Vec<f64>> = points
        .iter()
        .map(|position| coordinates(&moved, posterior, position))
        .collect();
    let from_posterior = likeliest(&mut candidates, &moved, posterior);
    let count = moved.len() as f64;
    let golden = (0..64).fold(2.0_f64, |x, _| (1.0 + x).powf(1.0 / (count + 1.0)));
    let mut spread: Vec<Vec<f64>> = (0..SPREAD_POINTS)
        .map(|index| spread_point(&moved, golden, index))
        .collect();
    let from_spread = likeliest(&mut spread, &moved, posterior);
    let starts: Vec<Vec<f64>> = from_posterior.into_iter().chain(from_spread).collect();
    climb_likelihood(posterior, &moved, &starts)
}

/// The highest likelihood found from any of the starts, which are on the coordinates of the climb.
fn climb_likelihood(
    posterior: &mut Posterior,
    moved: &[Parameter],
    starts: &[Vec<f64>],
) -> Optimum {
    let mut function = |position: &[f64]| {
        let parameters = parameters(moved, posterior, position);
        posterior.ln_likelihood(&parameters)
    };
    maximise(&mut function, starts, STEP)
}

/// The maximum, with what lies at a bound reported there and not next to it.
fn snapped(
    model: &'static ChoiceModel,
    posterior: &mut Posterior,
    best: &Optimum,
) -> MaximumLikelihood {
    let moved = posterior.moved().to_vec();
    let mut ln_likelihood = best.value;
    let mut best = parameters(&moved, posterior, &best.position);
    for parameter in Parameter::ALL {
        let end = match parameter {
            Parameter::Theta | Parameter::Lambda => 0.0,
            Parameter::Alpha | Parameter::Beta | Parameter::Gamma | Parameter::Delta => 1.0,
            // Their range has no end that belongs to it.
            Parameter::EtaGain | Parameter::EtaLoss => continue,
        };
        let snapped = best
            .with(parameter, end)
            .expect("the ends of the ranges are allowed");
        let snapped = model.complete(snapped);
        let there = posterior.ln_likelihood(&snapped);
        if model.is_free(parameter) && there >= ln_likelihood - SNAP_LOSS {
            best = snapped;
            ln_likelihood = ln_likelihood.max(there);
        }
    }
    let unidentified = posterior.is_losses_only();
    let known = moved
        .iter()
        .filter(|parameter| !(unidentified && **parameter == Parameter::Theta));
    MaximumLikelihood {
        ln_likelihood,
        parameters: known
            .map(|parameter| (*parameter, best.get(*parameter)))
            .collect(),
    }
}

/// The likeliest points and as many evenly from the rest, so that not all lie on one hill.
fn likeliest(
    candidates: &mut Vec<Vec<f64>>,
    moved: &[Parameter],
    posterior: &mut Posterior,
) -> Vec<Vec<f64>> {
    let mut rated: Vec<(f64, Vec<f64>)> = candidates
        .drain(..)
        .map(|position| {
            let parameters = parameters(moved, posterior, &position);
            (posterior.ln_likelihood(&parameters), position)
        })
        .collect();
    rated.sort_by(|left, right| right.0.total_cmp(&left.0));
    let rest = rated.len().saturating_sub(CLIMBS / 2);
    let stride = (rest / (CLIMBS / 2)).max(1);
    let first = 0..rated.len().min(CLIMBS / 2);
    let others = (CLIMBS / 2..rated.len()).step_by(stride).take(CLIMBS / 2);
    first
        .chain(others)
        .map(|index| rated[index].1.clone())
        .collect()
}

/// A position of the posterior on the coordinates of the climb.
fn coordinates(moved: &[Parameter], posterior: &mut Posterior, position: &[f64]) -> Vec<f64> {
    let point = posterior.point(position);
    let funnel = posterior.funnel(&point.parameters);
    moved
        .iter()
        .map(|parameter| match parameter {
            Parameter::Theta => point.tau.ln() + funnel,
            Parameter::Lambda | Parameter::EtaGain | Parameter::EtaLoss => {
                point.parameters.get(*parameter).ln()
            }
            Parameter::Alpha | Parameter::Beta | Parameter::Gamma | Parameter::Delta => {
                point.parameters.get(*parameter).sqrt().asin()
            }
        })
        .collect()
}

/// The parameters at coordinates of the climb.
fn parameters(moved: &[Parameter], posterior: &mut Posterior, position: &[f64]) -> Parameters {
    // The largest logarithm of a sensitivity or loss aversion that is tried.
    const LARGEST_LN: f64 = 100.0;
    let bounded = |x: f64| x.clamp(-LARGEST_LN, LARGEST_LN).exp();
    let mut parameters = posterior.point(&vec![0.0; moved.len()]).parameters;
    let set = |parameters: Parameters, parameter, value: f64| {
        parameters
            .with(parameter, value)
            .expect("coordinates map into the ranges")
    };
    let mut sensitivity = 0.0;
    for (parameter, x) in moved.iter().zip(position) {
        match parameter {
            Parameter::Theta => sensitivity = *x,
            Parameter::Lambda | Parameter::EtaGain | Parameter::EtaLoss => {
                parameters = set(parameters, *parameter, bounded(*x));
            }
            Parameter::Alpha | Parameter::Beta | Parameter::Gamma | Parameter::Delta => {
                let exponent = x.sin().powi(2).clamp(SMALLEST_EXPONENT, 1.0);
                parameters = set(parameters, *parameter, exponent);
            }
        }
    }
    let parameters = posterior.complete(parameters);
    let tau = bounded(sensitivity - posterior.funnel(&parameters));
    let theta = (tau / posterior.reference_value(&parameters)).min(f64::MAX);
    set(parameters, Parameter::Theta, theta)
}

/// Point `index` of a lattice over the coordinates of the climb.
///
/// * `golden`: the generalised golden ratio of as many dimensions.
fn spread_point(moved: &[Parameter], golden: f64, index: usize) -> Vec<f64> {
    let mut slope = 1.0;
    moved
        .iter()
        .map(|parameter| {
            slope /= golden;
            let at = (0.5 + (index as f64 + 1.0) * slope).fract();
            match parameter {
                Parameter::Theta => -3.0 + 7.0 * at,
                Parameter::Lambda => -3.0 + 5.0 * at,
                Parameter::EtaGain | Parameter::EtaLoss => -1.0 + 2.0 * at,
                Parameter::Alpha | Parameter::Beta | Parameter::Gamma | Parameter::Delta => {
                    at * std::f64::consts::FRAC_PI_2
                }
            }
        })
        .collect()
}

/// The highest point of the posterior density on the sampler's coordinates, from the best of `points`.
fn posterior_mode(posterior: &mut Posterior, points: &[Vec<f64>]) -> Option<Optimum> {
    let mut rated: Vec<(f64, &Vec<f64>)> = points
        .iter()
        .map(|point| (posterior.ln_density(point), point))
        .collect();
    rated.sort_by(|left, right| right.0.total_cmp(&left.0));
    let starts: Vec<Vec<f64>> = rated
        .iter()
        .take(CLIMBS)
        .map(|(_, point)| (*point).clone())
        .collect();
    if starts.is_empty() || posterior.dimension() == 0 {
        return None;
    }
    Some(maximise(
        &mut |position| posterior.ln_density(position),
        &starts,
        STEP,
    ))
}
