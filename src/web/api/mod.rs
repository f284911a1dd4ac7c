//! `/api/v1`: the same numbers for programs. docs/API.md has one sample of each path.
//!
//! Every error is `application/problem+json` (RFC 9457), also those of the framework.

mod answers;
mod draws;
mod exports;
mod extract;
mod fits;
mod predict;
mod sweeps;

use std::sync::Arc;

use axum::{
    Json, Router,
    extract::State,
    response::{IntoResponse, Response},
    routing::{get, post},
};
use serde::{Deserialize, Serialize};
use tokio_util::sync::CancellationToken;

use self::extract::{Path, Query};
use super::{
    ApiError, AppState, Error, Settings, events,
    results::{self, Accuracy, Comparison, Sequential, Summary},
};
use crate::{
    jobs::Catalogue,
    store::{Store, StudyState},
    study::{PlanId, Study, StudyId},
};

pub(super) fn router() -> Router<AppState> {
    let studies = Router::new()
        .route("/studies", get(list))
        .route("/studies/{study}", get(one))
        .route("/studies/{study}/summary", get(summary))
        .route("/studies/{study}/answers", get(answers::page))
        .route("/studies/{study}/fits", get(fits::list))
        .route("/studies/{study}/fits/{fit}", get(fits::one))
        .route("/studies/{study}/fits/{fit}/draws", get(draws::arviz))
        .route("/studies/{study}/fits/{fit}/draws.csv", get(draws::csv))
        .route("/studies/{study}/curves", get(curves))
        .route("/studies/{study}/accuracy", get(accuracy))
        .route("/studies/{study}/sweep", get(sweeps::share))
        .route("/studies/{study}/gap-sweep", get(sweeps::gap))
        .route("/studies/{study}/comparison", get(comparison))
        .route("/studies/{study}/sequential", get(sequential))
        .route("/studies/{study}/predict", post(predict::predict))
        .route("/studies/{study}/events", get(stream));
    // Inside the nest, so that these answer everything below /api and nothing else.
    Router::new().nest(
        "/api",
        Router::new()
            .nest("/v1", studies.merge(exports::router()))
            .fallback(|| async { ApiError(Error::NotFound("address of the API")) })
            .method_not_allowed_fallback(|| async { ApiError(Error::MethodNotAllowed) }),
    )
}

/// The same documents for whoever is logged in, so that pages need no token.
pub(super) fn router_of_pages() -> Router<AppState> {
    Router::new()
        .route("/results/{study}/data/fits.json", get(fits::list))
        .route("/results/{study}/data/sweep.json", get(sweeps::share))
        .route("/results/{study}/data/gap-sweep.json", get(sweeps::gap))
        .merge(exports::router_of_pages())
}

/// What every handler of a study needs.
pub(super) type Parts = (State<Store>, State<Arc<Catalogue>>, State<Arc<Settings>>);

/// The query of a path that takes none.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct NoQuery {}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanQuery {
    plan: Option<PlanId>,
}

#[derive(Serialize)]
struct StudyList {
    studies: Vec<StudyEntry>,
}

#[derive(Serialize)]
struct StudyEntry {
    id: String,
    title: String,
    summary: String,
    minutes: u32,
    state: StudyState,
    /// SHA-256 of the study file that new runs get.
    hash: String,
    simulated: bool,
}

#[derive(Serialize)]
struct StudyDetail {
    #[serde(flatten)]
    entry: StudyEntry,
    cells: Vec<CellEntry>,
    plans: Vec<PlanEntry>,
    /// The study file.
    file: String,
}

#[derive(Serialize)]
struct CellEntry {
    id: String,
    label: String,
    fitted: bool,
    /// Null where the question withholds a probability or a reward.
    problem: Option<crate::model::ChoiceProblem>,
}

#[derive(Serialize)]
struct PlanEntry {
    id: String,
    label: String,
    parts: Vec<String>,
}

async fn list(
    (State(store), State(catalogue), State(settings)): Parts,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let mut studies = Vec::new();
    for study in catalogue.studies() {
        studies.push(entry(&store, &settings, &study).await?);
    }
    Ok(Json(StudyList { studies }).into_response())
}

async fn one(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let detail = StudyDetail {
        entry: entry(&store, &settings, &study).await?,
        cells: study
            .cells()
            .iter()
            .map(|cell| CellEntry {
                id: cell.id.to_string(),
                label: cell.label.clone(),
                fitted: cell.fitted,
                problem: cell.problem.clone(),
            })
            .collect(),
        plans: study
            .plans()
            .iter()
            .map(|plan| PlanEntry {
                id: plan.id.to_string(),
                label: plan.label.clone(),
                parts: plan.parts.iter().map(|part| part.id.to_string()).collect(),
            })
            .collect(),
        file: study.text().to_owned(),
    };
    Ok(Json(detail).into_response())
}

async fn entry(store: &Store, settings: &Settings, study: &Study) -> Result<StudyEntry, Error> {
    Ok(StudyEntry {
        id: study.id().to_string(),
        title: study.title().to_owned(),
        summary: study.summary().to_owned(),
        minutes: study.minutes(),
        state: store.study(study.id()).await?.state,
        hash: study.hash().to_owned(),
        simulated: settings.population.is_simulated(),
    })
}

fn served(catalogue: &Catalogue, study: &StudyId) -> Result<Arc<Study>, Error> {
    catalogue
        .current(study)
        .map(|(_, study)| study)
        .ok_or(Error::NotFound("study"))
}

async fn summary(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let snapshot = results::snapshot(&store, &catalogue, &settings, &study).await?;
    Ok(Json(Summary::new(&snapshot)).into_response())
}

async fn curves(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(query): Query<results::CurvesQuery>,
) -> Result<Response, ApiError> {
    let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
    Ok(Json(query.curves(&snapshot)?).into_response())
}

async fn accuracy(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(PlanQuery { plan }): Query<PlanQuery>,
) -> Result<Response, ApiError> {
    let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
    let plan = results::plan(&snapshot, plan.as_ref())?;
    Ok(Json(Accuracy::new(&snapshot, plan)).into_response())
}

async fn comparison(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(PlanQuery { plan }): Query<PlanQuery>,
) -> Result<Response, ApiError> {
    let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
    let plan = results::coarse_plan(&snapshot, plan.as_ref())?;
    Ok(Json(Comparison::new(&snapshot, plan)).into_response())
}

async fn sequential(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
    Ok(Json(Sequential::new(&snapshot)).into_response())
}

async fn stream(
    (State(store), State(catalogue), State(settings)): Parts,
    State(stop): State<CancellationToken>,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    Ok(
        events::stream(store, &catalogue, settings.population, study, stop)
            .await?
            .into_response(),
    )
}
