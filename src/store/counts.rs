//! Counts of what people chose, read from the counters that are kept with the answers.

use super::{AnalysisSet, AnswerStatus, Error, Population, ProblemId, Store, json};
use crate::study::{ActionId, StudyId};

/// How many people did what in a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Totals {
    /// Runs that began, whatever became of them.
    pub started: u64,
    /// Completed ones.
    pub completed: u64,
    /// Those without consent.
    pub declined: u64,
    /// Those for whom the study turned out not to be meant.
    pub screened_out: u64,
    /// Those that failed a check for good.
    pub failed_check: u64,
    /// Those that were not finished within their time.
    pub timed_out: u64,
    /// Withdrawn ones; each counts only here and as started.
    pub withdrawn: u64,
    /// Moves with every change of the data.
    pub data_version: i64,
    /// Moves with every change of what is shown, new fits included.
    pub page_version: i64,
    /// The data version of the last withdrawal of somebody who was counted; 0 if there was none.
    pub erased_version: i64,
}

#[derive(sqlx::FromRow)]
struct TotalsRow {
    started: i64,
    completed: i64,
    declined: i64,
    screened_out: i64,
    failed_check: i64,
    timed_out: i64,
    withdrawn: i64,
    data_version: i64,
    page_version: i64,
    erased_version: i64,
}

impl Totals {
    /// Runs that are under way or were left.
    pub fn under_way(&self) -> u64 {
        let over = self.completed
            + self.declined
            + self.screened_out
            + self.failed_check
            + self.timed_out
            + self.withdrawn;
        self.started.saturating_sub(over)
    }
}

/// How often one action was chosen, or one question was late or ran out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellCount {
    /// The problem as it was put before people.
    pub problem: ProblemId,
    /// Its cell's id, or `block:question` outside the design.
    pub cell: String,
    /// The hash of its prospects and time limit: equal to that of [`AskedProblem::new`](super::AskedProblem::new) where the study
    /// still asks the same.
    pub hash: String,
    /// Answered, late, timed out.
    pub status: AnswerStatus,
    /// The action, where one was chosen.
    pub action: Option<ActionId>,
    /// Of everybody, from the moment of the answer.
    pub n_all: u64,
    /// Of completed runs.
    pub n_completed: u64,
}

impl CellCount {
    /// The count of one analysis set.
    pub fn n(&self, set: AnalysisSet) -> u64 {
        match set {
            AnalysisSet::All => self.n_all,
            AnalysisSet::Completed => self.n_completed,
        }
    }
}

/// A pattern of choices, and how many people have exactly it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    /// How many people.
    pub weight: u64,
    /// What they chose, by problem.
    pub choices: Vec<(ProblemId, ActionId)>,
}

impl Store {
    /// The totals of a study in one population.
    ///
    /// # Errors
    /// `NotFound` for an unknown study.
    pub async fn totals(&self, study: &StudyId, population: Population) -> Result<Totals, Error> {
        let row: Option<TotalsRow> = sqlx::query_as(
            r#"
            select
                started, completed, declined, screened_out, failed_check, timed_out, withdrawn, data_version,
                page_version, erased_version
            from population
            where study_id = ? and is_simulated = ?
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_optional(&self.pool)
        .await?;
        let row = row.ok_or(Error::NotFound("study"))?;
        Ok(Totals {
            started: count(row.started),
            completed: count(row.completed),
            declined: count(row.declined),
            screened_out: count(row.screened_out),
            failed_check: count(row.failed_check),
            timed_out: count(row.timed_out),
            withdrawn: count(row.withdrawn),
            data_version: row.data_version,
            page_version: row.page_version,
            erased_version: row.erased_version,
        })
    }

    /// All counts of a study in one population, by problem, status and action. Its size depends on the design and not
    /// on the number of people.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn cell_counts(
        &self,
        study: &StudyId,
        population: Population,
    ) -> Result<Vec<CellCount>, Error> {
        let rows: Vec<(ProblemId, String, String, String, String, i64, i64)> = sqlx::query_as(
            r#"
            select problem.id, problem.cell, problem.hash, counter.status, counter.action, n_all, n_completed
            from counter
            join problem on problem.id = counter.problem_id
            where counter.study_id = ? and counter.is_simulated = ?
            -- withdrawals leave zeros behind
            and n_all > 0
            order by problem.id, counter.status, counter.action
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter()
            .map(
                |(problem, cell, hash, status, action, n_all, n_completed)| {
                    Ok(CellCount {
                        problem,
                        cell,
                        hash,
                        status: status
                            .parse()
                            .map_err(|err| sqlx::Error::Decode(Box::new(err)))?,
                        action: (!action.is_empty()).then(|| ActionId::from(action)),
                        n_all: count(n_all),
                        n_completed: count(n_completed),
                    })
                },
            )
            .collect()
    }

    /// The distinct patterns of what people chose in the given problems. Reads every answer to them: for the
    /// bootstrap, not for each refit.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn patterns(
        &self,
        study: &StudyId,
        population: Population,
        set: AnalysisSet,
        problems: &[ProblemId],
    ) -> Result<Vec<Pattern>, Error> {
        let rows: Vec<(String, i64)> = sqlx::query_as(
            r#"
            select choices, count(*)
            from (
                select json_group_array(json_array(answer.problem_id, answer.action) order by answer.problem_id) as choices
                from run
                join answer on answer.run_id = run.id
                where run.study_id = ?1 and run.is_simulated = ?2
                and (run.state = 'completed' or not ?3)
                and answer.is_counted = 1 and answer.status = 'answered'
                and answer.problem_id in (select value from json_each(?4))
                group by run.id
            )
            group by choices
            order by count(*) desc, choices
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(set == AnalysisSet::Completed)
        .bind(json(&problems))
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter()
            .map(|(choices, weight)| {
                let choices: Vec<(i64, String)> = serde_json::from_str(&choices)
                    .map_err(|err| sqlx::Error::Decode(err.into()))?;
                let choices = choices
                    .into_iter()
                    .map(|(problem, action)| (ProblemId(problem), action.into()))
                    .collect();
                Ok(Pattern {
                    weight: count(weight),
                    choices,
                })
            })
            .collect()
    }
}

/// A count as the database checks it: never below zero.
fn count(stored: i64) -> u64 {
    u64::try_from(stored).unwrap_or(0)
}
