//! The end of a run.

use super::{FieldError, Reply};
use crate::study::EndingPage;

/// The last page: thanks, the completion code, and where to go next.
#[derive(Debug, Clone, Copy)]
pub struct ThanksStep<'a> {
    /// What it shows.
    pub completion: &'a EndingPage,
}

impl ThanksStep<'_> {
    pub(super) fn read(self) -> Result<Reply, Vec<FieldError>> {
        Err(vec![FieldError {
            field: "step".to_owned(),
            message: "There is nothing left to answer.".to_owned(),
        }])
    }
}
