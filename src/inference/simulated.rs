//! Simulated people: parameters from the prior, and the choices that they make.

use std::collections::BTreeMap;

use rand::{Rng, RngExt};

use super::{
    ChoiceData, ChoiceDataError, FitError, FittedProblem, Group, Priors, Quantity,
    ReferenceRewardError,
};
use crate::model::{
    ChoiceError, ChoiceModel, ChoiceProblem, Parameter, Parameters, RiskAwareOptions,
    probabilities, value,
};

/// A person as a model sees one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedPerson {
    /// The parameters; those that the model does not learn are 1, or follow from others.
    pub parameters: Parameters,
    /// τ = θ |v(R_ref)|, sensitivity in logits.
    pub tau: f64,
}

impl SimulatedPerson {
    /// A person with known parameters.
    ///
    /// * `reference_reward`: R_ref, the signed reward that gives τ its unit; not 0.
    pub fn new(parameters: Parameters, reference_reward: f64) -> Self {
        Self {
            parameters,
            tau: parameters.get(Parameter::Theta) * reference_value(&parameters, reference_reward),
        }
    }

    /// A person drawn from the prior of a model, each parameter by the inverse of its distribution function.
    ///
    /// ```text
    /// θ = τ / |v(R_ref)|
    /// ```
    ///
    /// This shares no code with the coordinates that a fit moves on, so that the two can be held against each other.
    ///
    /// * `reference_reward`: R_ref, the signed reward that gives τ its unit; not 0.
    pub fn from_prior(
        model: &ChoiceModel,
        priors: &Priors,
        reference_reward: f64,
        rng: &mut impl Rng,
    ) -> Self {
        let mut draw = |parameter| {
            // Neither end of the open interval may be hit.
            let at = rng.random::<f64>().clamp(1e-15, 1.0 - 1e-15);
            priors.of(parameter).quantile(at).max(f64::MIN_POSITIVE)
        };
        let with = |parameters: Parameters, parameter, value| {
            parameters
                .with(parameter, value)
                .expect("priors stay within the range of their parameter")
        };
        let mut parameters = Parameters::ONES;
        let mut tau = 1.0;
        for &parameter in model.parameters {
            let value = draw(parameter);
            if parameter == Parameter::Theta {
                tau = value;
            } else {
                parameters = with(parameters, parameter, value);
            }
        }
        let parameters = model.complete(parameters);
        let theta = (tau / reference_value(&parameters, reference_reward)).min(f64::MAX);
        Self {
            parameters: with(parameters, Parameter::Theta, theta),
            tau,
        }
    }

    /// The true value of a quantity that a fit reports.
    pub fn get(&self, quantity: Quantity) -> f64 {
        match quantity {
            Quantity::Parameter(parameter) => self.parameters.get(parameter),
            Quantity::Tau => self.tau,
            Quantity::LambdaTheta => {
                self.parameters.get(Parameter::Lambda) * self.parameters.get(Parameter::Theta)
            }
        }
    }

    /// What `people` like this one choose, each of them answering every problem once.
    ///
    /// People with the same answers make one group.
    ///
    /// * `options`: those of the [model](ChoiceModel::options) that the person follows.
    ///
    /// # Errors
    /// When the model gives no probabilities for a problem, or the problems are none.
    pub fn choices(
        &self,
        problems: &[FittedProblem],
        options: RiskAwareOptions,
        people: u64,
        rng: &mut impl Rng,
    ) -> Result<ChoiceData, SimulationError> {
        let mut shares = Vec::with_capacity(problems.len());
        for FittedProblem { id, problem } in problems {
            let probabilities =
                probabilities(problem, &self.parameters, options).map_err(|source| {
                    SimulationError::Choice {
                        problem: id.clone(),
                        source,
                    }
                })?;
            shares.push(probabilities);
        }
        let mut patterns: BTreeMap<Vec<usize>, u64> = BTreeMap::new();
        for _ in 0..people {
            let answers = shares.iter().map(|shares| choose(shares, rng)).collect();
            *patterns.entry(answers).or_default() += 1;
        }
        let group = |(answers, weight): (Vec<usize>, u64)| Group {
            weight,
            counts: answers
                .iter()
                .zip(&shares)
                .map(|(answer, shares)| {
                    let mut counts = vec![0; shares.len()];
                    counts[*answer] = 1;
                    counts
                })
                .collect(),
        };
        let groups = patterns.into_iter().map(group).collect();
        Ok(ChoiceData::new(problems.to_vec(), groups)?)
    }
}

/// |v(R_ref)|.
fn reference_value(parameters: &Parameters, reference_reward: f64) -> f64 {
    let [alpha, beta, lambda] =
        [Parameter::Alpha, Parameter::Beta, Parameter::Lambda].map(|name| parameters.get(name));
    value(reference_reward, alpha, beta, lambda).abs()
}

/// The position of the action that a person chooses, drawn with the probabilities of the model.
///
/// * `options`: those of the [model](ChoiceModel::options) that the person follows.
///
/// # Errors
/// When the model gives no probabilities.
pub fn draw_action(
    problem: &ChoiceProblem,
    parameters: &Parameters,
    options: RiskAwareOptions,
    rng: &mut impl Rng,
) -> Result<usize, ChoiceError> {
    Ok(choose(&probabilities(problem, parameters, options)?, rng))
}

/// One answer: an action's position, drawn with the actions' probabilities.
fn choose(probabilities: &[f64], rng: &mut impl Rng) -> usize {
    let mut left = rng.random::<f64>();
    for (action, probability) in probabilities.iter().enumerate() {
        left -= probability;
        if left < 0.0 {
            return action;
        }
    }
    // Probabilities sum to 1 but for rounding.
    probabilities.len() - 1
}

/// Why nobody could be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// The model does not say what the person would do.
    #[error("problem `{problem}`: {source}")]
    Choice {
        /// The problem's id.
        problem: String,
        /// Why.
        source: ChoiceError,
    },
    /// The problems make no data.
    #[error(transparent)]
    Data(#[from] ChoiceDataError),
}

/// Why a study of simulated people was not fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulatedFitError {
    /// Nobody could be simulated, or a draw gives no probabilities.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// There is no reference reward.
    #[error(transparent)]
    ReferenceReward(#[from] ReferenceRewardError),
    /// There is no fit.
    #[error(transparent)]
    Fit(#[from] FitError),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::choice_data::tests::data;
    use crate::inference::sampler::random_stream;
    use crate::model::MODELS;

    #[test]
    fn people_follow_their_probabilities_and_answer_everything_once() {
        let problems = data(&[
            (
                "coin",
                &[("a", &[(1.0, 2.0)]), ("b", &[(1.0, 2.0)])],
                &[0, 0],
            ),
            (
                "clear",
                &[("a", &[(1.0, 9.0)]), ("b", &[(1.0, 1.0)])],
                &[0, 0],
            ),
        ]);
        let person =
            SimulatedPerson::new(Parameters::ONES.with(Parameter::Theta, 0.25).unwrap(), 9.0);
        let mut rng = random_stream(5, 0);
        let options = RiskAwareOptions::default();
        let choices = person
            .choices(problems.problems(), options, 4000, &mut rng)
            .unwrap();
        let weights: u64 = choices.groups().iter().map(|group| group.weight).sum();
        assert_eq!((weights, choices.n()), (4000, 8000));
        assert!(choices.groups().len() <= 4);
        for (totals, share) in choices
            .totals()
            .iter()
            .zip([0.5, 1.0 / (1.0 + (-2.0_f64).exp())])
        {
            let found = totals[0] as f64 / 4000.0;
            let error = (share * (1.0 - share) / 4000.0).sqrt();
            assert!((found - share).abs() < 4.0 * error, "{found} {share}");
        }
    }

    /// Under the prior every parameter's distribution function is uniform, whatever the model.
    #[test]
    fn people_come_from_the_prior() {
        let priors = Priors::default();
        for model in MODELS {
            let mut rng = random_stream(6, 0);
            let people: Vec<SimulatedPerson> = (0..2000)
                .map(|_| SimulatedPerson::from_prior(model, &priors, -500.0, &mut rng))
                .collect();
            for parameter in model.parameters {
                let prior = priors.of(*parameter);
                for at in [0.1, 0.5, 0.9] {
                    let below = people.iter().filter(|person| {
                        let found = match parameter {
                            Parameter::Theta => person.tau,
                            other => person.parameters.get(*other),
                        };
                        found < prior.quantile(at)
                    });
                    let share = below.count() as f64 / 2000.0;
                    let error = (at * (1.0 - at) / 2000.0_f64).sqrt();
                    assert!(
                        (share - at).abs() < 4.0 * error,
                        "{parameter}: {share} {at}"
                    );
                }
            }
            for person in people {
                let again = SimulatedPerson::new(person.parameters, -500.0);
                assert!((again.tau / person.tau - 1.0).abs() < 1e-9);
            }
        }
    }
}
