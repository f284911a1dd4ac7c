//! A server behind a proxy, its log and its database, for the tests of the guard.

use riskaware::clock::Clock;
use riskaware::store::{AuditOutcome, AuditRow};
use riskaware::web::Settings;
use sqlx::{Connection, sqlite::SqliteConnection};

use crate::app::{App, START};
pub(super) use crate::browser::{Browser, PASSWORD, account, api_token, call, hash, token};

/// A server that believes a proxy on this machine: whoever names an address in a request comes from there.
pub(super) async fn behind_a_proxy() -> App {
    let settings = Settings {
        trusted_proxies: vec!["127.0.0.1".parse().unwrap()],
        ..Settings::default()
    };
    App::configured(Clock::manual(START), App::built_in(), settings).await
}

/// How often the log says that exactly this actor did or tried this.
pub(super) async fn times(app: &App, actor: &str, action: &str, outcome: AuditOutcome) -> usize {
    let is_it = |row: &&AuditRow| {
        row.entry.actor == actor && row.entry.action == action && row.entry.outcome == outcome
    };
    let rows = app.store.audit(None, 10_000).await.unwrap();
    rows.iter().filter(is_it).count()
}

/// Changes the database behind the server's back.
pub(super) async fn execute(app: &App, statement: &'static str) {
    let mut raw = SqliteConnection::connect(app.store.path().to_str().unwrap())
        .await
        .unwrap();
    sqlx::query(statement).execute(&mut raw).await.unwrap();
    raw.close().await.unwrap();
}

pub(super) async fn count(app: &App, question: &'static str) -> i64 {
    let mut raw = SqliteConnection::connect(app.store.path().to_str().unwrap())
        .await
        .unwrap();
    let count = sqlx::query_scalar(question)
        .fetch_one(&mut raw)
        .await
        .unwrap();
    raw.close().await.unwrap();
    count
}
