//! The folder with a lab's study files: read at the start, and looked at while the server runs.
//!
//! A file that changed becomes a new version for whoever starts from then on; one that cannot be read is told of, and
//! what ran before goes on. A file that goes away changes nothing. The folder is looked at again and again, which works
//! on every file system, also where an editor replaces files or the folder is mounted from elsewhere.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, SystemTime},
};

use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use super::{Catalogue, CatalogueError, catalogue::Origin};
use crate::{
    store::{self, Store},
    study::{Study, StudyId, built_in},
};

/// How soon a changed file is noticed.
const PERIOD: Duration = Duration::from_secs(2);

/// What must be done before a new version is served, such as computing its replays.
pub type Prepare = Arc<dyn Fn(&Study) -> Result<(), String> + Send + Sync>;

/// A folder with study files (`*.toml`).
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    known: HashMap<PathBuf, Known>,
    /// How changed files looked at the last look. What still changes is being written.
    seen: HashMap<PathBuf, (Option<SystemTime>, u64)>,
}

/// A file as it was last read.
#[derive(Debug, Clone)]
struct Known {
    modified: Option<SystemTime>,
    length: u64,
    text: String,
    /// The study that it described when it could last be read.
    study: Option<StudyId>,
    outcome: Outcome,
}

/// What became of a file when it was last read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// Its text is what is served.
    Served,
    /// It is wrong until its text changes.
    Refused,
    /// It is wrong as long as another file describes the same study.
    Duplicate,
}

/// A file that is to be read.
struct Changed {
    path: PathBuf,
    modified: Option<SystemTime>,
    length: u64,
}

impl StudyFolder {
    /// A folder of which nothing is known yet.
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            known: HashMap::new(),
            seen: HashMap::new(),
        }
    }

    /// Publishes the built-in studies and those of the folder, which replace built-in ones of the same id. A file that
    /// cannot be read keeps nothing else from being served.
    ///
    /// # Errors
    /// When a built-in study is refused, the folder cannot be listed, or the database fails.
    pub async fn publish(&mut self, store: &Store) -> Result<Catalogue, FolderError> {
        let mut studies = Vec::new();
        for (name, text) in built_in() {
            let study = Study::parse(name, text).map_err(CatalogueError::from)?;
            studies.push((Origin::Program, study));
        }
        let (mut errors, mut left_alone, mut given) = (Vec::new(), Vec::new(), Vec::new());
        for changed in self.changed()? {
            let path = changed.path.clone();
            match self.read(changed) {
                Ok(Some(study)) => {
                    self.note(&path, Outcome::Served);
                    given.push(study.id().clone());
                    studies.retain(|(_, known)| known.id() != study.id());
                    studies.push((Origin::File, study));
                }
                Ok(None) => {}
                Err(error) => {
                    left_alone.extend(self.likely_study(&path));
                    errors.push((path, error));
                }
            }
        }
        // A study that another file describes is served from there.
        left_alone.retain(|study| !given.contains(study));
        let catalogue = Catalogue::publish_but(store, studies, &left_alone).await?;
        for (path, error) in errors {
            refuse(&catalogue, &path, error);
        }
        Ok(catalogue)
    }

    /// Looks at the folder until `stop`.
    pub async fn watch(
        mut self,
        store: Store,
        catalogue: Arc<Catalogue>,
        prepare: Prepare,
        stop: CancellationToken,
    ) {
        let mut looks = interval(PERIOD);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = looks.tick() => {}
                () = stop.cancelled() => return,
            }
            if let Err(error) = self.look(&store, &catalogue, &prepare).await {
                tracing::warn!(%error, "the studies folder could not be looked at");
            }
        }
    }

    /// Publishes what changed, and looks as it did at the last look: a file that is being written may be half there.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub async fn look(
        &mut self,
        store: &Store,
        catalogue: &Catalogue,
        prepare: &Prepare,
    ) -> Result<(), FolderError> {
        for changed in self.changed()? {
            let path = changed.path.clone();
            if !self.is_settled(&changed) {
                continue;
            }
            match self.read(changed) {
                Ok(None) => catalogue.note_file(&path.display().to_string(), None),
                Ok(Some(study)) => match renew(store, catalogue, prepare, &path, study).await {
                    Ok(()) => self.note(&path, Outcome::Served),
                    Err(NotRenewed::Refused(error)) => refuse(catalogue, &path, error),
                    Err(NotRenewed::Store(error)) => {
                        // Forgotten, so that the next look tries again.
                        self.known.remove(&path);
                        tracing::warn!(file = %path.display(), %error, "a study file could not be stored yet");
                    }
                },
                Err(error) => refuse(catalogue, &path, error),
            }
        }
        Ok(())
    }

    /// Whether a file looks as it did at the last look.
    fn is_settled(&mut self, changed: &Changed) -> bool {
        let looks = (changed.modified, changed.length);
        let before = self.seen.insert(changed.path.clone(), looks);
        let read = self.known.get(&changed.path);
        before == Some(looks) || read.is_some_and(|read| (read.modified, read.length) == looks)
    }

    fn note(&mut self, path: &Path, outcome: Outcome) {
        if let Some(known) = self.known.get_mut(path) {
            known.outcome = outcome;
        }
    }

    /// The files that are new, look different from when they were last read, or wait for another one to go, by name.
    fn changed(&self) -> Result<Vec<Changed>, FolderError> {
        let failed = |error| FolderError::Folder {
            folder: self.path.clone(),
            error,
        };
        let mut changed = Vec::new();
        for entry in std::fs::read_dir(&self.path).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_none_or(|extension| extension != "toml") {
                continue;
            }
            // A file that goes away at this moment is looked at the next time, if it is there then.
            let Ok(metadata) = std::fs::metadata(&path) else {
                continue;
            };
            let (modified, length) = (metadata.modified().ok(), metadata.len());
            let is_known = self.known.get(&path).is_some_and(|known| {
                known.modified == modified
                    && known.length == length
                    && known.outcome != Outcome::Duplicate
            });
            if !is_known {
                changed.push(Changed {
                    path,
                    modified,
                    length,
                });
            }
        }
        changed.sort_by(|one, other| one.path.cmp(&other.path));
        Ok(changed)
    }

    /// Reads a file; nothing if its text is the one that is served.
    fn read(&mut self, changed: Changed) -> Result<Option<Study>, String> {
        let Changed {
            path,
            modified,
            length,
        } = changed;
        let text = std::fs::read_to_string(&path).map_err(|error| error.to_string())?;
        let earlier = self.known.get(&path).cloned();
        let is_served = earlier
            .as_ref()
            .is_some_and(|known| known.text == text && known.outcome == Outcome::Served);
        let parsed = Study::parse(&path.display().to_string(), &text);
        let study = match &parsed {
            Ok(study) => Some(study.id().clone()),
            Err(_) => earlier.and_then(|known| known.study),
        };
        let known = Known {
            modified,
            length,
            text,
            study,
            outcome: if is_served {
                Outcome::Served
            } else {
                Outcome::Refused
            },
        };
        self.known.insert(path.clone(), known);
        let study = parsed.map_err(|error| error.to_string())?;
        if let Some(other) = self.other_file_of(study.id(), &path) {
            let error = format!(
                "study {} is described by {} already; give one of them another id",
                study.id(),
                other.display()
            );
            self.note(&path, Outcome::Duplicate);
            return Err(error);
        }
        Ok((!is_served).then_some(study))
    }

    fn other_file_of(&self, study: &StudyId, path: &Path) -> Option<&Path> {
        self.known
            .iter()
            .filter(|(other, known)| {
                other.as_path() != path && known.outcome != Outcome::Duplicate && other.exists()
            })
            .find(|(_, known)| known.study.as_ref() == Some(study))
            .map(|(other, _)| other.as_path())
    }

    /// Which study a file that cannot be read may describe: the one that it names, or the one that it is named after.
    fn likely_study(&self, path: &Path) -> Vec<StudyId> {
        let named = self.known.get(path).and_then(|known| {
            let table: toml::Table = known.text.parse().ok()?;
            Some(table.get("id")?.as_str()?.to_owned())
        });
        let stem = path.file_stem().and_then(|stem| stem.to_str());
        named
            .as_deref()
            .or(stem)
            .map(StudyId::from)
            .into_iter()
            .collect()
    }
}

/// Why the studies folder cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// It cannot be listed.
    #[error("reading the studies folder {folder}: {error}")]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// Its studies, or the built-in ones, cannot be served.
    #[error(transparent)]
    Catalogue(#[from] CatalogueError),
}

/// Why a new version is not served.
enum NotRenewed {
    /// It cannot be.
    Refused(String),
    /// Not yet.
    Store(store::Error),
}

async fn renew(
    store: &Store,
    catalogue: &Catalogue,
    prepare: &Prepare,
    path: &Path,
    study: Study,
) -> Result<(), NotRenewed> {
    let (id, prepare) = (study.id().clone(), prepare.clone());
    let study = tokio::task::spawn_blocking(move || prepare(&study).map(|()| study))
        .await
        .map_err(|error| NotRenewed::Refused(error.to_string()))?
        .map_err(NotRenewed::Refused)?;
    let version = catalogue
        .renew(store, study)
        .await
        .map_err(NotRenewed::Store)?;
    catalogue.note_file(&path.display().to_string(), None);
    tracing::info!(study = %id, version = version.get(), file = %path.display(), "a study file is served in a new version");
    Ok(())
}

fn refuse(catalogue: &Catalogue, path: &Path, error: String) {
    let file = path.display().to_string();
    // A file that waits for another one to go is read at each look, and told of once.
    if catalogue.file_errors().get(&file) != Some(&error) {
        tracing::error!(file, %error, "a study file is refused; what was served before goes on");
    }
    catalogue.note_file(&file, Some(error));
}
