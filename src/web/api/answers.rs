//! Answers one by one, as pages of JSON.

use std::sync::Arc;

use axum::{Json, extract::State, response::Response};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::{
    Parts, StudyPath, cursor,
    extract::{Path, Query},
    served,
};
use crate::{
    export::Answer,
    jobs::Catalogue,
    store::{AnswerKey, AnswerRow, RunId},
    study::{Study, StudyId},
    web::{ApiError, Error},
};

const PAGE_ROWS: u32 = 100;
const MAX_PAGE_ROWS: u32 = 1_000;

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct PageQuery {
    /// Where the page before ended, as its link says.
    #[param(nullable = false)]
    after: Option<String>,
    /// Answers on a page, 100 if left out.
    #[param(minimum = 1, maximum = 1000, nullable = false)]
    limit: Option<u32>,
}

#[derive(Serialize, utoipa::ToSchema)]
struct AnswerPage<'a> {
    answers: Vec<Answer<'a>>,
    /// The cursor of the next page; null on the last.
    next: Option<String>,
}

/// The answers in pages, in the order of runs and steps.
///
/// One row per question shown; what is on somebody's screen has none yet. Withdrawn people have no rows; previews never have.
#[utoipa::path(
    get, path = "/studies/{study}/answers", tag = "data", params(StudyPath, PageQuery),
    responses((status = 200, description = "A page of answers", body = AnswerPage,
        headers(("Link" = String, description = "`next` and `first` page (RFC 8288)")))),
    security((), ("token" = ["data"])),
)]
pub(super) async fn page(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(PageQuery { after, limit }): Query<PageQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let limit = cursor::rows(limit, PAGE_ROWS, MAX_PAGE_ROWS)?;
    let after = after.as_deref().map_or(Ok(AnswerKey::START), key)?;
    // One more than asked for tells whether there is a next page.
    let mut rows = store
        .answers(study.id(), settings.population, after, limit + 1)
        .await?;
    let has_more = rows.len() > limit as usize;
    rows.truncate(limit as usize);
    let next = rows
        .last()
        .filter(|_| has_more)
        .map(|row| cursor::cursor(&[row.key.run.get(), row.key.position.into()]));
    let versions: Vec<Arc<Study>> = rows
        .iter()
        .map(|row| version(&catalogue, &study, row))
        .collect();
    let answers = rows
        .iter()
        .zip(&versions)
        .map(|(row, version)| Answer::new(version, row))
        .collect();
    let page = Json(AnswerPage {
        answers,
        next: next.clone(),
    });
    let first = format!("/api/v1/studies/{}/answers?limit={limit}", study.id());
    Ok(cursor::linked(page, &first, next.as_deref()))
}

fn key(text: &str) -> Result<AnswerKey, Error> {
    let [run, position] = cursor::key(text)?;
    Ok(AnswerKey {
        run: RunId::from(run),
        // No run has a step at a place that is no number of a step.
        position: u32::try_from(position).unwrap_or(u32::MAX),
    })
}

/// The study as it was when the answer was given.
fn version(catalogue: &Catalogue, current: &Arc<Study>, row: &AnswerRow) -> Arc<Study> {
    catalogue
        .version(row.version)
        .unwrap_or_else(|| current.clone())
}
