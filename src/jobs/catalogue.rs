//! The studies that are served, every stored version parsed once.

use std::{collections::HashMap, sync::Arc};

use super::snapshot_cache::SnapshotCache;
use crate::{
    store::{self, Store, VersionId},
    study::{ParseError, Study, StudyId},
};

/// All served studies by id and version. They do not change while the server runs.
#[derive(Debug)]
pub struct Catalogue {
    /// The current version of each study, in the order in which the files were given.
    current: Vec<(VersionId, Arc<Study>)>,
    versions: HashMap<VersionId, Arc<Study>>,
    /// What was read of them last.
    pub(super) snapshots: SnapshotCache,
}

/// Why the studies cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum CatalogueError {
    /// A study file is refused.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// The database does not take or give the texts.
    #[error("study files: {0}")]
    Store(#[from] store::Error),
}

impl Catalogue {
    /// Publishes study files, given as names and texts, as the current versions, and reads all versions that people
    /// may still be answering. A later file replaces an earlier one with the same study id.
    ///
    /// # Errors
    /// When a file is refused, or the database fails.
    pub async fn publish(
        store: &Store,
        files: Vec<(String, String)>,
    ) -> Result<Self, CatalogueError> {
        let mut studies: Vec<Study> = Vec::new();
        for (file, text) in files {
            let study = Study::parse(&file, &text)?;
            match studies
                .iter_mut()
                .find(|earlier| earlier.id() == study.id())
            {
                Some(earlier) => {
                    tracing::info!(study = %study.id(), file, "this file replaces an earlier one of the same study");
                    *earlier = study;
                }
                None => studies.push(study),
            }
        }
        let mut catalogue = Self {
            current: Vec::new(),
            versions: HashMap::new(),
            snapshots: SnapshotCache::default(),
        };
        for study in studies {
            let version = store
                .publish(study.id(), study.hash(), study.text())
                .await?;
            catalogue.add_earlier(store, &study, version).await?;
            let study = Arc::new(study);
            catalogue.versions.insert(version, study.clone());
            catalogue.current.push((version, study));
        }
        Ok(catalogue)
    }

    async fn add_earlier(
        &mut self,
        store: &Store,
        study: &Study,
        current: VersionId,
    ) -> Result<(), CatalogueError> {
        for stored in store.study_versions(study.id()).await? {
            if stored.id == current {
                continue;
            }
            match Study::parse(
                &format!("version {} of {}", stored.id, study.id()),
                &stored.text,
            ) {
                Ok(earlier) => {
                    self.versions.insert(stored.id, Arc::new(earlier));
                }
                // An old text that a newer program no longer reads must not keep the new one from being served.
                Err(error) => {
                    tracing::warn!(%error, "a stored study version is not readable any more")
                }
            }
        }
        Ok(())
    }

    /// The version of a study that new runs get.
    pub fn current(&self, id: &StudyId) -> Option<(VersionId, Arc<Study>)> {
        self.current
            .iter()
            .find(|(_, study)| study.id() == id)
            .cloned()
    }

    /// One version of one study, for runs that began with it.
    pub fn version(&self, version: VersionId) -> Option<Arc<Study>> {
        self.versions.get(&version).cloned()
    }

    /// The current versions, in the order in which the files were given.
    pub fn studies(&self) -> impl Iterator<Item = &Arc<Study>> {
        self.current.iter().map(|(_, study)| study)
    }
}
