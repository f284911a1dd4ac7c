//! Server-sent events: which version of a study's data and fits is current. A page then fetches what changed.

use std::{
    collections::{HashMap, hash_map::Entry},
    convert::Infallible,
    net::IpAddr,
    sync::{LazyLock, Mutex, MutexGuard, PoisonError},
};

use axum::response::sse::{Event, KeepAlive, Sse};
use tokio::sync::{Semaphore, SemaphorePermit, broadcast::error::RecvError};
use tokio_stream::Stream;
use tokio_util::sync::CancellationToken;

use super::{
    Error,
    access::{ClientAddress, Reader},
};
use crate::{
    jobs::{Catalogue, Version},
    store::{Change, Population, Store},
    study::StudyId,
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

/// Events named `version`: the current one at once, then each that follows, until the client goes or the server stops.
///
/// A slow client skips versions, because only the newest says anything. Strangers are told of the version that was released
/// when they came: when others move the data is not theirs to know.
pub(super) async fn stream(
    (store, catalogue, population): (Store, &Catalogue, Population),
    study: StudyId,
    (reader, client): (&Reader, ClientAddress),
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
                    () = sender.closed() => return,
                    () = stop.cancelled() => return,
                };
                match change {
                    Ok(_) | Err(RecvError::Lagged(_)) if released.is_some() => {}
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
        }
    });
    let events = tokio_stream::wrappers::ReceiverStream::new(events);
    Ok(Sse::new(events).keep_alive(KeepAlive::default()))
}
