//! Study files as they were when people answered.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::ExportError;
use crate::store::{Store, StudyVersion, VersionId};
use crate::study::{Study, StudyId};

/// All readable versions of a study, the oldest first.
#[derive(Debug, Clone)]
pub(super) struct Versions {
    current: Arc<Study>,
    studies: BTreeMap<VersionId, Arc<Study>>,
    stored: Arc<Vec<StudyVersion>>,
}

impl Versions {
    pub(super) async fn read(
        store: &Store,
        study: &StudyId,
        current: VersionId,
    ) -> Result<Self, ExportError> {
        let stored = store.study_versions(study).await?;
        let mut studies = BTreeMap::new();
        let mut current_study = None;
        for version in &stored {
            let name = format!("version {} of {study}", version.number);
            match Study::parse(&name, &version.text) {
                Ok(study) => {
                    let study = Arc::new(study);
                    if version.id == current {
                        current_study = Some(study.clone());
                    }
                    studies.insert(version.id, study);
                }
                Err(error) if version.id == current => return Err(error.into()),
                // Its answers are exported all the same, with the labels of the current version.
                Err(error) => {
                    tracing::warn!(%error, "a stored study version is not readable any more");
                }
            }
        }
        Ok(Self {
            current: current_study.ok_or(crate::store::Error::NotFound("study version"))?,
            studies,
            stored: Arc::new(stored),
        })
    }

    /// The version that new participants get.
    pub(super) fn current(&self) -> &Arc<Study> {
        &self.current
    }

    /// The study as it was in a version.
    pub(super) fn of(&self, version: VersionId) -> &Study {
        self.studies.get(&version).unwrap_or(&self.current)
    }

    /// The readable versions by id.
    pub(super) fn iter(&self) -> impl Iterator<Item = (VersionId, &Study)> {
        self.studies
            .iter()
            .map(|(version, study)| (*version, study.as_ref()))
    }

    /// All versions as they are stored.
    pub(super) fn stored(&self) -> &[StudyVersion] {
        &self.stored
    }
}
