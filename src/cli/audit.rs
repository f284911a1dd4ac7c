//! What commands write to the log of who did what.

use anyhow::Context;

use crate::{
    store::{AuditEntry, AuditOutcome, Store},
    study::StudyId,
};

/// Whom the log names for a command.
pub(super) const ACTOR: &str = "command";

/// What the log says of something that a command on this machine does; for changes, with [`Store::recording`].
pub(super) fn entry(action: &str, study: Option<&StudyId>, detail: Option<String>) -> AuditEntry {
    AuditEntry {
        actor: ACTOR.to_owned(),
        action: action.to_owned(),
        study: study.cloned(),
        detail,
        outcome: AuditOutcome::Done,
    }
}

/// Writes that a command on this machine takes data out: an export or a copy. Before it does: what was read must not stay
/// unsaid. Changes are written together with their entry instead, see [`Store::recording`].
pub(super) async fn record(
    store: &Store,
    action: &str,
    study: Option<&StudyId>,
    detail: Option<String>,
) -> anyhow::Result<()> {
    let entry = entry(action, study, detail);
    store.log(entry).await.context("writing to the log")
}
