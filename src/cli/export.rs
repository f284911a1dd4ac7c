//! `riskaware export`: a study's data as files, also while a server takes answers.

use std::{
    fs::File,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
};

use anyhow::{Context, bail, ensure};
use clap::{Args, ValueEnum};

use super::audit;
use crate::{
    clock::Clock,
    export::{Export, Form, Ids},
    jobs::Catalogue,
    store::{Population, Store},
    study::StudyId,
    web,
};

/// What to export, and where to.
#[derive(Debug, Clone, Args)]
pub struct Arguments {
    /// The study's id
    study: StudyId,
    /// The form of the file
    #[arg(long, value_enum, default_value_t = WantedForm::Long)]
    format: WantedForm,
    /// The file to write, which must not exist; - is standard output
    #[arg(long, default_value = "-")]
    out: PathBuf,
    /// What tells of a person's id at a recruiting platform (wide, psych-ds, codebook, bonus); left out unless asked for
    #[arg(long, value_enum)]
    ids: Option<WantedIds>,
    /// Simulated people instead of real ones
    #[arg(long)]
    simulated: bool,
    /// The database file
    #[arg(long, env = "RISKAWARE_DATABASE", default_value = "riskaware.db")]
    database: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum WantedForm {
    /// CSV, one row per question shown
    Long,
    /// CSV, one row per participant
    Wide,
    /// One JSON object per question shown
    Ndjson,
    /// A ZIP archive of everything, in the form of the Psych-DS standard
    PsychDs,
    /// Every column of the tables, as CSV
    Codebook,
    /// What each participant is paid beside the fee
    Bonus,
    /// Final fits and the numbers behind every figure, frozen to be cited
    Analysis,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum WantedIds {
    /// A keyed hash
    Hashed,
    /// The id itself, where the study stored it so
    Plain,
}

impl WantedForm {
    /// None for what is no table of the data.
    fn form(self) -> Option<Form> {
        match self {
            Self::Long => Some(Form::LongCsv),
            Self::Wide => Some(Form::WideCsv),
            Self::Ndjson => Some(Form::Ndjson),
            Self::PsychDs => Some(Form::PsychDs),
            Self::Codebook => Some(Form::CodebookCsv),
            Self::Bonus => Some(Form::BonusCsv),
            Self::Analysis => None,
        }
    }

    fn takes_ids(self) -> bool {
        match self {
            Self::Wide | Self::PsychDs | Self::Codebook | Self::Bonus => true,
            Self::Long | Self::Ndjson | Self::Analysis => false,
        }
    }
}

/// Writes the file. What was begun and failed is removed.
///
/// # Errors
/// When the database or the study is missing, the file exists, or writing fails.
pub async fn run(arguments: Arguments) -> anyhow::Result<()> {
    let Arguments {
        study,
        format,
        out,
        ids,
        simulated,
        database,
    } = arguments;
    ensure!(
        ids.is_none() || format.takes_ids(),
        "--ids has no place in this format; allowed: wide, psych-ds, codebook, bonus"
    );
    let population = if simulated {
        Population::Simulated
    } else {
        Population::People
    };
    let store = Store::open_to_read(&database, Clock::start())
        .await
        .with_context(|| format!("opening the database {}", database.display()))?;
    let known = store.studies().await?;
    if known.iter().all(|known| known.id != study) {
        let known: Vec<&str> = known.iter().map(|known| known.id.as_str()).collect();
        bail!(
            "study {study} is not in {}; there are: {}",
            database.display(),
            known.join(", ")
        );
    }
    let ids = match ids {
        None => Ids::LeftOut,
        Some(WantedIds::Hashed) => Ids::Hashed,
        Some(WantedIds::Plain) => Ids::Plain,
    };
    let detail = ids.name().map(|name| format!("ids {name}"));
    let format_name = format.to_possible_value();
    let action = format!(
        "export {}",
        format_name.as_ref().map_or("", |name| name.get_name())
    );
    // Before the first byte is written: whoever reads along may have it all and end this command.
    // A copy that can only be read has no log to write to.
    if let Err(error) = log(&database, &action, &study, detail).await {
        tracing::warn!(%error, "this export does not stand in the log");
    }
    let written = match format.form() {
        Some(form) => {
            let export = Export::open(&store, &study, population, ids).await?;
            tokio::task::spawn_blocking(move || {
                to_file(&out, |file| {
                    export.write(form, file)?;
                    Ok(())
                })
            })
            .await?
        }
        None => {
            let catalogue = Catalogue::stored(&store).await?;
            let analysis = web::analysis_json(&store, &catalogue, population, &study).await?;
            to_file(&out, |file| Ok(file.write_all(&analysis)?))
        }
    };
    store.close().await;
    written
}

async fn log(
    database: &Path,
    action: &str,
    study: &StudyId,
    detail: Option<String>,
) -> anyhow::Result<()> {
    let store = Store::open_beside(database, Clock::start()).await?;
    let recorded = audit::record(&store, action, Some(study), detail).await;
    store.close().await;
    recorded
}

/// Writes a file that must not exist yet, or standard output for `-`; what was begun and failed is removed.
pub(super) fn to_file(
    out: &Path,
    write: impl FnOnce(&mut dyn Write) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    if out == Path::new("-") {
        let mut stdout = BufWriter::with_capacity(1 << 16, std::io::stdout().lock());
        write(&mut stdout)?;
        return stdout.flush().context("writing to standard output");
    }
    let file =
        File::create_new(out).with_context(|| format!("making the file {}", out.display()))?;
    let mut buffered = BufWriter::with_capacity(1 << 16, file);
    let written = write(&mut buffered).and_then(|()| {
        let file = buffered.into_inner().map_err(|error| error.into_error())?;
        Ok(file.sync_all()?)
    });
    if written.is_err() {
        // Half an export looks like a whole one.
        drop(std::fs::remove_file(out));
    }
    written.with_context(|| format!("writing {}", out.display()))
}
