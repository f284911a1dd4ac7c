//! Replays over HTTP: what the engine computed, as one document for the page that plays it, and the words that the page has
//! beside it in its own language.

mod words;

use std::{
    collections::HashMap,
    sync::{Arc, OnceLock, PoisonError, RwLock},
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
    planning::table::{
        BOTTOM_RADIUS, CUP_HEIGHT, FRAME_MS, MOUTH_RADIUS, PROJECTION, Projection, Replay,
        ReplayError, SHOULDER, Timeline, Tracks,
    },
    study::{ReplayId, Study, Words},
};

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
    timeline: Timeline,
    json: Bytes,
}

impl Played {
    /// What happens in it, for whoever does not see it.
    pub(super) fn description(&self, words: &Words) -> String {
        words::description(&self.timeline, words)
    }

    /// The lines under its picture, as JSON.
    pub(super) fn captions(&self, words: &Words) -> String {
        // Numbers and texts: nothing that JSON could refuse.
        serde_json::to_string(&words::captions(&self.timeline, words)).expect("plain values")
    }
}

/// The replays that served studies show, and no others: each is computed once, when it is first needed.
#[derive(Debug)]
pub struct Replays(RwLock<HashMap<ReplayId, Arc<Slot>>>);

#[derive(Debug)]
struct Slot {
    replay: Replay,
    played: OnceLock<Result<Arc<Played>, ReplayError>>,
}

impl Replays {
    /// The replays of all versions of all studies, none of them computed yet.
    pub fn of(catalogue: &Catalogue) -> Self {
        let named = catalogue.replays();
        Self(RwLock::new(
            named
                .into_iter()
                .map(|named| (named.id, Slot::new(named.replay)))
                .collect(),
        ))
    }

    /// Computes those of a version that is about to be served.
    ///
    /// # Errors
    /// The first replay that cannot be made; none is served then.
    pub fn add(&self, study: &Study) -> Result<(), (ReplayId, ReplayError)> {
        let mut added = Vec::new();
        for named in study.replays() {
            if self.slot(&named.id).is_none() {
                let slot = Slot::new(named.replay);
                slot.played().map_err(|error| (named.id.clone(), error))?;
                added.push((named.id.clone(), slot));
            }
        }
        let mut slots = self.0.write().unwrap_or_else(PoisonError::into_inner);
        slots.extend(added);
        Ok(())
    }

    fn slot(&self, id: &ReplayId) -> Option<Arc<Slot>> {
        let slots = self.0.read().unwrap_or_else(PoisonError::into_inner);
        slots.get(id).cloned()
    }

    /// Computes all of them, which takes some hundredths of a second each.
    ///
    /// # Errors
    /// The first replay that cannot be made, so that nobody meets it in the middle of a run.
    pub fn compute(&self) -> Result<(), (ReplayId, ReplayError)> {
        let slots = self.0.read().unwrap_or_else(PoisonError::into_inner);
        for (id, slot) in slots.iter() {
            slot.played().map_err(|error| (id.clone(), error))?;
        }
        Ok(())
    }

    /// A replay's document and what the page around it needs.
    pub(super) async fn played(&self, id: &ReplayId) -> Result<Arc<Played>, Error> {
        let slot = self.slot(id).ok_or(Error::NotFound("replay"))?;
        let played = match slot.played.get() {
            Some(played) => played.clone(),
            None => tokio::task::spawn_blocking(move || slot.played())
                .await
                .map_err(|panicked| Error::Internal(panicked.into()))?,
        };
        played.map_err(|error| Error::Internal(error.into()))
    }
}

impl Slot {
    fn new(replay: Replay) -> Arc<Self> {
        Arc::new(Self {
            replay,
            played: OnceLock::new(),
        })
    }

    fn played(&self) -> Result<Arc<Played>, ReplayError> {
        let compute = || Played::of(self.replay).map(Arc::new);
        self.played.get_or_init(compute).clone()
    }
}

/// GET `/replays/ID`.
async fn document(
    State(replays): State<Arc<Replays>>,
    Path(id): Path<ReplayId>,
) -> Result<Response, Error> {
    let played = replays.played(&id).await?;
    let json = [(header::CONTENT_TYPE, "application/json")];
    Ok((json, played.json.clone()).into_response())
}

/// What a page plays: places in whole millimetres, turns in tenths of a degree.
#[derive(Serialize)]
struct Document {
    #[serde(flatten)]
    replay: Replay,
    duration_ms: u32,
    frame_ms: u32,
    projection: Projection,
    arm: Arm,
    cup: Cup,
    tracks: Tracks,
    still_ms: Vec<u32>,
}

#[derive(Serialize)]
struct Arm {
    shoulder: [i32; 3],
}

/// What a cup measures, in whole millimetres.
#[derive(Serialize)]
struct Cup {
    height: i32,
    mouth_radius: i32,
    bottom_radius: i32,
}

impl Played {
    fn of(replay: Replay) -> Result<Self, ReplayError> {
        let timeline = replay.timeline()?;
        let document = Document {
            replay,
            duration_ms: timeline.duration_ms(),
            frame_ms: FRAME_MS,
            projection: PROJECTION,
            arm: Arm {
                shoulder: SHOULDER.millimetres(),
            },
            cup: Cup {
                height: millimetres(CUP_HEIGHT),
                mouth_radius: millimetres(MOUTH_RADIUS),
                bottom_radius: millimetres(BOTTOM_RADIUS),
            },
            tracks: timeline.tracks(),
            still_ms: words::stills(&timeline),
        };
        // Numbers and texts: nothing that JSON could refuse.
        let json = serde_json::to_vec(&document).expect("a document of plain values");
        Ok(Self {
            duration_ms: timeline.duration_ms().into(),
            json: json.into(),
            timeline,
        })
    }
}

fn millimetres(metres: f64) -> i32 {
    (metres * 1000.0).round() as i32
}
