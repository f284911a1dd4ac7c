//! Closes what nobody comes back to: questions whose time ran out, so that counts and the next page are right, and
//! runs that were not finished in their time, arrivals that started nothing within their day, and after a study's
//! retention date all that tells whose answers are whose.

use std::{sync::Arc, time::Duration};

use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use super::Catalogue;
use crate::store::Store;

const QUESTIONS_PERIOD: Duration = Duration::from_secs(1);
const ARRIVALS_PERIOD: Duration = Duration::from_secs(60 * 60);

/// Closes what is overdue until `stop`.
pub async fn run(store: Store, catalogue: Arc<Catalogue>, stop: CancellationToken) {
    let mut questions = interval(QUESTIONS_PERIOD);
    let mut arrivals = interval(ARRIVALS_PERIOD);
    let mut people = interval(ARRIVALS_PERIOD);
    // After a pause one look is enough: it finds everything that is overdue.
    questions.set_missed_tick_behavior(MissedTickBehavior::Delay);
    arrivals.set_missed_tick_behavior(MissedTickBehavior::Delay);
    people.set_missed_tick_behavior(MissedTickBehavior::Delay);
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
            _ = people.tick() => forget_people(&store, &catalogue).await,
            () = stop.cancelled() => return,
        }
    }
}

/// Makes the runs of all studies anonymous whose retention date has passed.
pub async fn forget_people(store: &Store, catalogue: &Catalogue) {
    let now = store.clock().now();
    for study in catalogue.studies() {
        let is_over = study
            .recruiting()
            .retention
            .is_some_and(|retention| now >= retention);
        if !is_over {
            continue;
        }
        match store.forget_people(study.id()).await {
            Ok(0) => {}
            Ok(runs) => {
                tracing::info!(study = %study.id(), runs, "the retention date has passed: links and recruiting ids were erased");
            }
            Err(error) => {
                tracing::warn!(study = %study.id(), %error, "could not erase links and recruiting ids");
            }
        }
    }
}
