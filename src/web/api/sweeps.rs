//! Simulated sweeps, computed on demand: 202 with progress until one is ready.

use std::sync::Arc;

use axum::{
    Json,
    extract::State,
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use serde::Serialize;

use super::{
    Parts, StudyPath,
    extract::{Path, Query},
    served,
};
use crate::{
    jobs::Sweeps,
    study::StudyId,
    web::{
        ApiError,
        access::Reader,
        results::{GapQuery, Outcome, ShareQuery, Sweep, Wanted},
    },
};

/// A simulated sweep over the share of an action: what each model would find if that share of people chose it.
#[utoipa::path(
    get, path = "/studies/{study}/sweep", tag = "results", params(StudyPath, ShareQuery),
    responses(
        (status = 200, description = "The sweep", body = Sweep),
        (status = 202, description = "It is being computed; ask again", body = Sweep, headers(("Retry-After" = u32, description = "Seconds"))),
        (status = 422, description = "A value is not allowed, or the sweep would take too many fits", body = crate::web::problem::Problem, content_type = "application/problem+json"),
    ),
    security((), ("token" = ["results"])),
)]
pub(super) async fn share(
    (_, State(catalogue), _): Parts,
    reader: Reader,
    State(sweeps): State<Arc<Sweeps>>,
    Path(study): Path<StudyId>,
    Query(query): Query<ShareQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let wanted = Wanted::share(&study, &query)?;
    let state = sweeps.ask(&wanted.input, reader.asker());
    Ok(answer(wanted.answer(&study, state)?))
}

/// A simulated sweep over the gap of expected rewards.
#[utoipa::path(
    get, path = "/studies/{study}/gap-sweep", tag = "results", params(StudyPath, GapQuery),
    responses(
        (status = 200, description = "The sweep", body = Sweep),
        (status = 202, description = "It is being computed; ask again", body = Sweep, headers(("Retry-After" = u32, description = "Seconds"))),
        (status = 422, description = "A value is not allowed, or the sweep would take too many fits", body = crate::web::problem::Problem, content_type = "application/problem+json"),
    ),
    security((), ("token" = ["results"])),
)]
pub(super) async fn gap(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    State(sweeps): State<Arc<Sweeps>>,
    Path(study): Path<StudyId>,
    Query(query): Query<GapQuery>,
) -> Result<Response, ApiError> {
    let snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    let wanted = Wanted::gap(&snapshot, &query)?;
    let state = sweeps.ask(&wanted.input, reader.asker());
    Ok(answer(wanted.answer(&snapshot.study, state)?))
}

fn answer(sweep: Sweep) -> Response {
    let is_running = matches!(sweep.outcome, Outcome::Running { .. });
    on_demand(sweep, is_running)
}

/// What is computed on demand: 202 while it is on its way.
pub(super) fn on_demand(found: impl Serialize, is_running: bool) -> Response {
    if !is_running {
        return Json(found).into_response();
    }
    let mut response = (StatusCode::ACCEPTED, Json(found)).into_response();
    response
        .headers_mut()
        .insert(header::RETRY_AFTER, HeaderValue::from_static("2"));
    response
}
