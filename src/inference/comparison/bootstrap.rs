//! How estimates vary if other people of the same kind had taken part.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use rand_chacha::ChaCha12Rng;
use rand_distr::{Binomial, Distribution};
use serde::{Deserialize, Serialize};

use super::leave_one_out::relative_efficiency;
use super::pareto::{shape_threshold, smooth};
use super::plan::{Part, PlanData};
use super::pointwise::PartFit;
use crate::inference::diagnostics::{ESS_LIMIT, quantile};
use crate::inference::sampler::{random_stream, streams};
use crate::inference::{ChoiceData, FitError, fit};
use crate::model::OrderedMap;

/// How people are drawn anew for fits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BootstrapSettings {
    /// How often; 200 by default.
    pub resamples: usize,
    /// Random seed.
    pub seed: u64,
}

impl Default for BootstrapSettings {
    fn default() -> Self {
        Self {
            resamples: 200,
            seed: 1,
        }
    }
}

/// The spread of posterior medians and predicted shares over people drawn anew.
///
/// A pooled fit takes a person's answers for independent, which they are not, so its posterior may be too narrow. Each
/// resample draws as many people as there are, with replacement and with all their answers, and takes the posterior of
/// theirs. Where this interval is wider than the posterior's, it is to be believed. Where it is narrower it is not: a
/// median that prior or bounds hold in place hardly moves with the people, however little they say of it.
///
/// The posterior of a resample comes from the draws at hand, weighted by the ratio of likelihoods with Pareto smoothing,
/// if k̂ and the effective sample size allow it; else, as for most resamples of a model with many parameters, from a fit
/// of its own. Highest points of the likelihood would be cheaper, but lie at the ends of the ranges or nowhere where
/// choices say little, and are not what is reported elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Bootstrap {
    /// How often people were drawn.
    pub resamples: usize,
    /// How many resamples were fitted; the others weight the draws at hand.
    pub refitted: usize,
    /// How many were left out because that fit did not converge.
    pub left_out: usize,
    /// Of the posterior median of each quantity.
    #[schema(value_type = HashMap<String, ResampledInterval>)]
    pub parameters: OrderedMap<ResampledInterval>,
    /// Of the predicted share of each action of each problem.
    #[schema(value_type = HashMap<String, HashMap<String, ResampledInterval>>)]
    pub predicted: OrderedMap<OrderedMap<ResampledInterval>>,
}

/// The middle 90 % over resamples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ResampledInterval {
    /// 5 % quantile; missing if no resample could be used.
    pub q5: Option<f64>,
    /// 95 % quantile.
    pub q95: Option<f64>,
}

/// Estimates of one resample.
#[derive(Debug, Clone)]
struct Estimates {
    medians: Vec<f64>,
    shares: Vec<Vec<f64>>,
    refitted: bool,
}

/// Resampled intervals of one model in one part, beside the posterior's.
///
/// * `part`: position in the plan; `fit`: of all its answers.
///
/// Every model and part sees the same resamples.
///
/// # Errors
/// As [`fit`](crate::inference::fit()).
pub fn participant_bootstrap(
    plan: &PlanData,
    part: usize,
    fit: &PartFit,
    settings: &BootstrapSettings,
    watch: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Bootstrap, FitError> {
    let part = &plan.parts()[part];
    let columns = fit.ln_likelihoods(part.data().problems(), part.patterns());
    // What matters of a resample is the sum of its answers, and small studies repeat them.
    let mut known: BTreeMap<Vec<Vec<u64>>, Option<Estimates>> = BTreeMap::new();
    let mut found = Vec::with_capacity(settings.resamples);
    let mut rng = random_stream(settings.seed, streams::BOOTSTRAP);
    for _ in 0..settings.resamples {
        if watch().is_break() {
            return Err(FitError::Stopped);
        }
        let weights = drawn_weights(plan, part, &mut rng);
        let data = resampled(part, &weights);
        let estimates = match known.get(data.totals()) {
            Some(estimates) => estimates.clone(),
            None => {
                let weighted = weighted_estimates(part, fit, &columns, &weights);
                let estimates = match weighted {
                    Some(estimates) => Some(estimates),
                    None => refitted_estimates(&data, fit, watch)?,
                };
                known.insert(data.totals().to_vec(), estimates.clone());
                estimates
            }
        };
        found.push(estimates);
    }
    let used: Vec<&Estimates> = found.iter().flatten().collect();
    let interval = |value: &dyn Fn(&Estimates) -> f64| {
        let all = used.iter().map(|estimates| value(estimates));
        let mut values: Vec<f64> = all.filter(|value| !value.is_nan()).collect();
        values.sort_by(f64::total_cmp);
        let at = |probability| (!values.is_empty()).then(|| quantile(&values, probability));
        ResampledInterval {
            q5: at(0.05),
            q95: at(0.95),
        }
    };
    let quantities = fit.draws.columns.iter().enumerate();
    let problems = part.data().problems().iter().enumerate();
    Ok(Bootstrap {
        resamples: settings.resamples,
        refitted: used.iter().filter(|estimates| estimates.refitted).count(),
        left_out: found.len() - used.len(),
        parameters: quantities
            .map(|(place, (quantity, _))| {
                let of_medians = interval(&|estimates| estimates.medians[place]);
                (quantity.key().to_owned(), of_medians)
            })
            .collect(),
        predicted: problems
            .map(|(place, problem)| {
                let shares = problem.problem.names().enumerate().map(|(action, name)| {
                    let of_shares = interval(&|estimates| estimates.shares[place][action]);
                    (name.to_owned(), of_shares)
                });
                (problem.id.clone(), shares.collect())
            })
            .collect(),
    })
}

/// How many units of each of the part's patterns are drawn, out of as many units as the plan has.
fn drawn_weights(plan: &PlanData, part: &Part, rng: &mut ChaCha12Rng) -> Vec<u64> {
    let mut drawn = vec![0; part.patterns().len()];
    let mut rest = plan.units();
    let mut left = rest;
    for (pattern, own) in plan.patterns().iter().zip(part.membership()) {
        // A multinomial is a chain of binomials, each of what the earlier ones left.
        let share = pattern.weight as f64 / rest as f64;
        let count = Binomial::new(left, share.min(1.0))
            .expect("a share lies between 0 and 1")
            .sample(rng);
        rest -= pattern.weight;
        left -= count;
        if let Some(own) = own {
            drawn[*own] += count;
        }
    }
    drawn
}

fn resampled(part: &Part, weights: &[u64]) -> ChoiceData {
    let data = part.data();
    let mut counts: Vec<Vec<u64>> = data.totals().iter().map(|row| vec![0; row.len()]).collect();
    for (pattern, weight) in part.patterns().iter().zip(weights) {
        for answers in &pattern.answers {
            counts[answers.problem][answers.action] += weight * answers.count;
        }
    }
    ChoiceData::from_counts(data.problems().to_vec(), counts)
        .expect("as many people as before leave data valid")
}

/// Estimates from weighted draws; nothing where the weights cannot be trusted.
///
/// ```text
/// ln w(draw) = Σ_patterns (drawn − weight) ln p(y | draw)
/// ```
fn weighted_estimates(
    part: &Part,
    fit: &PartFit,
    columns: &[Vec<f64>],
    drawn: &[u64],
) -> Option<Estimates> {
    let mut ln_ratios = vec![0.0; fit.draws.len()];
    for ((pattern, drawn), column) in part.patterns().iter().zip(drawn).zip(columns) {
        let more = *drawn as f64 - pattern.weight as f64;
        if more != 0.0 {
            for (ratio, ln_l) in ln_ratios.iter_mut().zip(column) {
                *ratio += more * ln_l;
            }
        }
    }
    if ln_ratios.iter().any(|ratio| !ratio.is_finite()) {
        return None;
    }
    let efficiency = relative_efficiency(fit, &ln_ratios);
    let smoothed = smooth(&ln_ratios, efficiency);
    let weights: Vec<f64> = smoothed.ln_weights.iter().map(|ln_w| ln_w.exp()).collect();
    // Draws of a chain repeat each other, so fewer count than their weights say.
    let effective = efficiency / weights.iter().map(|weight| weight * weight).sum::<f64>();
    if !is_trusted(smoothed.shape, weights.len(), effective) {
        return None;
    }
    let medians = fit.draws.columns.iter();
    Some(Estimates {
        medians: medians
            .map(|(_, values)| weighted_median(values, &weights))
            .collect(),
        shares: fit.weighted_probabilities(part.data().problems(), &weights),
        refitted: false,
    })
}

/// Whether weighted draws may stand for a fit; not if k̂ or the effective sample size is not a number.
fn is_trusted(shape: f64, draws: usize, effective: f64) -> bool {
    shape <= shape_threshold(draws) && effective >= ESS_LIMIT
}

fn refitted_estimates(
    data: &ChoiceData,
    known: &PartFit,
    watch: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Option<Estimates>, FitError> {
    let refit: PartFit = fit(known.model, data, &known.settings(), &mut |_| watch())?.into();
    if !refit.summary.converged {
        return Ok(None);
    }
    let median = |values: &[f64]| {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        quantile(&sorted, 0.5)
    };
    // A resample may say nothing of a parameter that the answers at hand speak of, and then names other quantities.
    let medians = known.draws.columns.iter().map(|(quantity, _)| {
        let column = refit.draws.column(*quantity);
        column.map_or(f64::NAN, median)
    });
    Ok(Some(Estimates {
        medians: medians.collect(),
        shares: refit.mean_probabilities(data.problems()),
        refitted: true,
    }))
}

/// The smallest value with half of the weight at or below it.
fn weighted_median(values: &[f64], weights: &[f64]) -> f64 {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|left, right| values[*left].total_cmp(&values[*right]));
    let mut below = 0.0;
    for place in order {
        below += weights[place];
        if below >= 0.5 {
            return values[place];
        }
    }
    f64::NAN
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::choice_data::tests::data;
    use crate::inference::comparison::Unit;
    use crate::inference::{ChoiceData, FitSettings, FittedProblem, Group, uninterrupted};
    use crate::model::{ChoiceProblem, NOISY_RATIONAL};

    const SURE: &[(f64, f64)] = &[(1.0, 20.0)];
    const RISKY: &[(f64, f64)] = &[(0.2, 105.0), (0.8, 0.0)];

    fn bootstrapped(data: &ChoiceData, unit: Unit) -> Bootstrap {
        let plan = PlanData::whole(data, unit);
        let settings = FitSettings::default();
        let found = fit(&NOISY_RATIONAL, data, &settings, &mut uninterrupted).unwrap();
        let wanted = BootstrapSettings {
            resamples: 400,
            seed: 2,
        };
        participant_bootstrap(&plan, 0, &found.into(), &wanted, &mut || {
            ControlFlow::Continue(())
        })
        .unwrap()
    }

    fn width(interval: ResampledInterval) -> f64 {
        interval.q95.unwrap() - interval.q5.unwrap()
    }

    /// Twenty people who answer one way all ten times say less than two hundred people who answer once: √10 wider.
    #[test]
    fn repeated_answers_of_a_person_widen_the_interval() {
        let problem = FittedProblem {
            id: "cups".to_owned(),
            problem: ChoiceProblem::from_outcomes([("sure", SURE), ("risky", RISKY)]).unwrap(),
        };
        let group = |weight, counts: [u64; 2]| Group {
            weight,
            counts: vec![counts.to_vec()],
        };
        let groups = vec![group(6, [10, 0]), group(14, [0, 10])];
        let people = ChoiceData::new(vec![problem], groups).unwrap();
        let dependent = bootstrapped(&people, Unit::Participant);
        let independent = bootstrapped(&people, Unit::Answer);
        let share = |found: &Bootstrap| {
            let shares = found.predicted.get("cups").unwrap();
            width(*shares.get("risky").unwrap())
        };
        // sd √(0.3 · 0.7/200) = 0.032, the middle 90 % 3.29 sd wide, a little less as the prior pulls.
        assert!(
            (share(&independent) - 0.107).abs() < 0.03,
            "{independent:?}"
        );
        let ratio = share(&dependent) / share(&independent);
        assert!((2.2..3.8).contains(&ratio), "{ratio}");
        assert_eq!((dependent.left_out, dependent.resamples), (0, 400));
        assert!(independent.refitted < 100, "{}", independent.refitted);
        assert!(width(*dependent.parameters.get("theta").unwrap()) > 0.0);
    }

    #[test]
    fn as_many_units_are_drawn_as_there_are() {
        let data = data(&[("one", &[("sure", SURE), ("risky", RISKY)], &[13, 29])]);
        let plan = PlanData::whole(&data, Unit::Answer);
        let mut rng = random_stream(1, streams::BOOTSTRAP);
        for _ in 0..50 {
            let drawn = drawn_weights(&plan, &plan.parts()[0], &mut rng);
            assert_eq!(drawn.iter().sum::<u64>(), 42);
        }
    }

    #[test]
    fn weights_without_a_shape_are_not_trusted() {
        assert!(is_trusted(0.5, 4000, 1000.0));
        assert!(!is_trusted(f64::NAN, 4000, 1000.0));
        assert!(!is_trusted(0.5, 4000, f64::NAN));
        assert!(!is_trusted(0.8, 4000, 1000.0) && !is_trusted(0.5, 4000, 300.0));
    }

    /// Chains that stand still for a hundred draws hold a hundredth of them.
    #[test]
    fn repeated_draws_are_not_counted() {
        let data = data(&[("one", &[("sure", SURE), ("risky", RISKY)], &[20, 22])]);
        let plan = PlanData::whole(&data, Unit::Answer);
        let part = &plan.parts()[0];
        let settings = FitSettings::default();
        let found = fit(&NOISY_RATIONAL, &data, &settings, &mut uninterrupted).unwrap();
        let mut found: PartFit = found.into();
        let mut drawn: Vec<u64> = part.patterns().iter().map(|one| one.weight).collect();
        drawn[0] -= 1;
        drawn[1] += 1;
        let estimates = |fit: &PartFit| {
            let columns = fit.ln_likelihoods(data.problems(), part.patterns());
            weighted_estimates(part, fit, &columns, &drawn)
        };
        assert!(estimates(&found).is_some());
        for (_, values) in &mut found.draws.columns {
            for still in values.chunks_mut(100) {
                still.fill(still[0]);
            }
        }
        assert!(estimates(&found).is_none());
    }

    #[test]
    fn medians_follow_weights() {
        assert_eq!(weighted_median(&[3.0, 1.0, 2.0], &[0.6, 0.2, 0.2]), 3.0);
        assert_eq!(weighted_median(&[3.0, 1.0, 2.0], &[0.2, 0.2, 0.6]), 2.0);
    }
}
