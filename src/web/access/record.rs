//! What is written to the log.

use super::{Caller, Error};
use crate::{
    store::{AuditEntry, AuditOutcome, Store},
    study::StudyId,
};

/// What a handler says about what it did or refused, where no entry is written yet: an extension of its response, which the
/// guard writes to the log.
#[derive(Debug, Clone, Default)]
pub(in crate::web) struct Recorded {
    /// Instead of the route's own action: what was refused, where the route has a page of its own or does several things.
    pub(in crate::web) action: Option<String>,
    /// On what; never a secret.
    pub(in crate::web) detail: Option<String>,
}

/// An extension of a response whose change is in the log already, in one transaction with its entry.
#[derive(Debug, Clone, Copy)]
pub(in crate::web) struct Written;

/// What the log says of something that is about to be done, for [`Store::recording`].
pub(in crate::web) fn entry(
    caller: &Caller,
    action: &str,
    study: Option<&StudyId>,
    detail: Option<String>,
) -> AuditEntry {
    AuditEntry {
        actor: caller.name(),
        action: action.to_owned(),
        study: study.cloned(),
        detail,
        outcome: AuditOutcome::Done,
    }
}

/// Writes something to the log that changes nothing else: a look, or a refusal. Where that fails the caller gets the error,
/// and so does whoever asked. Changes are written together with their entry instead, see [`Store::recording`].
pub(in crate::web) async fn record(
    store: &Store,
    caller: &Caller,
    action: &str,
    study: Option<&StudyId>,
    detail: Option<String>,
    outcome: AuditOutcome,
) -> Result<(), Error> {
    let entry = AuditEntry {
        outcome,
        ..entry(caller, action, study, detail)
    };
    Ok(store.log(entry).await?)
}
