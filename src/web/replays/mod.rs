//! Replays over HTTP: what the engine computed, with words beside it, as one document for the page that plays it.

mod words;

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use axum::{
    Router,
    body::Bytes,
    extract::{Path, State},
    http::header,
    response::{IntoResponse, Response},
    routing::get,
};
use serde::Serialize;

use super::{AppState, Error};
use crate::{
    jobs::Catalogue,
    planning::table::{FRAME_MS, PROJECTION, Projection, Replay, SHOULDER, Tracks},
    study::{ReplayId, step::NamedReplay},
};
use words::Caption;

/// For an hour a browser need not ask again; a newer program may draw the same replay otherwise.
const CACHE: &str = "public, max-age=3600";

pub(super) fn router() -> Router<AppState> {
    Router::new().route("/replays/{id}", get(document))
}

/// The address of a replay's document.
pub(super) fn url(id: &ReplayId) -> String {
    format!("/replays/{id}")
}

/// A replay that was computed.
#[derive(Debug)]
pub(super) struct Played {
    /// How long it lasts, in milliseconds.
    pub(super) duration_ms: u64,
    /// What happens in it, in words.
    pub(super) description: String,
    json: Bytes,
}

/// The replays that were asked for, each computed once. Only those that a served study names are ever computed, so
/// there are never more than the study files list.
#[derive(Debug, Default)]
pub struct Replays(Mutex<HashMap<ReplayId, Arc<Played>>>);

impl Replays {
    /// A replay's document and what the page around it needs.
    pub(super) async fn played(&self, named: &NamedReplay) -> Result<Arc<Played>, Error> {
        let known = self.lock().get(&named.id).cloned();
        if let Some(known) = known {
            return Ok(known);
        }
        let replay = named.replay;
        let computed = tokio::task::spawn_blocking(move || Played::of(replay))
            .await
            .map_err(|panicked| Error::Internal(panicked.into()))?;
        let computed = Arc::new(computed?);
        self.lock().insert(named.id.clone(), computed.clone());
        Ok(computed)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<ReplayId, Arc<Played>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// GET `/replays/ID`.
async fn document(
    State(catalogue): State<Arc<Catalogue>>,
    State(replays): State<Arc<Replays>>,
    Path(id): Path<ReplayId>,
) -> Result<Response, Error> {
    let named = catalogue.replay(&id).ok_or(Error::NotFound("replay"))?;
    let played = replays.played(named).await?;
    let headers = [
        (header::CONTENT_TYPE, "application/json"),
        (header::CACHE_CONTROL, CACHE),
    ];
    Ok((headers, played.json.clone()).into_response())
}

/// What a page plays: places in whole millimetres, turns in tenths of a degree.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    replay: Replay,
    duration_ms: u32,
    frame_ms: u32,
    projection: Projection,
    arm: Arm,
    tracks: Tracks,
    captions: Vec<Caption>,
    still_ms: Vec<u32>,
    description: &'a str,
}

#[derive(Serialize)]
struct Arm {
    shoulder: [i32; 3],
}

impl Played {
    fn of(replay: Replay) -> Result<Self, Error> {
        let timeline = replay
            .timeline()
            .map_err(|err| Error::Internal(err.into()))?;
        let description = words::description(&timeline);
        let document = Document {
            replay,
            duration_ms: timeline.duration_ms(),
            frame_ms: FRAME_MS,
            projection: PROJECTION,
            arm: Arm {
                shoulder: [SHOULDER.x, SHOULDER.y, SHOULDER.z]
                    .map(|metres| (metres * 1000.0).round() as i32),
            },
            tracks: timeline.tracks(),
            captions: words::captions(&timeline),
            still_ms: words::stills(&timeline),
            description: &description,
        };
        let json = serde_json::to_vec(&document).map_err(|err| Error::Internal(err.into()))?;
        Ok(Self {
            duration_ms: timeline.duration_ms().into(),
            json: json.into(),
            description,
        })
    }
}
