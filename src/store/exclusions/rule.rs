//! The rules of study versions: stored when a version is published, applied when a run ends, checked by the doctor.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use sqlx::sqlite::SqliteConnection;

use super::{Counted, count};
use crate::store::quality::{checks_json, flag_columns};
use crate::store::{FAST_CHOICE_MS, RunId, json};
use crate::study::{ExclusionRule, Flag};

/// A rule as it is stored with a version of a study.
#[derive(Debug, Serialize, Deserialize)]
struct StoredRule {
    flags: Vec<Flag>,
    checks: Vec<Value>,
}

#[derive(sqlx::FromRow)]
struct JudgedRow {
    id: RunId,
    rule: String,
    stored: Option<String>,
    is_excluded: bool,
    fast_choice: bool,
    hidden_page: bool,
    failed_check: bool,
    late_answer: bool,
}

/// What a rule makes of a run that has ended.
pub(in crate::store) struct Judged {
    pub(in crate::store) run: RunId,
    /// The flags for which it is left out, as they are stored; none where there are none.
    pub(in crate::store) flags: Option<String>,
    /// The same as it stands in the database.
    pub(in crate::store) stored: Option<String>,
    /// Whether the run is left out already, for whatever reason.
    is_excluded: bool,
}

/// A rule as it is stored.
pub(in crate::store) fn rule_json(rule: &ExclusionRule) -> String {
    json(&StoredRule {
        flags: rule.flags.clone(),
        checks: checks_json(&rule.checks),
    })
}

/// What the rules of their versions make of these runs, as far as they have ended and have a rule.
async fn judge(
    connection: &mut SqliteConnection,
    runs: &[RunId],
) -> Result<Vec<Judged>, sqlx::Error> {
    if runs.is_empty() {
        return Ok(Vec::new());
    }
    let rows: Vec<JudgedRow> = sqlx::query_as(concat!(
        r#"
        select
            run.id, version.exclusion as rule, exclusion.flags as stored, exclusion.run_id is not null as is_excluded,
        "#,
        flag_columns!("?2", "version.exclusion -> 'checks'"),
        r#"
        from json_each(?1) as asked
        join run on run.id = asked.value
        join study_version as version on version.id = run.version_id
        left join exclusion on exclusion.run_id = run.id
        left join answer on answer.run_id = run.id
        where version.exclusion is not null and run.is_preview = 0 and run.state not in ('active', 'withdrawn')
        group by run.id
        order by run.id
        "#,
    ))
    .bind(json(&runs))
    .bind(FAST_CHOICE_MS)
    .fetch_all(connection)
    .await?;
    rows.into_iter().map(JudgedRow::judged).collect()
}

impl JudgedRow {
    fn judged(self) -> Result<Judged, sqlx::Error> {
        let rule: StoredRule =
            serde_json::from_str(&self.rule).map_err(|err| sqlx::Error::Decode(err.into()))?;
        let flags: Vec<&str> = rule
            .flags
            .iter()
            .filter(|flag| match flag {
                Flag::FastChoice => self.fast_choice,
                Flag::HiddenPage => self.hidden_page,
                Flag::FailedCheck => self.failed_check,
                Flag::LateAnswer => self.late_answer,
                // No study file can name them here.
                Flag::ShortRun | Flag::SeveralArrivals => false,
            })
            .map(|flag| flag.as_str())
            .collect();
        Ok(Judged {
            run: self.id,
            flags: (!flags.is_empty()).then(|| flags.join(" ")),
            stored: self.stored,
            is_excluded: self.is_excluded,
        })
    }
}

/// Leaves out those among the runs that have just ended whom the rules of their versions leave out. Their answers, states
/// and counts are written already.
pub(in crate::store) async fn apply_rules(
    connection: &mut SqliteConnection,
    ended: &[RunId],
) -> Result<(), sqlx::Error> {
    let judged = judge(connection, ended).await?;
    let found: Vec<(RunId, &str)> = judged
        .iter()
        .filter_map(|judged| Some((judged.run, judged.flags.as_deref()?)))
        .collect();
    if found.is_empty() {
        return Ok(());
    }
    sqlx::query(
        r#"
        insert into exclusion (run_id, flags)
        select value ->> 0, value ->> 1
        from json_each(?)
        where true
        on conflict do update set flags = excluded.flags
        "#,
    )
    .bind(json(&found))
    .execute(&mut *connection)
    .await?;
    let newly: Vec<RunId> = judged
        .iter()
        .filter(|judged| judged.flags.is_some() && !judged.is_excluded)
        .map(|judged| judged.run)
        .collect();
    count(connection, &newly, Counted::LeftOut).await
}

/// Those among these runs whose stored flags are not what the rule of their version makes of their answers: what it makes
/// of them, and what is stored.
pub(in crate::store) async fn misjudged(
    connection: &mut SqliteConnection,
    runs: &[RunId],
) -> Result<Vec<Judged>, sqlx::Error> {
    let mut judged = judge(connection, runs).await?;
    let known: BTreeSet<RunId> = judged.iter().map(|judged| judged.run).collect();
    judged.retain(|judged| judged.flags != judged.stored);
    let without_rule: Vec<(RunId, String)> = sqlx::query_as(
        r#"
        select exclusion.run_id, exclusion.flags
        from json_each(?) as asked
        join exclusion on exclusion.run_id = asked.value
        where exclusion.flags is not null
        "#,
    )
    .bind(json(&runs))
    .fetch_all(connection)
    .await?;
    judged.extend(
        without_rule
            .into_iter()
            .filter(|(run, _)| !known.contains(run))
            .map(|(run, stored)| Judged {
                run,
                flags: None,
                stored: Some(stored),
                is_excluded: true,
            }),
    );
    Ok(judged)
}
