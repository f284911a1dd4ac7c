//! The curves of a fit: how probabilities and rewards are felt, with bands of the posterior.

use serde::{Deserialize, Serialize};

use super::diagnostics::{mean, quantile};
use super::{Draws, Fit, FittedProblem};
use crate::model::{
    ChoiceModel, Outcome, Parameter, Parameters, Prospect, RiskAwareOptions, utilities, value,
    weight_spans, weights_of_spans,
};

/// Most draws of each fit that curves are made from, evenly over its chains.
const DRAWS: usize = 1000;

/// The same of a provisional fit, which is drawn while answers arrive and soon replaced. Curves take longer than a warm
/// refit; the ends of a 90 % band of so many draws are off by about a tenth of an sd.
const PROVISIONAL_DRAWS: usize = 200;

/// Steps of the grid of probabilities.
const PROBABILITY_STEPS: usize = 100;

/// Steps of the grid of rewards.
const REWARD_STEPS: usize = 80;

/// The posterior of one number: its mean, pointwise 50 % and 90 % intervals, and the mean before any choice was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Band {
    /// Posterior mean.
    pub mean: f64,
    /// 5 % quantile.
    pub q5: f64,
    /// 25 % quantile.
    pub q25: f64,
    /// 75 % quantile.
    pub q75: f64,
    /// 95 % quantile.
    pub q95: f64,
    /// Prior mean; the prior median for what is measured in logits, whose tail is so heavy that a mean says nothing.
    /// Missing if no prior draw has a value.
    pub prior: Option<f64>,
}

/// A function of one variable with its band at each point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// Where.
    pub x: Vec<f64>,
    /// What is known there: nothing if no posterior draw has a value.
    pub bands: Vec<Option<Band>>,
}

impl Curve {
    fn band(&self, index: usize) -> Option<&Band> {
        self.bands.get(index)?.as_ref()
    }
}

/// The decision weight of a risky outcome as a function of its true probability.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RiskyWeight {
    /// The outcome's reward.
    pub reward: f64,
    /// The reward that comes otherwise.
    pub otherwise: f64,
    /// Probabilities that occur in the problems.
    pub probabilities: Vec<f64>,
    /// Normalised decision weight over probability.
    pub curve: Curve,
}

/// How much better an action is than the sure one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ActionGap {
    /// The problem's id.
    pub problem: String,
    /// The action.
    pub action: String,
    /// The action it is compared with: the first sure one, or the first if none is.
    pub than: String,
    /// θ times the difference of utilities, in logits; missing if no posterior draw has one.
    pub logits: Option<Band>,
}

/// All curves of one model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curves {
    /// w⁺ over probability; missing if the model takes probabilities as they are.
    pub weighting_gains: Option<Curve>,
    /// w⁻ over probability.
    pub weighting_losses: Option<Curve>,
    /// Decision weights of risky outcomes, one per pair of rewards.
    pub risky_weights: Vec<RiskyWeight>,
    /// Whether γ counts through the normalisation of decision weights only, since no gain is above 0.
    pub gains_through_normalisation_only: bool,
    /// θ v(R) over reward, in logits: shows size.
    pub value_logits: Curve,
    /// v(R)/|v(R_ref)| over reward: shape only, ±1 at the reference reward in every draw.
    pub value_shape: Curve,
    /// Every action of every problem against the sure one.
    pub gaps: Vec<ActionGap>,
}

/// The curves of one or more fits of the same model, their draws pooled with equal weight.
///
/// * `problems`: those whose rewards and probabilities set the grids.
/// * `fits`: at least one; nothing is returned otherwise.
/// * `earlier`: curves of an earlier fit of the same model, problems and settings, if there is one. The prior, which
///   answers do not move, is taken over from them; that is half of the work.
pub fn curves(
    problems: &[FittedProblem],
    fits: &[&Fit],
    earlier: Option<&Curves>,
) -> Option<Curves> {
    let first = fits.first()?;
    let options = first.summary.options;
    let posterior: Vec<Parameters> = fits
        .iter()
        .flat_map(|fit| spread(&fit.draws, drawn(fit)))
        .collect();
    let prior: Vec<Parameters> = spread(&first.prior_draws, drawn(first));
    let sample = Sample { posterior, prior };
    let reference = first.reference_reward;

    let chances: Vec<f64> = (0..=PROBABILITY_STEPS)
        .map(|i| i as f64 / PROBABILITY_STEPS as f64)
        .collect();
    let rewards = reward_grid(problems);
    let weight = |known: Option<&Curve>, exponent: Parameter, elevation: Parameter| {
        is_weighted(first.model).then(|| {
            sample.curve(&chances, known, Centre::Mean, |p, person| {
                let function = options.weighting_function;
                function.weight(p, person.get(exponent), person.get(elevation))
            })
        })
    };
    let known_gains = earlier.and_then(|known| known.weighting_gains.as_ref());
    let known_losses = earlier.and_then(|known| known.weighting_losses.as_ref());
    let felt = |reward: f64, person: &Parameters| {
        let [alpha, beta, lambda] =
            [Parameter::Alpha, Parameter::Beta, Parameter::Lambda].map(|name| person.get(name));
        value(reward, alpha, beta, lambda)
    };
    Some(Curves {
        weighting_gains: weight(known_gains, Parameter::Gamma, Parameter::EtaGain),
        weighting_losses: weight(known_losses, Parameter::Delta, Parameter::EtaLoss),
        risky_weights: risky_weights(
            problems,
            &sample,
            &chances,
            earlier.map_or(&[], |known| &known.risky_weights),
            options,
        ),
        gains_through_normalisation_only: is_weighted(first.model)
            && options.normalise
            && rewards_of(problems).all(|reward| reward <= 0.0),
        value_logits: sample.curve(
            &rewards,
            earlier.map(|known| &known.value_logits),
            Centre::Median,
            |reward, person| person.get(Parameter::Theta) * felt(reward, person),
        ),
        value_shape: sample.curve(
            &rewards,
            earlier.map(|known| &known.value_shape),
            Centre::Mean,
            |reward, person| felt(reward, person) / felt(reference, person).abs(),
        ),
        gaps: gaps(
            problems,
            &sample,
            earlier.map_or(&[], |known| &known.gaps),
            options,
        ),
    })
}

fn is_weighted(model: &ChoiceModel) -> bool {
    model.is_free(Parameter::Gamma)
}

/// What stands for the prior.
#[derive(Clone, Copy)]
enum Centre {
    Mean,
    Median,
}

struct Sample {
    posterior: Vec<Parameters>,
    prior: Vec<Parameters>,
}

impl Sample {
    fn curve(
        &self,
        grid: &[f64],
        known: Option<&Curve>,
        centre: Centre,
        function: impl Fn(f64, &Parameters) -> f64,
    ) -> Curve {
        let bands = grid
            .iter()
            .enumerate()
            .map(|(index, x)| {
                let known = known.and_then(|known| known.band(index));
                self.band(known, centre, |person| function(*x, person))
            })
            .collect();
        Curve {
            x: grid.to_vec(),
            bands,
        }
    }

    /// The band of a number; `known` has the same prior.
    fn band(
        &self,
        known: Option<&Band>,
        centre: Centre,
        function: impl Fn(&Parameters) -> f64,
    ) -> Option<Band> {
        let sorted = |people: &[Parameters]| {
            let mut values = Vec::with_capacity(people.len());
            // A draw under which decision weights vanish has no value.
            values.extend(
                people
                    .iter()
                    .map(&function)
                    .filter(|value| value.is_finite()),
            );
            values.sort_unstable_by(f64::total_cmp);
            (!values.is_empty()).then_some(values)
        };
        let prior = || {
            sorted(&self.prior).map(|prior| match centre {
                Centre::Mean => mean(&prior),
                Centre::Median => quantile(&prior, 0.5),
            })
        };
        let posterior = sorted(&self.posterior)?;
        Some(Band {
            mean: mean(&posterior),
            q5: quantile(&posterior, 0.05),
            q25: quantile(&posterior, 0.25),
            q75: quantile(&posterior, 0.75),
            q95: quantile(&posterior, 0.95),
            prior: known.map_or_else(prior, |known| known.prior),
        })
    }
}

fn drawn(fit: &Fit) -> usize {
    if fit.summary.provisional {
        PROVISIONAL_DRAWS
    } else {
        DRAWS
    }
}

fn spread(draws: &Draws, most: usize) -> Vec<Parameters> {
    let stride = draws.len().div_ceil(most).max(1);
    (0..draws.len())
        .step_by(stride)
        .map(|draw| draws.parameters(draw))
        .collect()
}

fn rewards_of(problems: &[FittedProblem]) -> impl Iterator<Item = f64> {
    let actions = problems
        .iter()
        .flat_map(|problem| problem.problem.actions());
    actions
        .flat_map(|action| action.prospect.outcomes())
        .map(|outcome| outcome.reward)
}

/// From the worst to the best reward, nothing included.
fn reward_grid(problems: &[FittedProblem]) -> Vec<f64> {
    let low = rewards_of(problems).fold(0.0, f64::min);
    let high = rewards_of(problems).fold(0.0, f64::max);
    let mut grid: Vec<f64> = (0..=REWARD_STEPS)
        .map(|i| low + (high - low) * i as f64 / REWARD_STEPS as f64)
        .collect();
    // The kink at 0 must be a point of the grid.
    if !grid.contains(&0.0) {
        grid.push(0.0);
        grid.sort_by(f64::total_cmp);
    }
    grid
}

fn risky_weights(
    problems: &[FittedProblem],
    sample: &Sample,
    chances: &[f64],
    earlier: &[RiskyWeight],
    options: RiskAwareOptions,
) -> Vec<RiskyWeight> {
    let mut found: Vec<RiskyWeight> = Vec::new();
    for action in problems
        .iter()
        .flat_map(|problem| problem.problem.actions())
    {
        let [high, low] = action.prospect.outcomes() else {
            continue;
        };
        if action.prospect.is_sure() {
            continue;
        }
        let (risky, other) = if high.reward.abs() > low.reward.abs() {
            (high, low)
        } else {
            (low, high)
        };
        let known = found
            .iter_mut()
            .find(|w| w.reward == risky.reward && w.otherwise == other.reward);
        if let Some(known) = known {
            if !known.probabilities.contains(&risky.probability) {
                known.probabilities.push(risky.probability);
            }
            continue;
        }
        let known = earlier
            .iter()
            .find(|w| w.reward == risky.reward && w.otherwise == other.reward);
        let bands = chances.iter().enumerate().map(|(index, &p)| {
            let prospect = risky_prospect(p, risky.reward, other.reward)?;
            let outcomes = prospect.outcomes();
            let position = outcomes.iter().position(|o| o.reward == risky.reward)?;
            let spans = weight_spans(&prospect, options.zero);
            let known = known.and_then(|known| known.curve.band(index));
            sample.band(known, Centre::Mean, |person| {
                let weights = weights_of_spans(&spans, person, options);
                weights.map_or(f64::NAN, |weights| weights[position])
            })
        });
        let curve = Curve {
            x: chances.to_vec(),
            bands: bands.collect(),
        };
        found.push(RiskyWeight {
            reward: risky.reward,
            otherwise: other.reward,
            probabilities: vec![risky.probability],
            curve,
        });
    }
    found
}

fn risky_prospect(p: f64, reward: f64, otherwise: f64) -> Option<Prospect> {
    let outcomes = [
        Outcome {
            probability: p,
            reward,
        },
        Outcome {
            probability: 1.0 - p,
            reward: otherwise,
        },
    ];
    Prospect::new(outcomes).ok()
}

fn gaps(
    problems: &[FittedProblem],
    sample: &Sample,
    earlier: &[ActionGap],
    options: RiskAwareOptions,
) -> Vec<ActionGap> {
    let mut gaps = Vec::new();
    for FittedProblem { id, problem } in problems {
        let sure = problem
            .actions()
            .iter()
            .position(|action| action.prospect.is_sure())
            .unwrap_or(0);
        for (index, action) in problem
            .actions()
            .iter()
            .enumerate()
            .filter(|(index, _)| *index != sure)
        {
            // The problems are the same, so the gaps stand in the same order.
            let known = earlier.get(gaps.len()).and_then(|gap| gap.logits.as_ref());
            let logits = sample.band(known, Centre::Median, |person| {
                let found = utilities(problem, person, options);
                let difference = found.map(|utilities| utilities[index] - utilities[sure]);
                difference.map_or(f64::NAN, |gap| person.get(Parameter::Theta) * gap)
            });
            gaps.push(ActionGap {
                problem: id.clone(),
                action: action.name.clone(),
                than: problem.actions()[sure].name.clone(),
                logits,
            });
        }
    }
    gaps
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A band of nothing is nothing: a 0 would look like a finding.
    #[test]
    fn draws_without_a_value_make_no_band() {
        let person = Parameters::ONES;
        let sample = Sample {
            posterior: vec![person],
            prior: vec![person],
        };
        assert_eq!(sample.band(None, Centre::Mean, |_| f64::NAN), None);
    }
}
