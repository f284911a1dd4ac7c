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
    /// Runs that are left out of the analysis, whatever became of them.
    pub excluded: u64,
    /// Completed ones among them.
    pub excluded_completed: u64,
    /// The data version of the last exclusion by hand, or of its undoing.
    pub exclusion_version: i64,
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
    excluded: i64,
    excluded_completed: i64,
    exclusion_version: i64,
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

    /// How far the study is, for the log: `30 had finished, 2 of them left out`.
    pub fn in_words(&self) -> String {
        let (completed, excluded) = (self.completed, self.excluded_completed);
        format!("{completed} had finished, {excluded} of them left out")
    }

    /// Completed runs that are not left out of the analysis.
    pub fn analysed(&self) -> u64 {
        self.completed.saturating_sub(self.excluded_completed)
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
    /// Of everybody, those included who are left out of the analysis.
    pub n_before_exclusions: u64,
    /// Of everybody else, from the moment of the answer.
    pub n_all: u64,
    /// Of those among them who completed their runs.
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

#[derive(sqlx::FromRow)]
struct CellRow {
    id: ProblemId,
    cell: String,
    hash: String,
    #[sqlx(try_from = "String")]
    status: AnswerStatus,
    action: String,
    n_before_exclusions: i64,
    n_all: i64,
    n_completed: i64,
}

impl From<CellRow> for CellCount {
    fn from(row: CellRow) -> Self {
        Self {
            problem: row.id,
            cell: row.cell,
            hash: row.hash,
            status: row.status,
            action: (!row.action.is_empty()).then(|| ActionId::from(row.action)),
            n_before_exclusions: count(row.n_before_exclusions),
            n_all: count(row.n_all),
            n_completed: count(row.n_completed),
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
                started, completed, declined, screened_out, failed_check, timed_out, withdrawn, excluded,
                excluded_completed, exclusion_version, data_version, page_version, erased_version
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
            excluded: count(row.excluded),
            excluded_completed: count(row.excluded_completed),
            exclusion_version: row.exclusion_version,
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
        let rows: Vec<CellRow> = sqlx::query_as(
            r#"
            select
                problem.id, problem.cell, problem.hash, counter.status, counter.action, n_all as n_before_exclusions,
                n_all - excluded_all as n_all, n_completed - excluded_completed as n_completed
            from counter
            join problem on problem.id = counter.problem_id
            where counter.study_id = ? and counter.is_simulated = ?
            -- withdrawals leave zeros behind
            and counter.n_all > 0
            order by problem.id, counter.status, counter.action
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_all(&self.pool)
        .await?;
        Ok(rows.into_iter().map(CellCount::from).collect())
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
                and not exists (select 1 from exclusion where exclusion.run_id = run.id)
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
