//! The comparison of models: held-out score, Bayes factor, what is said of them, and where they disagree.

use crate::{
    inference::{
        Estimate, ParameterSummary, Source,
        comparison::{
            BayesFactor, Comparison, EvidenceWords, LEAST_DIFFERENCE, LEAST_UNITS,
            LeaveOneOutDifference, OBSERVED_SHARE, Pair, PriorChange, RANDOM, Unit, Verdict,
        },
    },
    jobs::Snapshot,
    model::{NOISY_RATIONAL, RISK_AWARE},
    study::{FitPlan, Timestamp},
    web::results::{
        format::{count, decimal, mean_sd},
        reading::parameters::{range, symbol},
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
    /// Newer answers are not in it.
    is_behind: bool,
    pub(super) seed: u64,
    pub(super) at: Timestamp,
}

impl<'a> Compared<'a> {
    /// All plans that were compared, in file order.
    pub(in crate::web::results) fn all(snapshot: &'a Snapshot) -> Vec<Self> {
        let of_plan = |plan: &'a FitPlan| {
            let known = snapshot.comparison(&plan.id)?;
            Some(Self {
                plan: plan.id.as_str(),
                label: &plan.label,
                comparison: known.report.as_ref().ok()?,
                is_behind: known.is_behind,
                seed: known.seed,
                at: known.at,
            })
        };
        snapshot.study.plans().iter().filter_map(of_plan).collect()
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

    /// What predicts, for people: chance, the other problems' share, or a model.
    fn predictor(&self, id: &str) -> String {
        match id {
            RANDOM => "Random".to_owned(),
            OBSERVED_SHARE => "Share in the other cells".to_owned(),
            model => self.model_label(model),
        }
    }

    /// The paper's two models.
    fn paper_pair(&self) -> Option<&'a Pair> {
        self.comparison
            .pairs
            .iter()
            .find(|pair| pair.first == RISK_AWARE.id && pair.second == NOISY_RATIONAL.id)
    }

    /// What is left out, for people.
    pub(super) fn units(&self) -> &'static str {
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
fn left_out_side(found: &LeaveOneOutDifference) -> Side {
    if found.distinguishable && found.difference.beyond_two_se {
        Side::of(found.difference.value)
    } else {
        Side::Neither
    }
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
    let has = |side| found.iter().any(|(_, found)| left_out_side(found) == side);
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
    let behind = if found.iter().any(|(plan, _)| plan.is_behind) {
        "; newer answers are not in it yet"
    } else {
        ""
    };
    Some((
        label,
        format!(
            "held-out score, {} minus {}: {}{behind}",
            RISK_AWARE.label,
            NOISY_RATIONAL.label,
            scores.join("; ")
        ),
    ))
}

/// What the comparison is of, or when there will be one.
pub(super) fn compared(snapshot: &Snapshot, compared: &[Compared<'_>]) -> String {
    let Some(first) = compared.first() else {
        let failed = snapshot.study.plans().iter().find_map(|plan| {
            let message = snapshot.comparison(&plan.id)?.report.as_ref().err()?;
            Some(format!("The models could not be compared: {message}."))
        });
        return failed.unwrap_or_else(|| {
            "Not compared yet: that follows once no answer has come for ten seconds and all fits are final.".to_owned()
        });
    };
    let comparison = first.comparison;
    let mut text = match comparison.unit {
        Unit::Participant => format!(
            "One person is left out at a time, with all answers: {} people, {} answers.",
            count(comparison.units),
            count(comparison.n)
        ),
        Unit::Answer => format!(
            "Nobody knows who gave which answer, so one answer is left out at a time: {}. Where a person gave several, standard errors are too small.",
            count(comparison.n)
        ),
    };
    if compared.iter().any(|plan| plan.is_behind) {
        text.push_str(" Newer answers are not in it yet.");
    }
    text
}

/// Differences in held-out score.
pub(super) fn left_out(compared: &[Compared<'_>]) -> Table {
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
    match left_out_side(found) {
        Side::First => format!("{} predicts better", plan.model_label(&pair.first)),
        Side::Second => format!("{} predicts better", plan.model_label(&pair.second)),
        Side::Neither if difference.units < LEAST_UNITS => {
            format!(
                "not distinguishable: fewer than {LEAST_UNITS} {}",
                plan.units()
            )
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

pub(in crate::web) fn estimate(found: Option<&Estimate>) -> String {
    found.map_or_else(
        || "–".to_owned(),
        |found| mean_sd(Some(found.value), Some(found.se), 2),
    )
}

/// Bayes factors: those of the comparison, live ones where a plan was not compared since the last answer.
pub(super) fn bayes(snapshot: &Snapshot, compared: &[Compared<'_>]) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Models", Align::Words),
        ("ln Bayes factor ± error", Align::Numbers),
        ("Bayes factor", Align::Numbers),
        ("In words", Align::Prose),
    ]);
    for plan in snapshot.study.plans() {
        let newest = compared
            .iter()
            .find(|found| plan.id == *found.plan && !found.is_behind);
        if let Some(found) = newest {
            for pair in &found.comparison.pairs {
                if let Some(factor) = &pair.bayes_factor {
                    table.row([
                        plan.label.clone(),
                        found.pair_label(pair),
                        estimate(Some(&factor.ln)),
                        ratio(factor.ln.value),
                        in_words(found, pair, factor),
                    ]);
                }
            }
            continue;
        }
        let models = snapshot.study.models();
        for (place, first) in models.iter().enumerate() {
            for second in &models[..place] {
                if let Some(ln) = snapshot.ln_bayes_factor(&plan.id, first.id, second.id) {
                    table.row([
                        plan.label.clone(),
                        format!("{} against {}", first.label, second.label),
                        estimate(Some(&ln)),
                        ratio(ln.value),
                        NOT_TRIED.to_owned(),
                    ]);
                }
            }
        }
    }
    table
}

/// Beside a Bayes factor without a table of other priors.
const NOT_TRIED: &str = "live; no words before other priors were tried";

/// A Bayes factor as people write it: `12 to 1`, `1 to 3.4`, `4·10⁷ to 1`.
pub(in crate::web) fn ratio(ln: f64) -> String {
    let size = ln.abs().exp();
    let size = if size < 10.0 {
        format!("{size:.1}")
    } else if size < 1e4 {
        format!("{size:.0}")
    } else {
        let power = (ln.abs() / std::f64::consts::LN_10).floor();
        let leading = (ln.abs() - power * std::f64::consts::LN_10).exp();
        format!("{leading:.0}·10{}", superscript(power))
    };
    if ln < 0.0 {
        format!("1 to {size}")
    } else {
        format!("{size} to 1")
    }
}

fn superscript(power: f64) -> String {
    let digits = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let written = format!("{power:.0}");
    let places = written.chars().filter_map(|digit| digit.to_digit(10));
    places.map(|digit| digits[digit as usize]).collect()
}

fn in_words(plan: &Compared<'_>, pair: &Pair, factor: &BayesFactor) -> String {
    let Some(words) = factor.words else {
        return if factor.sensitivity.is_some() {
            "no words: not every prior below has the same sign".to_owned()
        } else {
            NOT_TRIED.to_owned()
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
            let rows = pair
                .bayes_factor
                .as_ref()
                .and_then(|factor| factor.sensitivity.as_ref());
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
                    row.ln
                        .as_ref()
                        .map_or_else(|| "not converged".to_owned(), |ln| estimate(Some(ln))),
                ]);
            }
        }
    }
    table
}

/// Problems held out, with what chance, the other problems' share and each model predict of them.
pub(super) fn held_out(snapshot: &Snapshot, compared: &[Compared<'_>]) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Cell held out", Align::Words),
        ("n", Align::Numbers),
        ("Predicted by", Align::Words),
        ("Log score", Align::Numbers),
        ("Per answer", Align::Numbers),
        ("ln KL", Align::Numbers),
    ]);
    for plan in compared {
        let Some(found) = &plan.comparison.held_out else {
            continue;
        };
        for (id, score) in found.scores.iter() {
            table.row([
                plan.label.to_owned(),
                "All of them".to_owned(),
                count(found.n),
                plan.predictor(id),
                score.map_or_else(
                    || "not converged".to_owned(),
                    |score| mean_sd(Some(score.score), score.se, 2),
                ),
                decimal(score.map(|score| score.per_answer), 3),
                decimal(score.and_then(|score| score.mean_ln_kl), 2),
            ]);
        }
        for problem in &found.problems {
            let cell = snapshot.study.cell(&problem.problem);
            let label = cell.map_or(problem.problem.as_str(), |cell| cell.label.as_str());
            for (id, prediction) in problem.predictions.iter() {
                table.row([
                    plan.label.to_owned(),
                    label.to_owned(),
                    count(problem.n),
                    plan.predictor(id),
                    prediction.as_ref().map_or_else(
                        || "not converged".to_owned(),
                        |prediction| decimal(Some(prediction.score), 2),
                    ),
                    decimal(
                        prediction
                            .as_ref()
                            .map(|prediction| prediction.score / problem.n as f64),
                        3,
                    ),
                    decimal(
                        prediction.as_ref().and_then(|prediction| prediction.ln_kl),
                        2,
                    ),
                ]);
            }
        }
    }
    table
}

/// Intervals of the posterior median over people drawn anew, beside the posterior's.
pub(super) fn bootstrap(snapshot: &Snapshot, compared: &[Compared<'_>]) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Part", Align::Words),
        ("Model", Align::Words),
        ("Parameter", Align::Words),
        ("Posterior, 5–95 %", Align::Numbers),
        ("People drawn anew, 5–95 %", Align::Numbers),
    ]);
    for part in &snapshot.fits {
        // Beside a posterior of newer answers it would say nothing.
        let newest = compared
            .iter()
            .find(|plan| part.plan == *plan.plan && !plan.is_behind);
        let Some(plan) = newest else {
            continue;
        };
        let resampled = plan
            .comparison
            .models
            .get(part.model.id)
            .and_then(|model| model.bootstrap.as_ref()?.get(part.part.as_str()));
        let posterior = part
            .converged()
            .and_then(|report| report.summary.parameters.as_ref());
        let (Some(resampled), Some(posterior)) = (resampled, posterior) else {
            continue;
        };
        for (name, found) in resampled.parameters.iter() {
            let Some(posterior) = posterior
                .get(name)
                .filter(|found| varies_with_people(found))
            else {
                continue;
            };
            let drawn_anew = found.q5.zip(found.q95);
            table.row([
                part.plan_label.clone(),
                part.part_label.clone(),
                part.model.label.to_owned(),
                symbol(name),
                range(posterior.q5, posterior.q95),
                drawn_anew.map_or_else(|| "–".to_owned(), |(low, high)| range(low, high)),
            ]);
        }
    }
    table
}

/// Whether an interval over people means anything: a median that the prior holds in place, whoever comes, hardly moves,
/// and its interval would look exact.
fn varies_with_people(found: &ParameterSummary) -> bool {
    found.source == Source::Choices && found.informed
}

/// What each plan's comparison says on the study's hypothesis.
fn judged<'a>(snapshot: &Snapshot, compared: &[Compared<'a>]) -> Vec<(&'a str, Verdict)> {
    let Some(hypothesis) = snapshot.hypothesis() else {
        return Vec::new();
    };
    let of_plan = |plan: &Compared<'a>| {
        let verdict = Verdict::of(&hypothesis, plan.comparison)?;
        Some((plan.label, verdict))
    };
    compared.iter().filter_map(of_plan).collect()
}

/// One line per hypothesis and plan, with the criterion last.
pub(super) fn verdicts(snapshot: &Snapshot, compared: &[Compared<'_>]) -> Vec<String> {
    let judged = judged(snapshot, compared);
    let mut lines: Vec<String> = judged
        .iter()
        .map(|(plan, verdict)| format!("{} ({}).", with_minus(&verdict.line), plan.to_lowercase()))
        .collect();
    if let Some((_, verdict)) = judged.first() {
        lines.insert(0, format!("{}: {}.", verdict.hypothesis, verdict.statement));
        lines.push(format!("Criterion: {}.", Verdict::CRITERION));
    }
    if snapshot.hypothesis().is_none() {
        let line = |plan: &Compared<'_>| {
            let pair = plan.paper_pair()?;
            let found = pair.leave_one_out.as_ref()?;
            Some(format!(
                "{}: {} (held-out score {} over {} {}; criterion: a difference of at least {LEAST_DIFFERENCE}, beyond two standard errors, over at least {LEAST_UNITS}).",
                plan.label,
                reading(plan, pair, found),
                mean_sd(Some(found.difference.value), found.difference.se, 1),
                count(found.difference.units),
                plan.units(),
            ))
        };
        lines.extend(compared.iter().filter_map(line));
    }
    lines
}

fn with_minus(text: &str) -> String {
    text.replace(" -", " \u{2212}")
}

/// Where the measures do not agree, and what each asks.
pub(super) fn disagreement(snapshot: &Snapshot, compared: &[Compared<'_>]) -> String {
    let judged = judged(snapshot, compared);
    let differing: Vec<&(&str, Verdict)> = judged
        .iter()
        .filter(|(_, verdict)| verdict.disagreement.is_some())
        .collect();
    let Some((_, first)) = differing.first() else {
        return String::new();
    };
    let plans: Vec<String> = differing
        .iter()
        .map(|(plan, _)| plan.to_lowercase())
        .collect();
    format!(
        "The measures do not agree ({}). {}",
        plans.join("; "),
        first.disagreement.as_deref().unwrap_or_default()
    )
}

#[cfg(test)]
mod tests {
    use super::{ratio, varies_with_people};
    use crate::inference::{ParameterSummary, Source};

    #[test]
    fn only_what_choices_speak_of_varies_with_people() {
        for (informed, source, varies) in [
            (true, Source::Choices, true),
            (false, Source::Choices, false),
            (false, Source::Prior, false),
        ] {
            let found: ParameterSummary = serde_json::from_value(serde_json::json!({
                "mean": 1.0, "sd": 0.1, "q5": 0.8, "q50": 1.0, "q95": 1.2, "rhat": 1.0, "ess_bulk": 4000.0,
                "ess_tail": 4000.0, "mcse_mean": 0.01, "mcse_q50": 0.01, "prior_q5": 0.1, "prior_q50": 1.0,
                "prior_q95": 9.0, "contraction": 0.5, "informed": informed, "source": source,
            }))
            .unwrap();
            assert_eq!(varies_with_people(&found), varies, "{informed} {source:?}");
        }
    }

    #[test]
    fn bayes_factors_read_as_odds() {
        for (factor, text) in [
            (1.0_f64, "1.0 to 1"),
            (12.4, "12 to 1"),
            (0.25, "1 to 4.0"),
            (3.9e5, "4·10⁵ to 1"),
            (1.0 / 2e12, "1 to 2·10¹²"),
        ] {
            assert_eq!(ratio(factor.ln()), text);
        }
    }
}
