//! The folder with a lab's study files: read at the start, and looked at while the server runs.
//!
//! A file that changed becomes a new version for whoever starts from then on; one that cannot be read is told of, and
//! what ran before goes on. A file that goes away changes nothing. The folder is looked at again and again, which works
//! on every file system, also where an editor replaces files or the folder is mounted from elsewhere.

use std::{
    collections::{HashMap, HashSet},
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, SystemTime},
};

use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use super::{Catalogue, CatalogueError, catalogue::built_in_ids};
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
    has_built_in: bool,
    known: HashMap<PathBuf, Known>,
    /// Whether something was served since refused files were read last, which may be what they waited for.
    reads_refused: bool,
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

/// What is different in the folder.
struct Changes {
    files: Vec<Changed>,
    /// Files that were there at the last look.
    gone: Vec<PathBuf>,
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
            has_built_in: true,
            known: HashMap::new(),
            reads_refused: false,
        }
    }

    /// The same without the built-in studies. Those that somebody has begun are served as they are stored.
    #[must_use]
    pub fn without_built_in(self) -> Self {
        Self {
            has_built_in: false,
            ..self
        }
    }

    /// Publishes the built-in studies, if they are wanted, and those of the folder, which replace built-in ones of the same id. A file that
    /// cannot be read keeps nothing else from being served.
    ///
    /// # Errors
    /// When a built-in study is refused, the folder cannot be listed, or the database fails.
    pub async fn publish(&mut self, store: &Store) -> Result<Catalogue, FolderError> {
        let mut studies = Vec::new();
        if self.has_built_in {
            for (name, text) in built_in() {
                studies.push(Study::parse(name, text).map_err(CatalogueError::from)?);
            }
        }
        let (mut errors, mut left_alone, mut given) = (Vec::new(), Vec::new(), Vec::new());
        for changed in self.changed()?.files {
            let path = changed.path.clone();
            match self.read(changed) {
                Ok(Some(study)) => {
                    self.note(&path, Outcome::Served);
                    given.push(study.id().clone());
                    match studies.iter_mut().find(|known| known.id() == study.id()) {
                        Some(known) => *known = study,
                        None => studies.push(study),
                    }
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
        let unwanted = if self.has_built_in {
            Vec::new()
        } else {
            built_in_ids().map_err(CatalogueError::from)?
        };
        let catalogue = Catalogue::publish_but(store, studies, &left_alone, &unwanted).await?;
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

    /// Publishes what changed since the last look.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub async fn look(
        &mut self,
        store: &Store,
        catalogue: &Catalogue,
        prepare: &Prepare,
    ) -> Result<(), FolderError> {
        let Changes { files, gone } = self.changed()?;
        for path in gone {
            catalogue.note_file(&path.display().to_string(), None);
        }
        for changed in files {
            let path = changed.path.clone();
            match self.read(changed) {
                Ok(None) => catalogue.note_file(&path.display().to_string(), None),
                Ok(Some(study)) => match renew(store, catalogue, prepare, &path, study).await {
                    Ok(()) => {
                        self.note(&path, Outcome::Served);
                        self.reads_refused = true;
                    }
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

    fn note(&mut self, path: &Path, outcome: Outcome) {
        if let Some(known) = self.known.get_mut(path) {
            known.outcome = outcome;
        }
    }

    /// The files that are new or look different from when they were last read, by name. Where anything is different, those that
    /// were refused come after them: what was wrong may have been another file.
    fn changed(&mut self) -> Result<Changes, FolderError> {
        let failed = |error| FolderError::Folder {
            folder: self.path.clone(),
            error,
        };
        let (mut changed, mut refused) = (Vec::new(), Vec::new());
        let mut there = HashSet::new();
        for entry in std::fs::read_dir(&self.path).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_none_or(|extension| extension != "toml") {
                continue;
            }
            // A file that goes away at this moment is looked at the next time, if it is there then.
            let Ok(metadata) = std::fs::metadata(&path) else {
                continue;
            };
            there.insert(path.clone());
            let (modified, length) = (metadata.modified().ok(), metadata.len());
            let found = self
                .known
                .get(&path)
                .filter(|known| known.modified == modified && known.length == length);
            let list = match found.map(|known| known.outcome) {
                None => &mut changed,
                Some(Outcome::Refused | Outcome::Duplicate) => &mut refused,
                Some(Outcome::Served) => continue,
            };
            list.push(Changed {
                path,
                modified,
                length,
            });
        }
        let gone: Vec<PathBuf> = self
            .known
            .keys()
            .filter(|path| !there.contains(*path))
            .cloned()
            .collect();
        for path in &gone {
            self.known.remove(path);
        }
        let reads_refused = std::mem::take(&mut self.reads_refused);
        let by_name = |one: &Changed, other: &Changed| one.path.cmp(&other.path);
        changed.sort_by(by_name);
        if reads_refused || !changed.is_empty() || !gone.is_empty() {
            refused.sort_by(by_name);
            changed.append(&mut refused);
        }
        Ok(Changes {
            files: changed,
            gone,
        })
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
            .filter(|(other, known)| other.as_path() != path && known.outcome != Outcome::Duplicate)
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
    let version = store
        .study_version(version)
        .await
        .map_err(NotRenewed::Store)?
        .number;
    tracing::info!(study = %id, %version, file = %path.display(), "a study file is served in a new version");
    Ok(())
}

fn refuse(catalogue: &Catalogue, path: &Path, error: String) {
    let file = path.display().to_string();
    // A file that is refused again for the same reason is told of once.
    if catalogue.file_errors().get(&file) != Some(&error) {
        tracing::error!(file, %error, "a study file is refused; what was served before goes on");
    }
    catalogue.note_file(&file, Some(error));
}
