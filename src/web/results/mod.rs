//! Results of a study: the page, the data that its figures are drawn from, and the events that say what changed.
//!
//! The API serves the same [`Summary`], [`Curves`] and [`Accuracy`].

mod accuracy;
mod analysis;
mod codebook;
mod curves;
mod evidence;
mod format;
mod page;
mod page_tables;
mod predictive;
mod reading;
mod report;
mod sources;
mod summary;
mod sweep;
mod sweep_page;
mod table;
mod verdict;

use std::sync::Arc;

use axum::{
    Extension, Json, Router,
    extract::{Path, Query, State, rejection::QueryRejection},
    response::{IntoResponse, Response},
    routing::get,
};
use serde::Deserialize;
use tokio_util::sync::CancellationToken;
use utoipa::IntoParams;

pub use self::analysis::analysis_json;
use self::reading::Reading;
pub use self::report::FitReportPage;
use self::sweep_page::{PageQuery, SweepPage};
pub(super) use self::{
    accuracy::Accuracy,
    curves::Curves,
    evidence::{Comparison, Sequential},
    format::{count, decimal, mean_sd, percent, percents, rfc3339, significant},
    reading::{contraction, estimate, range, ratio, symbol},
    sources::{SourceChoices, SourceFitting, Sources},
    summary::{FitRow, Summary},
    sweep::{GapQuery, Outcome, ShareQuery, Sweep, Wanted},
    table::{Align, Cell, Table},
};
use super::{
    ApiError, AppState, Error, Settings,
    access::{Caller, ClientAddress, Need, Reader, Standing},
    accounts::Bar,
    api::Query as JsonQuery,
    events,
};
use crate::{
    inference::sweep::DEFAULT_ANSWERS,
    jobs::{Catalogue, Snapshot, Sweeps},
    store::Store,
    study::{FitPlan, PartId, PlanId, StudyId},
};

pub(super) fn router() -> Router<AppState> {
    Router::new()
        .route("/results/{study}", get(results))
        .route("/results/{study}/codebook", get(codebook::page))
        .route("/results/{study}/sweep", get(sweep))
        .route("/results/{study}/data/summary.json", get(summary))
        .route("/results/{study}/data/curves.json", get(curves))
        .route("/results/{study}/data/accuracy.json", get(accuracy))
        .route("/results/{study}/data/comparison.json", get(comparison))
        .route("/results/{study}/data/reading.json", get(reading))
        .route("/results/{study}/data/sequential.json", get(sequential))
        .route("/results/{study}/events", get(stream))
}

/// The state of a study, or what a visitor is told when it is not served.
pub(super) async fn snapshot(
    store: &Store,
    catalogue: &Catalogue,
    settings: &Settings,
    study: &StudyId,
) -> Result<Arc<Snapshot>, Error> {
    Snapshot::read(store, catalogue, settings.population, study)
        .await?
        .ok_or(Error::NotFound("study"))
}

/// The state of a study whose results may be shown: all that says how choices fall, or how the models do, asks for this
/// one.
pub(super) async fn shown(
    store: &Store,
    catalogue: &Catalogue,
    settings: &Settings,
    study: &StudyId,
) -> Result<Arc<Snapshot>, Error> {
    unless_blind(snapshot(store, catalogue, settings, study).await?)
}

/// The same snapshot, if its results may be shown.
pub(super) fn unless_blind(snapshot: Arc<Snapshot>) -> Result<Arc<Snapshot>, Error> {
    match snapshot.blind() {
        Some(blind) => Err(Error::Blind(blind)),
        None => Ok(snapshot),
    }
}

/// The plan with this id, or the one with the fewest parts.
pub(super) fn coarse_plan<'a>(
    snapshot: &'a Snapshot,
    id: Option<&PlanId>,
) -> Result<&'a FitPlan, Error> {
    let coarsest = snapshot
        .study
        .plans()
        .iter()
        .min_by_key(|plan| plan.parts.len());
    plan(snapshot, id.or(coarsest.map(|plan| &plan.id)))
}

/// The plan with this id, or the finest one.
pub(super) fn plan<'a>(snapshot: &'a Snapshot, id: Option<&PlanId>) -> Result<&'a FitPlan, Error> {
    let Some(id) = id else {
        return Ok(snapshot.finest_plan());
    };
    let plans = snapshot.study.plans();
    plans.iter().find(|plan| plan.id == *id).ok_or_else(|| {
        let known: Vec<&str> = plans.iter().map(|plan| plan.id.as_str()).collect();
        Error::BadRequest(format!(
            "plan `{id}` does not exist; allowed: {}",
            known.join(", ")
        ))
    })
}

/// Whose curves are asked for.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct CurvesQuery {
    /// All plans if left out.
    #[param(value_type = Option<String>, nullable = false)]
    plan: Option<PlanId>,
    /// All parts of the plan if left out.
    #[param(value_type = Option<String>, nullable = false)]
    part: Option<PartId>,
}

impl CurvesQuery {
    /// The curves, if the plan and the part exist.
    pub(super) fn curves(&self, snapshot: &Snapshot) -> Result<Curves, Error> {
        let plan = plan(snapshot, self.plan.as_ref())?;
        match (&self.plan, &self.part) {
            (None, Some(_)) => {
                return Err(Error::BadRequest(
                    "part is given without plan; allowed: both, or plan alone".to_owned(),
                ));
            }
            (Some(_), Some(part)) if plan.parts.iter().all(|known| known.id != *part) => {
                let known: Vec<&str> = plan.parts.iter().map(|part| part.id.as_str()).collect();
                return Err(Error::BadRequest(format!(
                    "part `{part}` does not exist; allowed: {}",
                    known.join(", ")
                )));
            }
            (Some(_), Some(_)) | (_, None) => {}
        }
        Ok(Curves::new(
            snapshot,
            self.plan.as_ref(),
            self.part.as_ref(),
        ))
    }
}

/// Which plan is asked for.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct PlanQuery {
    /// A plan of the study, as `/studies/STUDY` lists them.
    #[param(value_type = Option<String>, nullable = false)]
    pub(super) plan: Option<PlanId>,
}

type Parts = (State<Store>, State<Arc<Catalogue>>, State<Arc<Settings>>);

async fn results(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
) -> Result<Response, Error> {
    let snapshot = reader
        .snapshot(&store, &catalogue, &settings, &study)
        .await?;
    let bar = Bar::of_study(&store, &caller, &study).await?;
    if let Some(blind) = snapshot.blind() {
        return Ok(page::BlindPage::new(&snapshot, blind, bar).into_response());
    }
    // What forms say is counted as it is now: strangers see what was released.
    let attention = match reader.released() {
        Some(_) => Vec::new(),
        None => page::attention(&store, &snapshot).await?,
    };
    let shows_data = caller.may(Need::Data);
    Ok(page::ResultsPage::new(&snapshot, attention, bar, shows_data).into_response())
}

async fn sweep(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    State(sweeps): State<Arc<Sweeps>>,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
    query: Result<Query<PageQuery>, QueryRejection>,
) -> Result<Response, Error> {
    let Query(query) = query.map_err(|rejection| Error::BadRequest(rejection.body_text()))?;
    // The page also draws what this study's people chose.
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    let n = query.n.unwrap_or(DEFAULT_ANSWERS);
    let wanted = ShareQuery {
        cell: query.cell.clone(),
        n: Some(n),
        seeds: query.seeds,
        ..ShareQuery::default()
    };
    let share = Wanted::share(&snapshot.study, &wanted)?;
    let wanted = GapQuery {
        steps: query.steps,
        seeds: query.seeds,
        ..GapQuery::default()
    };
    let gap = Wanted::gap(&snapshot, &wanted)?;
    // Asked for here already, so that they are on their way when the page's script asks.
    let state = sweeps.ask(&share.input, reader.asker());
    let share = share.answer(&snapshot.study, state)?;
    let state = sweeps.ask(&gap.input, reader.asker());
    let gap = gap.answer(&snapshot.study, state)?;
    let bar = Bar::of(&store, &caller).await?;
    Ok(SweepPage::new(&snapshot, &query, n, &share, &gap, bar).into_response())
}

async fn summary(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    let snapshot = reader
        .snapshot(&store, &catalogue, &settings, &study)
        .await?;
    Ok(Json(Summary::new(&snapshot)).into_response())
}

async fn comparison(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
    JsonQuery(PlanQuery { plan }): JsonQuery<PlanQuery>,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    let plan = coarse_plan(&snapshot, plan.as_ref())?;
    Ok(Json(Comparison::new(&snapshot, plan)).into_response())
}

async fn reading(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    Ok(Json(Reading::new(&snapshot)).into_response())
}

async fn sequential(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    Ok(Json(Sequential::new(&snapshot)).into_response())
}

async fn curves(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
    JsonQuery(query): JsonQuery<CurvesQuery>,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    Ok(Json(query.curves(&snapshot)?).into_response())
}

async fn accuracy(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    Ok(Json(Accuracy::new(&snapshot, snapshot.finest_plan())).into_response())
}

async fn stream(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    State(stop): State<CancellationToken>,
    Extension(client): Extension<ClientAddress>,
    Extension(standing): Extension<Standing>,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    Ok(events::stream(
        (store, &catalogue, settings.population),
        study,
        (&reader, client, standing),
        stop,
    )
    .await?
    .into_response())
}
