//! `curves.json`: what each converged fit says about value and probability (models.md, section 8).

use serde::Serialize;

use crate::{
    jobs::{PartFit, Snapshot},
    model::OrderedMap,
    study::PlanId,
    web::results::format::rfc3339,
};

/// The curves of all plans.
#[derive(Debug, Serialize)]
pub(in crate::web) struct Curves<'a> {
    pub data_version: i64,
    pub fit_version: i64,
    /// Draws per fit, where all fits keep equally many.
    pub draws: Option<u64>,
    /// When the latest of the fits was made.
    pub at: Option<String>,
    pub plans: Vec<PartCurves<'a>>,
}

#[derive(Debug, Serialize)]
pub(in crate::web) struct PartCurves<'a> {
    pub plan: String,
    pub part: String,
    pub label: String,
    /// Only models whose fit has converged.
    pub models: OrderedMap<&'a crate::inference::curves::Curves>,
    /// The seeds of those fits.
    pub seeds: OrderedMap<u64>,
}

impl<'a> Curves<'a> {
    /// The curves of one plan, or of all.
    pub(in crate::web) fn new(snapshot: &'a Snapshot, plan: Option<&PlanId>) -> Self {
        let fits: Vec<&PartFit> =
            snapshot.fits.iter().filter(|part| plan.is_none_or(|plan| part.plan == *plan)).collect();
        let mut plans: Vec<PartCurves> = Vec::new();
        for part in &fits {
            let entry = match plans.iter().position(|known| part.plan == known.plan.as_str() && part.part == known.part.as_str()) {
                Some(index) => &mut plans[index],
                None => {
                    plans.push(PartCurves {
                        plan: part.plan.to_string(),
                        part: part.part.to_string(),
                        label: part.part_label.clone(),
                        models: OrderedMap(Vec::new()),
                        seeds: OrderedMap(Vec::new()),
                    });
                    let last = plans.len() - 1;
                    &mut plans[last]
                }
            };
            if let (Some(findings), Some(fit)) = (part.converged(), &part.fit) {
                entry.models.0.push((part.model.id.to_owned(), &findings.curves));
                entry.seeds.0.push((part.model.id.to_owned(), fit.seed));
            }
        }
        let mut draws = fits.iter().filter_map(|part| Some(part.report()?.diagnostics.draws));
        let first = draws.next();
        Self {
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            draws: first.filter(|first| draws.all(|other| other == *first)),
            at: fits.iter().filter_map(|part| Some(part.fit.as_ref()?.created_at)).max().map(rfc3339),
            plans,
        }
    }
}
