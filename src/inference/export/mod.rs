//! Draws in the forms that other programs read: CmdStan CSV and ArviZ JSON.
//!
//! Everything that is written follows from what is stored of a fit: its summary, its counts and its draws. So a file
//! written by `riskaware fit` and one fetched from a server hold the same numbers.

mod arviz;
mod cmdstan;

use std::ops::Range;

use serde::Serialize;

use super::lanes::exp;
use super::likelihood::Predictor;
use super::{ChoiceData, Draws, FitError, FitSettings, FitSummary, Group, Prior, Priors, Quantity};
use crate::model::{ChoiceModel, OrderedMap, Parameter, Parameters};

/// Numbers of one kind (predicted probabilities, ln likelihoods) that are written at most: 20 million take about 400 MB of
/// text. Where there would be more, the kind is left out and the file says so.
const MOST_VALUES: usize = 20_000_000;

/// Evenly spread draws from the prior that go with the posterior's.
const PRIOR_DRAWS: usize = 2000;

/// A logit beyond this lies where rounding has put the value on its bound.
const FARTHEST_COORDINATE: f64 = 700.0;

/// A fit's draws with all that is written beside them.
///
/// * `lp`: ln posterior density of each draw on the unconstrained coordinates (logit over the prior's bounds, or
///   logarithm; τ stands for θ), Jacobian included, of all parameters of the model, also those that no choice depends
///   on. Neither the marginal likelihood nor binomial coefficients are in it. Shifting the sensitivity as the sampler
///   does has Jacobian 1 and leaves it as it is.
/// * `p`: the probability of each option, that is of each action of each problem.
/// * ln likelihoods by problem, and by pattern of answers where there are two patterns or more.
#[derive(Debug)]
pub struct DrawsExport<'a> {
    summary: &'a FitSummary,
    draws: &'a Draws,
    prior: Draws,
    lp: Vec<f64>,
    options: Vec<ChoiceOption<'a>>,
    /// By option, then by draw; `None` where that is too much.
    predicted: Option<Vec<Vec<f64>>>,
    /// By problem with answers, then by draw.
    by_problem: Option<OrderedMap<Vec<f64>>>,
    /// By pattern of answers, then by draw; also `None` where there is one pattern only.
    by_pattern: Option<Vec<Vec<f64>>>,
    /// How many people answered in each pattern.
    pattern_weights: Vec<u64>,
}

/// An action of a problem.
#[derive(Debug)]
struct ChoiceOption<'a> {
    problem: &'a str,
    action: &'a str,
    count: u64,
}

impl ChoiceOption<'_> {
    fn label(&self) -> String {
        format!("{}:{}", self.problem, self.action)
    }
}

impl<'a> DrawsExport<'a> {
    /// Computes what goes beside the draws of a fit.
    ///
    /// * `data`: what was fitted.
    ///
    /// # Errors
    /// When the draws are not those of such a fit, or a number is not finite.
    pub fn new(
        summary: &'a FitSummary,
        data: &'a ChoiceData,
        draws: &'a Draws,
    ) -> Result<Self, ExportError> {
        let model = draws.model;
        for quantity in model.parameters.iter().copied().map(Quantity::Parameter) {
            if draws.column(quantity).is_none() {
                return Err(ExportError::NoColumn { quantity });
            }
        }
        let tau = draws.column(Quantity::Tau).ok_or(ExportError::NoColumn {
            quantity: Quantity::Tau,
        })?;
        for (quantity, values) in &draws.columns {
            finite(quantity.key(), values)?;
        }

        let prior = FitSettings {
            priors: summary.priors,
            options: summary.options,
            reference_reward: Some(summary.reference_reward),
            ..FitSettings::default()
        }
        .posterior(model, data)?
        .prior_draws(PRIOR_DRAWS);

        let options: Vec<ChoiceOption<'a>> = data
            .problems()
            .iter()
            .zip(data.totals())
            .flat_map(|(problem, counts)| {
                let pairs = problem.problem.names().zip(counts);
                pairs.map(|(action, &count)| ChoiceOption {
                    problem: &problem.id,
                    action,
                    count,
                })
            })
            .collect();
        let mut predictor = Predictor::new(
            data.problems().iter().map(|problem| &problem.problem),
            summary.options,
        );
        let is_kept = options.len() * draws.len() <= MOST_VALUES;
        let mut ln_predicted = vec![Vec::new(); if is_kept { options.len() } else { 0 }];
        let mut lp = Vec::with_capacity(draws.len());
        for (draw, tau) in tau.iter().enumerate() {
            let parameters = draws.parameters(draw);
            let ln_p = predictor.ln_probabilities(&parameters);
            let ln_likelihood: f64 = options
                .iter()
                .zip(&ln_p)
                .filter(|(option, _)| option.count > 0)
                .map(|(option, ln_p)| option.count as f64 * ln_p)
                .sum();
            lp.push(ln_prior(summary.priors, &parameters, draws.model, *tau) + ln_likelihood);
            for (column, ln_p) in ln_predicted.iter_mut().zip(ln_p) {
                column.push(ln_p);
            }
        }
        finite("lp__", &lp)?;
        let mut export = Self {
            summary,
            draws,
            prior,
            lp,
            options,
            predicted: None,
            by_problem: None,
            by_pattern: None,
            pattern_weights: Vec::new(),
        };
        if is_kept {
            let ranges = (0..data.problems().len()).map(|problem| predictor.range(problem));
            export.keep_predictions(data, ranges, ln_predicted)?;
        }
        Ok(export)
    }

    /// Probabilities and ln likelihoods from ln P by option and draw.
    ///
    /// * `ranges`: which options belong to each problem.
    fn keep_predictions(
        &mut self,
        data: &ChoiceData,
        ranges: impl Iterator<Item = Range<usize>>,
        mut ln_predicted: Vec<Vec<f64>>,
    ) -> Result<(), ExportError> {
        let ln_likelihood = |counts: &mut dyn Iterator<Item = (usize, u64)>| {
            let mut sum = vec![0.0; self.draws.len()];
            for (option, count) in counts.filter(|(_, count)| *count > 0) {
                for (sum, ln_p) in sum.iter_mut().zip(&ln_predicted[option]) {
                    *sum += count as f64 * ln_p;
                }
            }
            sum
        };
        let mut by_problem: OrderedMap<Vec<f64>> = OrderedMap(Vec::new());
        for ((problem, counts), range) in data.problems().iter().zip(data.totals()).zip(ranges) {
            if counts.iter().any(|count| *count > 0) {
                let sum = ln_likelihood(&mut range.zip(counts.iter().copied()));
                by_problem.0.push((problem.id.clone(), sum));
            }
        }
        let patterns = data.groups();
        if patterns.len() > 1 && patterns.len() * self.draws.len() <= MOST_VALUES {
            let sum_of = |pattern: &Group| {
                let counts = pattern.counts.iter().flatten().copied();
                ln_likelihood(&mut counts.enumerate())
            };
            self.by_pattern = Some(patterns.iter().map(sum_of).collect());
            self.pattern_weights = patterns.iter().map(|pattern| pattern.weight).collect();
        }
        for column in &mut ln_predicted {
            for value in column.iter_mut() {
                *value = exp(*value);
            }
            finite("p", column)?;
        }
        self.by_problem = Some(by_problem);
        self.predicted = Some(ln_predicted);
        Ok(())
    }

    /// The id of the model, after which files are named.
    pub fn model_id(&self) -> &'static str {
        self.draws.model.id
    }

    /// How many chains there are.
    pub fn chains(&self) -> usize {
        self.draws.chains
    }

    /// Whether predicted probabilities and ln likelihoods were left out, for there would be too many.
    pub fn is_without_predictions(&self) -> bool {
        self.predicted.is_none()
    }

    /// What the files say of the fit, name by name.
    fn facts(&self) -> Vec<(String, Fact)> {
        let summary = self.summary;
        let text = |text: &str| Fact::Text(text.to_owned());
        let truth = |holds: bool| text(if holds { "true" } else { "false" });
        let mut facts = vec![
            ("inference_library".to_owned(), text("riskaware")),
            (
                "inference_library_version".to_owned(),
                text(env!("CARGO_PKG_VERSION")),
            ),
            ("choice_model".to_owned(), text(self.draws.model.id)),
            ("converged".to_owned(), truth(summary.converged)),
            ("choices".to_owned(), Fact::Whole(summary.n)),
            ("seed".to_owned(), Fact::Whole(summary.seed)),
            (
                "steps_per_draw".to_owned(),
                Fact::Whole(summary.steps_per_draw as u64),
            ),
            (
                "reference_reward".to_owned(),
                Fact::Number(summary.reference_reward),
            ),
            ("normalise".to_owned(), truth(summary.options.normalise)),
            ("zero".to_owned(), named(summary.options.zero)),
            (
                "weighting_function".to_owned(),
                named(summary.options.weighting_function),
            ),
        ];
        if let Some(acceptance) = summary.acceptance {
            facts.push(("acceptance".to_owned(), Fact::Number(acceptance)));
        }
        for &parameter in self.draws.model.parameters {
            let name = if parameter == Parameter::Theta {
                Quantity::Tau.key()
            } else {
                parameter.key()
            };
            let prior = match summary.priors.of(parameter) {
                Prior::Uniform { low, high } => format!("uniform({low},{high})"),
                Prior::LogNormal { median, log_sd } => format!("log_normal({median},{log_sd})"),
            };
            facts.push((format!("prior_{name}"), Fact::Text(prior)));
        }
        if self.is_without_predictions() {
            facts.push(("left_out".to_owned(), text("predictions")));
        }
        facts
    }
}

/// A variant by its name in study files and JSON.
fn named(variant: impl Serialize) -> Fact {
    let name = serde_json::to_value(variant).unwrap_or_default();
    Fact::Text(name.as_str().unwrap_or_default().to_owned())
}

/// A value that a file states about a fit.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Fact {
    Text(String),
    Whole(u64),
    Number(f64),
}

/// Why draws cannot be written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// What the fit depended on is not possible.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The draws are not those of such a fit.
    #[error("the draws have no column `{quantity}`")]
    NoColumn {
        /// What is missing.
        quantity: Quantity,
    },
    /// Neither format has a place for it.
    #[error("`{name}` is {value} in draw {draw}, allowed is a finite number")]
    NotFinite {
        /// The column.
        name: String,
        /// What was found.
        value: f64,
        /// Which draw, counted from 1 over all chains.
        draw: usize,
    },
}

/// ln prior density on the unconstrained coordinates, Jacobian included.
fn ln_prior(priors: Priors, parameters: &Parameters, model: &ChoiceModel, tau: f64) -> f64 {
    let of = |&parameter: &Parameter| {
        let value = if parameter == Parameter::Theta {
            tau
        } else {
            parameters.get(parameter)
        };
        let prior = priors.of(parameter);
        let coordinate = prior.coordinate(value);
        prior.ln_density(coordinate.clamp(-FARTHEST_COORDINATE, FARTHEST_COORDINATE))
    };
    model.parameters.iter().map(of).sum()
}

fn finite(name: &str, values: &[f64]) -> Result<(), ExportError> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(draw) => Err(ExportError::NotFinite {
            name: name.to_owned(),
            value: values[draw],
            draw: draw + 1,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::choice_data::tests::data;
    use crate::inference::diagnostics::Convergence;
    use crate::inference::{fit, uninterrupted};
    use crate::model::{NOISY_RATIONAL, RISK_AWARE, ln_probabilities};

    const STOP: &[(f64, f64)] = &[(1.0, -100.0)];
    const LOW: &[(f64, f64)] = &[(0.05, -500.0), (0.95, 0.0)];
    const CUPS: &[(f64, f64)] = &[(0.2, 105.0), (0.8, 0.0)];
    const STABLE: &[(f64, f64)] = &[(1.0, 20.0)];

    fn choices() -> ChoiceData {
        data(&[
            ("low", &[("go", LOW), ("stop", STOP)], &[5, 25]),
            ("cups", &[("stable", STABLE), ("unstable", CUPS)], &[20, 10]),
            ("nobody", &[("a", STABLE), ("b", STOP)], &[0, 0]),
        ])
    }

    fn fitted(model: &'static ChoiceModel, data: &ChoiceData) -> crate::inference::Fit {
        fit(model, data, &FitSettings::default(), &mut uninterrupted).unwrap()
    }

    /// By the equations of models.md, sections 2 to 4, for uniform priors on (0, 1) or (0.28, 1).
    fn ln_posterior(data: &ChoiceData, parameters: &Parameters, tau: f64) -> f64 {
        let mut sum = 0.0;
        let uniform = |value: f64, low: f64| {
            let share = (value - low) / (1.0 - low);
            (share * (1.0 - share)).ln()
        };
        let log_normal = |value: f64, median: f64, sd: f64| {
            let z = (value / median).ln() / sd;
            -0.5 * z * z - (sd * (2.0 * std::f64::consts::PI).sqrt()).ln()
        };
        sum += uniform(parameters.get(Parameter::Alpha), 0.0);
        sum += uniform(parameters.get(Parameter::Beta), 0.0);
        sum += uniform(parameters.get(Parameter::Gamma), 0.28);
        sum += uniform(parameters.get(Parameter::Delta), 0.28);
        sum += log_normal(parameters.get(Parameter::Lambda), 1.5, 0.75);
        sum += log_normal(tau, 5.0, 1.5);
        for (problem, counts) in data.problems().iter().zip(data.totals()) {
            let ln_p = ln_probabilities(&problem.problem, parameters, Default::default()).unwrap();
            let terms = counts.iter().zip(ln_p);
            sum += terms.map(|(n, ln_p)| *n as f64 * ln_p).sum::<f64>();
        }
        sum
    }

    #[test]
    fn lp_is_the_posterior_density_of_all_parameters() {
        let data = choices();
        let fit = fitted(&RISK_AWARE, &data);
        let export = DrawsExport::new(&fit.summary, &data, &fit.draws).unwrap();
        let tau = fit.draws.column(Quantity::Tau).unwrap();
        for draw in [0, 77, 3999] {
            let expected = ln_posterior(&data, &fit.draws.parameters(draw), tau[draw]);
            assert!(
                (export.lp[draw] - expected).abs() < 1e-6,
                "{} {expected}",
                export.lp[draw]
            );
        }
    }

    /// A line of a CSV file as numbers.
    fn numbers(line: &str) -> Vec<f64> {
        line.split(',').map(|text| text.parse().unwrap()).collect()
    }

    #[test]
    fn the_csv_holds_the_draws_to_the_last_digit() {
        let data = choices();
        let fit = fitted(&NOISY_RATIONAL, &data);
        let export = DrawsExport::new(&fit.summary, &data, &fit.draws).unwrap();
        let mut columns: Vec<Vec<f64>> = Vec::new();
        for chain in 0..export.chains() {
            let mut out = Vec::new();
            export.write_cmdstan_csv(chain, &mut out).unwrap();
            let text = String::from_utf8(out).unwrap();
            let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
            assert_eq!(lines[0], "lp__,theta,tau,p.1,p.2,p.3,p.4,p.5,p.6");
            assert_eq!(lines.len(), 1 + fit.draws.per_chain);
            assert!(text.contains("# option_4 = \"cups:unstable\"\n"));
            assert!(text.contains(&format!("# id = {}\n", chain + 1)));
            // What cmdstanpy takes for the end of the draws.
            let ends: Vec<&str> = text.lines().rev().take(2).collect();
            assert!(ends.iter().all(|line| line.starts_with('#')));
            columns.resize(9, Vec::new());
            for line in &lines[1..] {
                for (column, number) in columns.iter_mut().zip(numbers(line)) {
                    column.push(number);
                }
            }
        }
        assert_eq!(columns[1], fit.draws.columns[0].1);
        assert_eq!(columns[2], fit.draws.columns[1].1);
        for option in [3, 5] {
            let together = columns[option].iter().zip(&columns[option + 1]);
            assert!(
                together
                    .into_iter()
                    .all(|(p, q)| (p + q - 1.0).abs() < 1e-12)
            );
        }
        let of_cups = Convergence::of(&fit.draws.by_chain(&columns[5]));
        let stated = fit.summary.diagnostics.predicted.get("cups").unwrap();
        assert!((of_cups.ess_bulk / stated.ess_bulk - 1.0).abs() < 1e-6);
    }

    #[test]
    fn likelihoods_by_problem_and_by_pattern_add_up() {
        let problems = choices().problems().to_vec();
        let groups = vec![
            Group {
                weight: 5,
                counts: vec![vec![1, 0], vec![1, 0], vec![0, 0]],
            },
            Group {
                weight: 3,
                counts: vec![vec![0, 2], vec![0, 0], vec![0, 0]],
            },
        ];
        let data = ChoiceData::new(problems, groups).unwrap();
        let fit = fitted(&NOISY_RATIONAL, &data);
        let export = DrawsExport::new(&fit.summary, &data, &fit.draws).unwrap();
        let (by_problem, by_pattern) = (
            export.by_problem.as_ref().unwrap(),
            export.by_pattern.as_ref().unwrap(),
        );
        assert!(by_problem.get("nobody").is_none());
        for draw in [0, 1234] {
            let of_problems: f64 = by_problem.iter().map(|(_, sums)| sums[draw]).sum();
            let of_patterns = 5.0 * by_pattern[0][draw] + 3.0 * by_pattern[1][draw];
            assert!((of_problems - of_patterns).abs() < 1e-9);
        }

        let mut out = Vec::new();
        export.write_arviz_json(&mut out).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&out).unwrap();
        assert_eq!(json["constant_data"]["pattern_weight"][0], 5);
        assert_eq!(
            json["coords"]["problem"],
            serde_json::json!(["low", "cups"])
        );
        assert_eq!(json["posterior"]["p"][7][499].as_array().unwrap().len(), 6);
        assert_eq!(json["attrs"]["prior_tau"], "log_normal(5,1.5)");
    }

    #[test]
    fn draws_that_are_no_numbers_are_refused() {
        let data = choices();
        let fit = fitted(&NOISY_RATIONAL, &data);
        let mut draws = fit.draws.clone();
        draws.columns[1].1[4] = f64::INFINITY;
        let error = DrawsExport::new(&fit.summary, &data, &draws).unwrap_err();
        assert_eq!(
            error.to_string(),
            "`tau` is inf in draw 5, allowed is a finite number"
        );
        draws.columns.pop();
        let error = DrawsExport::new(&fit.summary, &data, &draws).unwrap_err();
        assert_eq!(error.to_string(), "the draws have no column `tau`");
    }
}
