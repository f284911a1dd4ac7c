//! The latest snapshot of each study and population: reading a page again at the same version parses nothing again.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use super::Snapshot;
use crate::{
    store::{Population, Totals},
    study::StudyId,
};

/// One snapshot per study and population.
#[derive(Debug, Default)]
pub(super) struct SnapshotCache {
    slots: Mutex<HashMap<(StudyId, Population), Arc<Slot>>>,
}

/// The place of one snapshot. Its lock is held while the snapshot is read, so that many requests at a new version read it
/// once.
#[derive(Debug, Default)]
pub(super) struct Slot(pub(super) tokio::sync::Mutex<Option<Arc<Snapshot>>>);

impl SnapshotCache {
    /// The place of a study that is served.
    pub(super) fn slot(&self, study: &StudyId, population: Population) -> Arc<Slot> {
        // Nothing can be left half done under this lock.
        let mut slots = self.slots.lock().unwrap_or_else(PoisonError::into_inner);
        slots
            .entry((study.clone(), population))
            .or_default()
            .clone()
    }

    /// A study is served in another version from now on: what was read before is not shown any more.
    pub(super) async fn forget(&self, study: &StudyId) {
        for population in [Population::People, Population::Simulated] {
            *self.slot(study, population).0.lock().await = None;
        }
    }
}

/// The kept snapshot, unless the page has moved on since.
pub(super) fn fresh(kept: Option<&Arc<Snapshot>>, people: &Totals) -> Option<Arc<Snapshot>> {
    // A later one than asked for is as good: another request was faster.
    kept.filter(|kept| kept.people.page_version >= people.page_version)
        .cloned()
}
