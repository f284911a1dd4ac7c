//! The ladder: from chance to the richest model, what each step gains in held-out score.

use serde::Serialize;

use super::{broadest_plan, comparison::Compared};
use crate::{
    inference::comparison::{
        LEAST_DIFFERENCE, LEAST_PROBLEMS, LEAST_UNITS, LadderStep, ScoreDifference,
    },
    jobs::Snapshot,
    web::results::format::rfc3339,
};

/// Chance, then each model that the study fits, from the plainest to the richest.
#[derive(Debug, Serialize)]
pub(in crate::web::results) struct Ladder {
    pub plan: String,
    pub plan_label: String,
    /// Answers.
    pub n: u64,
    /// People or answers left out one at a time.
    pub units: u64,
    /// `people` or `answers`.
    pub units_are: &'static str,
    pub seed: u64,
    pub at: String,
    /// Whether cells were left out; else people (or answers) were.
    pub cells_left_out: bool,
    pub rungs: Vec<Rung>,
}

/// One step of the ladder; null where a fit has not converged.
#[derive(Debug, Serialize)]
pub(in crate::web::results) struct Rung {
    pub model: String,
    pub label: String,
    /// Expected log score, in nats.
    pub score: Option<f64>,
    pub per_answer: Option<f64>,
    /// Above the rung below; null for the first.
    pub gain: Option<f64>,
    pub gain_se: Option<f64>,
    /// Whether the gain can be told from nothing.
    pub distinguishable: Option<bool>,
}

impl Ladder {
    /// The ladder of the plan with the fewest parts; `None` before it was compared.
    pub(super) fn new(snapshot: &Snapshot, compared: &[Compared<'_>]) -> Option<Self> {
        let plan = &broadest_plan(snapshot).id;
        let found = compared.iter().find(|found| *plan == *found.plan)?;
        let steps = &found.comparison.ladder;
        let cells_left_out = steps.iter().any(|step| step.problems.is_some());
        if steps.is_empty() {
            return None;
        }
        Some(Self {
            plan: plan.to_string(),
            plan_label: found.label.to_owned(),
            n: found.comparison.n,
            units: found.comparison.units,
            units_are: found.units(),
            seed: found.seed,
            at: rfc3339(found.at),
            cells_left_out,
            rungs: steps
                .iter()
                .map(|step| Rung::new(step, cells_left_out))
                .collect(),
        })
    }
}

impl Rung {
    fn new(step: &LadderStep, cells_left_out: bool) -> Self {
        let score = if cells_left_out {
            step.problems
        } else {
            step.units
        };
        let gain = score.and_then(|score| score.gain);
        let is_clear = |gain: ScoreDifference| {
            gain.beyond_two_se
                && if cells_left_out {
                    gain.units >= LEAST_PROBLEMS
                } else {
                    gain.units >= LEAST_UNITS && gain.value.abs() >= LEAST_DIFFERENCE
                }
        };
        Self {
            model: step.id.clone(),
            label: step.label.clone(),
            score: score.map(|score| score.score),
            per_answer: score.map(|score| score.per_answer),
            gain: gain.map(|gain| gain.value),
            gain_se: gain.and_then(|gain| gain.se),
            distinguishable: gain.map(is_clear),
        }
    }
}
