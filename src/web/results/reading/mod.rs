//! `reading.json`: what may be read off the fits, and how the models compare.
//!
//! Sentences and tables are made here once: the page shows them as text, the live page replaces them.

mod choices;
mod comparison;
mod ladder;
mod parameters;

use serde::Serialize;

pub(super) use self::{
    comparison::{Compared, headline},
    ladder::Ladder,
};
pub(in crate::web) use self::{
    comparison::{estimate, ratio},
    parameters::{contraction, range, symbol},
};
use super::{format::rfc3339, table::Table};
use crate::{jobs::Snapshot, study::FitPlan};

/// Everything beside the figures of the fits themselves.
#[derive(Debug, Serialize)]
pub(in crate::web::results) struct Reading {
    pub data_version: i64,
    pub fit_version: i64,
    /// When the latest comparison was made.
    pub at: Option<String>,
    pub texts: Texts,
    pub lists: Lists,
    pub tables: Tables,
    pub ladder: Option<Ladder>,
}

/// Sentences; an empty one is not shown.
#[derive(Debug, Serialize)]
pub(in crate::web::results) struct Texts {
    /// Which fits may still change, though no answer comes.
    pub provisional: String,
    /// Who or what is left out when predictions are scored.
    pub compared: String,
    /// Where the measures do not agree, and what each asks.
    pub disagreement: String,
}

/// Sentences that belong together.
#[derive(Debug, Serialize)]
pub(in crate::web::results) struct Lists {
    /// What the design cannot tell, whatever is chosen.
    pub design: Vec<String>,
    /// What limits the reading of the fits to all cells together.
    pub notes: Vec<String>,
    /// One line per question, with the criterion.
    pub verdicts: Vec<String>,
}

#[derive(Debug, Serialize)]
pub(in crate::web::results) struct Tables {
    pub parameters: Table,
    pub notes: Table,
    pub loss_aversion: Table,
    pub left_out: Table,
    pub scores: Table,
    pub bayes: Table,
    pub sensitivity: Table,
    pub held_out: Table,
    pub bootstrap: Table,
    pub halves: Table,
    pub changes: Table,
}

impl Reading {
    pub(in crate::web::results) fn new(snapshot: &Snapshot) -> Self {
        let compared = Compared::all(snapshot);
        Self {
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            at: compared.iter().map(|plan| plan.at).max().map(rfc3339),
            texts: Texts {
                provisional: parameters::provisional(snapshot),
                compared: comparison::compared(snapshot, &compared),
                disagreement: comparison::disagreement(snapshot, &compared),
            },
            lists: Lists {
                design: parameters::of_design(snapshot),
                notes: parameters::notes(snapshot),
                verdicts: comparison::verdicts(snapshot, &compared),
            },
            tables: Tables {
                parameters: parameters::table(snapshot),
                notes: parameters::all_notes(snapshot),
                loss_aversion: parameters::loss_aversion(snapshot),
                left_out: comparison::left_out(&compared),
                scores: comparison::scores(&compared),
                bayes: comparison::bayes(snapshot, &compared),
                sensitivity: comparison::sensitivity(&compared),
                held_out: comparison::held_out(snapshot, &compared),
                bootstrap: comparison::bootstrap(snapshot, &compared),
                halves: choices::halves(snapshot),
                changes: choices::changes(snapshot),
            },
            ladder: Ladder::new(snapshot, &compared),
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
