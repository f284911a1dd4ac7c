//! A ZIP archive whose bytes depend on its contents alone, with a manifest of them.
//!
//! The writer only ever appends, so an archive is sent while it is made.

use std::io::{self, Write};

use serde::Serialize;
use sha2::{Digest, Sha256};
use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::ExportError;

/// What is in the archive.
#[derive(Debug, Serialize)]
pub(super) struct Entry {
    path: String,
    /// Rows below the header, for tables.
    rows: Option<u64>,
    bytes: u64,
    sha256: String,
}

/// An archive that is being written.
pub(super) struct Archive<'a> {
    zip: ZipWriter<StreamWriter<&'a mut dyn Write>>,
    entries: Vec<Entry>,
}

impl<'a> Archive<'a> {
    pub(super) fn new(out: &'a mut dyn Write) -> Self {
        Self {
            zip: ZipWriter::new_stream(out),
            entries: Vec::new(),
        }
    }

    /// Adds a table; `write` says how many rows it has.
    pub(super) fn table(
        &mut self,
        path: &str,
        write: impl FnOnce(&mut dyn Write) -> Result<u64, ExportError>,
    ) -> Result<(), ExportError> {
        self.add(path, |out| write(out).map(Some))
    }

    /// Adds a text.
    pub(super) fn text(&mut self, path: &str, text: &str) -> Result<(), ExportError> {
        self.add(path, |out| {
            out.write_all(text.as_bytes())?;
            Ok(None)
        })
    }

    fn add(
        &mut self,
        path: &str,
        write: impl FnOnce(&mut dyn Write) -> Result<Option<u64>, ExportError>,
    ) -> Result<(), ExportError> {
        // The earliest time that the format knows: the moment of the export would change the bytes.
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .last_modified_time(DateTime::default())
            .unix_permissions(0o644);
        self.zip.start_file(path, options)?;
        let mut hashed = Hashed {
            out: &mut self.zip,
            digest: Sha256::new(),
            bytes: 0,
        };
        let rows = write(&mut hashed)?;
        let Hashed { digest, bytes, .. } = hashed;
        self.entries.push(Entry {
            path: path.to_owned(),
            rows,
            bytes,
            sha256: data_encoding::HEXLOWER.encode(&digest.finalize()),
        });
        Ok(())
    }

    /// Ends the archive with a manifest of what was added before. Returns the number of files.
    pub(super) fn finish(mut self, manifest: &str) -> Result<u64, ExportError> {
        #[derive(Serialize)]
        struct Manifest {
            files: Vec<Entry>,
        }
        let listed = Manifest {
            files: std::mem::take(&mut self.entries),
        };
        let count = listed.files.len() as u64 + 1;
        self.text(manifest, &pretty(&listed)?)?;
        self.zip.finish()?;
        Ok(count)
    }
}

/// JSON for people, ending in a line break.
pub(super) fn pretty(value: &impl Serialize) -> Result<String, ExportError> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    Ok(text)
}

struct Hashed<W> {
    out: W,
    digest: Sha256,
    bytes: u64,
}

impl<W: Write> Write for Hashed<W> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let written = self.out.write(buffer)?;
        self.digest.update(&buffer[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
