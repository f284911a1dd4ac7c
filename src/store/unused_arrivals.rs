//! Arrivals that started nothing: whoever only looks at a link leaves one, so they are kept for a day and not without end.

use sqlx::sqlite::SqliteConnection;

use super::json;
use crate::study::Timestamp;

/// So many per study: far more than look at a link within a day, and little enough on a disk. Where more come, the oldest
/// make room, so that somebody who asks for thousands keeps nobody out who presses the button within minutes.
pub(super) const KEPT: u32 = 20_000;

/// Removes those from before `before`.
pub(super) async fn forget(
    connection: &mut SqliteConnection,
    before: Timestamp,
) -> Result<u64, sqlx::Error> {
    let deleted = sqlx::query(
        r#"
        delete from arrival
        where run_id is null
        and created_at_ms < ?
        "#,
    )
    .bind(before.0)
    .execute(connection)
    .await?;
    Ok(deleted.rows_affected())
}

/// Removes the oldest ones of each of these studies that are more than `kept`.
pub(super) async fn make_room(
    connection: &mut SqliteConnection,
    studies: &[&str],
    kept: u32,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        r#"
        delete from arrival
        where token_hash in (
            select crowded_out.token_hash
            from json_each(?1) as study
            join arrival as crowded_out on crowded_out.study_id = study.value
            where crowded_out.run_id is null
            and crowded_out.created_at_ms <= (
                -- The newest of those that have to go; none where there are few.
                select created_at_ms
                from arrival
                where study_id = study.value
                and run_id is null
                order by created_at_ms desc
                limit 1 offset ?2
            )
        )
        "#,
    )
    .bind(json(&studies))
    .bind(kept)
    .execute(connection)
    .await?;
    Ok(())
}
