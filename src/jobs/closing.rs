//! Closes questions whose time ran out with nobody there, so that counts and the next page are right.

use std::time::Duration;

use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use crate::store::Store;

const PERIOD: Duration = Duration::from_secs(1);

/// Closes what is overdue, once a second, until `stop`.
pub async fn run(store: Store, stop: CancellationToken) {
    let mut ticks = interval(PERIOD);
    // After a pause one look is enough: it finds everything that is overdue.
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = ticks.tick() => {}
            () = stop.cancelled() => return,
        }
        match store.close_overdue().await {
            Ok(0) => {}
            Ok(closed) => tracing::debug!(closed, "closed questions whose time ran out"),
            Err(error) => tracing::warn!(%error, "could not close questions whose time ran out"),
        }
    }
}
