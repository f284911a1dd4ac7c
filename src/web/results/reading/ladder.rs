//! The ladder: from chance to the paper's model, what each step gains in held-out score.

use serde::Serialize;

use super::{broadest_plan, comparison::Compared};
use crate::{
    inference::comparison::Comparison,
    jobs::Snapshot,
    model::{CUMULATIVE_PROSPECT, EXPECTED_UTILITY, NOISY_RATIONAL, RISK_AWARE},
    web::results::format::rfc3339,
};

/// Chance, then each nested model that the study fits.
#[derive(Debug, Serialize)]
pub(in crate::web) struct Ladder {
    pub plan: String,
    pub plan_label: String,
    /// Answers.
    pub n: u64,
    /// People or answers left out one at a time.
    pub units: u64,
    pub seed: Option<u64>,
    pub at: Option<String>,
    pub rungs: Vec<Rung>,
}

/// One model on the ladder.
#[derive(Debug, Serialize)]
pub(in crate::web) struct Rung {
    pub model: &'static str,
    pub label: String,
    /// What it adds to the rung below.
    pub adds: &'static str,
    /// Expected log score of what is left out, in nats.
    pub elpd: f64,
    /// Above chance.
    pub above_chance: f64,
    /// Above the rung below; null for chance.
    pub gain: Option<f64>,
    /// Standard error of the gain; null against chance, which has none to compare with.
    pub gain_se: Option<f64>,
    /// Whether the gain can be told from nothing; null where there is no standard error.
    pub distinguishable: Option<bool>,
}

/// The nested models with what each adds.
const RUNGS: [(&str, &str); 4] = [
    (NOISY_RATIONAL.id, "expected rewards, with noise"),
    (EXPECTED_UTILITY.id, "bent rewards (α)"),
    (CUMULATIVE_PROSPECT.id, "weighted probabilities, loss aversion"),
    (RISK_AWARE.id, "a curvature of its own for losses (β)"),
];

impl Ladder {
    /// The ladder of the plan with the fewest parts; `None` before it was compared.
    pub(super) fn new(snapshot: &Snapshot, compared: &[Compared<'_>]) -> Option<Self> {
        let plan = &broadest_plan(snapshot).id;
        let found = compared.iter().find(|found| *plan == *found.plan)?;
        let actions = |cell: &crate::study::Cell| cell.actions.len();
        let fitted = || snapshot.study.cells().iter().filter(|cell| cell.fitted);
        let of_first = fitted().next().map(actions)?;
        // Otherwise chance depends on who was asked what.
        let is_even = fitted().all(|cell| actions(cell) == of_first);
        let chance = is_even.then(|| -(found.comparison.n as f64) * (of_first as f64).ln())?;
        Some(Self {
            plan: plan.to_string(),
            plan_label: found.label.to_owned(),
            n: found.comparison.n,
            units: found.comparison.units,
            seed: found.seed,
            at: found.at.map(rfc3339),
            rungs: rungs(found.comparison, chance)?,
        })
    }
}

fn rungs(comparison: &Comparison, chance: f64) -> Option<Vec<Rung>> {
    let mut rungs = vec![Rung {
        model: "random",
        label: "Random".to_owned(),
        adds: "every action equally likely",
        elpd: chance,
        above_chance: 0.0,
        gain: None,
        gain_se: None,
        distinguishable: None,
    }];
    for (id, adds) in RUNGS {
        let Some(model) = comparison.models.get(id) else {
            continue;
        };
        let elpd = model.leave_one_out.as_ref()?.elpd;
        let below = &rungs[rungs.len() - 1];
        let pair = comparison
            .pairs
            .iter()
            .find(|pair| pair.first == id && pair.second == below.model)
            .and_then(|pair| pair.leave_one_out);
        rungs.push(Rung {
            model: id,
            label: model.label.clone(),
            adds,
            elpd,
            above_chance: elpd - chance,
            gain: Some(elpd - below.elpd),
            gain_se: pair.and_then(|pair| pair.difference.se),
            distinguishable: pair
                .map(|pair| pair.distinguishable && pair.difference.beyond_two_se),
        });
    }
    Some(rungs)
}
