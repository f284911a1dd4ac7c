//! One simulated study: a person from the prior, their choices, a fit, the rank of the truth.

use std::fmt;

use rand::{Rng, RngExt};

use crate::inference::sampler::random_stream;
use crate::inference::simulated::{SimulatedFitError, SimulatedPerson, SimulationError};
use crate::inference::{
    ChoiceData, FitSettings, FittedProblem, Priors, Quantity, default_reference_reward, fit,
    uninterrupted,
};
use crate::model::{ChoiceModel, ChoiceProblem, Parameters, RiskAwareOptions, ln_probabilities};

/// A design and a model to be calibrated on it.
#[derive(Debug, Clone)]
pub struct Experiment {
    /// The model that people follow and that is fitted.
    pub model: &'static ChoiceModel,
    /// The problems.
    pub problems: Vec<FittedProblem>,
    /// How many people answer each problem.
    pub people: u64,
    /// Where the people come from: the priors of `settings`, unless a wrong fit is to be shown up.
    pub priors: Priors,
    /// Where its random streams begin, so that experiments of one seed do not share their people; replicates count up
    /// from here.
    pub first_stream: u64,
    /// How each fit is made; its `samples` are the draws that the truth is ranked among, its seed is not used.
    pub settings: FitSettings,
}

/// A quantity with a true value in every simulated study.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RankedQuantity {
    /// A quantity that fits report.
    Reported(Quantity),
    /// The probability of the first action of a problem.
    Predicted {
        /// The problem's id.
        problem: String,
        /// The action.
        action: String,
    },
    /// The logarithm of the likelihood of the choices, which depends on data and parameters together.
    LnLikelihood,
}

impl fmt::Display for RankedQuantity {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reported(quantity) => quantity.fmt(formatter),
            Self::Predicted { problem, action } => write!(formatter, "P({action}) in {problem}"),
            Self::LnLikelihood => formatter.write_str("ln likelihood"),
        }
    }
}

/// What one simulated study says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Replicate {
    /// The rank of each quantity's true value among the draws, from 0 to their number.
    pub ranks: Vec<(RankedQuantity, usize)>,
    /// Whether the chains of the fit converged.
    pub converged: bool,
}

impl Experiment {
    /// How many values a rank can have: one more than there are draws.
    pub fn rank_values(&self) -> usize {
        self.settings.samples + 1
    }

    /// The ranks of one simulated study.
    ///
    /// A pure function of the experiment, the seed and the replicate's number; the replicates of a seed are independent.
    ///
    /// # Errors
    /// When nobody can be simulated, the settings allow no fit, or a draw gives no probabilities.
    pub fn replicate(&self, seed: u64, number: u64) -> Result<Replicate, SimulatedFitError> {
        let mut rng = random_stream(seed, self.first_stream + number);
        let options = self.model.options(self.settings.options);
        let reference_reward = match self.settings.reference_reward {
            Some(reward) => reward,
            None => default_reference_reward(&self.problems)?,
        };
        let person =
            SimulatedPerson::from_prior(self.model, &self.priors, reference_reward, &mut rng);
        let data = person.choices(&self.problems, options, self.people, &mut rng)?;
        let settings = FitSettings {
            seed: rng.random(),
            reference_reward: Some(reference_reward),
            ..self.settings.clone()
        };
        let fit = fit(self.model, &data, &settings, &mut uninterrupted)?;

        let mut ranks = Vec::new();
        for (quantity, values) in &fit.draws.columns {
            let draws = fit.sample_indices.iter().map(|index| values[*index]);
            let rank = rank(person.get(*quantity), draws, &mut rng);
            ranks.push((RankedQuantity::Reported(*quantity), rank));
        }
        let truth = derived(&data, &person.parameters, options)?;
        let mut draws = Vec::with_capacity(fit.sample_indices.len());
        for index in &fit.sample_indices {
            draws.push(derived(&data, &fit.draws.parameters(*index), options)?);
        }
        for (place, (quantity, value)) in truth.into_iter().enumerate() {
            let rank = rank(value, draws.iter().map(|draw| draw[place].1), &mut rng);
            ranks.push((quantity, rank));
        }
        Ok(Replicate {
            ranks,
            converged: fit.summary.converged,
        })
    }
}

/// ln P of the first action of every distinct problem, and ln L.
fn derived(
    data: &ChoiceData,
    parameters: &Parameters,
    options: RiskAwareOptions,
) -> Result<Vec<(RankedQuantity, f64)>, SimulatedFitError> {
    let mut values = Vec::new();
    let mut seen: Vec<&ChoiceProblem> = Vec::new();
    let mut ln_likelihood = 0.0;
    for (FittedProblem { id, problem }, counts) in data.problems().iter().zip(data.totals()) {
        let ln_p = ln_probabilities(problem, parameters, options).map_err(|source| {
            SimulationError::Choice {
                problem: id.clone(),
                source,
            }
        })?;
        let chosen = counts.iter().zip(&ln_p).filter(|(count, _)| **count > 0);
        ln_likelihood += chosen
            .map(|(count, ln_p)| *count as f64 * ln_p)
            .sum::<f64>();
        if !seen.contains(&problem) {
            seen.push(problem);
            let quantity = RankedQuantity::Predicted {
                problem: id.clone(),
                action: problem.actions()[0].name.clone(),
            };
            values.push((quantity, ln_p[0]));
        }
    }
    values.push((RankedQuantity::LnLikelihood, ln_likelihood));
    Ok(values)
}

/// How many draws lie below the truth; each that equals it does so by the toss of a coin that all of them share: the
/// truth takes a random place among its equals.
pub fn rank(truth: f64, draws: impl IntoIterator<Item = f64>, rng: &mut impl Rng) -> usize {
    let (mut below, mut equal) = (0, 0);
    for draw in draws {
        below += usize::from(draw < truth);
        equal += usize::from(draw == truth);
    }
    below + rng.random_range(0..=equal)
}

#[cfg(test)]
mod tests {
    use rand_distr::{Beta, Distribution};

    use super::*;
    use crate::inference::calibration::UniformRanks;
    use crate::inference::choice_data::tests::data;
    use crate::model::NOISY_RATIONAL;

    /// Shares from Uniform(0, 1), counts from Binomial(n, share), ranks among draws of Beta(k + 1, n − k + 1), where
    /// `seen` says what the posterior is told of k and n.
    fn beta_binomial(seed: u64, seen: impl Fn(u32) -> u32) -> Vec<usize> {
        const N: u32 = 20;
        let mut rng = random_stream(seed, 0);
        let mut replicate = |_| {
            let share: f64 = rng.random();
            let count = (0..N).filter(|_| rng.random::<f64>() < share).count() as u32;
            let (count, n) = (seen(count), seen(N));
            let posterior = Beta::new(f64::from(count + 1), f64::from(n - count + 1)).unwrap();
            let draws: Vec<f64> = (0..63).map(|_| posterior.sample(&mut rng)).collect();
            rank(share, draws, &mut rng)
        };
        (0..600).map(&mut replicate).collect()
    }

    #[test]
    fn a_conjugate_posterior_is_calibrated_and_one_of_half_the_counts_is_not() {
        let uniform = UniformRanks::new(600, 64);
        for seed in 1..=3 {
            let right = beta_binomial(seed, |count| count);
            assert!(
                uniform.p_value(&right) > 0.01,
                "{}",
                uniform.p_value(&right)
            );
            let halved = beta_binomial(seed, |count| count / 2);
            assert!(uniform.p_value(&halved) < 1e-3);
        }
    }

    #[test]
    fn the_truth_takes_a_random_place_among_its_equals() {
        let mut rng = random_stream(3, 0);
        assert_eq!(rank(2.0, [1.0, 3.0, 1.5], &mut rng), 2);
        let mut seen = [0; 4];
        for _ in 0..4000 {
            seen[rank(0.0, [0.0, -0.0, 1.0, -1.0, 0.0], &mut rng) - 1] += 1;
        }
        let error = (1000.0 * 0.75_f64).sqrt();
        assert!(
            seen.iter()
                .all(|count| (f64::from(*count) - 1000.0).abs() < 4.0 * error),
            "{seen:?}"
        );
    }

    fn cups(people: u64, priors: Priors) -> Experiment {
        let cups = data(&[(
            "cups",
            &[
                ("stable", &[(1.0, 20.0)]),
                ("unstable", &[(0.2, 105.0), (0.8, 0.0)]),
            ],
            &[0, 0],
        )]);
        Experiment {
            model: &NOISY_RATIONAL,
            problems: cups.problems().to_vec(),
            people,
            priors,
            first_stream: 0,
            settings: FitSettings {
                draws: 250,
                samples: 15,
                ..FitSettings::default()
            },
        }
    }

    fn ranks(experiment: &Experiment, wanted: &RankedQuantity, count: u64) -> Vec<usize> {
        let rank = |number| {
            let replicate = experiment.replicate(4, number).unwrap();
            let found = replicate
                .ranks
                .iter()
                .find(|(quantity, _)| quantity == wanted);
            found.unwrap().1
        };
        (0..count).map(rank).collect()
    }

    #[test]
    fn a_fit_with_another_prior_than_the_peoples_is_noticed() {
        let narrow = Priors {
            tau: crate::inference::Prior::LogNormal {
                median: 1.0,
                log_sd: 0.3,
            },
            ..Priors::default()
        };
        let tau = RankedQuantity::Reported(Quantity::Tau);
        let uniform = UniformRanks::new(40, 16);
        let right = ranks(&cups(10, Priors::default()), &tau, 40);
        assert!(uniform.p_value(&right) > 0.01, "{right:?}");
        let wrong = ranks(&cups(10, narrow), &tau, 40);
        assert!(uniform.p_value(&wrong) < 1e-3, "{wrong:?}");
    }

    #[test]
    fn a_replicate_is_a_function_of_seed_and_number() {
        let experiment = cups(50, Priors::default());
        let first = experiment.replicate(1, 0).unwrap();
        assert_eq!(first, experiment.replicate(1, 0).unwrap());
        let names: Vec<String> = first
            .ranks
            .iter()
            .map(|(name, _)| name.to_string())
            .collect();
        assert_eq!(
            names,
            ["theta", "tau", "P(stable) in cups", "ln likelihood"]
        );
        let others: Vec<Replicate> = (1..5)
            .map(|number| experiment.replicate(1, number).unwrap())
            .collect();
        assert!(others.iter().any(|other| *other != first));
    }
}
