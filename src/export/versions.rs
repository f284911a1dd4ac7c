//! Study files as they were when people answered.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::ExportError;
use crate::store::{Store, StudyVersion, VersionId, VersionNumber};
use crate::study::{Study, StudyId};

/// All readable versions of a study, the oldest first.
#[derive(Debug, Clone)]
pub(super) struct Versions {
    current: (VersionId, Arc<Study>),
    studies: BTreeMap<VersionId, Arc<Study>>,
    numbers: BTreeMap<VersionId, VersionNumber>,
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
            match Study::parse_stored(&name, &version.text) {
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
            current: (
                current,
                current_study.ok_or(crate::store::Error::NotFound("study version"))?,
            ),
            studies,
            numbers: stored
                .iter()
                .map(|version| (version.id, version.number))
                .collect(),
            stored: Arc::new(stored),
        })
    }

    /// The version that new participants get.
    pub(super) fn current(&self) -> &Arc<Study> {
        &self.current.1
    }

    /// The study as it was in a version.
    pub(super) fn of(&self, version: VersionId) -> &Study {
        self.studies.get(&version).unwrap_or(&self.current.1)
    }

    /// The number of a readable version among those of its study.
    pub(super) fn number(&self, version: VersionId) -> VersionNumber {
        self.numbers[&version]
    }

    /// The version itself where it is readable, else the current one, whose labels stand for it.
    pub(super) fn readable(&self, version: VersionId) -> VersionId {
        if self.studies.contains_key(&version) {
            version
        } else {
            self.current.0
        }
    }

    /// The readable versions, the current one first: what it asks now comes first in every table.
    pub(super) fn current_first(&self) -> impl Iterator<Item = (VersionId, &Study)> {
        let (current, study) = &self.current;
        let others = self.iter().filter(move |(version, _)| version != current);
        std::iter::once((*current, study.as_ref())).chain(others)
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
