//! Fits of a file as one page that stands alone: for `riskaware fit --html`.

use askama::Template;

use super::{
    format::{count, decimal, interval, mean_sd, percent, percents, rfc3339},
    table::{Align, Cell, Table},
};
use crate::{
    inference::{
        ChoiceData, Fit, ParameterSummary, Prior, Quantity, QuantityDiagnostics, Source,
        accuracy::{CellAccuracy, LnKl, Shares, pooled},
        wilson_interval,
    },
    model::{NOISY_RATIONAL, Parameter, RISK_AWARE},
    study::Timestamp,
};

/// A report of fits: HTML with its style inside, without scripts and without anything to load.
#[derive(Template)]
#[template(path = "results/report.html")]
pub struct FitReportPage<'a> {
    source: &'a str,
    at: String,
    n: String,
    problems: String,
    best: Option<Best>,
    trust: &'static str,
    trust_note: String,
    models: Vec<&'static str>,
    options: Vec<OptionRow>,
    comparison: Option<Table>,
    ln_kl: Option<Table>,
    fits: Vec<FitSection>,
}

/// The model with the highest marginal likelihood.
struct Best {
    label: &'static str,
    note: String,
}

/// An action of a problem: what was chosen, and what the models say.
struct OptionRow {
    problem: String,
    action: String,
    n: String,
    chosen: String,
    wilson: String,
    predicted: Vec<String>,
    observed: Option<Mark>,
    marks: Vec<Mark>,
}

/// A point with its interval, in percent of the axis from 0 to 1.
struct Mark {
    class: &'static str,
    /// The vertical place.
    y: usize,
    low: f64,
    middle: f64,
    high: f64,
}

struct FitSection {
    label: &'static str,
    is_converged: bool,
    /// Whether results follow, and not diagnostics alone.
    is_shown: bool,
    run: String,
    parameters: Option<Table>,
    diagnostics: Table,
    priors: Table,
}

impl<'a> FitReportPage<'a> {
    /// The report of these fits of the same choices.
    ///
    /// * `source`: where choices and problems come from, in words.
    /// * `show_unconverged`: whether fits that have not converged show more than their diagnostics; they are marked.
    /// * `at`: when it was made.
    pub fn new(
        source: &'a str,
        data: &ChoiceData,
        fits: &[Fit],
        show_unconverged: bool,
        at: Timestamp,
    ) -> Self {
        let shown: Vec<&Fit> = fits
            .iter()
            .filter(|fit| fit.summary.converged || show_unconverged)
            .collect();
        let converged = fits.iter().filter(|fit| fit.summary.converged).count();
        Self {
            source,
            at: rfc3339(at),
            n: count(data.n()),
            problems: count(data.problems().len() as u64),
            best: best(data, &shown),
            trust: if converged == fits.len() {
                "Yes"
            } else {
                "Not all"
            },
            trust_note: format!("{converged} of {} fits converged", fits.len()),
            models: shown.iter().map(|fit| fit.model.label).collect(),
            options: option_rows(data, &shown),
            comparison: (!shown.is_empty()).then(|| comparison(data, &shown)),
            ln_kl: (!shown.is_empty()).then(|| ln_kl(&shown)),
            fits: fits
                .iter()
                .map(|fit| section(fit, fit.summary.converged || show_unconverged))
                .collect(),
        }
    }

    /// The page.
    ///
    /// # Errors
    /// When the template fails.
    pub fn html(&self) -> Result<String, askama::Error> {
        self.render()
    }
}

fn evidence(fit: &Fit) -> Option<f64> {
    fit.summary.log_marginal_likelihood.map(|found| found.value)
}

/// ln likelihood, and so ln marginal likelihood, when all actions are equally likely.
fn at_random(data: &ChoiceData) -> f64 {
    let cells = data.problems().iter().zip(data.totals());
    cells
        .map(|(problem, counts)| {
            let n: u64 = counts.iter().sum();
            -(n as f64) * (problem.problem.actions().len() as f64).ln()
        })
        .sum()
}

fn best(data: &ChoiceData, fits: &[&Fit]) -> Option<Best> {
    if fits.is_empty() {
        return None;
    }
    let of_models = fits
        .iter()
        .filter_map(|fit| Some((fit.model.label, evidence(fit)?)));
    let mut ranked: Vec<(&'static str, f64)> =
        of_models.chain([("Random", at_random(data))]).collect();
    ranked.sort_by(|left, right| right.1.total_cmp(&left.1));
    let (&(label, highest), rest) = ranked.split_first()?;
    let (second, next) = rest.first()?;
    Some(Best {
        label,
        note: format!(
            "highest marginal likelihood; ln Bayes factor {} against {second}",
            decimal(Some(highest - next), 1),
        ),
    })
}

fn class(model: &str) -> &'static str {
    if model == NOISY_RATIONAL.id {
        "noisy"
    } else if model == RISK_AWARE.id {
        "aware"
    } else {
        "other"
    }
}

fn option_rows(data: &ChoiceData, fits: &[&Fit]) -> Vec<OptionRow> {
    let mut rows = Vec::new();
    for (problem, counts) in data.problems().iter().zip(data.totals()) {
        let n: u64 = counts.iter().sum();
        for (action, &chosen) in problem.problem.names().zip(counts) {
            let (low, high) = wilson_interval(chosen, n);
            let share = (n > 0).then(|| chosen as f64 / n as f64);
            let shares = fits.iter().enumerate().map(|(index, fit)| {
                let predicted = fit.summary.predicted.as_ref();
                let share = predicted.and_then(|map| map.get(&problem.id)?.get(action));
                (index, fit.model.id, share)
            });
            rows.push(OptionRow {
                problem: problem.id.clone(),
                action: action.to_owned(),
                n: count(chosen),
                chosen: percent(share),
                wilson: if n > 0 {
                    percents(Some(low), Some(high))
                } else {
                    "–".to_owned()
                },
                predicted: shares
                    .clone()
                    .map(|(_, _, share)| {
                        share.map_or_else(
                            || "–".to_owned(),
                            |share| {
                                let ends = percents(Some(share.q5), Some(share.q95));
                                format!("{} ({ends})", percent(Some(share.mean)))
                            },
                        )
                    })
                    .collect(),
                observed: share.map(|share| Mark {
                    class: "observed",
                    y: 6,
                    low: low * 100.0,
                    middle: share * 100.0,
                    high: high * 100.0,
                }),
                marks: shares
                    .filter_map(|(index, model, share)| {
                        let share = share?;
                        Some(Mark {
                            class: class(model),
                            y: 14 + 8 * index,
                            low: share.q5 * 100.0,
                            middle: share.mean * 100.0,
                            high: share.q95 * 100.0,
                        })
                    })
                    .collect(),
            });
        }
    }
    rows
}

impl OptionRow {
    /// How high the strip of marks is.
    fn height(&self) -> usize {
        12 + 8 * self.marks.len()
    }
}

fn comparison(data: &ChoiceData, fits: &[&Fit]) -> Table {
    let mut table = Table::new(&[
        ("Model", Align::Words),
        ("Highest ln L", Align::Numbers),
        ("ln marginal likelihood", Align::Numbers),
        ("ln Bayes factor to random", Align::Numbers),
        ("ln KL, mean ± sd", Align::Numbers),
    ]);
    let random = at_random(data);
    table.row([
        "Random".to_owned(),
        decimal(Some(random), 2),
        decimal(Some(random), 2),
        decimal(Some(0.0), 2),
        "–".to_owned(),
    ]);
    for fit in fits {
        let cells: Vec<&CellAccuracy> = fit.accuracy.iter().collect();
        let ln_kl = pooled(&cells, Shares::Observed);
        let evidence = fit.summary.log_marginal_likelihood.map_or_else(
            || "–".to_owned(),
            |found| mean_sd(Some(found.value), Some(found.se), 3),
        );
        table.row([
            fit.model.label.to_owned(),
            decimal(fit.summary.max_log_likelihood, 2),
            evidence,
            decimal(self::evidence(fit).map(|value| value - random), 2),
            of_samples(&ln_kl),
        ]);
    }
    table
}

fn of_samples(ln_kl: &LnKl) -> String {
    mean_sd(ln_kl.mean, ln_kl.sd, 2)
}

fn ln_kl(fits: &[&Fit]) -> Table {
    let mut table = Table::new(&[
        ("Problem", Align::Words),
        ("n", Align::Numbers),
        ("Model", Align::Words),
        ("ln KL, mean ± sd", Align::Numbers),
        ("Median", Align::Numbers),
        ("5–95 %", Align::Numbers),
        ("Reference", Align::Numbers),
    ]);
    let cells = fits.first().map_or(0, |fit| fit.accuracy.len());
    for index in 0..cells {
        for fit in fits {
            let Some(cell) = fit.accuracy.get(index) else {
                continue;
            };
            let mark = if cell.unanimous { " (unanimous)" } else { "" };
            table.row([
                format!("{}{mark}", cell.problem),
                count(cell.n),
                fit.model.label.to_owned(),
                of_samples(&cell.ln_kl),
                decimal(cell.ln_kl.median, 2),
                interval(cell.ln_kl.q5, cell.ln_kl.q95, 2),
                decimal(cell.reference_level, 2),
            ]);
        }
    }
    table
}

fn section(fit: &Fit, is_shown: bool) -> FitSection {
    let summary = &fit.summary;
    let acceptance = summary
        .acceptance
        .map_or_else(|| "–".to_owned(), |share| decimal(Some(share), 2));
    let parameters = summary.parameters.as_ref().filter(|_| is_shown);
    FitSection {
        label: fit.model.label,
        is_converged: summary.converged,
        is_shown,
        run: format!(
            "{} chains of {} draws, acceptance {acceptance}, seed {}, reference reward {}",
            summary.chains,
            count(summary.draws as u64),
            summary.seed,
            summary.reference_reward
        ),
        parameters: parameters.map(|map| {
            let mut table = Table::new(&[
                ("Parameter", Align::Words),
                ("Median", Align::Numbers),
                ("5–95 %", Align::Numbers),
                ("Mean ± sd", Align::Numbers),
                ("Prior 5–95 %", Align::Numbers),
                ("Contraction", Align::Numbers),
                ("What the choices say", Align::Words),
            ]);
            for (name, found) in map.iter() {
                table.row(parameter_row(name, found));
            }
            table
        }),
        diagnostics: diagnostics(fit),
        priors: priors(fit),
    }
}

fn parameter_row(name: &str, found: &ParameterSummary) -> [String; 7] {
    let note = match found.source {
        Source::Prior => "nothing: the prior",
        Source::Choices if found.informed => "informed",
        Source::Choices => "hardly anything",
    };
    [
        name.to_owned(),
        short(found.q50),
        format!("{} to {}", short(found.q5), short(found.q95)),
        format!("{} ± {}", short(found.mean), short(found.sd)),
        format!("{} to {}", short(found.prior_q5), short(found.prior_q95)),
        decimal(Some(found.contraction).filter(|x| x.is_finite()), 2),
        note.to_owned(),
    ]
}

fn diagnostics(fit: &Fit) -> Table {
    let mut table = Table::new(&[
        ("Quantity", Align::Words),
        ("R̂", Align::Numbers),
        ("Bulk ESS", Align::Numbers),
        ("Tail ESS", Align::Numbers),
        ("State", Align::Words),
    ]);
    let diagnostics = &fit.summary.diagnostics;
    let parameters = diagnostics
        .parameters
        .iter()
        .map(|(name, found)| (name.to_owned(), found));
    let predicted = diagnostics
        .predicted
        .iter()
        .map(|(name, found)| (format!("probabilities of {name}"), found));
    for (name, found) in parameters.chain(predicted) {
        table.row(diagnostics_row(name, found));
    }
    table
}

fn diagnostics_row(name: String, found: &QuantityDiagnostics) -> Vec<Cell> {
    use crate::inference::diagnostics::{ESS_LIMIT, RHAT_LIMIT};
    let fine = found.rhat < RHAT_LIMIT && found.ess_bulk > ESS_LIMIT && found.ess_tail > ESS_LIMIT;
    let state = if fine {
        Cell::State {
            id: "converged",
            word: "converged",
        }
    } else {
        Cell::State {
            id: "unconverged",
            word: "not converged",
        }
    };
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    vec![
        name.into(),
        decimal(finite(found.rhat), 4).into(),
        decimal(finite(found.ess_bulk), 0).into(),
        decimal(finite(found.ess_tail), 0).into(),
        state,
    ]
}

fn priors(fit: &Fit) -> Table {
    let mut table = Table::new(&[("Parameter", Align::Words), ("Prior", Align::Words)]);
    for &parameter in fit.model.parameters {
        let name = if parameter == Parameter::Theta {
            Quantity::Tau.key()
        } else {
            parameter.key()
        };
        let prior = match fit.summary.priors.of(parameter) {
            Prior::Uniform { low, high } => format!("uniform from {low} to {high}"),
            Prior::LogNormal { median, log_sd } => {
                format!("log-normal, median {median}, sd of the logarithm {log_sd}")
            }
        };
        table.row([name.to_owned(), prior]);
    }
    table
}

/// Three significant digits, however large or small.
fn short(value: f64) -> String {
    let text = if value == 0.0 || (1e-3..1e4).contains(&value.abs()) {
        let digits = match value.abs() {
            size if size >= 100.0 => 0,
            size if size >= 10.0 => 1,
            size if size >= 0.1 => 2,
            _ => 4,
        };
        format!("{value:.digits$}")
    } else {
        format!("{value:.2e}")
    };
    text.replace('-', "\u{2212}")
}
