//! Posterior predictive checks of the fits that are shown (models.md has the models, `inference::predictive_check` the checks).

use serde::Serialize;

use super::{
    format::{count, decimal, percent, percents},
    table::{Align, Table},
};
use crate::{
    inference::predictive_check::PredictiveCheck,
    jobs::Snapshot,
    model::{ChoiceModel, OrderedMap, model_named},
    study::FitPlan,
};

/// One fitted cell's answers beside answers replicated from each model's fit.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct CheckRow {
    pub id: String,
    #[serde(skip)]
    pub label: String,
    /// Null where there is no converged fit, or one from before there were such checks.
    #[schema(value_type = HashMap<String, PredictiveCheck>)]
    pub models: OrderedMap<Option<PredictiveCheck>>,
}

/// The checks of a plan's fits, in file order.
pub(super) fn checks(snapshot: &Snapshot, plan: &FitPlan) -> Vec<CheckRow> {
    let of_model = |model: &ChoiceModel, cell: &str| {
        snapshot
            .fits
            .iter()
            .filter(|part| part.plan == plan.id && part.model.id == model.id)
            .filter_map(|part| part.converged())
            .flat_map(|report| &report.predictive_check)
            .find(|check| check.problem == cell)
            .cloned()
    };
    let cells = snapshot.study.cells().iter().filter(|cell| cell.fitted);
    cells
        .map(|cell| CheckRow {
            id: cell.id.to_string(),
            label: cell.label.clone(),
            models: snapshot
                .study
                .models()
                .iter()
                .map(|model| (model.id.to_owned(), of_model(model, cell.id.as_str())))
                .collect(),
        })
        .collect()
}

/// The numbers as text.
pub(super) fn table(rows: &[CheckRow]) -> Table {
    let mut table = Table::new(&[
        ("Cell", Align::Words),
        ("Model", Align::Words),
        ("Action", Align::Words),
        ("n", Align::Numbers),
        ("Chosen", Align::Numbers),
        ("50 % replicated", Align::Words),
        ("90 % replicated", Align::Words),
        ("mid-p", Align::Numbers),
        ("Discrepancy p", Align::Numbers),
    ]);
    for row in rows {
        for (model, check) in row.models.iter() {
            let Some(check) = check else {
                continue;
            };
            for action in &check.actions {
                table.row([
                    row.label.clone(),
                    model_named(model)
                        .map_or(model, |model| model.label)
                        .to_owned(),
                    action.action.clone(),
                    count(check.n),
                    percent(Some(action.observed)),
                    percents(Some(action.q25), Some(action.q75)),
                    percents(Some(action.q5), Some(action.q95)),
                    decimal(Some(action.p), 2),
                    decimal(Some(check.discrepancy_p), 2),
                ]);
            }
        }
    }
    table
}
