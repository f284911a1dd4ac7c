//! The comparison of models: held-out score, Bayes factor, what is said of them, and where they disagree.

use crate::{
    inference::{
        Estimate,
        comparison::{
            BayesFactor, Comparison, EvidenceWords, LEAST_DIFFERENCE, LEAST_UNITS,
            LeaveOneOutDifference, Pair, PriorChange, Unit,
        },
    },
    jobs::Snapshot,
    model::{NOISY_RATIONAL, RISK_AWARE},
    study::Timestamp,
    web::results::{
        format::{count, decimal, mean_sd},
        table::{Align, Table},
    },
};

/// The comparison of one plan's fits.
#[derive(Debug, Clone, Copy)]
pub(in crate::web::results) struct Compared<'a> {
    /// The plan's id.
    pub(super) plan: &'a str,
    /// The plan's text on pages.
    pub(super) label: &'a str,
    pub(super) comparison: &'a Comparison,
    pub(super) seed: Option<u64>,
    pub(super) at: Option<Timestamp>,
}

impl<'a> Compared<'a> {
    /// All plans that were compared, in file order.
    pub(in crate::web::results) fn all(snapshot: &'a Snapshot) -> Vec<Self> {
        let _ = snapshot;
        Vec::new()
    }

    fn model_label(&self, id: &str) -> String {
        let models = &self.comparison.models;
        models
            .get(id)
            .map_or_else(|| id.to_owned(), |model| model.label.clone())
    }

    fn pair_label(&self, pair: &Pair) -> String {
        format!(
            "{} against {}",
            self.model_label(&pair.first),
            self.model_label(&pair.second)
        )
    }

    /// The paper's two models.
    fn paper_pair(&self) -> Option<&'a Pair> {
        self.comparison
            .pairs
            .iter()
            .find(|pair| pair.first == RISK_AWARE.id && pair.second == NOISY_RATIONAL.id)
    }

    fn units(&self) -> &'static str {
        match self.comparison.unit {
            Unit::Participant => "people",
            Unit::Answer => "answers",
        }
    }
}

/// Which side a measure takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    First,
    Second,
    Neither,
}

impl Side {
    fn of(value: f64) -> Self {
        if value > 0.0 {
            Self::First
        } else {
            Self::Second
        }
    }
}

/// Distinguishable, and beyond two standard errors.
fn held_out_side(found: &LeaveOneOutDifference) -> Side {
    if found.distinguishable && found.difference.beyond_two_se {
        Side::of(found.difference.value)
    } else {
        Side::Neither
    }
}

/// Clear of its Monte-Carlo error, under every prior tried.
fn bayes_side(found: &BayesFactor) -> Side {
    found.common_sign().map_or(Side::Neither, Side::of)
}

/// Which model the headline names, and why; nothing before the first comparison.
pub(in crate::web::results) fn headline(
    compared: &[Compared<'_>],
) -> Option<(&'static str, String)> {
    let found: Vec<(&Compared<'_>, LeaveOneOutDifference)> = compared
        .iter()
        .filter_map(|plan| Some((plan, plan.paper_pair()?.leave_one_out?)))
        .collect();
    if found.is_empty() {
        return None;
    }
    let has = |side| found.iter().any(|(_, found)| held_out_side(found) == side);
    let label = match (has(Side::First), has(Side::Second)) {
        (true, true) => "It depends",
        (true, false) => RISK_AWARE.label,
        (false, true) => NOISY_RATIONAL.label,
        (false, false) => "Not distinguishable",
    };
    let scores = found.iter().map(|(plan, found)| {
        let difference = found.difference;
        format!(
            "{} ({})",
            mean_sd(Some(difference.value), difference.se, 1),
            plan.label.to_lowercase()
        )
    });
    let scores: Vec<String> = scores.collect();
    Some((
        label,
        format!(
            "held-out score, {} minus {}: {}",
            RISK_AWARE.label,
            NOISY_RATIONAL.label,
            scores.join("; ")
        ),
    ))
}

/// Who or what is left out.
pub(super) fn unit(compared: &[Compared<'_>]) -> String {
    let Some(first) = compared.first() else {
        return "Not compared yet: a comparison follows once the study has been idle for a moment and the fits of all models have converged.".to_owned();
    };
    let comparison = first.comparison;
    match comparison.unit {
        Unit::Participant => format!(
            "One person is left out at a time, with all answers: {} people.",
            count(comparison.units)
        ),
        Unit::Answer => format!(
            "Nobody knows who gave which answer, so one answer is left out at a time: {} answers. Where a person gave several, standard errors are too small.",
            count(comparison.units)
        ),
    }
}

/// Differences in held-out score.
pub(super) fn held_out(compared: &[Compared<'_>]) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Models", Align::Words),
        ("Difference ± SE", Align::Numbers),
        ("Over", Align::Numbers),
        ("Reading", Align::Prose),
    ]);
    for plan in compared {
        for pair in &plan.comparison.pairs {
            let Some(found) = &pair.leave_one_out else {
                continue;
            };
            table.row([
                plan.label.to_owned(),
                plan.pair_label(pair),
                mean_sd(Some(found.difference.value), found.difference.se, 2),
                format!("{} {}", count(found.difference.units), plan.units()),
                reading(plan, pair, found),
            ]);
        }
    }
    table
}

fn reading(plan: &Compared<'_>, pair: &Pair, found: &LeaveOneOutDifference) -> String {
    let difference = found.difference;
    match held_out_side(found) {
        Side::First => format!("{} predicts better", plan.model_label(&pair.first)),
        Side::Second => format!("{} predicts better", plan.model_label(&pair.second)),
        Side::Neither if difference.units < LEAST_UNITS => {
            format!("not distinguishable: fewer than {LEAST_UNITS} {}", plan.units())
        }
        Side::Neither if difference.value.abs() < LEAST_DIFFERENCE => {
            format!("not distinguishable: a difference under {LEAST_DIFFERENCE}")
        }
        Side::Neither if !found.distinguishable => {
            "not distinguishable: a fit that left someone out did not converge".to_owned()
        }
        Side::Neither => "not distinguishable: within two standard errors".to_owned(),
    }
}

/// Each model's score by itself, with what shows whether it can be trusted.
pub(super) fn scores(compared: &[Compared<'_>]) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Model", Align::Words),
        ("Held-out score ± SE", Align::Numbers),
        ("Effective parameters", Align::Numbers),
        ("Largest k̂ kept (limit)", Align::Numbers),
        ("Left out by a fit of their own", Align::Numbers),
        ("ln marginal likelihood ± error", Align::Numbers),
    ]);
    for plan in compared {
        for (_, model) in plan.comparison.models.iter() {
            let evidence = model.log_marginal_likelihood.as_ref();
            let score = model.leave_one_out.as_ref();
            let mut row = vec![plan.label.to_owned(), model.label.clone()];
            match score {
                Some(score) => row.extend([
                    mean_sd(Some(score.elpd), score.se, 2),
                    decimal(Some(score.effective_parameters), 1),
                    format!(
                        "{} ({})",
                        decimal(score.worst_shape, 2),
                        decimal(Some(score.threshold), 2)
                    ),
                    if score.unconverged > 0 {
                        format!(
                            "{}, of which {} did not converge",
                            count(score.refitted),
                            count(score.unconverged)
                        )
                    } else {
                        count(score.refitted)
                    },
                ]),
                None if model.converged => row.extend(["–"; 4].map(str::to_owned)),
                None => row.extend(["not converged", "–", "–", "–"].map(str::to_owned)),
            }
            row.push(estimate(evidence));
            table.row(row);
        }
    }
    table
}

fn estimate(found: Option<&Estimate>) -> String {
    found.map_or_else(
        || "–".to_owned(),
        |found| mean_sd(Some(found.value), Some(found.se), 2),
    )
}

/// Bayes factors.
pub(super) fn bayes(compared: &[Compared<'_>]) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Models", Align::Words),
        ("ln Bayes factor ± error", Align::Numbers),
        ("Bayes factor", Align::Numbers),
        ("In words", Align::Prose),
    ]);
    for plan in compared {
        for pair in &plan.comparison.pairs {
            let Some(factor) = &pair.bayes_factor else {
                continue;
            };
            table.row([
                plan.label.to_owned(),
                plan.pair_label(pair),
                estimate(Some(&factor.ln)),
                ratio(factor.ln.value),
                in_words(plan, pair, factor),
            ]);
        }
    }
    table
}

/// A Bayes factor as people write it: `12 to 1`, `1 to 3.4`, `10^7 to 1`.
fn ratio(ln: f64) -> String {
    let size = ln.abs().exp();
    let size = if size < 10.0 {
        format!("{size:.1}")
    } else if size < 1e4 {
        format!("{size:.0}")
    } else {
        format!("10^{:.0}", ln.abs() / std::f64::consts::LN_10)
    };
    if ln < 0.0 {
        format!("1 to {size}")
    } else {
        format!("{size} to 1")
    }
}

fn in_words(plan: &Compared<'_>, pair: &Pair, factor: &BayesFactor) -> String {
    let Some(words) = factor.words else {
        return if factor.sensitivity.is_some() {
            "no words: not every prior below has the same sign".to_owned()
        } else {
            "no words before other priors were tried".to_owned()
        };
    };
    let strength = match words {
        EvidenceWords::Anecdotal => "anecdotal",
        EvidenceWords::Moderate => "moderate",
        EvidenceWords::Strong => "strong",
        EvidenceWords::VeryStrong => "very strong",
        EvidenceWords::Extreme => "extreme",
    };
    let model = if factor.ln.value > 0.0 {
        &pair.first
    } else {
        &pair.second
    };
    format!("{strength} evidence for {}", plan.model_label(model))
}

/// Bayes factors under other priors.
pub(super) fn sensitivity(compared: &[Compared<'_>]) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Models", Align::Words),
        ("Prior", Align::Words),
        ("ln Bayes factor ± error", Align::Numbers),
    ]);
    for plan in compared {
        for pair in &plan.comparison.pairs {
            let rows = pair.bayes_factor.as_ref().and_then(|factor| factor.sensitivity.as_ref());
            for row in rows.into_iter().flatten() {
                let what = match row.change {
                    PriorChange::TauLogSd => "log-sd of τ",
                    PriorChange::WeightingFloor => "floor of γ and δ",
                    PriorChange::LambdaLogSd => "log-sd of λ",
                };
                let mark = if row.in_use { " (in use)" } else { "" };
                table.row([
                    plan.label.to_owned(),
                    plan.pair_label(pair),
                    format!("{what} {}{mark}", row.value),
                    row.ln.as_ref().map_or_else(
                        || "not converged".to_owned(),
                        |ln| estimate(Some(ln)),
                    ),
                ]);
            }
        }
    }
    table
}

/// One line per plan on the paper's two models, with the criterion.
pub(super) fn verdicts(compared: &[Compared<'_>]) -> Vec<String> {
    let line = |plan: &Compared<'_>| {
        let pair = plan.paper_pair()?;
        let found = pair.leave_one_out.as_ref()?;
        Some(format!(
            "Does {} predict people better than {}? {}: {} (held-out score {} over {} {}; criterion: a difference of at least {LEAST_DIFFERENCE}, beyond two standard errors, over at least {LEAST_UNITS} {}).",
            RISK_AWARE.label,
            NOISY_RATIONAL.label,
            plan.label,
            reading(plan, pair, found),
            mean_sd(Some(found.difference.value), found.difference.se, 1),
            count(found.difference.units),
            plan.units(),
            plan.units(),
        ))
    };
    compared.iter().filter_map(line).collect()
}

/// Where held-out score and Bayes factor take different sides, and why they can.
pub(super) fn disagreement(compared: &[Compared<'_>]) -> String {
    let differing = compared.iter().filter_map(|plan| {
        let pair = plan.paper_pair()?;
        let held_out = held_out_side(pair.leave_one_out.as_ref()?);
        let bayes = bayes_side(pair.bayes_factor.as_ref()?);
        let name = |side: Side| match side {
            Side::First => plan.model_label(&pair.first),
            Side::Second => plan.model_label(&pair.second),
            Side::Neither => "neither".to_owned(),
        };
        (held_out != bayes).then(|| {
            format!(
                "“{}”: the held-out score favours {}, the Bayes factor {}",
                plan.label,
                name(held_out),
                name(bayes)
            )
        })
    });
    let differing: Vec<String> = differing.collect();
    if differing.is_empty() {
        return String::new();
    }
    format!(
        "The measures do not agree. {}. They ask different things: the held-out score, how well a model that has learned from everybody else predicts one more person; the Bayes factor, how likely the model with its priors made these answers before any was seen, so that wide priors cost it; ln KL above, how close a model can come to answers that it has seen.",
        differing.join("; ")
    )
}
