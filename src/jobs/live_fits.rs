//! What the running server remembers of the fits that it made: where the next one can start, and the draws of those
//! that are provisional. The database holds everything that must outlive it.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use super::FitReport;
use crate::{
    inference::{Draws, WarmStart},
    store::{Fit, FitKey, Population},
    study::StudyId,
};

/// The latest fit of each part and model that this server made.
#[derive(Debug, Default)]
pub(super) struct LiveFits {
    fits: Mutex<HashMap<(StudyId, Population, FitKey), Arc<LiveFit>>>,
}

/// A fit that this server made.
#[derive(Debug)]
pub(super) struct LiveFit {
    /// At least as new as this were the answers that it was made of.
    pub(super) data_version: i64,
    pub(super) input_hash: String,
    pub(super) is_provisional: bool,
    pub(super) report: Arc<FitReport>,
    pub(super) draws: Arc<Draws>,
    pub(super) warm_start: WarmStart,
    /// What the latest warm fit cost in processor time, in microseconds; 0 while there was none.
    pub(super) warm_us: u64,
}

impl LiveFits {
    /// Remembers a fit in place of the earlier one of the same part and model.
    pub(super) fn keep(&self, study: &StudyId, population: Population, key: FitKey, fit: LiveFit) {
        let at = (study.clone(), population, key);
        self.fits().insert(at, Arc::new(fit));
    }

    /// Forgets the fits of a study that were made before somebody who was counted withdrew: nothing that follows may start
    /// from what was drawn with them.
    pub(super) fn forget_before(
        &self,
        study: &StudyId,
        population: Population,
        erased_version: i64,
    ) {
        self.fits().retain(|(of, people, _), fit| {
            of != study || *people != population || fit.data_version >= erased_version
        });
    }

    /// The latest fit of a part and model.
    pub(super) fn get(
        &self,
        study: &StudyId,
        population: Population,
        key: &FitKey,
    ) -> Option<Arc<LiveFit>> {
        let at = (study.clone(), population, key.clone());
        self.fits().get(&at).cloned()
    }

    /// The latest fit, if it is the one that was stored so.
    pub(super) fn of(
        &self,
        study: &StudyId,
        population: Population,
        stored: &Fit,
    ) -> Option<Arc<LiveFit>> {
        self.get(study, population, &stored.key).filter(|fit| {
            fit.input_hash == stored.input_hash && fit.is_provisional == stored.is_provisional
        })
    }

    fn fits(
        &self,
    ) -> std::sync::MutexGuard<'_, HashMap<(StudyId, Population, FitKey), Arc<LiveFit>>> {
        // Nothing can be left half done under this lock.
        self.fits.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
