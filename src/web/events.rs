//! Server-sent events: which version of a study's data and fits is current. A page then fetches what changed.

use std::{
    collections::{HashMap, hash_map::Entry},
    convert::Infallible,
    net::IpAddr,
    sync::{LazyLock, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use axum::response::sse::{Event, KeepAlive, Sse};
use tokio::{
    sync::{Semaphore, SemaphorePermit, broadcast::error::RecvError},
    time::MissedTickBehavior,
};
use tokio_stream::Stream;
use tokio_util::sync::CancellationToken;

use super::{
    Error,
    access::{ClientAddress, Reader, Standing},
};
use crate::{
    clock::Clock,
    jobs::{Catalogue, Version},
    store::{Change, Population, Store},
    study::{StudyId, Timestamp},
};

/// One event of a stream.
#[derive(utoipa::ToSchema)]
#[expect(dead_code, reason = "describes what axum writes")]
pub(super) struct VersionEvent {
    /// Always `version`.
    event: String,
    /// A `Version` as JSON, such as `{"data_version":450,"fit_version":22}`.
    data: String,
}

/// Streams that may be open at a time, so that watchers cannot use up the connections that answers need.
static OPEN: Semaphore = Semaphore::const_new(256);
/// The same for strangers, beside those of whoever may see results.
static OPEN_TO_STRANGERS: Semaphore = Semaphore::const_new(64);
/// How many of them one address may have open.
const OPEN_TO_ONE: usize = 8;
/// How many streams each address of strangers has open.
static STRANGERS: LazyLock<Mutex<HashMap<IpAddr, usize>>> = LazyLock::new(Mutex::default);

/// A stream's place, until it is dropped.
struct Place {
    _permit: SemaphorePermit<'static>,
    stranger: Option<IpAddr>,
}

impl Place {
    fn of_known() -> Result<Self, Error> {
        Ok(Self {
            _permit: OPEN.try_acquire().map_err(|_| Error::Busy)?,
            stranger: None,
        })
    }

    fn of_stranger(address: IpAddr) -> Result<Self, Error> {
        let permit = OPEN_TO_STRANGERS.try_acquire().map_err(|_| Error::Busy)?;
        let mut strangers = strangers();
        let open = strangers.entry(address).or_default();
        if *open >= OPEN_TO_ONE {
            return Err(Error::Busy);
        }
        *open += 1;
        Ok(Self {
            _permit: permit,
            stranger: Some(address),
        })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        if let Some(address) = self.stranger
            && let Entry::Occupied(mut open) = strangers().entry(address)
        {
            *open.get_mut() -= 1;
            if *open.get() == 0 {
                open.remove();
            }
        }
    }
}

fn strangers() -> MutexGuard<'static, HashMap<IpAddr, usize>> {
    // Nothing can be left half done under this lock.
    STRANGERS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// How long a stream goes on without asking again whether its reader may read it, where nothing changes.
const ASKED_AGAIN: Duration = Duration::from_secs(10);

/// Where much changes it is asked no more often than this, in milliseconds.
const LEAST_BETWEEN_MS: u64 = 1000;

/// A reader's leave with the time at which it was last asked for.
struct Leave {
    standing: Standing,
    clock: Clock,
    asked_at: Timestamp,
}

impl Leave {
    /// Whether the reader may read what changed: asked again where the last answer is not of this moment.
    async fn lasts(&mut self) -> bool {
        let now = self.clock.now();
        if now.millis_since(self.asked_at) < LEAST_BETWEEN_MS {
            return true;
        }
        self.asked_at = now;
        self.holds().await
    }

    /// Whether the reader may go on at all.
    async fn holds(&self) -> bool {
        self.standing.holds().await.unwrap_or_else(|error| {
            tracing::warn!(%error, "whether a stream may go on could not be read");
            false
        })
    }
}

/// Events named `version`: the current one at once, then each that follows, until the client goes, may read the study no
/// longer, or the server stops.
///
/// A slow client skips versions, because only the newest says anything. Strangers are told of the version that was released
/// when they came: when others move the data is not theirs to know.
pub(super) async fn stream(
    (store, catalogue, population): (Store, &Catalogue, Population),
    study: StudyId,
    (reader, client, standing): (&Reader, ClientAddress, Standing),
    stop: CancellationToken,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>> + use<>>, Error> {
    if catalogue.current(&study).is_none() {
        return Err(Error::NotFound("study"));
    }
    let released = reader.released().map(|released| released.version);
    let place = match released {
        Some(_) => Place::of_stranger(client.counted_as())?,
        None => Place::of_known()?,
    };
    // Subscribed before the current version is read: nothing falls between the two.
    let mut changes = store.subscribe();
    let (sender, events) = tokio::sync::mpsc::channel(1);
    let mut version = match released {
        Some(version) => version,
        None => Version::from(&store.totals(&study, population).await?),
    };
    let mut leave = Leave {
        standing,
        clock: store.clock().clone(),
        asked_at: store.clock().now(),
    };
    let mut again = tokio::time::interval(ASKED_AGAIN);
    again.set_missed_tick_behavior(MissedTickBehavior::Delay);
    again.tick().await;
    tokio::spawn(async move {
        let _place = place;
        loop {
            let event = match Event::default().event("version").json_data(version) {
                Ok(event) => event,
                Err(error) => {
                    tracing::error!(%error, "a version could not be written as JSON");
                    return;
                }
            };
            tokio::select! {
                sent = sender.send(Ok(event)) => if sent.is_err() { return },
                () = stop.cancelled() => return,
            }
            version = loop {
                let change = tokio::select! {
                    change = changes.recv() => change,
                    _ = again.tick() => {
                        if leave.holds().await {
                            continue;
                        }
                        return;
                    }
                    () = sender.closed() => return,
                    () = stop.cancelled() => return,
                };
                match change {
                    Ok(_) | Err(RecvError::Lagged(_)) if released.is_some() => {
                        if !leave.lasts().await {
                            return;
                        }
                    }
                    Ok(Change {
                        study: changed,
                        population: of,
                        data_version,
                        page_version,
                    }) if changed == study && of == population => {
                        break Version::new(data_version, page_version);
                    }
                    Ok(_) => {}
                    Err(RecvError::Lagged(_)) => match store.totals(&study, population).await {
                        Ok(totals) => break Version::from(&totals),
                        Err(error) => tracing::warn!(%error, "a version could not be read"),
                    },
                    Err(RecvError::Closed) => return,
                }
            };
            if !leave.lasts().await {
                return;
            }
        }
    });
    let events = tokio_stream::wrappers::ReceiverStream::new(events);
    Ok(Sse::new(events).keep_alive(KeepAlive::default()))
}
