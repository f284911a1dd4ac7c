//! Closes what nobody comes back to: questions whose time ran out, so that counts and the next page are right, and
//! runs that were not finished in their time, arrivals that started nothing within their day, and after the
//! retention date of the version under which they began all that tells whose answers are whose.

use std::time::Duration;

use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use crate::{
    store::{self, Store, VersionId},
    study::{Study, StudyId},
};

const QUESTIONS_PERIOD: Duration = Duration::from_secs(1);
const ARRIVALS_PERIOD: Duration = Duration::from_secs(60 * 60);

/// Closes what is overdue until `stop`.
pub async fn run(store: Store, stop: CancellationToken) {
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
            _ = people.tick() => forget_people(&store).await,
            () = stop.cancelled() => return,
        }
    }
}

/// Makes all runs anonymous whose retention date has passed: that of the version under which each began, since a later
/// version cannot change what people agreed to. Versions that this program cannot serve any more are among them.
pub async fn forget_people(store: &Store) {
    let studies = match store.studies().await {
        Ok(studies) => studies,
        Err(error) => {
            tracing::warn!(%error, "could not look for retention dates that have passed");
            return;
        }
    };
    for study in studies {
        match forget_people_of(store, &study.id).await {
            Ok(0) => {}
            Ok(runs) => {
                tracing::info!(study = %study.id, runs, "the retention date has passed: links and recruiting ids were erased");
            }
            Err(error) => {
                tracing::warn!(study = %study.id, %error, "could not erase links and recruiting ids");
            }
        }
    }
}

async fn forget_people_of(store: &Store, study: &StudyId) -> Result<u64, store::Error> {
    let now = store.clock().now();
    let versions: Vec<VersionId> = store
        .study_versions(study)
        .await?
        .into_iter()
        .filter(|version| {
            Study::retention_in(&version.text).is_some_and(|retention| now >= retention)
        })
        .map(|version| version.id)
        .collect();
    if versions.is_empty() {
        return Ok(0);
    }
    store.forget_people(study, &versions).await
}
