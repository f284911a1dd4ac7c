//! The studies that are served, every stored version parsed once.

use std::{
    collections::{BTreeMap, HashMap},
    sync::{Arc, PoisonError, RwLock},
};

use super::{live_fits::LiveFits, snapshot_cache::SnapshotCache};
use crate::{
    store::{self, Population, Store, StudyRow, StudyState, StudyVersion, VersionId},
    study::{ParseError, Study, StudyId, built_in, step::NamedReplay},
};

/// All served studies by id and version. A version never changes; new ones can be added while the server runs.
#[derive(Debug)]
pub struct Catalogue {
    served: RwLock<Arc<Served>>,
    /// What is wrong with which file, since it was last read.
    file_errors: RwLock<BTreeMap<String, String>>,
    /// What was read of them last.
    pub(super) snapshots: SnapshotCache,
    /// What this server remembers of its fits.
    pub(super) live_fits: LiveFits,
}

/// What is served at one moment.
#[derive(Debug, Clone, Default)]
struct Served {
    /// The current version of each study, in the order in which the files were given.
    current: Vec<(VersionId, Arc<Study>)>,
    versions: HashMap<VersionId, Arc<Study>>,
}

/// Where the text of a study stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// In the program.
    Program,
    /// In a file of the lab's.
    File,
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
        Self::publish_but(store, parse(files)?, &[], &[]).await
    }

    /// The same for studies that were read already. Those in `left_alone` are served as they are stored, because their
    /// files cannot be read. So is one that is stored as a file of the lab's described it, and that only the program
    /// describes now: people may be taking it, and a missing file is no reason to ask them something else. Those in `unwanted` that have no file
    /// are served only if somebody has begun them.
    pub(super) async fn publish_but(
        store: &Store,
        studies: Vec<(Origin, Study)>,
        left_alone: &[StudyId],
        unwanted: &[StudyId],
    ) -> Result<Self, CatalogueError> {
        let mut served = Served::default();
        let stored = store.studies().await?;
        for (origin, study) in studies {
            let row = stored.iter().find(|row| row.id == *study.id());
            if left_alone.contains(study.id()) && row.is_some() {
                continue;
            }
            let version = match (origin, row) {
                (Origin::Program, Some(row)) if is_of_the_lab(store, row, &study).await? => {
                    tracing::warn!(
                        study = %study.id(),
                        "the file with which this study was last served is gone; it is served as it was stored, not as the built-in study of the same id"
                    );
                    continue;
                }
                (Origin::Program, Some(_) | None) => {
                    let state = state_if_new(&study);
                    let rule = study.exclusion_rule();
                    store
                        .publish_built_in(
                            study.id(),
                            study.hash(),
                            study.text(),
                            state,
                            rule.as_ref(),
                        )
                        .await?
                }
                (Origin::File, _) => publish(store, &study).await?,
            };
            set_ends(store, &study).await?;
            served.add_earlier(store, &study, version).await?;
            served.add(version, Arc::new(study));
        }
        served.add_stored(store, unwanted).await?;
        Ok(Self::of(served))
    }

    /// The studies as they are stored, for commands that only read a database. A study whose current version is not
    /// readable any more is left out.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn stored(store: &Store) -> Result<Self, CatalogueError> {
        let mut served = Served::default();
        for row in store.studies().await? {
            served.add_versions(store, &row).await?;
        }
        Ok(Self::of(served))
    }

    /// Publishes no file: what the database holds is served as it is stored, but of the built-in studies only what somebody
    /// has begun.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn publish_without_built_in(store: &Store) -> Result<Self, CatalogueError> {
        Self::publish_but(store, Vec::new(), &[], &built_in_ids()?).await
    }

    fn of(served: Served) -> Self {
        Self {
            served: RwLock::new(Arc::new(served)),
            file_errors: RwLock::default(),
            snapshots: SnapshotCache::default(),
            live_fits: LiveFits::default(),
        }
    }

    /// Makes a study the current version of itself while the server runs. People under way go on with theirs.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn renew(&self, store: &Store, study: Study) -> Result<VersionId, store::Error> {
        let version = publish(store, &study).await?;
        // Before anybody is taken in by it.
        set_ends(store, &study).await?;
        let study = Arc::new(study);
        {
            let mut served = self.served.write().unwrap_or_else(PoisonError::into_inner);
            let mut changed = Served::clone(&served);
            changed.add(version, study.clone());
            *served = Arc::new(changed);
        }
        self.snapshots.forget(study.id()).await;
        Ok(version)
    }

    /// What is wrong with which file of the studies folder.
    pub fn file_errors(&self) -> BTreeMap<String, String> {
        let errors = self.file_errors.read();
        errors.unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Notes what is wrong with a file, or that nothing is any more.
    pub(super) fn note_file(&self, file: &str, error: Option<String>) {
        let errors = self.file_errors.write();
        let mut errors = errors.unwrap_or_else(PoisonError::into_inner);
        match error {
            Some(error) => errors.insert(file.to_owned(), error),
            None => errors.remove(file),
        };
    }

    fn served(&self) -> Arc<Served> {
        let served = self.served.read();
        served.unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The version of a study that new runs get.
    pub fn current(&self, id: &StudyId) -> Option<(VersionId, Arc<Study>)> {
        self.served()
            .current
            .iter()
            .find(|(_, study)| study.id() == id)
            .cloned()
    }

    /// One version of one study, for runs that began with it.
    pub fn version(&self, version: VersionId) -> Option<Arc<Study>> {
        self.served().versions.get(&version).cloned()
    }

    /// The replays that any version shows; the same one as often as it is shown.
    pub fn replays(&self) -> Vec<NamedReplay> {
        let served = self.served();
        served
            .versions
            .values()
            .flat_map(|study| study.replays())
            .cloned()
            .collect()
    }

    /// The current versions, in the order in which the files were given.
    pub fn studies(&self) -> Vec<Arc<Study>> {
        let served = self.served();
        served
            .current
            .iter()
            .map(|(_, study)| study.clone())
            .collect()
    }
}

impl Served {
    fn add(&mut self, version: VersionId, study: Arc<Study>) {
        self.versions.insert(version, study.clone());
        match self
            .current
            .iter_mut()
            .find(|(_, known)| known.id() == study.id())
        {
            Some(current) => *current = (version, study),
            None => self.current.push((version, study)),
        }
    }

    /// Studies whose file is gone are served as they were stored, so that people under way can finish and their
    /// answers can be read.
    /// Unwanted ones are left out unless somebody has begun them, because the links of these people were promised to work.
    async fn add_stored(
        &mut self,
        store: &Store,
        unwanted: &[StudyId],
    ) -> Result<(), CatalogueError> {
        for row in store.studies().await? {
            if self.current.iter().any(|(_, study)| *study.id() == row.id) {
                continue;
            }
            if unwanted.contains(&row.id) {
                let people = store.totals(&row.id, Population::People).await?;
                let simulated = store.totals(&row.id, Population::Simulated).await?;
                let is_built_in = store.study_version(row.version).await?.is_built_in;
                if is_built_in && people.started == 0 && simulated.started == 0 {
                    continue;
                }
            }
            self.add_versions(store, &row).await?;
            if self.current.iter().any(|(_, study)| *study.id() == row.id) {
                tracing::warn!(study = %row.id, "no file describes this study any more; it is served as it was stored");
            } else {
                tracing::error!(study = %row.id, "no file describes this study any more, and its stored text is not readable; it is not served");
            }
        }
        Ok(())
    }

    async fn add_versions(&mut self, store: &Store, row: &StudyRow) -> Result<(), CatalogueError> {
        for stored in store.study_versions(&row.id).await? {
            let Some(study) = readable(&row.id, &stored) else {
                continue;
            };
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
            if let Some(earlier) = readable(study.id(), &stored) {
                self.versions.insert(stored.id, Arc::new(earlier));
            }
        }
        Ok(())
    }
}

/// A stored text as this program reads it; nothing where it cannot, which must not keep anything else from being served.
fn readable(study: &StudyId, stored: &StudyVersion) -> Option<Study> {
    let name = format!("version {} of {study}", stored.number);
    Study::parse_stored(&name, &stored.text)
        .inspect_err(
            |error| tracing::warn!(%error, "a stored study version is not readable any more"),
        )
        .ok()
}

/// Makes a study the current version of itself in the database.
async fn publish(store: &Store, study: &Study) -> Result<VersionId, store::Error> {
    let (id, rule) = (study.id(), study.exclusion_rule());
    store
        .publish(
            id,
            study.hash(),
            study.text(),
            state_if_new(study),
            rule.as_ref(),
        )
        .await
}

/// Whether the current version of a study is another text than the program's, and was never one of the program's own.
async fn is_of_the_lab(
    store: &Store,
    row: &StudyRow,
    built_in: &Study,
) -> Result<bool, store::Error> {
    let current = store.study_version(row.version).await?;
    Ok(!current.is_built_in && current.hash != built_in.hash())
}

/// Where unfinished runs give their places back, those do too that began under a version without an end.
async fn set_ends(store: &Store, study: &Study) -> Result<(), store::Error> {
    let Some(time_limit_ms) = study.recruiting().time_limit_ms else {
        return Ok(());
    };
    let runs = store.set_ends(study.id(), time_limit_ms).await?;
    if runs > 0 {
        tracing::info!(study = %study.id(), runs, "runs under way that had no end got one, since the study limits the time of a run now");
    }
    Ok(())
}

/// A study whose file does not say that it is open is a draft until somebody opens it.
fn state_if_new(study: &Study) -> StudyState {
    if study.is_open_at_first() {
        StudyState::Open
    } else {
        StudyState::Draft
    }
}

/// The ids of the studies that are compiled in.
pub(super) fn built_in_ids() -> Result<Vec<StudyId>, ParseError> {
    built_in()
        .into_iter()
        .map(|(name, text)| Ok(Study::parse(name, text)?.id().clone()))
        .collect()
}

/// Reads study files in their order. A file may replace a built-in study, but no other file.
fn parse(files: Vec<(String, String)>) -> Result<Vec<(Origin, Study)>, CatalogueError> {
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
    let origin = |file: &str, study: &Study| {
        if built_in().contains(&(file, study.text())) {
            Origin::Program
        } else {
            Origin::File
        }
    };
    Ok(read
        .into_iter()
        .map(|(file, study)| (origin(&file, &study), study))
        .collect())
}
