//! The two figures on top of a results page that are words: which model fits, and whether the fits can be trusted.

use serde::Serialize;

use crate::{
    jobs::{Blind, PartState, Snapshot},
    model::{NOISY_RATIONAL, RISK_AWARE},
    web::results::reading::{Compared, headline as headline_of},
};

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Verdict {
    /// Which model comes closer to the choices.
    pub model: &'static str,
    pub model_note: String,
    /// Whether all fits converged.
    pub trust: &'static str,
    pub trust_note: String,
}

/// How the two models' accuracies in one cell stand to each other.
enum Closer {
    RiskAware,
    NoisyRational,
    Neither,
}

impl Verdict {
    pub(super) fn new(snapshot: &Snapshot) -> Self {
        if let Some(Blind { until, completed }) = snapshot.blind() {
            let hidden = (
                "Hidden",
                format!("until {until} people have finished; now {completed}"),
            );
            return Self {
                model: hidden.0,
                model_note: hidden.1.clone(),
                trust: hidden.0,
                trust_note: hidden.1,
            };
        }
        // The comparison asks for prediction, accuracy only for closeness to answers already seen.
        let (model, model_note) =
            headline_of(&Compared::all(snapshot)).unwrap_or_else(|| model(snapshot));
        let (trust, trust_note) = trust(snapshot);
        Self {
            model,
            model_note,
            trust,
            trust_note,
        }
    }
}

fn model(snapshot: &Snapshot) -> (&'static str, String) {
    let cells: Vec<Closer> = snapshot
        .fitted_cells()
        .filter_map(|cell| closer(snapshot, cell))
        .collect();
    let compared = cells.len();
    let aware = cells
        .iter()
        .filter(|cell| matches!(cell, Closer::RiskAware))
        .count();
    let noisy = cells
        .iter()
        .filter(|cell| matches!(cell, Closer::NoisyRational))
        .count();
    headline(aware, noisy, compared)
}

/// Names a model only where it is closer in at least half of the compared cells and the other one in none.
fn headline(aware: usize, noisy: usize, compared: usize) -> (&'static str, String) {
    let leads = |closer: usize, other: usize| other == 0 && closer > 0 && 2 * closer >= compared;
    let label = if compared == 0 {
        return (
            "Not known yet",
            "no cell has converged fits of both models".to_owned(),
        );
    } else if leads(aware, noisy) {
        RISK_AWARE.label
    } else if leads(noisy, aware) {
        NOISY_RATIONAL.label
    } else if aware > 0 && noisy > 0 {
        "It depends"
    } else {
        "No clear difference"
    };
    let note = format!(
        "of {compared} cells, {} is closer in {aware}, {} in {noisy}",
        RISK_AWARE.label, NOISY_RATIONAL.label
    );
    (label, note)
}

/// A model is closer where the 90 % intervals of ln KL do not meet: where both reach the reference level, a lower mean
/// says nothing.
fn closer(snapshot: &Snapshot, cell: &str) -> Option<Closer> {
    let interval = |model: &str| {
        let ln_kl = &snapshot
            .accuracy(&snapshot.finest_plan().id, model, cell)?
            .ln_kl;
        Some((ln_kl.q5, ln_kl.q95))
    };
    let (aware, noisy) = (interval(RISK_AWARE.id)?, interval(NOISY_RATIONAL.id)?);
    let below = |left: (Option<f64>, Option<f64>), right: (Option<f64>, Option<f64>)| {
        left.1.zip(right.0).is_some_and(|(high, low)| high < low)
    };
    Some(if below(aware, noisy) {
        Closer::RiskAware
    } else if below(noisy, aware) {
        Closer::NoisyRational
    } else {
        Closer::Neither
    })
}

fn trust(snapshot: &Snapshot) -> (&'static str, String) {
    let all = snapshot.fits.len();
    let with = |state: PartState| {
        snapshot
            .fits
            .iter()
            .filter(|part| part.state == state)
            .count()
    };
    let converged = with(PartState::Converged);
    let provisional = snapshot
        .fits
        .iter()
        .filter(|part| part.is_provisional())
        .count();
    let note = if provisional == 0 {
        format!("{converged} of {all} fits converged")
    } else {
        format!("{converged} of {all} fits converged, {provisional} provisional")
    };
    if with(PartState::Failed) > 0 {
        return (
            "No",
            format!("{} of {all} fits failed", with(PartState::Failed)),
        );
    }
    if converged == all {
        ("The fits, yes", note)
    } else if with(PartState::Unconverged) > 0 {
        ("Not all of it", note)
    } else {
        ("Not yet", note)
    }
}

#[cfg(test)]
mod tests {
    use super::headline;

    #[track_caller]
    fn check(aware: usize, noisy: usize, compared: usize, expected: &str) {
        assert_eq!(
            headline(aware, noisy, compared).0,
            expected,
            "{aware}, {noisy} of {compared}"
        );
    }

    #[test]
    fn a_model_is_named_only_where_it_leads_in_half_of_the_cells() {
        check(0, 0, 0, "Not known yet");
        check(0, 0, 8, "No clear difference");
        check(1, 0, 8, "No clear difference");
        check(4, 0, 8, "Risk-Aware");
        check(0, 8, 8, "Noisy Rational");
        check(5, 1, 8, "It depends");
    }
}
