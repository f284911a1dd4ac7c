//! How the evidence grew while people took part: what the first so many of them chose, what followed from it, and when
//! a rule for stopping was reached.

use sqlx::sqlite::SqliteConnection;

use super::job::{Job, Rare};
use super::studies::turn_page;
use super::{Change, Error, Population, ProblemId, Store};
use crate::study::{ActionId, StudyId, Timestamp};

/// How often the people between two looks chose an action.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LookCount {
    /// At which look they count for the first time: 0 for the first one.
    pub look: u64,
    /// The problem.
    pub problem: ProblemId,
    /// Its cell's id, or `block:question` outside the design.
    pub cell: String,
    /// The hash of its prospects, as in [`CellCount`](super::CellCount).
    pub hash: String,
    /// The action.
    pub action: ActionId,
    /// How many chose it.
    pub n: u64,
}

/// What the first people who finished say.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// How many people.
    pub n: u64,
    /// The hash of everything that the result depends on.
    pub input_hash: String,
    /// The result as JSON.
    pub result: String,
}

/// That a rule for stopping was reached.
#[derive(Debug, Clone, PartialEq)]
pub struct Stopping {
    /// The hash of the rule.
    pub rule_hash: String,
    /// The rule as JSON.
    pub rule: String,
    /// How many people had finished.
    pub n: u64,
    /// What was compared with the bound.
    pub value: f64,
    /// When that was stored.
    pub reached_at: Timestamp,
}

/// Checkpoints to be stored, and the rule if it was reached for the first time.
#[derive(Debug, Clone, PartialEq)]
pub struct NewCheckpoints {
    /// The study.
    pub study: StudyId,
    /// Of whom.
    pub population: Population,
    /// The data version of the answers that they are about, or an earlier one.
    pub data_version: i64,
    /// Each replaces the earlier one of as many people.
    pub checkpoints: Vec<Checkpoint>,
    /// Kept only where this rule was not reached before. Its moment is that of the commit.
    pub reached: Option<Reached>,
}

/// A rule that was found to be reached.
#[derive(Debug, Clone, PartialEq)]
pub struct Reached {
    /// The hash of the rule.
    pub rule_hash: String,
    /// The rule as JSON.
    pub rule: String,
    /// How many people had finished.
    pub n: u64,
    /// What was compared with the bound.
    pub value: f64,
}

impl Store {
    /// Stores checkpoints, and that a rule for stopping was reached. Says whether it was reached for the first time.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn save_checkpoints(&self, new: NewCheckpoints) -> Result<bool, Error> {
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::SaveCheckpoints(Box::new(new), now, ticket)))
            .await
    }

    /// What the people who finished chose, in the order in which they finished: of the first `minimum` for look 0, of the
    /// next `every` for look 1, and so on; the last look may be of fewer people than that. Previews are left out.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn look_counts(
        &self,
        study: &StudyId,
        population: Population,
        minimum: u64,
        every: u64,
    ) -> Result<Vec<LookCount>, Error> {
        let rows: Vec<(i64, ProblemId, String, String, String, i64)> = sqlx::query_as(
            r#"
            select finisher.look, problem.id, problem.cell, problem.hash, answer.action, count(*)
            from (
                select
                    id,
                    -- the first ones together are look 0; each look after it begins with the person after the last.
                    -- In the order of the events that completed the runs, which is the order of their commits: by the
                    -- time of arrival somebody could still come before people who were looked at already.
                    max(0, (row_number() over (order by completed_by) - ?3 + ?4 - 1) / ?4) as look
                from (
                    select id, (select max(event_id) from answer where answer.run_id = run.id) as completed_by
                    from run
                    where study_id = ?1 and is_simulated = ?2 and is_preview = 0 and state = 'completed'
                )
            ) as finisher
            join answer on answer.run_id = finisher.id
            join problem on problem.id = answer.problem_id
            where answer.is_counted = 1 and answer.status = 'answered'
            group by finisher.look, problem.id, answer.action
            order by finisher.look, problem.id, answer.action
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(i64::try_from(minimum).unwrap_or(i64::MAX))
        .bind(i64::try_from(every.max(1)).unwrap_or(i64::MAX))
        .fetch_all(&self.pool)
        .await?;
        Ok(rows
            .into_iter()
            .map(|(look, problem, cell, hash, action, n)| LookCount {
                look: u64::try_from(look).unwrap_or(0),
                problem,
                cell,
                hash,
                action: action.into(),
                n: u64::try_from(n).unwrap_or(0),
            })
            .collect())
    }

    /// All checkpoints of a study, by the number of people.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn checkpoints(
        &self,
        study: &StudyId,
        population: Population,
    ) -> Result<Vec<Checkpoint>, Error> {
        let rows: Vec<(i64, String, String)> = sqlx::query_as(
            r#"
            select n, input_hash, result
            from checkpoint
            where study_id = ? and is_simulated = ?
            order by n
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_all(&self.pool)
        .await?;
        Ok(rows
            .into_iter()
            .map(|(n, input_hash, result)| Checkpoint {
                n: u64::try_from(n).unwrap_or(0),
                input_hash,
                result,
            })
            .collect())
    }

    /// When this rule was reached for the first time, if it was.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn stopping(
        &self,
        study: &StudyId,
        population: Population,
        rule_hash: &str,
    ) -> Result<Option<Stopping>, Error> {
        let row: Option<(String, i64, f64, i64)> = sqlx::query_as(
            r#"
            select rule, n, value, reached_at_ms
            from stopping
            where study_id = ? and is_simulated = ? and rule_hash = ?
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(rule_hash)
        .fetch_optional(&self.pool)
        .await?;
        Ok(row.map(|(rule, n, value, reached_at_ms)| Stopping {
            rule_hash: rule_hash.to_owned(),
            rule,
            n: u64::try_from(n).unwrap_or(0),
            value,
            reached_at: Timestamp(reached_at_ms),
        }))
    }
}

/// Stores checkpoints, and that a rule was reached; nothing where they counted somebody who has withdrawn since. Says whether
/// the rule was new.
pub(super) async fn save(
    connection: &mut SqliteConnection,
    new: &NewCheckpoints,
    at: Timestamp,
) -> Result<(bool, Vec<Change>), sqlx::Error> {
    for checkpoint in &new.checkpoints {
        sqlx::query(
            r#"
            insert or replace into checkpoint (
                study_id, is_simulated, n, input_hash, program_version, result, created_at_ms
            )
            select ?1, ?2, ?3, ?4, ?5, ?6, ?7
            where not exists (
                select 1
                from population
                where study_id = ?1 and is_simulated = ?2 and erased_version > ?8
            )
            "#,
        )
        .bind(new.study.as_str())
        .bind(new.population.is_simulated())
        .bind(i64::try_from(checkpoint.n).unwrap_or(i64::MAX))
        .bind(&checkpoint.input_hash)
        .bind(env!("CARGO_PKG_VERSION"))
        .bind(&checkpoint.result)
        .bind(at.0)
        .bind(new.data_version)
        .execute(&mut *connection)
        .await?;
    }
    let mut is_first = false;
    if let Some(reached) = &new.reached {
        let stored = sqlx::query(
            r#"
            insert into stopping (study_id, is_simulated, rule_hash, rule, n, value, reached_at_ms)
            select ?1, ?2, ?3, ?4, ?5, ?6, ?7
            where not exists (
                select 1
                from population
                where study_id = ?1 and is_simulated = ?2 and erased_version > ?8
            )
            -- what was announced stays as it was announced
            on conflict do nothing
            "#,
        )
        .bind(new.study.as_str())
        .bind(new.population.is_simulated())
        .bind(&reached.rule_hash)
        .bind(&reached.rule)
        .bind(i64::try_from(reached.n).unwrap_or(i64::MAX))
        .bind(reached.value)
        .bind(at.0)
        .bind(new.data_version)
        .execute(&mut *connection)
        .await?;
        is_first = stored.rows_affected() > 0;
    }
    Ok((
        is_first,
        turn_page(connection, &new.study, new.population).await?,
    ))
}
