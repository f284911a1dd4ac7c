//! Closes what nobody comes back to: questions whose time ran out, so that counts and the next page are right, and
//! arrivals that started nothing within their day.

use std::time::Duration;

use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use crate::store::Store;

const QUESTIONS_PERIOD: Duration = Duration::from_secs(1);
const ARRIVALS_PERIOD: Duration = Duration::from_secs(60 * 60);

/// Closes what is overdue until `stop`.
pub async fn run(store: Store, stop: CancellationToken) {
    let mut questions = interval(QUESTIONS_PERIOD);
    let mut arrivals = interval(ARRIVALS_PERIOD);
    // After a pause one look is enough: it finds everything that is overdue.
    questions.set_missed_tick_behavior(MissedTickBehavior::Delay);
    arrivals.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = questions.tick() => match store.close_overdue().await {
                Ok(0) => {}
                Ok(closed) => tracing::debug!(closed, "closed questions whose time ran out"),
                Err(error) => tracing::warn!(%error, "could not close questions whose time ran out"),
            },
            _ = arrivals.tick() => match store.forget_arrivals().await {
                Ok(0) => {}
                Ok(forgotten) => tracing::debug!(forgotten, "forgot arrivals that started nothing"),
                Err(error) => tracing::warn!(%error, "could not forget old arrivals"),
            },
            () = stop.cancelled() => return,
        }
    }
}
