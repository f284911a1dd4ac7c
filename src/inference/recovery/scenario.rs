//! One simulated study, fitted with the model that made its choices and with a rival.

use std::ops::ControlFlow;

use rand::RngExt;

use crate::inference::comparison::{ComparisonSettings, KnownFit, PlanData, Unit, compare_models};
use crate::inference::sampler::random_stream;
use crate::inference::simulated::{SimulatedFitError, SimulatedPerson};
use crate::inference::{
    ChoiceData, Fit, FitError, FitSettings, FittedProblem, Quantity, Source,
    default_reference_reward, fit, uninterrupted,
};
use crate::model::{ChoiceModel, Parameters};

/// A study to be simulated, and the models to be fitted to it.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// The model that people follow.
    pub model: &'static ChoiceModel,
    /// The model that they do not follow, and that is compared with it.
    pub rival: &'static ChoiceModel,
    /// The problems, each answered once by each person.
    pub problems: Vec<FittedProblem>,
    /// How many people take part.
    pub people: u64,
    /// Their parameters.
    pub truth: Truth,
    /// How both models are fitted; the seed is not used.
    pub settings: FitSettings,
}

/// The parameters of simulated people.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Truth {
    /// The same in every simulated study.
    Known(Parameters),
    /// Drawn from the prior, anew for every simulated study.
    Prior,
}

/// What one simulated study found.
#[derive(Debug, Clone, PartialEq)]
pub struct Replicate {
    /// What the model that people follow says about its parameters; missing if its chains have not converged.
    pub quantities: Option<Vec<RecoveredQuantity>>,
    /// ln of the Bayes factor of this model to its rival; missing unless both have converged.
    pub ln_bayes_factor: Option<f64>,
    /// Their difference when people are left out; missing unless both have converged, without these people too.
    pub score_gap: Option<ScoreGap>,
}

/// A quantity beside its true value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecoveredQuantity {
    /// The quantity.
    pub quantity: Quantity,
    /// Its true value.
    pub truth: f64,
    /// Posterior median.
    pub median: f64,
    /// Ends of the 90 % interval.
    pub interval: (f64, f64),
    /// Whether no choice depends on it, so that the posterior is the prior.
    pub is_prior: bool,
}

/// How much better the model that people follow predicts a person who was left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreGap {
    /// Difference in expected log predictive density, in nats; negative if the rival predicts better.
    pub value: f64,
    /// Whether it exceeds two standard errors, to either side.
    pub beyond_two_se: bool,
}

impl Scenario {
    /// Simulates and fits one study.
    ///
    /// A pure function of the scenario, the seed and the replicate's number; the replicates of a seed are independent.
    ///
    /// # Errors
    /// When nobody can be simulated, or the settings allow no fit.
    pub fn replicate(&self, seed: u64, number: u64) -> Result<Replicate, SimulatedFitError> {
        let mut rng = random_stream(seed, number);
        let reference_reward = match self.settings.reference_reward {
            Some(reward) => reward,
            None => default_reference_reward(&self.problems)?,
        };
        let person = match self.truth {
            Truth::Known(parameters) => SimulatedPerson::new(parameters, reference_reward),
            Truth::Prior => SimulatedPerson::from_prior(
                self.model,
                &self.settings.priors,
                reference_reward,
                &mut rng,
            ),
        };
        let options = self.model.options(self.settings.options);
        let data = person.choices(&self.problems, options, self.people, &mut rng)?;
        let settings = FitSettings {
            seed: rng.random(),
            reference_reward: Some(reference_reward),
            ..self.settings.clone()
        };
        let right = fit(self.model, &data, &settings, &mut uninterrupted)?;
        let wrong = fit(self.rival, &data, &settings, &mut uninterrupted)?;
        let quantities = right.summary.converged.then(|| recovered(&right, &person));
        let both = right.summary.converged && wrong.summary.converged;
        Ok(Replicate {
            quantities,
            ln_bayes_factor: ln_bayes_factor(&right, &wrong).filter(|_| both),
            score_gap: if both {
                score_gap(&data, right, wrong, &settings)?
            } else {
                None
            },
        })
    }
}

fn recovered(fit: &Fit, person: &SimulatedPerson) -> Vec<RecoveredQuantity> {
    let Some(summaries) = &fit.summary.parameters else {
        return Vec::new();
    };
    let columns = fit.draws.columns.iter();
    columns
        .filter_map(|(quantity, _)| {
            let summary = summaries.get(quantity.key())?;
            Some(RecoveredQuantity {
                quantity: *quantity,
                truth: person.get(*quantity),
                median: summary.q50,
                interval: (summary.q5, summary.q95),
                is_prior: summary.source == Source::Prior,
            })
        })
        .collect()
}

fn ln_bayes_factor(right: &Fit, wrong: &Fit) -> Option<f64> {
    let ln_evidence = |fit: &Fit| fit.summary.log_marginal_likelihood;
    Some(ln_evidence(right)?.value - ln_evidence(wrong)?.value)
}

/// Nothing where a person's score needed a fit without them that did not converge.
fn score_gap(
    data: &ChoiceData,
    right: Fit,
    wrong: Fit,
    settings: &FitSettings,
) -> Result<Option<ScoreGap>, FitError> {
    let plan = PlanData::whole(data, Unit::Participant);
    let models = [wrong.model, right.model];
    let known = [wrong, right].map(|fit| KnownFit {
        part: 0,
        fit: fit.into(),
    });
    let comparison = compare_models(
        &plan,
        &models,
        settings,
        &known,
        &ComparisonSettings::BRIEF,
        &mut |_| ControlFlow::Continue(()),
    )?;
    let trusted = comparison.models.iter().all(|(_, scores)| {
        let left_out = scores.leave_one_out.as_ref();
        left_out.is_some_and(|left_out| left_out.unconverged == 0)
    });
    // The later of the two models comes first in their pair.
    let gap = comparison.pairs.first().and_then(|pair| pair.leave_one_out);
    Ok(gap
        .filter(|gap| trusted && gap.difference.value.is_finite())
        .map(|gap| ScoreGap {
            value: gap.difference.value,
            beyond_two_se: gap.difference.beyond_two_se,
        }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::choice_data::tests::data;
    use crate::inference::recovery::Recovery;
    use crate::model::{EXPECTED_UTILITY, NOISY_RATIONAL, Parameter};

    fn scenario(theta: f64, people: u64) -> Scenario {
        let problems = data(&[
            (
                "cups",
                &[
                    ("stable", &[(1.0, 20.0)]),
                    ("unstable", &[(0.2, 105.0), (0.8, 0.0)]),
                ],
                &[0, 0],
            ),
            (
                "better",
                &[
                    ("stable", &[(1.0, 30.0)]),
                    ("unstable", &[(0.2, 105.0), (0.8, 0.0)]),
                ],
                &[0, 0],
            ),
        ]);
        Scenario {
            model: &NOISY_RATIONAL,
            rival: &EXPECTED_UTILITY,
            problems: problems.problems().to_vec(),
            people,
            truth: Truth::Known(Parameters::ONES.with(Parameter::Theta, theta).unwrap()),
            settings: FitSettings {
                draws: 250,
                ..FitSettings::default()
            },
        }
    }

    #[test]
    fn more_people_make_intervals_narrower() {
        let theta = Quantity::Parameter(Parameter::Theta);
        let widths = [10, 200].map(|people| {
            let scenario = scenario(0.1, people);
            let replicates: Vec<Replicate> = (0..8)
                .map(|number| scenario.replicate(2, number).unwrap())
                .collect();
            let recovery = Recovery::of(people, &replicates);
            assert_eq!(recovery.unconverged, 0);
            let found = recovery
                .quantities
                .iter()
                .find(|entry| entry.quantity == theta);
            let found = found.unwrap();
            assert!(
                found.bias.value.abs() < 5.0 * found.bias.se + 0.5,
                "{found:?}"
            );
            assert!(found.coverage.value > 0.5, "{found:?}");
            found.width.value
        });
        assert!(widths[1] < 0.7 * widths[0], "{widths:?}");
    }

    #[test]
    fn a_replicate_is_a_function_of_seed_and_number() {
        let scenario = scenario(0.1, 20);
        let first = scenario.replicate(1, 0).unwrap();
        assert_eq!(first, scenario.replicate(1, 0).unwrap());
        assert_ne!(first, scenario.replicate(1, 1).unwrap());
        let prior = Scenario {
            truth: Truth::Prior,
            ..scenario
        };
        let truths = [0, 1].map(|number| prior.replicate(1, number).unwrap().quantities.unwrap());
        assert_ne!(truths[0][0].truth, truths[1][0].truth);
    }
}
