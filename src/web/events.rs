//! Server-sent events: which version of a study's data and fits is current. A page then fetches what changed.

use std::convert::Infallible;

use axum::response::sse::{Event, KeepAlive, Sse};
use tokio::sync::{Semaphore, broadcast::error::RecvError};
use tokio_stream::Stream;
use tokio_util::sync::CancellationToken;

use super::Error;
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

/// Events named `version`: the current one at once, then each that follows, until the client goes or the server stops.
///
/// A slow client skips versions, because only the newest says anything.
pub(super) async fn stream(
    store: Store,
    catalogue: &Catalogue,
    population: Population,
    study: StudyId,
    stop: CancellationToken,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>> + use<>>, Error> {
    if catalogue.current(&study).is_none() {
        return Err(Error::NotFound("study"));
    }
    let place = OPEN.try_acquire().map_err(|_| Error::Busy)?;
    // Subscribed before the current version is read: nothing falls between the two.
    let mut changes = store.subscribe();
    let (sender, events) = tokio::sync::mpsc::channel(1);
    let mut version = Version::from(&store.totals(&study, population).await?);
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
