//! The studies that are served, every stored version parsed once.

use std::{collections::HashMap, sync::Arc};

use super::{live_fits::LiveFits, snapshot_cache::SnapshotCache};
use crate::{
    store::{self, Store, StudyRow, VersionId},
    study::{ParseError, Study, StudyId, built_in, step::NamedReplay},
};

/// All served studies by id and version. They do not change while the server runs.
#[derive(Debug)]
pub struct Catalogue {
    /// The current version of each study, in the order in which the files were given.
    current: Vec<(VersionId, Arc<Study>)>,
    versions: HashMap<VersionId, Arc<Study>>,
    /// What was read of them last.
    pub(super) snapshots: SnapshotCache,
    /// What this server remembers of its fits.
    pub(super) live_fits: LiveFits,
}

/// Why the studies cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum CatalogueError {
    /// A study file is refused.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// Two files of the lab's describe the same study.
    #[error("study {id} is described by {first} and by {second}; give one of them another id")]
    Twice {
        /// The id of both.
        id: StudyId,
        /// The file that was read first.
        first: String,
        /// The other one.
        second: String,
    },
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
        let studies = parse(files)?;
        let mut catalogue = Self::empty();
        for study in studies {
            let version = store
                .publish(study.id(), study.hash(), study.text())
                .await?;
            catalogue.add_earlier(store, &study, version).await?;
            let study = Arc::new(study);
            catalogue.versions.insert(version, study.clone());
            catalogue.current.push((version, study));
        }
        catalogue.add_stored(store).await?;
        Ok(catalogue)
    }

    /// The studies as they are stored, for commands that only read a database.
    ///
    /// # Errors
    /// When a stored file is not readable any more, or the database fails.
    pub async fn stored(store: &Store) -> Result<Self, CatalogueError> {
        let mut catalogue = Self::empty();
        for row in store.studies().await? {
            catalogue.add_versions(store, &row).await?;
        }
        Ok(catalogue)
    }

    fn empty() -> Self {
        Self {
            current: Vec::new(),
            versions: HashMap::new(),
            snapshots: SnapshotCache::default(),
            live_fits: LiveFits::default(),
        }
    }

    /// Studies whose file is gone are served as they were stored, so that people under way can finish and their
    /// answers can be read.
    async fn add_stored(&mut self, store: &Store) -> Result<(), CatalogueError> {
        for row in store.studies().await? {
            if self.current(&row.id).is_some() {
                continue;
            }
            self.add_versions(store, &row).await?;
            tracing::warn!(study = %row.id, "no file describes this study any more; it is served as it was stored");
        }
        Ok(())
    }

    async fn add_versions(&mut self, store: &Store, row: &StudyRow) -> Result<(), CatalogueError> {
        for stored in store.study_versions(&row.id).await? {
            let study = Study::parse(
                &format!("version {} of {}", stored.id, row.id),
                &stored.text,
            )?;
            let study = Arc::new(study);
            self.versions.insert(stored.id, study.clone());
            if stored.id == row.version {
                self.current.push((stored.id, study));
            }
        }
        Ok(())
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

    /// The replays that any version shows; the same one as often as it is shown.
    pub fn replays(&self) -> impl Iterator<Item = &NamedReplay> {
        self.versions.values().flat_map(|study| study.replays())
    }

    /// The current versions, in the order in which the files were given.
    pub fn studies(&self) -> impl Iterator<Item = &Arc<Study>> {
        self.current.iter().map(|(_, study)| study)
    }
}

/// Reads study files in their order. A file may replace a built-in study, but no other file.
fn parse(files: Vec<(String, String)>) -> Result<Vec<Study>, CatalogueError> {
    let mut read: Vec<(String, Study)> = Vec::new();
    for (file, text) in files {
        let study = Study::parse(&file, &text)?;
        let Some((earlier_file, earlier)) = read
            .iter_mut()
            .find(|(_, earlier)| earlier.id() == study.id())
        else {
            read.push((file, study));
            continue;
        };
        if built_in().iter().all(|(name, _)| name != earlier_file) {
            return Err(CatalogueError::Twice {
                id: study.id().clone(),
                first: earlier_file.clone(),
                second: file,
            });
        }
        tracing::info!(study = %study.id(), file, "this file replaces the built-in study");
        (*earlier_file, *earlier) = (file, study);
    }
    Ok(read.into_iter().map(|(_, study)| study).collect())
}
