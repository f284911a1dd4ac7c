//! What the tests of accounts ask for, and what they read of the log.

use reqwest::{Response, header};
use riskaware::store::{AuditOutcome, AuditRow};

use crate::app::App;
pub(super) use crate::browser::{Browser, PASSWORD, account, api_token, call, token};

pub(super) const ANSWERS: &str = "/api/v1/studies/driving/answers.csv";
pub(super) const SUMMARY: &str = "/api/v1/studies/driving/summary";
pub(super) const EXPORT: &str = "/results/driving/data/answers.csv";

pub(super) fn location(response: &Response) -> &str {
    response.headers()[header::LOCATION].to_str().unwrap()
}

/// The log, the oldest entry first.
pub(super) async fn log(app: &App) -> Vec<AuditRow> {
    let mut rows = app.store.audit(None, 1000).await.unwrap();
    rows.reverse();
    rows
}

/// Whether the log has an entry: who, what, outcome.
#[track_caller]
pub(super) fn has(rows: &[AuditRow], actor: &str, action: &str, outcome: AuditOutcome) {
    let found = rows.iter().any(|row| {
        row.entry.actor.contains(actor)
            && row.entry.action == action
            && row.entry.outcome == outcome
    });
    assert!(found, "{actor}: {action} ({outcome}) is not in {rows:#?}");
}
