//! The log of who did what, for admins.

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Query, State},
};
use serde::Deserialize;

use super::{
    super::{Error, access::Caller, assets, results::rfc3339},
    bar::{Bar, Who},
};
use crate::store::{AuditRow, Store};

/// Entries on one page.
const PAGE: u32 = 100;

#[derive(Template, WebTemplate)]
#[template(path = "account/log.html")]
pub(super) struct LogPage {
    bar: Bar,
    rows: Vec<Line>,
    /// Where the next page begins.
    older: Option<i64>,
}

struct Line {
    at: String,
    actor: String,
    action: String,
    study: String,
    detail: String,
    outcome: &'static str,
}

impl From<AuditRow> for Line {
    fn from(row: AuditRow) -> Self {
        Self {
            at: rfc3339(row.at),
            actor: row.entry.actor,
            action: row.entry.action,
            study: row
                .entry
                .study
                .map_or_else(String::new, |study| study.to_string()),
            detail: row.entry.detail.unwrap_or_default(),
            outcome: row.entry.outcome.as_str(),
        }
    }
}

#[derive(Deserialize)]
pub(super) struct LogQuery {
    before: Option<i64>,
}

/// GET `/admin/audit`.
pub(super) async fn show(
    State(store): State<Store>,
    Extension(caller): Extension<Caller>,
    Query(query): Query<LogQuery>,
) -> Result<LogPage, Error> {
    let rows = store.audit(query.before, PAGE).await?;
    let is_full = rows.len() == PAGE as usize;
    let older = rows.last().map(|row| row.id).filter(|_| is_full);
    Ok(LogPage {
        bar: Bar::of(&store, &caller).await?,
        rows: rows.into_iter().map(Line::from).collect(),
        older,
    })
}
