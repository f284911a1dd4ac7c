//! What commands write to the log of who did what.

use anyhow::Context;

use crate::{
    store::{AuditEntry, AuditOutcome, Store},
    study::StudyId,
};

/// Whom the log names for a command.
pub(super) const ACTOR: &str = "command";

/// Writes that a command on this machine did this.
pub(super) async fn record(
    store: &Store,
    action: &str,
    study: Option<&StudyId>,
    detail: Option<String>,
) -> anyhow::Result<()> {
    let entry = AuditEntry {
        actor: ACTOR.to_owned(),
        action: action.to_owned(),
        study: study.cloned(),
        detail,
        outcome: AuditOutcome::Done,
    };
    store.log(entry).await.context("writing to the log")
}
