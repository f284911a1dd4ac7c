//! Draws in the forms that other programs read: CmdStan CSV and ArviZ JSON.
//!
//! Everything that is written follows from what is stored of a fit: its summary, its counts and its draws. So a file
//! written by `riskaware fit` and one fetched from a server hold the same numbers.

mod arviz;
mod cmdstan;

use super::likelihood::{Likelihood, Predictor};
use super::{ChoiceData, Draws, FitError, FitSettings, FitSummary, Prior, Quantity};
use crate::model::{OrderedMap, Parameter};

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

        let mut likelihood = Likelihood::new(data, summary.options);
        let lp: Vec<f64> = (0..draws.len())
            .map(|draw| {
                let parameters = draws.parameters(draw);
                let ln_prior: f64 = model
                    .parameters
                    .iter()
                    .map(|&parameter| {
                        let value = match parameter {
                            Parameter::Theta => tau[draw],
                            other => parameters.get(other),
                        };
                        let prior = summary.priors.of(parameter);
                        prior.ln_density(
                            prior
                                .coordinate(value)
                                .clamp(-FARTHEST_COORDINATE, FARTHEST_COORDINATE),
                        )
                    })
                    .sum();
                ln_prior + likelihood.ln_likelihood(&parameters)
            })
            .collect();
        finite("lp__", &lp)?;

        let options: Vec<ChoiceOption<'a>> = data
            .problems()
            .iter()
            .zip(data.totals())
            .flat_map(|(problem, counts)| {
                problem
                    .problem
                    .names()
                    .zip(counts)
                    .map(|(action, &count)| ChoiceOption {
                        problem: &problem.id,
                        action,
                        count,
                    })
            })
            .collect();
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
        if export.options.len() * draws.len() <= MOST_VALUES {
            export.predict(data)?;
        }
        Ok(export)
    }

    /// Probabilities and ln likelihoods.
    fn predict(&mut self, data: &ChoiceData) -> Result<(), ExportError> {
        let mut predictor = Predictor::new(
            data.problems().iter().map(|problem| &problem.problem),
            self.summary.options,
        );
        let mut ln_predicted = vec![Vec::with_capacity(self.draws.len()); self.options.len()];
        for draw in 0..self.draws.len() {
            let found = predictor.ln_probabilities(&self.draws.parameters(draw));
            for (column, ln_p) in ln_predicted.iter_mut().zip(found) {
                column.push(ln_p);
            }
        }
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
        for (index, (problem, counts)) in data.problems().iter().zip(data.totals()).enumerate() {
            if counts.iter().any(|count| *count > 0) {
                let range = predictor.range(index);
                let sum = ln_likelihood(&mut range.zip(counts.iter().copied()));
                finite("log_likelihood", &sum)?;
                by_problem.0.push((problem.id.clone(), sum));
            }
        }
        let patterns = data.groups();
        if patterns.len() > 1 && patterns.len() * self.draws.len() <= MOST_VALUES {
            let mut by_pattern = Vec::with_capacity(patterns.len());
            for pattern in patterns {
                let counts = pattern.counts.iter().flatten().copied();
                by_pattern.push(ln_likelihood(&mut counts.enumerate()));
            }
            self.by_pattern = Some(by_pattern);
            self.pattern_weights = patterns.iter().map(|pattern| pattern.weight).collect();
        }
        for column in &mut ln_predicted {
            for value in column.iter_mut() {
                *value = value.exp();
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
        ];
        if let Some(acceptance) = summary.acceptance {
            facts.push(("acceptance".to_owned(), Fact::Number(acceptance)));
        }
        for &parameter in self.draws.model.parameters {
            let name = match parameter {
                Parameter::Theta => Quantity::Tau.key(),
                other => other.key(),
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

/// A value that a file states about a fit.
#[derive(Debug, serde::Serialize)]
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
