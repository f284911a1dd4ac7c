//! What people chose, told apart by where they came from.

use super::{AnalysisSet, Error, Population, ProblemId, Store};
use crate::study::{ActionId, StudyId};

/// How often people from one source chose an action of a problem.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceCount {
    /// The label of their link, where it had one.
    pub source: Option<String>,
    /// The problem as it was put before people.
    pub problem: ProblemId,
    /// Its cell's id, or `block:question` outside the design.
    pub cell: String,
    /// The hash of its prospects.
    pub hash: String,
    /// What was chosen.
    pub action: ActionId,
    /// How many chose it.
    pub n: u64,
}

impl Store {
    /// How often each action was chosen by source, over all answers that count. Reads them all.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn choices_by_source(
        &self,
        study: &StudyId,
        population: Population,
        set: AnalysisSet,
    ) -> Result<Vec<SourceCount>, Error> {
        let rows: Vec<(Option<String>, ProblemId, String, String, String, i64)> = sqlx::query_as(
            r#"
            select counted.source, problem.id, problem.cell, problem.hash, counted.action, counted.n
            from (
                select run.source, answer.problem_id, answer.action, count(*) as n
                from run
                cross join answer on answer.run_id = run.id
                where run.study_id = ?1 and run.is_simulated = ?2 and run.is_preview = 0
                and (run.state = 'completed' or not ?3)
                and answer.is_counted = 1 and answer.status = 'answered'
                group by run.source, answer.problem_id, answer.action
            ) as counted
            join problem on problem.id = counted.problem_id
            order by counted.source, problem.id, counted.action
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(set == AnalysisSet::Completed)
        .fetch_all(&self.pool)
        .await?;
        Ok(rows
            .into_iter()
            .map(|(source, problem, cell, hash, action, n)| SourceCount {
                source,
                problem,
                cell,
                hash,
                action: action.into(),
                n: u64::try_from(n).unwrap_or(0),
            })
            .collect())
    }

    /// How many people from each source gave answers that count, those without a label under none.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn people_by_source(
        &self,
        study: &StudyId,
        population: Population,
        set: AnalysisSet,
    ) -> Result<Vec<(Option<String>, u64)>, Error> {
        let rows: Vec<(Option<String>, i64)> = sqlx::query_as(
            r#"
            select run.source, count(*)
            from run
            where run.study_id = ?1 and run.is_simulated = ?2 and run.is_preview = 0
            and (run.state = 'completed' or not ?3)
            and exists (
                select 1 from answer
                where answer.run_id = run.id and answer.is_counted = 1 and answer.status = 'answered'
            )
            group by run.source
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(set == AnalysisSet::Completed)
        .fetch_all(&self.pool)
        .await?;
        Ok(rows
            .into_iter()
            .map(|(source, people)| (source, u64::try_from(people).unwrap_or(0)))
            .collect())
    }
}
