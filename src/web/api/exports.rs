//! Exports: files that are sent while they are written.
//!
//! Writing one waits for the database and for the client, so it has a thread of its own; a bounded channel carries the
//! bytes to the response.

use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use axum::{
    Extension, Router,
    body::{Body, Bytes},
    extract::State,
    http::{HeaderName, HeaderValue, header},
    response::{IntoResponse, Response},
    routing::get,
};
use serde::Deserialize;
use tokio::{
    runtime::Handle,
    sync::{OwnedSemaphorePermit, Semaphore, mpsc},
};
use utoipa::IntoParams;
use utoipa_axum::{router::OpenApiRouter, routes};

use super::{
    NoQuery, Parts, StudyPath,
    extract::{Path, Query},
    served,
};
use crate::{
    export::{Codebook, Export, ExportError, Form, Ids},
    study::StudyId,
    web::{ApiError, AppState, Error, access::Recorded, analysis_json},
};

/// Bytes that are sent at once.
const CHUNK: usize = 64 * 1024;
/// A client that takes nothing for so long has gone away.
const PATIENCE: Duration = Duration::from_secs(60);
/// Exports that are written at once, over all studies; whoever comes later is told to try again.
static TURNS: std::sync::LazyLock<Arc<Semaphore>> =
    std::sync::LazyLock::new(|| Arc::new(Semaphore::new(8)));

/// The paths below `/api/v1`.
pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(long))
        .routes(routes!(ndjson))
        .routes(routes!(wide))
        .routes(routes!(psych_ds))
        .routes(routes!(codebook_csv))
        .routes(routes!(codebook_json))
        .routes(routes!(bonus))
        .routes(routes!(analysis))
}

/// The same files for whoever is logged in, so that pages need no token.
pub(super) fn router_of_pages() -> Router<AppState> {
    Router::new()
        .route("/results/{study}/data/answers.csv", get(long))
        .route("/results/{study}/data/answers.ndjson", get(ndjson))
        .route("/results/{study}/data/wide.csv", get(wide))
        .route("/results/{study}/data/psych-ds.zip", get(psych_ds))
        .route("/results/{study}/data/codebook.csv", get(codebook_csv))
        .route("/results/{study}/data/codebook.json", get(codebook_json))
        .route("/results/{study}/data/bonus.csv", get(bonus))
        .route("/results/{study}/data/analysis.json", get(analysis))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct IdsQuery {
    /// How ids of recruiting platforms are given out; left out, they are not. `plain` where the study stored them so.
    #[param(inline)]
    ids: Option<WantedIds>,
}

#[derive(Debug, Clone, Copy, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
enum WantedIds {
    Hashed,
    Plain,
}

impl IdsQuery {
    fn ids(&self) -> Ids {
        match self.ids {
            None => Ids::LeftOut,
            Some(WantedIds::Hashed) => Ids::Hashed,
            Some(WantedIds::Plain) => Ids::Plain,
        }
    }
}

/// All answers as CSV: the columns of `Answer`, with one column per factor instead of `levels`.
///
/// A text that begins like a formula gets an apostrophe in front.
#[utoipa::path(
    get, path = "/studies/{study}/answers.csv", tag = "data", params(StudyPath),
    responses((status = 200, description = "The file", content((String = "text/csv; charset=utf-8")))),
    security((), ("token" = ["data"])),
)]
async fn long(
    parts: Parts,
    study: Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::LongCsv, Ids::LeftOut).await
}

/// All answers as NDJSON: one `Answer` a line.
#[utoipa::path(
    get, path = "/studies/{study}/answers.ndjson", tag = "data", params(StudyPath),
    responses((status = 200, description = "The file", content((String = "application/x-ndjson")))),
    security((), ("token" = ["data"])),
)]
async fn ndjson(
    parts: Parts,
    study: Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::Ndjson, Ids::LeftOut).await
}

/// One row per participant, as CSV: what the codebook lists under `participants`.
#[utoipa::path(
    get, path = "/studies/{study}/export/wide.csv", tag = "data", params(StudyPath, IdsQuery),
    responses((status = 200, description = "The file", content((String = "text/csv; charset=utf-8"))),
        (status = 409, description = "Plain ids that no version of the study stored", body = crate::web::problem::Problem, content_type = "application/problem+json")),
    security((), ("token" = ["data"])),
)]
async fn wide(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::WideCsv, query.ids()).await
}

/// All data, their descriptions and the study, as an archive in Psych-DS form.
#[utoipa::path(
    get, path = "/studies/{study}/export/psych-ds.zip", tag = "data", params(StudyPath, IdsQuery),
    responses((status = 200, description = "The file", content((String = "application/zip"))),
        (status = 409, description = "Plain ids that no version of the study stored", body = crate::web::problem::Problem, content_type = "application/problem+json")),
    security((), ("token" = ["data"])),
)]
async fn psych_ds(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::PsychDs, query.ids()).await
}

/// What every column of the tables holds, as CSV: one row per column and level.
#[utoipa::path(
    get, path = "/studies/{study}/export/codebook.csv", tag = "data", params(StudyPath, IdsQuery),
    responses((status = 200, description = "The file", content((String = "text/csv; charset=utf-8"))),
        (status = 409, description = "Plain ids that no version of the study stored", body = crate::web::problem::Problem, content_type = "application/problem+json")),
    security((), ("token" = ["data"])),
)]
async fn codebook_csv(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::CodebookCsv, query.ids()).await
}

/// What every column of the tables holds.
#[utoipa::path(
    get, path = "/studies/{study}/export/codebook.json", tag = "data", params(StudyPath, IdsQuery),
    responses((status = 200, description = "The file", body = Codebook),
        (status = 409, description = "Plain ids that no version of the study stored", body = crate::web::problem::Problem, content_type = "application/problem+json")),
    security((), ("token" = ["data"])),
)]
async fn codebook_json(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::CodebookJson, query.ids()).await
}

/// Who is paid which bonus, as CSV with the columns `participant` and `amount`.
#[utoipa::path(
    get, path = "/studies/{study}/export/bonus.csv", tag = "data", params(StudyPath, IdsQuery),
    responses((status = 200, description = "The file", content((String = "text/csv; charset=utf-8"))),
        (status = 409, description = "Plain ids that no version of the study stored", body = crate::web::problem::Problem, content_type = "application/problem+json")),
    security((), ("token" = ["data"])),
)]
async fn bonus(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::BonusCsv, query.ids()).await
}

/// The frozen analysis: all final fits with the numbers behind the figures, for citing.
#[utoipa::path(
    get, path = "/studies/{study}/export/analysis.json", tag = "data", params(StudyPath),
    responses((status = 200, description = "The file", body = serde_json::Value)),
    security((), ("token" = ["data"])),
)]
async fn analysis(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let body = analysis_json(&store, &catalogue, settings.population, &study).await?;
    let name = format!("attachment; filename=\"{study}-analysis.json\"");
    let headers = [
        (header::CONTENT_TYPE, "application/json".to_owned()),
        (header::CONTENT_DISPOSITION, name),
    ];
    Ok((headers, body).into_response())
}

async fn export(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    form: Form,
    ids: Ids,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let export = Export::open(&store, study.id(), settings.population, ids).await?;
    let turn = TURNS.clone().try_acquire_owned().map_err(|_| Error::Busy)?;
    // One piece ahead of the client, no more.
    let (sender, pieces) = mpsc::channel(1);
    tokio::task::spawn_blocking(move || write(&export, form, sender, turn));
    let name = format!(
        "attachment; filename=\"{}-{}\"",
        study.id(),
        form.file_suffix()
    );
    let headers: [(HeaderName, HeaderValue); 2] = [
        (
            header::CONTENT_TYPE,
            HeaderValue::from_static(form.content_type()),
        ),
        // A study's id is made of letters, digits and hyphens.
        (
            header::CONTENT_DISPOSITION,
            HeaderValue::from_str(&name).unwrap_or(HeaderValue::from_static("attachment")),
        ),
    ];
    let body = Body::from_stream(tokio_stream::wrappers::ReceiverStream::new(pieces));
    let recorded = Recorded {
        action: None,
        detail: ids.name().map(|name| format!("ids {name}")),
    };
    Ok((Extension(recorded), headers, body).into_response())
}

/// Writes the export; where it breaks off, the client sees a body that ends early.
fn write(
    export: &Export,
    form: Form,
    sender: mpsc::Sender<io::Result<Bytes>>,
    _turn: OwnedSemaphorePermit,
) {
    let mut client = io::BufWriter::with_capacity(
        CHUNK,
        Client {
            sender: sender.clone(),
            runtime: Handle::current(),
        },
    );
    let written = export
        .write(form, &mut client)
        .and_then(|_| client.flush().map_err(ExportError::from));
    if let Err(error) = written {
        let is_gone = matches!(&error, ExportError::Write(cause) if cause.kind() == io::ErrorKind::BrokenPipe);
        if is_gone {
            tracing::debug!(study = %export.study().id(), "the reader of an export went away");
        } else {
            tracing::warn!(study = %export.study().id(), %error, "an export broke off");
        }
        // What is buffered must not follow the error, nor a whole end: a body that merely ended would look complete.
        drop(client.into_parts());
        let broke_off = Err(io::Error::other("the export broke off"));
        let told = Handle::current().block_on(sender.send_timeout(broke_off, PATIENCE));
        // Whoever has gone away needs no error.
        drop(told);
    }
}

/// The response's body as something to write to.
struct Client {
    sender: mpsc::Sender<io::Result<Bytes>>,
    runtime: Handle,
}

impl Write for Client {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let piece = Bytes::copy_from_slice(buffer);
        let sent = self
            .runtime
            .block_on(self.sender.send_timeout(Ok(piece), PATIENCE));
        match sent {
            Ok(()) => Ok(buffer.len()),
            Err(_) => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
