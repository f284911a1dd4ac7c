//! Results on standard output.

use std::io::{self, Write};

use anyhow::Context;

/// Writes a finished result.
///
/// # Errors
/// When it cannot be written; a reader that went away has seen enough.
pub(super) fn print(text: &[u8]) -> anyhow::Result<()> {
    match io::stdout().write_all(text) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written.context("cannot write the result"),
    }
}
