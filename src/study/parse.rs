//! From text to a checked study.

use super::{ParseError, Study};

/// Parses a study file.
pub(super) fn study(_file_name: &str, _text: &str) -> Result<Study, ParseError> {
    todo!("parse the study file")
}
