//! People by where they came from, computed on demand: 202 with progress until the fits are ready.

use std::{sync::Arc, time::Duration};

use axum::{extract::State, response::Response};

use super::{
    Parts, PlanQuery, StudyPath,
    extract::{Path, Query},
    sweeps::on_demand,
};
use crate::{
    jobs::SourceFits,
    study::StudyId,
    web::{
        ApiError,
        results::{self, SourceFitting, Sources},
    },
};

/// People by the `source` label of their links: what they chose, and the models fitted to each source.
///
/// Sources with too few choices, and all but the eight with the most, are listed and not compared.
#[utoipa::path(
    get, path = "/studies/{study}/sources", tag = "results", params(StudyPath, PlanQuery),
    responses(
        (status = 200, description = "Choices, and fits where there is something to compare", body = Sources),
        (status = 202, description = "The fits are being computed; ask again", body = Sources, headers(("Retry-After" = u32, description = "Seconds"))),
    ),
    security((), ("token" = ["results"])),
)]
pub(super) async fn sources(
    (State(store), State(catalogue), State(settings)): Parts,
    State(fits): State<Arc<SourceFits>>,
    Path(study): Path<StudyId>,
    Query(PlanQuery { plan }): Query<PlanQuery>,
) -> Result<Response, ApiError> {
    let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
    let plan = results::coarse_plan(&snapshot, plan.as_ref())?;
    let found = Sources::read(&store, &fits, &snapshot, plan, Duration::ZERO).await?;
    let is_running = matches!(found.fits, SourceFitting::Running { .. });
    Ok(on_demand(found, is_running))
}
