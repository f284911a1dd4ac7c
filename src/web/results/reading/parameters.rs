//! What the fits say about parameters, and what they cannot.

use super::broadest_plan;
use crate::{
    inference::{Note, ParameterSummary, Quantity, Source, design_note},
    jobs::{PartFit, Snapshot},
    model::{ChoiceModel, ChoiceProblem, Curvature, Parameter},
    study::RewardUnit,
    web::results::{
        format::{decimal, interval, significant},
        table::{Align, Table},
    },
};

/// Converged fits, those of the plan with the fewest parts first.
fn converged(snapshot: &Snapshot) -> Vec<&PartFit> {
    let size = |part: &PartFit| {
        let plans = snapshot.study.plans().iter();
        plans
            .filter(|plan| plan.id == part.plan)
            .map(|plan| plan.parts.len())
            .sum::<usize>()
    };
    let mut fits: Vec<&PartFit> = snapshot
        .fits
        .iter()
        .filter(|part| part.converged().is_some())
        .collect();
    fits.sort_by_key(|part| size(part));
    fits
}

/// What each converged fit learned about each parameter.
pub(super) fn table(snapshot: &Snapshot) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Part", Align::Words),
        ("Model", Align::Words),
        ("Parameter", Align::Words),
        ("Median", Align::Numbers),
        ("5–95 %", Align::Numbers),
        ("Contraction", Align::Words),
        ("Prior 5–95 %", Align::Numbers),
        ("Mean ± sd", Align::Numbers),
        ("Most likely", Align::Numbers),
    ]);
    for part in converged(snapshot) {
        let Some(summary) = part.converged().map(|report| &report.summary) else {
            continue;
        };
        for (name, found) in summary.parameters.iter().flat_map(|all| all.iter()) {
            let most_likely = summary
                .max_likelihood_parameters
                .as_ref()
                .and_then(|best| best.get(name).copied().flatten());
            table.row([
                part.plan_label.clone(),
                part.part_label.clone(),
                part.model.label.to_owned(),
                symbol(name),
                significant(found.q50),
                range(found.q5, found.q95),
                contraction(found),
                range(found.prior_q5, found.prior_q95),
                format!("{} ± {}", significant(found.mean), significant(found.sd)),
                most_likely.map_or_else(|| "–".to_owned(), significant),
            ]);
        }
    }
    table
}

/// The contraction of a parameter that the choices said something about, else that they did not.
pub(in crate::web) fn contraction(found: &ParameterSummary) -> String {
    match found.source {
        Source::Prior => "the prior: no choice depends on it".to_owned(),
        Source::Choices if !found.informed => "not informed by this study".to_owned(),
        Source::Choices => decimal(Some(found.contraction), 2),
    }
}

pub(in crate::web) fn range(low: f64, high: f64) -> String {
    format!("{} to {}", significant(low), significant(high))
}

pub(in crate::web) fn symbol(name: &str) -> String {
    let symbol = Quantity::try_from(name.to_owned()).map(Quantity::symbol);
    symbol.map_or_else(|_| name.to_owned(), str::to_owned)
}

/// What the signs of the rewards leave open, per model.
pub(super) fn of_design(snapshot: &Snapshot) -> Vec<String> {
    let study = &snapshot.study;
    let problems: Vec<&ChoiceProblem> = study
        .cells()
        .iter()
        .filter(|cell| cell.fitted)
        .filter_map(|cell| cell.problem.as_ref())
        .collect();
    let mut found: Vec<(Note, Vec<&str>)> = Vec::new();
    for model in study.models() {
        let note = design_note(model, problems.iter().copied(), study.fit().options);
        let Some(note) = note else { continue };
        match found.iter_mut().find(|(known, _)| *known == note) {
            Some((_, models)) => models.push(model.label),
            None => found.push((note, vec![model.label])),
        }
    }
    found
        .into_iter()
        .map(|(note, models)| format!("{}: {note}", models.join("; ")))
        .collect()
}

/// Notes on the fits of the plan with the fewest parts, without those that the design makes.
pub(super) fn notes(snapshot: &Snapshot) -> Vec<String> {
    let plan = &broadest_plan(snapshot).id;
    let fits = snapshot.fits.iter().filter(|part| part.plan == *plan);
    fits.flat_map(|part| {
        let label = if part.part_label.is_empty() || part.cells.len() == fitted(snapshot) {
            part.model.label.to_owned()
        } else {
            format!("{}, {}", part.model.label, part.part_label)
        };
        shown_notes(part).map(move |note| format!("{label}: {note}"))
    })
    .collect()
}

fn fitted(snapshot: &Snapshot) -> usize {
    snapshot.fitted_cells().count()
}

/// Notes on every fit, without those that the design makes.
pub(super) fn all_notes(snapshot: &Snapshot) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Part", Align::Words),
        ("Model", Align::Words),
        ("Note", Align::Prose),
    ]);
    for part in &snapshot.fits {
        for note in shown_notes(part) {
            table.row([
                part.plan_label.clone(),
                part.part_label.clone(),
                part.model.label.to_owned(),
                note.to_string(),
            ]);
        }
    }
    table
}

fn shown_notes(part: &PartFit) -> impl Iterator<Item = &Note> {
    let notes = part.report().map(|report| report.summary.notes.as_slice());
    notes
        .unwrap_or_default()
        .iter()
        .filter(|note| !note.is_of_design())
}

/// Loss aversion where it depends on the amount, with what a model of one curvature says of every amount.
pub(super) fn loss_aversion(snapshot: &Snapshot) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Part", Align::Words),
        ("Model", Align::Words),
        ("Amount", Align::Numbers),
        ("−v(−x)/v(x), median", Align::Numbers),
        ("5–95 %", Align::Numbers),
    ]);
    let unit = snapshot.study.reward_unit();
    let fits = converged(snapshot);
    for part in &fits {
        let Some(amounts) = part
            .converged()
            .and_then(|report| report.summary.loss_aversion.as_ref())
        else {
            continue;
        };
        let mut row = |model: &ChoiceModel, amount: String, [q5, q50, q95]: [f64; 3]| {
            table.row([
                part.plan_label.clone(),
                part.part_label.clone(),
                model.label.to_owned(),
                amount,
                decimal(Some(q50), 2),
                interval(Some(q5), Some(q95), 2),
            ]);
        };
        for at in amounts {
            row(part.model, amount(unit, at.amount), [at.q5, at.q50, at.q95]);
        }
        let beside = fits.iter().find(|other| {
            other.plan == part.plan
                && other.part == part.part
                && other.model.curvature == Curvature::Shared
                && other.model.is_free(Parameter::Lambda)
        });
        let lambda = beside.and_then(|other| {
            let found = other.converged()?.summary.parameters.as_ref()?;
            Some((other.model, found.get("lambda")?))
        });
        if let Some((model, lambda)) = lambda {
            row(model, "any".to_owned(), [lambda.q5, lambda.q50, lambda.q95]);
        }
    }
    table
}

fn amount(unit: &RewardUnit, amount: f64) -> String {
    format!("{}{amount}{}", unit.prefix, unit.suffix)
}

/// How many fits are provisional, and what that means.
pub(super) fn provisional(snapshot: &Snapshot) -> String {
    let is_shown = |part: &&PartFit| part.is_provisional() && part.converged().is_some();
    match snapshot.fits.iter().filter(is_shown).count() {
        0 => String::new(),
        count => format!(
            "{count} of {} fits {} provisional: started from the fit before, so that they keep up with the answers. Final ones, which can be repeated draw by draw, follow once no answer has come for ten seconds. Cite those.",
            snapshot.fits.len(),
            if count == 1 { "is" } else { "are" }
        ),
    }
}
