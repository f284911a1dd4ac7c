//! A study's data as files, for programs that know nothing of riskaware.
//!
//! Everything here is written to an [`io::Write`] as it is read, page by page, so that memory stays flat and no read
//! transaction waits for a slow reader. The same data give the same bytes: nothing depends on when or where an export is
//! made. In reading order:
//!
//! * [`Export`]: a study's data, ready to be written in any [`Form`];
//! * `versions`: study files as they were when people answered;
//! * [`Codebook`] (`codebook`, `columns`, `wide_columns`): every column of the tables, from which their headers come too;
//! * `long`, `wide`, `bonus`: the tables; `cell`: what a cell may hold;
//! * `psych_ds`, `archive`: one archive of everything, in the form of the Psych-DS standard.

mod archive;
mod bonus;
mod cell;
mod codebook;
mod columns;
mod long;
mod psych_ds;
mod versions;
mod wide;
mod wide_columns;

use std::io;
use std::sync::Arc;

use tokio::runtime::Handle;

pub use codebook::{Codebook, Table};
pub use columns::{Column, ColumnKind, Level};
pub use long::{Answer, write_unstored};
use versions::Versions;

use crate::store::{self, Population, Store};
use crate::study::{RecruitingIds, Study, StudyId};

/// What can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// One row per question shown.
    LongCsv,
    /// One row per participant.
    WideCsv,
    /// One JSON object per question shown.
    Ndjson,
    /// Every column of the tables as a table.
    CodebookCsv,
    /// The same in JSON.
    CodebookJson,
    /// What each participant is paid beside the fee.
    BonusCsv,
    /// One ZIP archive of everything, in the form of the Psych-DS standard.
    PsychDs,
}

impl Form {
    /// The form's media type.
    pub fn content_type(self) -> &'static str {
        match self {
            Self::LongCsv | Self::WideCsv | Self::CodebookCsv | Self::BonusCsv => {
                "text/csv; charset=utf-8"
            }
            Self::Ndjson => "application/x-ndjson",
            Self::CodebookJson => "application/json",
            Self::PsychDs => "application/zip",
        }
    }

    /// What a file of this form is called after the study's id.
    pub fn file_suffix(self) -> &'static str {
        match self {
            Self::LongCsv => "answers.csv",
            Self::WideCsv => "participants.csv",
            Self::Ndjson => "answers.ndjson",
            Self::CodebookCsv => "codebook.csv",
            Self::CodebookJson => "codebook.json",
            Self::BonusCsv => "bonus.csv",
            Self::PsychDs => "psych-ds.zip",
        }
    }
}

/// What tells of a person's id at a recruiting platform.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ids {
    /// Nothing.
    #[default]
    LeftOut,
    /// A keyed hash: the same person has the same one throughout the study.
    Hashed,
    /// The id itself, where the study stored it so.
    Plain,
}

impl Ids {
    /// How it is asked for; none where nothing was.
    pub fn name(self) -> Option<&'static str> {
        match self {
            Self::LeftOut => None,
            Self::Hashed => Some("hashed"),
            Self::Plain => Some("plain"),
        }
    }
}

/// Why an export was not made, or broke off.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The database did not give the data.
    #[error(transparent)]
    Store(#[from] store::Error),
    /// The study file is not readable any more.
    #[error(transparent)]
    Study(#[from] crate::study::ParseError),
    /// Plain ids are wanted and not there.
    #[error(
        "study {0} stores the ids of recruiting platforms hashed, so there are no plain ones; allowed: hashed"
    )]
    NoPlainIds(StudyId),
    /// The file or its reader takes no more.
    #[error("writing: {0}")]
    Write(#[from] io::Error),
    /// A table's row does not fit its file.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// A value is no JSON.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// The archive cannot be put together.
    #[error("archive: {0}")]
    Archive(#[from] zip::result::ZipError),
}

/// A study's data, ready to be written.
#[derive(Debug, Clone)]
pub struct Export {
    store: Store,
    runtime: Handle,
    population: Population,
    study: Arc<Study>,
    versions: Versions,
    ids: Ids,
}

impl Export {
    /// Reads the study's versions. The runtime that this runs on is asked for the data later.
    ///
    /// # Errors
    /// `NotFound` for an unknown study, [`ExportError::NoPlainIds`] for plain ids that no version of it stored.
    pub async fn open(
        store: &Store,
        study: &StudyId,
        population: Population,
        ids: Ids,
    ) -> Result<Self, ExportError> {
        let current = store.study(study).await?.version;
        let versions = Versions::read(store, study, current).await?;
        if ids == Ids::Plain
            && !versions
                .iter()
                .any(|(_, study)| study.recruiting().ids == RecruitingIds::Plain)
        {
            return Err(ExportError::NoPlainIds(study.clone()));
        }
        Ok(Self {
            store: store.clone(),
            runtime: Handle::current(),
            population,
            study: versions.current().clone(),
            versions,
            ids,
        })
    }

    /// The current version of the study.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// All readable versions of the study, the current one first: what it asks now comes first in every table.
    fn versions_current_first(&self) -> impl Iterator<Item = &Study> {
        let earlier = self.versions.iter().map(|(_, study)| study);
        std::iter::once(self.study())
            .chain(earlier.filter(|study| study.hash() != self.study.hash()))
    }

    /// Every column of the tables.
    pub fn codebook(&self) -> Codebook {
        Codebook::new(self)
    }

    /// Writes the data, and says how many rows (for an archive: files) there are. It waits for the database: call it on a thread that may
    /// block, such as one of [`tokio::task::spawn_blocking`].
    ///
    /// # Errors
    /// When the database or `out` fails; what was written until then is incomplete.
    pub fn write(&self, form: Form, out: &mut dyn io::Write) -> Result<u64, ExportError> {
        match form {
            Form::LongCsv => long::csv(self, out),
            Form::Ndjson => long::ndjson(self, out),
            Form::WideCsv => wide::csv(self, out),
            Form::CodebookCsv => self.codebook().write_csv(out),
            Form::CodebookJson => self.codebook().write_json(out),
            Form::BonusCsv => bonus::csv(self, out),
            Form::PsychDs => psych_ds::zip(self, out),
        }
    }
}
