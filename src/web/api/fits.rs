//! Fits: the state of each part now, their history, and one fit in full.

use axum::{
    Json,
    extract::State,
    http::{HeaderValue, header},
    response::{IntoResponse, Response},
};
use serde::{Deserialize, Serialize};

use super::{
    NoQuery, Parts,
    extract::{Path, Query},
    served,
};
use crate::{
    inference::{FitSummary, accuracy::CellAccuracy, predictive_check::PredictiveCheck},
    jobs::FitReport,
    model::{ChoiceProblem, OrderedMap},
    store::{Fit, FitId, FitOutcome, FitState},
    study::StudyId,
    web::{
        ApiError, Error,
        results::{self, Summary, rfc3339},
    },
};

const PAGE_ROWS: u32 = 50;
const MAX_PAGE_ROWS: u32 = 200;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FitsQuery {
    /// Earlier fits instead of the current state.
    #[serde(default)]
    history: bool,
    /// Only fits with a smaller id.
    before: Option<i64>,
    limit: Option<u32>,
}

#[derive(Serialize)]
struct History {
    fits: Vec<StoredFit>,
}

/// A stored fit without its numbers.
#[derive(Serialize)]
struct StoredFit {
    id: i64,
    plan: String,
    part: String,
    model: String,
    state: FitState,
    /// It started from the fit before it: to be cited is the final one.
    provisional: bool,
    attempts: u32,
    data_version: i64,
    study_version: i64,
    seed: u64,
    program_version: String,
    input_hash: String,
    created_at: String,
    cpu_ms: u64,
    message: Option<String>,
}

#[derive(Serialize)]
struct FullFit {
    #[serde(flatten)]
    fit: StoredFit,
    /// Null for a failed fit; its numbers are null for one that has not converged.
    result: Option<Numbers>,
}

#[derive(Serialize)]
struct Numbers {
    problems: OrderedMap<ChoiceProblem>,
    counts: Vec<Vec<u64>>,
    summary: FitSummary,
    accuracy: Vec<CellAccuracy>,
    predictive_check: Vec<PredictiveCheck>,
}

impl From<&Fit> for StoredFit {
    fn from(fit: &Fit) -> Self {
        Self {
            id: fit.id.get(),
            plan: fit.key.plan.to_string(),
            part: fit.key.part.to_string(),
            model: fit.key.model.clone(),
            state: fit.outcome.state(),
            provisional: fit.is_provisional,
            attempts: fit.attempts,
            data_version: fit.data_version,
            study_version: fit.version.get(),
            seed: fit.seed,
            program_version: fit.program_version.clone(),
            input_hash: fit.input_hash.clone(),
            created_at: rfc3339(fit.created_at),
            cpu_ms: fit.cpu_ms,
            message: match &fit.outcome {
                FitOutcome::Converged(_) | FitOutcome::Unconverged(_) => None,
                FitOutcome::Failed(message) => Some(message.clone()),
            },
        }
    }
}

/// The state of each part now.
#[derive(Serialize)]
struct Current {
    data_version: i64,
    fit_version: i64,
    fits: Vec<results::FitRow>,
}

pub(super) async fn list(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(FitsQuery {
        history,
        before,
        limit,
    }): Query<FitsQuery>,
) -> Result<Response, ApiError> {
    if !history {
        if before.is_some() || limit.is_some() {
            return Err(Error::BadRequest(
                "before and limit page through the history; add history=true".to_owned(),
            )
            .into());
        }
        let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
        let Summary {
            data_version,
            fit_version,
            fits,
            ..
        } = Summary::new(&snapshot);
        return Ok(Json(Current {
            data_version,
            fit_version,
            fits,
        })
        .into_response());
    }
    results::shown(&store, &catalogue, &settings, &study).await?;
    let study = served(&catalogue, &study)?;
    let limit = limit.unwrap_or(PAGE_ROWS);
    if !(1..=MAX_PAGE_ROWS).contains(&limit) {
        return Err(
            Error::BadRequest(format!("limit is {limit}; allowed: 1 to {MAX_PAGE_ROWS}")).into(),
        );
    }
    let before = before.map(FitId::from);
    let mut fits = store
        .fit_history(study.id(), settings.population, before, limit + 1)
        .await?;
    let has_more = fits.len() > limit as usize;
    fits.truncate(limit as usize);
    let link = fits.last().filter(|_| has_more).map(|fit| {
        format!(
            "</api/v1/studies/{}/fits?history=true&before={}&limit={limit}>; rel=\"next\"",
            study.id(),
            fit.id
        )
    });
    let mut response = Json(History {
        fits: fits.iter().map(StoredFit::from).collect(),
    })
    .into_response();
    if let Some(Ok(link)) = link.map(|link| HeaderValue::from_str(&link)) {
        response.headers_mut().insert(header::LINK, link);
    }
    Ok(response)
}

pub(super) async fn one(
    (State(store), State(catalogue), State(settings)): Parts,
    Path((study, fit)): Path<(StudyId, i64)>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    results::shown(&store, &catalogue, &settings, &study).await?;
    let study = served(&catalogue, &study)?;
    let fit = store
        .fit(study.id(), settings.population, FitId::from(fit))
        .await?;
    let result = FitReport::read(&fit).map(|report| {
        let FitReport {
            problems,
            counts,
            summary,
            accuracy,
            curves: _,
            quantities: _,
            predictive_check,
        } = report;
        Numbers {
            problems,
            counts,
            summary,
            accuracy,
            predictive_check,
        }
    });
    Ok(Json(FullFit {
        fit: StoredFit::from(&fit),
        result,
    })
    .into_response())
}
