//! Simulated sweeps, computed on demand: 202 with progress until one is ready.

use std::sync::Arc;

use axum::{
    Json,
    extract::State,
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};

use super::{
    Parts,
    extract::{Path, Query},
    served,
};
use crate::{
    jobs::Sweeps,
    study::StudyId,
    web::{
        ApiError,
        results::{self, GapQuery, Outcome, ShareQuery, Sweep, Wanted},
    },
};

pub(super) async fn share(
    (_, State(catalogue), _): Parts,
    State(sweeps): State<Arc<Sweeps>>,
    Path(study): Path<StudyId>,
    Query(query): Query<ShareQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let wanted = Wanted::share(&study, &query)?;
    let state = sweeps.ask(&wanted.input);
    Ok(answer(wanted.answer(&study, state)?))
}

pub(super) async fn gap(
    (State(store), State(catalogue), State(settings)): Parts,
    State(sweeps): State<Arc<Sweeps>>,
    Path(study): Path<StudyId>,
    Query(query): Query<GapQuery>,
) -> Result<Response, ApiError> {
    let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
    let wanted = Wanted::gap(&snapshot, &query)?;
    let state = sweeps.ask(&wanted.input);
    Ok(answer(wanted.answer(&snapshot.study, state)?))
}

fn answer(sweep: Sweep) -> Response {
    match sweep.outcome {
        Outcome::Ready { .. } => Json(sweep).into_response(),
        Outcome::Running { .. } => {
            let mut response = (StatusCode::ACCEPTED, Json(sweep)).into_response();
            response
                .headers_mut()
                .insert(header::RETRY_AFTER, HeaderValue::from_static("2"));
            response
        }
    }
}
