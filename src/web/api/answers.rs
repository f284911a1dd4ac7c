//! Answers one by one: pages of JSON, and exports that stream.
//!
//! An export reads page after page by key, so no read transaction stays open while the client is slow.

use std::sync::Arc;

use axum::{
    Json,
    body::{Body, Bytes},
    extract::State,
    http::{HeaderName, HeaderValue, header},
    response::{IntoResponse, Response},
};
use serde::{Deserialize, Serialize};
use tokio::sync::mpsc;
use utoipa::IntoParams;

use super::{
    NoQuery, Parts, StudyPath, cursor,
    extract::{Path, Query},
    served,
};
use crate::{
    jobs::Catalogue,
    model::OrderedMap,
    store::{self, AnswerKey, AnswerRow, AnswerStatus, Population, RunId, RunState, Store},
    study::{Study, StudyId},
    web::{ApiError, Error, Settings},
};

/// Rows that an export reads at once.
const EXPORT_ROWS: u32 = 2_000;
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

/// An answer in the long form of product.md.
#[derive(Serialize, utoipa::ToSchema)]
struct Answer<'a> {
    study: &'a str,
    version: i64,
    participant: i64,
    run_state: RunState,
    block: &'a str,
    position: u32,
    question: &'a str,
    problem: String,
    #[schema(value_type = HashMap<String, String>)]
    levels: OrderedMap<&'a str>,
    #[schema(value_type = Option<String>)]
    action: Option<&'a str>,
    status: AnswerStatus,
    shown_at_ms: Option<i64>,
    answered_at_ms: i64,
    server_ms: Option<u64>,
    client_rt_ms: Option<u64>,
    limit_ms: Option<u64>,
    #[schema(value_type = Option<String>)]
    input: Option<&'a str>,
    hidden_ms: Option<u64>,
    #[schema(value_type = Option<String>)]
    source: Option<&'a str>,
    simulated: bool,
}

impl<'a> Answer<'a> {
    /// `study` is the version that the answer was given under.
    fn new(study: &'a Study, row: &'a AnswerRow) -> Self {
        let question = row
            .question
            .as_ref()
            .map_or("", |question| question.as_str());
        let problem = row
            .problem
            .clone()
            .unwrap_or_else(|| format!("{}:{question}", row.block));
        let levels = study
            .cell(&problem)
            .map(|cell| cell.levels.as_slice())
            .unwrap_or_default();
        Self {
            study: study.id().as_str(),
            version: row.version.get(),
            participant: row.key.run.get(),
            run_state: row.run_state,
            block: row.block.as_str(),
            position: row.key.position,
            question,
            levels: levels
                .iter()
                .map(|(factor, level)| (factor.to_string(), level.as_str()))
                .collect(),
            problem,
            action: row.action.as_ref().map(|action| action.as_str()),
            status: row.status,
            shown_at_ms: row.shown_at.map(|at| at.0),
            answered_at_ms: row.answered_at.0,
            server_ms: row.server_ms,
            client_rt_ms: row.client_rt_ms,
            limit_ms: row.limit_ms,
            input: row.input.as_deref(),
            hidden_ms: row.hidden_ms,
            source: row.source.as_deref(),
            simulated: row.population.is_simulated(),
        }
    }
}

/// The answers in pages, in the order of runs and steps.
///
/// One row per closed question. Withdrawn people have no rows; previews never have.
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

/// All answers as CSV: the columns of `Answer`, with one column per factor instead of `levels`.
///
/// A text that begins like a formula gets an apostrophe in front.
#[utoipa::path(
    get, path = "/studies/{study}/answers.csv", tag = "data", params(StudyPath),
    responses((status = 200, description = "All answers", content((String = "text/csv; charset=utf-8")))),
    security((), ("token" = ["data"])),
)]
pub(super) async fn csv(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let form = Form::Csv {
        factors: study
            .factors()
            .iter()
            .map(|factor| factor.id.to_string())
            .collect(),
    };
    Ok(export(
        store,
        catalogue,
        &settings,
        study,
        form,
        "text/csv; charset=utf-8",
        "csv",
    ))
}

/// All answers as NDJSON: one `Answer` a line.
#[utoipa::path(
    get, path = "/studies/{study}/answers.ndjson", tag = "data", params(StudyPath),
    responses((status = 200, description = "All answers", content((String = "application/x-ndjson")))),
    security((), ("token" = ["data"])),
)]
pub(super) async fn ndjson(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    Ok(export(
        store,
        catalogue,
        &settings,
        study,
        Form::NdJson,
        "application/x-ndjson",
        "ndjson",
    ))
}

enum Form {
    Csv { factors: Vec<String> },
    NdJson,
}

/// Why an export broke off; the client sees a body that ends early.
#[derive(Debug, thiserror::Error)]
enum ExportError {
    #[error(transparent)]
    Store(#[from] store::Error),
    #[error(transparent)]
    Csv(#[from] csv::Error),
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    #[error("the rows could not be put together: {0}")]
    Buffer(String),
}

fn export(
    store: Store,
    catalogue: Arc<Catalogue>,
    settings: &Settings,
    study: Arc<Study>,
    form: Form,
    content_type: &'static str,
    extension: &str,
) -> Response {
    let population = settings.population;
    let name = format!(
        "attachment; filename=\"{}-answers.{extension}\"",
        study.id()
    );
    // One page ahead of the client, no more.
    let (sender, chunks) = mpsc::channel(1);
    tokio::spawn(async move {
        if let Err(error) = write(&store, &catalogue, &study, population, &form, &sender).await {
            tracing::warn!(study = %study.id(), %error, "an export broke off");
            // Whoever has gone away needs no error.
            drop(sender.send(Err(error)).await);
        }
    });
    let headers: [(HeaderName, HeaderValue); 2] = [
        (header::CONTENT_TYPE, HeaderValue::from_static(content_type)),
        // A study's id is made of letters, digits and hyphens.
        (
            header::CONTENT_DISPOSITION,
            HeaderValue::from_str(&name).unwrap_or(HeaderValue::from_static("attachment")),
        ),
    ];
    (
        headers,
        Body::from_stream(tokio_stream::wrappers::ReceiverStream::new(chunks)),
    )
        .into_response()
}

async fn write(
    store: &Store,
    catalogue: &Catalogue,
    study: &Arc<Study>,
    population: Population,
    form: &Form,
    client: &mpsc::Sender<Result<Bytes, ExportError>>,
) -> Result<(), ExportError> {
    let mut after = AnswerKey::START;
    let mut is_first = true;
    loop {
        let rows = store
            .answers(study.id(), population, after, EXPORT_ROWS)
            .await?;
        let versions: Vec<Arc<Study>> = rows
            .iter()
            .map(|row| version(catalogue, study, row))
            .collect();
        let answers = rows
            .iter()
            .zip(&versions)
            .map(|(row, version)| Answer::new(version, row));
        let chunk = match form {
            Form::Csv { factors } => csv_rows(factors, answers, is_first)?,
            Form::NdJson => ndjson_rows(answers)?,
        };
        is_first = false;
        if client.send(Ok(chunk)).await.is_err() {
            return Ok(());
        }
        match rows.last() {
            Some(last) if rows.len() == EXPORT_ROWS as usize => after = last.key,
            Some(_) | None => return Ok(()),
        }
    }
}

fn ndjson_rows<'a>(answers: impl Iterator<Item = Answer<'a>>) -> Result<Bytes, ExportError> {
    let mut lines = Vec::new();
    for answer in answers {
        serde_json::to_writer(&mut lines, &answer)?;
        lines.push(b'\n');
    }
    Ok(lines.into())
}

fn csv_rows<'a>(
    factors: &[String],
    answers: impl Iterator<Item = Answer<'a>>,
    with_header: bool,
) -> Result<Bytes, ExportError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    if with_header {
        let before = [
            "study",
            "version",
            "participant",
            "run_state",
            "block",
            "position",
            "question",
            "problem",
        ];
        let after = [
            "action",
            "status",
            "shown_at_ms",
            "answered_at_ms",
            "server_ms",
            "client_rt_ms",
            "limit_ms",
            "input",
            "hidden_ms",
            "source",
            "simulated",
        ];
        writer.write_record(
            before
                .into_iter()
                .chain(factors.iter().map(String::as_str))
                .chain(after),
        )?;
    }
    for answer in answers {
        let number = |value: Option<u64>| value.map_or_else(String::new, |value| value.to_string());
        let mut record = vec![
            text(answer.study),
            answer.version.to_string(),
            answer.participant.to_string(),
            answer.run_state.to_string(),
            text(answer.block),
            answer.position.to_string(),
            text(answer.question),
            text(&answer.problem),
        ];
        record.extend(
            factors
                .iter()
                .map(|factor| text(answer.levels.get(factor).copied().unwrap_or_default())),
        );
        record.extend([
            text(answer.action.unwrap_or_default()),
            answer.status.to_string(),
            answer
                .shown_at_ms
                .map_or_else(String::new, |at| at.to_string()),
            answer.answered_at_ms.to_string(),
            number(answer.server_ms),
            number(answer.client_rt_ms),
            number(answer.limit_ms),
            text(answer.input.unwrap_or_default()),
            number(answer.hidden_ms),
            text(answer.source.unwrap_or_default()),
            answer.simulated.to_string(),
        ]);
        writer.write_record(record)?;
    }
    writer
        .into_inner()
        .map(Bytes::from)
        .map_err(|error| ExportError::Buffer(error.to_string()))
}

/// A text as a cell that no spreadsheet takes for a formula.
fn text(text: &str) -> String {
    if text.starts_with(['=', '+', '-', '@', '\t', '\r']) {
        format!("'{text}")
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_cell_is_a_formula() {
        for formula in ["=1+1", "+1", "-cmd", "@x", "\tx"] {
            assert_eq!(text(formula), format!("'{formula}"));
        }
        assert_eq!(text("prolific"), "prolific");
    }
}
