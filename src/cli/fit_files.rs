//! Files that a fit leaves behind: draws for other programs, and a report for people.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};

use crate::inference::{ChoiceData, DrawsExport, Fit};
use crate::model::ChoiceModel;
use crate::study::Timestamp;
use crate::web::FitReportPage;

/// Where files go.
#[derive(Debug, clap::Args)]
pub(super) struct FileArguments {
    /// Folder for the draws: MODEL-CHAIN.csv as CmdStan writes them and MODEL.json for ArviZ; it is made if needed
    #[arg(long, value_name = "DIR")]
    draws_dir: Option<PathBuf>,
    /// File for a report that is one page of HTML
    #[arg(long, value_name = "FILE.html")]
    html: Option<PathBuf>,
    /// Overwrite files that exist
    #[arg(long)]
    force: bool,
}

impl FileArguments {
    /// Refuses to begin a long fit that could not be written down at its end.
    pub(super) fn check(&self, models: &[&ChoiceModel], chains: usize) -> anyhow::Result<()> {
        if let Some(folder) = &self.draws_dir {
            fs::create_dir_all(folder)
                .with_context(|| format!("cannot make the folder {}", folder.display()))?;
            for model in models {
                for chain in 0..chains {
                    self.check_file(&chain_file(folder, model.id, chain, chains))?;
                }
                self.check_file(&arviz_file(folder, model.id))?;
            }
        }
        self.html
            .as_deref()
            .map_or(Ok(()), |file| self.check_file(file))
    }

    fn check_file(&self, path: &Path) -> anyhow::Result<()> {
        ensure!(
            self.force || !path.exists(),
            "{} exists already, --force overwrites it",
            path.display()
        );
        Ok(())
    }

    /// Writes the draws of these fits.
    pub(super) fn write_draws(&self, data: &ChoiceData, fits: &[&Fit]) -> anyhow::Result<()> {
        let Some(folder) = &self.draws_dir else {
            return Ok(());
        };
        for fit in fits {
            let export = DrawsExport::new(&fit.summary, data, &fit.draws)
                .with_context(|| format!("cannot write the draws of {}", fit.model.id))?;
            let (id, chains) = (export.model_id(), export.chains());
            for chain in 0..chains {
                let path = chain_file(folder, id, chain, chains);
                self.write(&path, |out| export.write_cmdstan_csv(chain, out))?;
            }
            let path = arviz_file(folder, id);
            self.write(&path, |out| export.write_arviz_json(out))?;
            if export.is_without_predictions() {
                eprintln!(
                    "note: the files of {id} have no predicted probabilities, for there would be too many numbers"
                );
            }
        }
        Ok(())
    }

    /// Writes the report of these fits.
    ///
    /// * `source`: what was fitted, in words.
    pub(super) fn write_report(
        &self,
        source: &str,
        data: &ChoiceData,
        fits: &[Fit],
        show_unconverged: bool,
        at: Timestamp,
    ) -> anyhow::Result<()> {
        let Some(path) = &self.html else {
            return Ok(());
        };
        let page = FitReportPage::new(source, data, fits, show_unconverged, at).html()?;
        self.write(path, |out| out.write_all(page.as_bytes()))
    }

    fn write(
        &self,
        path: &Path,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> anyhow::Result<()> {
        let written = self.open(path).and_then(|file| {
            let mut out = BufWriter::new(file);
            write(&mut out)?;
            out.flush()
        });
        written.with_context(|| format!("cannot write {}", path.display()))
    }

    fn open(&self, path: &Path) -> io::Result<File> {
        if self.force {
            File::create(path)
        } else {
            // Somebody may have made the file while the chains ran.
            OpenOptions::new().write(true).create_new(true).open(path)
        }
    }
}

/// Chain numbers have as many digits as the last, so that readers that sort names keep the order.
fn chain_file(folder: &Path, model: &str, chain: usize, chains: usize) -> PathBuf {
    let digits = chains.to_string().len();
    folder.join(format!("{model}-{:0digits$}.csv", chain + 1))
}

fn arviz_file(folder: &Path, model: &str) -> PathBuf {
    folder.join(format!("{model}.json"))
}
