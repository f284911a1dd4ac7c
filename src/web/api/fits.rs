//! Fits: the state of each part now, their history, and one fit in full.

use axum::{extract::State, response::Response};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::{
    FitPath, NoQuery, Parts, StudyPath, cursor,
    extract::{Path, Query},
    version::Asked,
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

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct FitsQuery {
    /// Earlier fits instead of the current state.
    #[serde(default)]
    history: bool,
    /// Where the page before ended, as its link says; with `history` only.
    #[param(nullable = false)]
    after: Option<String>,
    /// Fits on a page, 50 if left out; with `history` only.
    #[param(minimum = 1, maximum = 200, nullable = false)]
    limit: Option<u32>,
}

/// Either of the two lists.
#[derive(Serialize, utoipa::ToSchema)]
#[serde(untagged)]
pub(super) enum Fits {
    Current(Current),
    History(History),
}

#[derive(Serialize, utoipa::ToSchema)]
#[schema(as = FitHistory)]
pub(super) struct History {
    fits: Vec<StoredFit>,
    /// The cursor of the next page; null on the last.
    next: Option<String>,
}

/// A stored fit without its numbers.
#[derive(Serialize, utoipa::ToSchema)]
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

#[derive(Serialize, utoipa::ToSchema)]
struct FullFit {
    #[serde(flatten)]
    fit: StoredFit,
    /// Null for a failed fit; its numbers are null for one that has not converged.
    result: Option<Numbers>,
}

#[derive(Serialize, utoipa::ToSchema)]
#[schema(as = FitResult)]
struct Numbers {
    #[schema(value_type = HashMap<String, ChoiceProblem>)]
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
            study_version: fit.version_number.get(),
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
#[derive(Serialize, utoipa::ToSchema)]
#[schema(as = CurrentFits)]
pub(super) struct Current {
    data_version: i64,
    fit_version: i64,
    fits: Vec<results::FitRow>,
}

/// The fits: the state of each part now, or with `history=true` all that were made, newest first.
#[utoipa::path(
    get, path = "/studies/{study}/fits", tag = "results", params(StudyPath, FitsQuery),
    responses(
        (status = 200, description = "The fits; the history comes in pages", body = Fits,
            headers(("Link" = String, description = "`next` and `first` page of the history (RFC 8288)"))),
        (status = 304),
    ),
    security((), ("token" = ["results"])),
)]
pub(super) async fn list(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(FitsQuery {
        history,
        after,
        limit,
    }): Query<FitsQuery>,
    asked: Asked,
) -> Result<Response, ApiError> {
    if !history {
        if after.is_some() || limit.is_some() {
            return Err(Error::BadRequest(
                "after and limit page through the history; add history=true".to_owned(),
            )
            .into());
        }
        let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
        return asked.of(&snapshot, || {
            let Summary {
                data_version,
                fit_version,
                fits,
                ..
            } = Summary::new(&snapshot);
            Ok(Fits::Current(Current {
                data_version,
                fit_version,
                fits,
            }))
        });
    }
    let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
    let limit = cursor::rows(limit, PAGE_ROWS, MAX_PAGE_ROWS)?;
    let before = after
        .map(|after| cursor::key(&after).map(|[id]| FitId::from(id)))
        .transpose()?;
    let mut fits = store
        .fit_history(&study, settings.population, before, limit + 1)
        .await?;
    let has_more = fits.len() > limit as usize;
    fits.truncate(limit as usize);
    let next = fits
        .last()
        .filter(|_| has_more)
        .map(|fit| cursor::cursor(&[fit.id.get()]));
    let page = asked.of(&snapshot, || {
        Ok(Fits::History(History {
            fits: fits.iter().map(StoredFit::from).collect(),
            next: next.clone(),
        }))
    })?;
    let first = format!("/api/v1/studies/{study}/fits?history=true&limit={limit}");
    Ok(cursor::linked(page, &first, next.as_deref()))
}

/// One fit in full.
#[utoipa::path(
    get, path = "/studies/{study}/fits/{fit}", tag = "results", params(FitPath),
    responses((status = 200, description = "The fit with its numbers", body = FullFit), (status = 304)),
    security((), ("token" = ["results"])),
)]
pub(super) async fn one(
    (State(store), State(catalogue), State(settings)): Parts,
    Path((study, fit)): Path<(StudyId, i64)>,
    Query(NoQuery {}): Query<NoQuery>,
    asked: Asked,
) -> Result<Response, ApiError> {
    let snapshot = results::shown(&store, &catalogue, &settings, &study).await?;
    let fit = store
        .fit(&study, settings.population, FitId::from(fit))
        .await?;
    asked.of(&snapshot, || {
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
        Ok(FullFit {
            fit: StoredFit::from(&fit),
            result,
        })
    })
}
