//! What people chose, and how the models fit them, by where they came from.

use std::{sync::Arc, time::Duration};

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Path, Query, State, rejection::QueryRejection},
};
use serde::Deserialize;

use super::{
    super::{
        Error,
        access::Caller,
        accounts::Who,
        assets,
        results::{Cell, SourceFitting, Sources, Table, coarse_plan, count, shown},
    },
    Head, Parts,
    source_tables::{self as tables, SourceTables},
};
use crate::{
    jobs::{Snapshot, SourceFits},
    study::{PlanId, StudyId},
};

/// How long a page waits for fits before it says that they are under way. Few sources take a fraction of a second.
const PATIENCE: Duration = Duration::from_secs(2);

#[derive(Template, WebTemplate)]
#[template(path = "studies/sources.html")]
pub(super) struct SourcesPage {
    head: Head,
    plan: String,
    /// The other ways in which the choices can be fitted: id and text.
    plans: Vec<(String, String)>,
    fitted: SourcesPart,
}

/// The part of the page that changes with every answer.
#[derive(Template, WebTemplate)]
#[template(path = "studies/source_fits.html")]
pub(super) struct SourcesPart {
    plan_label: String,
    fitting: Fitting,
    sources: Table,
    choices: Table,
}

/// What is said of the fits.
enum Fitting {
    /// Why there is nothing.
    Nothing(&'static str),
    /// How far they are.
    Running(String),
    Ready(Box<SourceTables>),
}

/// Which plan is asked for.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlanQuery {
    plan: Option<PlanId>,
}

/// GET `/studies/STUDY/sources`.
pub(super) async fn show(
    (store, catalogue, settings): Parts,
    fits: State<Arc<SourceFits>>,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
    query: Result<Query<PlanQuery>, QueryRejection>,
) -> Result<SourcesPage, Error> {
    let snapshot = shown(&store, &catalogue, &settings, &study).await?;
    let sources = read(&store, &fits, &snapshot, query).await?;
    let served = &snapshot.study;
    let plans = served.plans().iter();
    Ok(SourcesPage {
        plans: plans
            .filter(|plan| plan.id != *sources.plan)
            .map(|plan| (plan.id.to_string(), plan.label.clone()))
            .collect(),
        plan: sources.plan.clone(),
        fitted: SourcesPart::new(&sources),
        head: Head::new(&store, &settings, &caller, served, "/sources").await?,
    })
}

/// GET `/studies/STUDY/data/sources.html`: what the open page fetches when something has changed.
pub(super) async fn part(
    (store, catalogue, settings): Parts,
    fits: State<Arc<SourceFits>>,
    Path(study): Path<StudyId>,
    query: Result<Query<PlanQuery>, QueryRejection>,
) -> Result<SourcesPart, Error> {
    let snapshot = shown(&store, &catalogue, &settings, &study).await?;
    let sources = read(&store, &fits, &snapshot, query).await?;
    Ok(SourcesPart::new(&sources))
}

async fn read(
    store: &crate::store::Store,
    fits: &SourceFits,
    snapshot: &Snapshot,
    query: Result<Query<PlanQuery>, QueryRejection>,
) -> Result<Sources, Error> {
    let Query(PlanQuery { plan }) =
        query.map_err(|rejection| Error::BadRequest(rejection.body_text()))?;
    let plan = coarse_plan(snapshot, plan.as_ref())?;
    Sources::read(store, fits, snapshot, plan, PATIENCE).await
}

impl SourcesPart {
    fn new(sources: &Sources) -> Self {
        Self {
            plan_label: sources.plan_label.clone(),
            fitting: match &sources.fits {
                SourceFitting::NothingToCompare => Fitting::Nothing(match sources.sources.len() {
                    0 => "No choice that the models are fitted to counts yet.",
                    1 => {
                        "All of these people came from one source, so there is nothing to compare. Links for several sources are made on the page Links."
                    }
                    _ => {
                        "There is nothing to compare yet: it takes two sources with enough choices."
                    }
                }),
                SourceFitting::Running { done, of, ahead: 0 } => Fitting::Running(format!(
                    "Being computed: {} of {} fits are done. Reload the page to see the numbers.",
                    count(*done as u64),
                    count(*of as u64)
                )),
                SourceFitting::Running { ahead, .. } => Fitting::Running(format!(
                    "Waits for {ahead} other comparisons. Reload the page to see the numbers."
                )),
                SourceFitting::Ready { result } => {
                    Fitting::Ready(Box::new(SourceTables::new(result)))
                }
            },
            sources: tables::sources(sources),
            choices: tables::choices(sources),
        }
    }
}
