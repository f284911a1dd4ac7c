//! `evidence.json`: what may be read off the fits, how the models compare, and how the evidence grew.
//!
//! Sentences and tables are made here once: the page shows them as text, the live page replaces them.

mod comparison;
mod ladder;
mod parameters;
mod sequential;

use serde::Serialize;

pub(super) use self::{
    comparison::{Compared, headline},
    ladder::Ladder,
    sequential::Sequential,
};
use super::{format::rfc3339, table::Table};
use crate::{
    jobs::Snapshot,
    study::{FitPlan, Timestamp},
};

/// Everything beside the figures of the fits themselves.
#[derive(Debug, Serialize)]
pub(in crate::web) struct Evidence {
    pub data_version: i64,
    pub fit_version: i64,
    /// When the latest comparison was made.
    pub at: Option<String>,
    pub texts: Texts,
    pub lists: Lists,
    pub tables: Tables,
    pub ladder: Option<Ladder>,
    pub sequential: Option<Sequential>,
}

/// Sentences; an empty one is not shown.
#[derive(Debug, Serialize)]
pub(in crate::web) struct Texts {
    /// Which fits may still change, though no answer comes.
    pub provisional: String,
    /// Who or what is left out when predictions are scored.
    pub compared: String,
    /// Where the measures do not agree, and what each asks.
    pub disagreement: String,
    /// That the rule for stopping was reached.
    pub stopping: String,
}

/// Sentences that belong together.
#[derive(Debug, Serialize)]
pub(in crate::web) struct Lists {
    /// What the design cannot tell, whatever is chosen.
    pub design: Vec<String>,
    /// What limits the reading of the fits to all cells together.
    pub notes: Vec<String>,
    /// One line per question, with the criterion.
    pub verdicts: Vec<String>,
}

#[derive(Debug, Serialize)]
pub(in crate::web) struct Tables {
    pub parameters: Table,
    pub notes: Table,
    pub loss_aversion: Table,
    pub held_out: Table,
    pub scores: Table,
    pub bayes: Table,
    pub sensitivity: Table,
}

impl Evidence {
    pub(in crate::web) fn new(snapshot: &Snapshot) -> Self {
        let compared = Compared::all(snapshot);
        let sequential = Sequential::new(snapshot);
        Self {
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            at: compared.iter().filter_map(|plan| plan.at).max().map(rfc3339),
            texts: Texts {
                provisional: parameters::provisional(snapshot),
                compared: comparison::unit(&compared),
                disagreement: comparison::disagreement(&compared),
                stopping: sequential
                    .as_ref()
                    .map(Sequential::announcement)
                    .unwrap_or_default(),
            },
            lists: Lists {
                design: parameters::of_design(snapshot),
                notes: parameters::notes(snapshot),
                verdicts: comparison::verdicts(&compared),
            },
            tables: Tables {
                parameters: parameters::table(snapshot),
                notes: parameters::all_notes(snapshot),
                loss_aversion: parameters::loss_aversion(snapshot),
                held_out: comparison::held_out(&compared),
                scores: comparison::scores(&compared),
                bayes: comparison::bayes(&compared),
                sensitivity: comparison::sensitivity(&compared),
            },
            ladder: Ladder::new(snapshot, &compared),
            sequential,
        }
    }
}

/// The plan with the fewest parts: closest to one fit of everything.
fn broadest_plan(snapshot: &Snapshot) -> &FitPlan {
    let plans = snapshot.study.plans();
    plans
        .iter()
        .min_by_key(|plan| plan.parts.len())
        .unwrap_or(&plans[0])
}

fn latest(left: Option<Timestamp>, right: Option<Timestamp>) -> Option<Timestamp> {
    left.max(right)
}
