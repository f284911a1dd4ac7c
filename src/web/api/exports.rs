//! Exports: files that are sent while they are written.
//!
//! Writing one waits for the database and for the client, so it has a thread of its own; a bounded channel carries the
//! bytes to the response.

use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use axum::{
    Router,
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

use super::{
    NoQuery, Parts,
    extract::{Path, Query},
    served,
};
use crate::{
    export::{Export, ExportError, Form, Ids},
    study::StudyId,
    web::{ApiError, AppState, Error, analysis_json},
};

/// Bytes that are sent at once.
const CHUNK: usize = 64 * 1024;
/// A client that takes nothing for so long has gone away.
const PATIENCE: Duration = Duration::from_secs(60);
/// Exports that are written at once, over all studies; whoever comes later is told to try again.
static TURNS: std::sync::LazyLock<Arc<Semaphore>> =
    std::sync::LazyLock::new(|| Arc::new(Semaphore::new(8)));

/// The paths below `/api/v1`.
pub(super) fn router() -> Router<AppState> {
    Router::new()
        .route("/studies/{study}/answers.csv", get(long))
        .route("/studies/{study}/answers.ndjson", get(ndjson))
        .route("/studies/{study}/export/long.csv", get(long))
        .route("/studies/{study}/export/wide.csv", get(wide))
        .route("/studies/{study}/export/answers.ndjson", get(ndjson))
        .route("/studies/{study}/export/psych-ds.zip", get(psych_ds))
        .route("/studies/{study}/export/codebook.csv", get(codebook_csv))
        .route("/studies/{study}/export/codebook.json", get(codebook_json))
        .route("/studies/{study}/export/bonus.csv", get(bonus))
        .route("/studies/{study}/export/analysis.json", get(analysis))
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

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct IdsQuery {
    ids: Option<WantedIds>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
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

async fn long(
    parts: Parts,
    study: Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::LongCsv, Ids::LeftOut).await
}

async fn ndjson(
    parts: Parts,
    study: Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::Ndjson, Ids::LeftOut).await
}

async fn wide(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::WideCsv, query.ids()).await
}

async fn psych_ds(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::PsychDs, query.ids()).await
}

async fn codebook_csv(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::CodebookCsv, query.ids()).await
}

async fn codebook_json(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::CodebookJson, query.ids()).await
}

async fn bonus(
    parts: Parts,
    study: Path<StudyId>,
    Query(query): Query<IdsQuery>,
) -> Result<Response, ApiError> {
    export(parts, study, Form::BonusCsv, query.ids()).await
}

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
    Ok((headers, body).into_response())
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
