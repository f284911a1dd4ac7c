//! `/api/v1`: the same numbers for programs. docs/API.md has one sample of each path.
//!
//! Every error is `application/problem+json` (RFC 9457), also those of the framework.

mod answers;
mod cursor;
mod document;
mod draws;
mod exports;
mod extract;
mod fits;
mod page;
mod participants;
mod predict;
mod sources;
mod sweeps;
mod version;

use std::sync::Arc;

use axum::{
    Extension, Router,
    extract::State,
    response::{IntoResponse, Response},
    routing::get,
};
use serde::{Deserialize, Serialize};
use tokio_util::sync::CancellationToken;
use utoipa::IntoParams;
use utoipa_axum::{router::OpenApiRouter, routes};

pub use self::document::document;
pub(super) use self::extract::Query;
use self::{extract::Path, version::Asked};
use super::{
    ApiError, AppState, Error, Settings,
    access::{Caller, ClientAddress, Need, Reader, Standing},
    events,
    results::{self, Accuracy, Comparison, Curves, PlanQuery, Sequential, Summary},
};
use crate::{
    jobs::Catalogue,
    store::{Store, StudyState},
    study::{Study, StudyId},
};

pub(super) fn router() -> Router<AppState> {
    // Inside the nest, so that these answer everything below /api and nothing else.
    Router::new().nest(
        "/api",
        Router::new()
            .nest("/v1", studies().into())
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

/// The description of the API, which tells nothing of any study and so is open to everybody.
pub(super) fn description() -> Router<AppState> {
    Router::new().nest(
        "/api/v1",
        Router::from(documents())
            .method_not_allowed_fallback(|| async { ApiError(Error::MethodNotAllowed) }),
    )
}

/// A path stands here together with its description, so that the document cannot lack one.
fn studies() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(list))
        .routes(routes!(one))
        .routes(routes!(summary))
        .routes(routes!(answers::page))
        .routes(routes!(participants::page))
        .routes(routes!(participants::funnel))
        .merge(exports::router())
        .routes(routes!(fits::list))
        .routes(routes!(fits::one))
        .routes(routes!(draws::arviz))
        .routes(routes!(draws::csv))
        .routes(routes!(curves))
        .routes(routes!(accuracy))
        .routes(routes!(sweeps::share))
        .routes(routes!(sweeps::gap))
        .routes(routes!(sources::sources))
        .routes(routes!(comparison))
        .routes(routes!(sequential))
        .routes(routes!(predict::predict))
        .routes(routes!(stream))
}

fn documents() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(document::openapi))
        .routes(routes!(page::docs))
}

/// What every handler of a study needs.
pub(super) type Parts = (State<Store>, State<Arc<Catalogue>>, State<Arc<Settings>>);

/// The query of a path that takes none.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct NoQuery {}

/// The path of a study.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[expect(dead_code, reason = "describes the path; the extractor reads it")]
struct StudyPath {
    /// The study's id.
    #[param(example = "driving")]
    study: String,
}

/// The path of a fit.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[expect(dead_code, reason = "describes the path; the extractor reads it")]
struct FitPath {
    /// The study's id.
    #[param(example = "driving")]
    study: String,
    /// The fit's id.
    fit: i64,
}

#[derive(Serialize, utoipa::ToSchema)]
struct StudyList {
    studies: Vec<StudyEntry>,
}

#[derive(Serialize, utoipa::ToSchema)]
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

#[derive(Serialize, utoipa::ToSchema)]
struct StudyDetail {
    #[serde(flatten)]
    entry: StudyEntry,
    cells: Vec<CellEntry>,
    plans: Vec<PlanEntry>,
    /// The study file, which holds completion codes and the answers of checks: null without the scope `data`.
    file: Option<String>,
}

#[derive(Serialize, utoipa::ToSchema)]
struct CellEntry {
    id: String,
    label: String,
    fitted: bool,
    /// Null where the question withholds a probability or a reward.
    problem: Option<crate::model::ChoiceProblem>,
}

#[derive(Serialize, utoipa::ToSchema)]
struct PlanEntry {
    id: String,
    label: String,
    parts: Vec<String>,
}

/// All studies.
#[utoipa::path(
    get, path = "/studies", tag = "studies", params(),
    responses((status = 200, description = "The studies that this server serves", body = StudyList), (status = 304)),
    security((), ("token" = ["results"])),
)]
async fn list(
    (State(store), State(catalogue), State(settings)): Parts,
    Query(NoQuery {}): Query<NoQuery>,
    asked: Asked,
) -> Result<Response, ApiError> {
    let mut studies = Vec::new();
    for study in catalogue.studies() {
        studies.push(entry(&store, &settings, &study).await?);
    }
    let of: Vec<String> = studies.iter().map(StudyEntry::version).collect();
    asked.decided_by(of.join(" "), || Ok(StudyList { studies }))
}

/// One study in full.
#[utoipa::path(
    get, path = "/studies/{study}", tag = "studies", params(StudyPath),
    responses((status = 200, description = "The study with its cells and plans", body = StudyDetail), (status = 304)),
    security((), ("token" = ["results"])),
)]
async fn one(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
    Extension(caller): Extension<Caller>,
    asked: Asked,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let entry = entry(&store, &settings, &study).await?;
    let version = entry.version();
    let shows_file = caller.may(Need::Data);
    let detail = StudyDetail {
        entry,
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
        file: shows_file.then(|| study.text().to_owned()),
    };
    asked.decided_by(format!("{version} {shows_file}"), || Ok(detail))
}

impl StudyEntry {
    /// What can change of it.
    fn version(&self) -> String {
        format!("{} {} {}", self.hash, self.state, self.simulated)
    }
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

/// Who took part, what they chose, and how far the fits are.
///
/// In a study that hides its results until enough people have finished, `blind` says so and all that tells of choices or
/// models is empty.
#[utoipa::path(
    get, path = "/studies/{study}/summary", tag = "results", params(StudyPath),
    responses((status = 200, description = "Counts, shares and the states of fits", body = Summary), (status = 304)),
    security((), ("token" = ["results"])),
)]
async fn summary(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
    asked: Asked,
) -> Result<Response, ApiError> {
    let snapshot = reader
        .snapshot(&store, &catalogue, &settings, &study)
        .await?;
    asked.of(&snapshot, || Ok(Summary::new(&snapshot)))
}

/// The curves of value and weighting, with 50 % and 90 % bands.
#[utoipa::path(
    get, path = "/studies/{study}/curves", tag = "results", params(StudyPath, results::CurvesQuery),
    responses((status = 200, description = "Value and weighting by part and model", body = Curves), (status = 304)),
    security((), ("token" = ["results"])),
)]
async fn curves(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
    Query(query): Query<results::CurvesQuery>,
    asked: Asked,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    asked.of(&snapshot, || Ok(query.curves(&snapshot)?))
}

/// How close each model comes to the choices.
#[utoipa::path(
    get, path = "/studies/{study}/accuracy", tag = "results", params(StudyPath, PlanQuery),
    responses((status = 200, description = "ln KL by cell and pooled", body = Accuracy), (status = 304)),
    security((), ("token" = ["results"])),
)]
async fn accuracy(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
    Query(PlanQuery { plan }): Query<PlanQuery>,
    asked: Asked,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    let plan = results::plan(&snapshot, plan.as_ref())?;
    asked.of(&snapshot, || Ok(Accuracy::new(&snapshot, plan)))
}

/// The models compared.
#[utoipa::path(
    get, path = "/studies/{study}/comparison", tag = "results", params(StudyPath, PlanQuery),
    responses((status = 200, description = "Bayes factors, and predictions of people and problems left out", body = Comparison), (status = 304)),
    security((), ("token" = ["results"])),
)]
async fn comparison(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
    Query(PlanQuery { plan }): Query<PlanQuery>,
    asked: Asked,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    let plan = results::coarse_plan(&snapshot, plan.as_ref())?;
    asked.of(&snapshot, || Ok(Comparison::new(&snapshot, plan)))
}

/// The evidence as people finished one after the other.
#[utoipa::path(
    get, path = "/studies/{study}/sequential", tag = "results", params(StudyPath),
    responses((status = 200, description = "The looks that were made, and the rule for stopping", body = Sequential), (status = 304)),
    security((), ("token" = ["results"])),
)]
async fn sequential(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
    asked: Asked,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    asked.of(&snapshot, || Ok(Sequential::new(&snapshot)))
}

/// The current version at once, then each that follows (server-sent events).
///
/// A slow reader skips versions. At most 256 streams are open at a time. Without a token a public study tells the version that is
/// released, and no other.
#[utoipa::path(
    get, path = "/studies/{study}/events", tag = "events", params(StudyPath),
    responses((status = 200, description = "Events named `version`, one for each version; the stream ends when the token or the study's public switch no longer opens it", content((events::VersionEvent = "text/event-stream")))),
    security((), ("token" = ["results"])),
)]
async fn stream(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    State(stop): State<CancellationToken>,
    Extension(client): Extension<ClientAddress>,
    Extension(standing): Extension<Standing>,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
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
