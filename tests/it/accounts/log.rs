//! The log.

use riskaware::store::Role;
use sqlx::{Connection, sqlite::SqliteConnection};

use crate::app::App;

use super::lab::{Browser, account, log};

#[tokio::test]
async fn the_log_is_only_appended_to() {
    let app = App::start().await;
    account(&app, "anna", Role::Researcher).await;
    Browser::logged_in(&app, "anna").await;
    let mut raw = SqliteConnection::connect(app.store.path().to_str().unwrap())
        .await
        .unwrap();
    for change in ["update audit set actor = 'nobody'", "delete from audit"] {
        let refused = sqlx::query(change).execute(&mut raw).await.unwrap_err();
        assert!(
            refused.to_string().contains("only appended to"),
            "{refused}"
        );
    }
    assert_eq!(log(&app).await.len(), 1);
}
