//! What is written to the log.

use super::{Caller, Error};
use crate::{
    store::{AuditEntry, AuditOutcome, Store},
    study::StudyId,
};

/// What a handler says about what it did: an extension of its response, which the guard writes to the log.
#[derive(Debug, Clone, Default)]
pub(in crate::web) struct Recorded {
    /// Instead of the route's own action.
    pub(in crate::web) action: Option<String>,
    /// On what; never a secret.
    pub(in crate::web) detail: Option<String>,
}

/// Writes to the log. What cannot be written is not let happen: the caller gets the error.
pub(in crate::web) async fn record(
    store: &Store,
    caller: &Caller,
    action: &str,
    study: Option<&StudyId>,
    detail: Option<String>,
    outcome: AuditOutcome,
) -> Result<(), Error> {
    let entry = AuditEntry {
        actor: caller.name(),
        action: action.to_owned(),
        study: study.cloned(),
        detail,
        outcome,
    };
    Ok(store.log(entry).await?)
}
