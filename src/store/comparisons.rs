//! How the models of a study compare: the newest comparison of each plan.

use sqlx::sqlite::SqliteConnection;

use super::job::{Job, Rare};
use super::studies::turn_page;
use super::{Change, Error, Population, Store, VersionId, json};
use crate::study::{PlanId, StudyId, Timestamp};

/// A comparison to be stored in place of the one before.
#[derive(Debug, Clone, PartialEq)]
pub struct NewComparison {
    /// The study.
    pub study: StudyId,
    /// Of whom.
    pub population: Population,
    /// The plan whose fits are compared.
    pub plan: PlanId,
    /// The hash of everything that the result depends on.
    pub input_hash: String,
    /// The version of the data that it read.
    pub data_version: i64,
    /// The version of the study file that it followed.
    pub version: VersionId,
    /// The seed with which it can be repeated.
    pub seed: u64,
    /// The result as JSON, or why there is none.
    pub outcome: Result<String, String>,
    /// Processor time in milliseconds.
    pub cpu_ms: u64,
}

/// A stored comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The plan whose fits are compared.
    pub plan: PlanId,
    /// The hash of everything that the result depends on.
    pub input_hash: String,
    /// The version of the data that it read.
    pub data_version: i64,
    /// The version of the study file that it followed.
    pub version: VersionId,
    /// The seed with which it can be repeated.
    pub seed: u64,
    /// The program that made it.
    pub program_version: String,
    /// The result as JSON, or why there is none.
    pub outcome: Result<String, String>,
    /// When it was stored.
    pub created_at: Timestamp,
    /// Processor time in milliseconds.
    pub cpu_ms: u64,
}

#[derive(sqlx::FromRow)]
struct ComparisonRow {
    plan: String,
    input_hash: String,
    data_version: i64,
    version_id: VersionId,
    seed: i64,
    program_version: String,
    result: Option<String>,
    message: Option<String>,
    created_at_ms: i64,
    cpu_ms: i64,
}

impl From<ComparisonRow> for Comparison {
    fn from(row: ComparisonRow) -> Self {
        Self {
            plan: row.plan.into(),
            input_hash: row.input_hash,
            data_version: row.data_version,
            version: row.version_id,
            seed: row.seed.cast_unsigned(),
            program_version: row.program_version,
            outcome: row.result.ok_or(row.message.unwrap_or_default()),
            created_at: Timestamp(row.created_at_ms),
            cpu_ms: u64::try_from(row.cpu_ms).unwrap_or(0),
        }
    }
}

impl Store {
    /// Stores a comparison in place of the plan's earlier one.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn save_comparison(&self, comparison: NewComparison) -> Result<(), Error> {
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::SaveComparison(Box::new(comparison), now, ticket)))
            .await
    }

    /// The newest comparison of each plan, whatever came out, but those with input hashes that are `known`: each is some
    /// tens of kilobytes.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn comparisons(
        &self,
        study: &StudyId,
        population: Population,
        known: &[&str],
    ) -> Result<Vec<Comparison>, Error> {
        let rows: Vec<ComparisonRow> = sqlx::query_as(
            r#"
            select plan, input_hash, data_version, version_id, seed, program_version, result, message, created_at_ms, cpu_ms
            from comparison
            where study_id = ? and is_simulated = ?
            and input_hash not in (select value from json_each(?))
            order by plan
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(json(&known))
        .fetch_all(&self.pool)
        .await?;
        Ok(rows.into_iter().map(Comparison::from).collect())
    }
}

/// Stores a comparison in place of the plan's earlier one; nothing where it counted somebody who has withdrawn since.
pub(super) async fn save(
    connection: &mut SqliteConnection,
    comparison: &NewComparison,
    at: Timestamp,
) -> Result<Vec<Change>, sqlx::Error> {
    sqlx::query(
        r#"
        insert or replace into comparison (
            study_id, is_simulated, plan, input_hash, data_version, version_id, seed, program_version, result, message,
            created_at_ms, cpu_ms
        )
        select ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12
        where not exists (
            select 1
            from population
            where study_id = ?1 and is_simulated = ?2 and erased_version > ?5
        )
        "#,
    )
    .bind(comparison.study.as_str())
    .bind(comparison.population.is_simulated())
    .bind(comparison.plan.as_str())
    .bind(&comparison.input_hash)
    .bind(comparison.data_version)
    .bind(comparison.version)
    // All 64 bits are kept; above 2^63 the database shows the seed as a negative number.
    .bind(comparison.seed.cast_signed())
    .bind(env!("CARGO_PKG_VERSION"))
    .bind(comparison.outcome.as_ref().ok())
    .bind(comparison.outcome.as_ref().err())
    .bind(at.0)
    .bind(i64::try_from(comparison.cpu_ms).unwrap_or(i64::MAX))
    .execute(&mut *connection)
    .await?;
    turn_page(connection, &comparison.study, comparison.population).await
}
