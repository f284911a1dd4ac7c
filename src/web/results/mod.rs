//! Results of a study: the page, the data that its figures are drawn from, and the events that say what changed.
//!
//! The API serves the same [`Summary`], [`Curves`] and [`Accuracy`].

mod accuracy;
mod curves;
mod format;
mod page;
mod page_tables;
mod report;
mod summary;
mod table;
mod verdict;

use std::sync::Arc;

use axum::{
    Json, Router,
    extract::{Path, State},
    response::{IntoResponse, Response},
    routing::get,
};
use tokio_util::sync::CancellationToken;

pub use self::report::FitReportPage;
pub(super) use self::{
    accuracy::Accuracy,
    curves::Curves,
    format::rfc3339,
    summary::{FitRow, Summary},
};
use super::{ApiError, AppState, Error, Settings, events};
use crate::{
    jobs::{Catalogue, Snapshot},
    store::Store,
    study::{FitPlan, PlanId, StudyId},
};

pub(super) fn router() -> Router<AppState> {
    Router::new()
        .route("/results/{study}", get(results))
        .route("/results/{study}/data/summary.json", get(summary))
        .route("/results/{study}/data/curves.json", get(curves))
        .route("/results/{study}/data/accuracy.json", get(accuracy))
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

type Parts = (State<Store>, State<Arc<Catalogue>>, State<Arc<Settings>>);

async fn results(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
) -> Result<Response, Error> {
    let snapshot = snapshot(&store, &catalogue, &settings, &study).await?;
    let attention = page::attention(&store, &snapshot).await?;
    Ok(page::ResultsPage::new(&snapshot, attention).into_response())
}

async fn summary(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    let snapshot = snapshot(&store, &catalogue, &settings, &study).await?;
    Ok(Json(Summary::new(&snapshot)).into_response())
}

async fn curves(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    let snapshot = snapshot(&store, &catalogue, &settings, &study).await?;
    Ok(Json(Curves::new(&snapshot, None)).into_response())
}

async fn accuracy(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    let snapshot = snapshot(&store, &catalogue, &settings, &study).await?;
    Ok(Json(Accuracy::new(&snapshot, snapshot.finest_plan())).into_response())
}

async fn stream(
    (State(store), State(catalogue), State(settings)): Parts,
    State(stop): State<CancellationToken>,
    Path(study): Path<StudyId>,
) -> Result<Response, ApiError> {
    Ok(
        events::stream(store, &catalogue, settings.population, study, stop)
            .await?
            .into_response(),
    )
}
