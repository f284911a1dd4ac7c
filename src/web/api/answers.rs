//! Answers one by one, as pages of JSON.

use std::sync::Arc;

use axum::{
    Json,
    extract::State,
    http::{HeaderValue, header},
    response::{IntoResponse, Response},
};
use serde::{Deserialize, Serialize};

use super::{
    Parts,
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

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PageQuery {
    /// Where the page before ended, as its link says.
    after: Option<String>,
    limit: Option<u32>,
}

#[derive(Serialize)]
struct AnswerPage<'a> {
    answers: Vec<Answer<'a>>,
    /// The cursor of the next page; null on the last.
    next: Option<String>,
}

pub(super) async fn page(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(PageQuery { after, limit }): Query<PageQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let limit = limit.unwrap_or(PAGE_ROWS);
    if !(1..=MAX_PAGE_ROWS).contains(&limit) {
        return Err(
            Error::BadRequest(format!("limit is {limit}; allowed: 1 to {MAX_PAGE_ROWS}")).into(),
        );
    }
    let after = after.as_deref().map_or(Ok(AnswerKey::START), cursor)?;
    // One more than asked for tells whether there is a next page.
    let mut rows = store
        .answers(study.id(), settings.population, after, limit + 1)
        .await?;
    let has_more = rows.len() > limit as usize;
    rows.truncate(limit as usize);
    let next = rows
        .last()
        .filter(|_| has_more)
        .map(|row| format!("{}-{}", row.key.run, row.key.position));
    let versions: Vec<Arc<Study>> = rows
        .iter()
        .map(|row| version(&catalogue, &study, row))
        .collect();
    let answers = rows
        .iter()
        .zip(&versions)
        .map(|(row, version)| Answer::new(version, row))
        .collect();
    let mut response = Json(AnswerPage {
        answers,
        next: next.clone(),
    })
    .into_response();
    if let Some(next) = next {
        let link = format!(
            "</api/v1/studies/{}/answers?after={next}&limit={limit}>; rel=\"next\"",
            study.id()
        );
        if let Ok(link) = HeaderValue::from_str(&link) {
            response.headers_mut().insert(header::LINK, link);
        }
    }
    Ok(response)
}

fn cursor(text: &str) -> Result<AnswerKey, Error> {
    let parsed = text.split_once('-').and_then(|(run, position)| {
        Some(AnswerKey {
            run: RunId::from(run.parse::<i64>().ok()?),
            position: position.parse().ok()?,
        })
    });
    parsed.ok_or_else(|| {
        Error::BadRequest(format!(
            "after is `{text}`; allowed: the `next` of an earlier page"
        ))
    })
}

/// The study as it was when the answer was given.
fn version(catalogue: &Catalogue, current: &Arc<Study>, row: &AnswerRow) -> Arc<Study> {
    catalogue
        .version(row.version)
        .unwrap_or_else(|| current.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cursors_read_back_and_others_are_refused() {
        assert_eq!(
            cursor("12-3").unwrap(),
            AnswerKey {
                run: RunId::from(12),
                position: 3
            }
        );
        for text in ["", "12", "a-b", "1--2"] {
            assert!(cursor(text).is_err(), "{text}");
        }
    }
}
