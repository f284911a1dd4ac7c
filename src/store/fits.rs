//! Fits of the models: the newest of each part, the shown ones, and their history.

use sqlx::sqlite::SqliteConnection;

use super::job::{Job, Rare};
use super::studies::turn_page;
use super::{Change, Error, FitId, FitState, Population, Store, VersionId, VersionNumber, json};
use crate::study::{PartId, PlanId, StudyId, Timestamp};

/// How many fits of one model and part are kept: each is some tens of kilobytes, and can be computed again.
const KEPT: i64 = 20;

/// What is fitted.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FitKey {
    /// The plan.
    pub plan: PlanId,
    /// The part of the plan.
    pub part: PartId,
    /// The model's id, such as `risk_aware`.
    pub model: String,
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub enum FitOutcome {
    /// The chains agree; the result as JSON.
    Converged(String),
    /// They do not yet; the result as JSON.
    Unconverged(String),
    /// It broke off, for this reason.
    Failed(String),
}

/// A fit to be stored.
#[derive(Debug, Clone, PartialEq)]
pub struct NewFit {
    /// The study.
    pub study: StudyId,
    /// Of whom.
    pub population: Population,
    /// What was fitted.
    pub key: FitKey,
    /// The hash of everything that the result depends on.
    pub input_hash: String,
    /// The version of the data that it read.
    pub data_version: i64,
    /// The version of the study file that it followed.
    pub version: VersionId,
    /// The seed with which it can be repeated.
    pub seed: u64,
    /// How many fits of this input there were, this one included.
    pub attempts: u32,
    /// Whether it started from an earlier fit, so that it depends on the way there.
    pub is_provisional: bool,
    /// What came out.
    pub outcome: FitOutcome,
    /// The kept draws, in a form of the caller's; none where it failed.
    pub draws: Option<Vec<u8>>,
    /// Processor time in milliseconds.
    pub cpu_ms: u64,
}

/// A stored fit, without its draws.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Its id.
    pub id: FitId,
    /// What was fitted.
    pub key: FitKey,
    /// The hash of everything that the result depends on.
    pub input_hash: String,
    /// The version of the data that it read.
    pub data_version: i64,
    /// The version of the study file that it followed.
    pub version: VersionId,
    /// Its number.
    pub version_number: VersionNumber,
    /// The seed with which it can be repeated.
    pub seed: u64,
    /// The program that made it.
    pub program_version: String,
    /// How many fits of this input there were, this one included.
    pub attempts: u32,
    /// Whether it started from an earlier fit, so that it depends on the way there.
    pub is_provisional: bool,
    /// What came out.
    pub outcome: FitOutcome,
    /// When it was stored.
    pub created_at: Timestamp,
    /// Processor time in milliseconds.
    pub cpu_ms: u64,
}

impl FitOutcome {
    /// The name of the state under which it is stored.
    pub fn state(&self) -> FitState {
        match self {
            Self::Converged(_) => FitState::Converged,
            Self::Unconverged(_) => FitState::Unconverged,
            Self::Failed(_) => FitState::Failed,
        }
    }

    fn columns(&self) -> (Option<&str>, Option<&str>) {
        match self {
            Self::Converged(result) | Self::Unconverged(result) => (Some(result), None),
            Self::Failed(message) => (None, Some(message)),
        }
    }
}

#[derive(sqlx::FromRow)]
struct FitRow {
    id: FitId,
    plan: String,
    part: String,
    model: String,
    input_hash: String,
    data_version: i64,
    version_id: VersionId,
    version_number: VersionNumber,
    seed: i64,
    program_version: String,
    #[sqlx(try_from = "String")]
    state: FitState,
    attempts: u32,
    is_provisional: bool,
    result: Option<String>,
    message: Option<String>,
    created_at_ms: i64,
    cpu_ms: i64,
}

impl From<FitRow> for Fit {
    fn from(row: FitRow) -> Self {
        let outcome = match row.state {
            FitState::Converged => FitOutcome::Converged(row.result.unwrap_or_default()),
            FitState::Unconverged => FitOutcome::Unconverged(row.result.unwrap_or_default()),
            FitState::Failed => FitOutcome::Failed(row.message.unwrap_or_default()),
        };
        Self {
            id: row.id,
            key: FitKey {
                plan: row.plan.into(),
                part: row.part.into(),
                model: row.model,
            },
            input_hash: row.input_hash,
            data_version: row.data_version,
            version: row.version_id,
            version_number: row.version_number,
            seed: row.seed.cast_unsigned(),
            program_version: row.program_version,
            attempts: row.attempts,
            is_provisional: row.is_provisional,
            outcome,
            created_at: Timestamp(row.created_at_ms),
            cpu_ms: u64::try_from(row.cpu_ms).unwrap_or(0),
        }
    }
}

impl Store {
    /// Stores fits together, in one commit; those of one study change its page once. Left out are fits that counted
    /// somebody who has withdrawn since.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn save_fits(&self, fits: Vec<NewFit>) -> Result<Vec<FitId>, Error> {
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::SaveFits(fits, now, ticket)))
            .await
    }

    /// The ids of the newest fit of each model and part, and those of them that are not `known`: a page that moved on
    /// needs only the new ones.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn new_fits(
        &self,
        study: &StudyId,
        population: Population,
        known: &[FitId],
    ) -> Result<(Vec<FitId>, Vec<Fit>), Error> {
        let ids: Vec<FitId> = sqlx::query_scalar(
            r#"
            select max(id)
            from fit
            where study_id = ? and is_simulated = ?
            group by plan, part, model
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_all(&self.pool)
        .await?;
        let new: Vec<FitId> = ids
            .iter()
            .copied()
            .filter(|id| !known.contains(id))
            .collect();
        let rows: Vec<FitRow> = sqlx::query_as(
            r#"
            select
                id, plan, part, model, input_hash, data_version, version_id,
                (select number from study_version where study_version.id = version_id) as version_number,
                seed, program_version, state, attempts, is_provisional, result, message, created_at_ms, cpu_ms
            from fit
            where id in (select value from json_each(?))
            "#,
        )
        .bind(json(&new))
        .fetch_all(&self.pool)
        .await?;
        Ok((ids, rows.into_iter().map(Fit::from).collect()))
    }

    /// The fits of a study before `before` (none: from the newest on), the newest first, at most `limit`.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn fit_history(
        &self,
        study: &StudyId,
        population: Population,
        before: Option<FitId>,
        limit: u32,
    ) -> Result<Vec<Fit>, Error> {
        let rows: Vec<FitRow> = sqlx::query_as(
            r#"
            select
                id, plan, part, model, input_hash, data_version, version_id,
                (select number from study_version where study_version.id = version_id) as version_number,
                seed, program_version, state, attempts, is_provisional, result, message, created_at_ms, cpu_ms
            from fit
            where study_id = ?1 and is_simulated = ?2
            and (?3 is null or id < ?3)
            order by id desc
            limit ?4
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(before)
        .bind(limit)
        .fetch_all(&self.pool)
        .await?;
        Ok(rows.into_iter().map(Fit::from).collect())
    }

    /// One fit of a study.
    ///
    /// # Errors
    /// `NotFound` for an unknown one, or one of another study or population.
    pub async fn fit(
        &self,
        study: &StudyId,
        population: Population,
        id: FitId,
    ) -> Result<Fit, Error> {
        let row: Option<FitRow> = sqlx::query_as(
            r#"
            select
                id, plan, part, model, input_hash, data_version, version_id,
                (select number from study_version where study_version.id = version_id) as version_number,
                seed, program_version, state, attempts, is_provisional, result, message, created_at_ms, cpu_ms
            from fit
            where id = ? and study_id = ? and is_simulated = ?
            "#,
        )
        .bind(id)
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_optional(&self.pool)
        .await?;
        row.map(Fit::from).ok_or(Error::NotFound("fit"))
    }

    /// The draws of a fit, in the form in which they were given.
    ///
    /// # Errors
    /// `NotFound` for an unknown fit, or one without draws.
    pub async fn fit_draws(&self, id: FitId) -> Result<Vec<u8>, Error> {
        let draws: Option<Option<Vec<u8>>> =
            sqlx::query_scalar("select draws from fit where id = ?")
                .bind(id)
                .fetch_optional(&self.pool)
                .await?;
        draws.flatten().ok_or(Error::NotFound("draws"))
    }
}

/// Stores fits of one study together: what is shown changes once.
pub(super) async fn save(
    connection: &mut SqliteConnection,
    fits: &[NewFit],
    at: Timestamp,
) -> Result<(Vec<FitId>, Vec<Change>), sqlx::Error> {
    let mut ids = Vec::with_capacity(fits.len());
    for fit in fits {
        ids.extend(save_one(connection, fit, at).await?);
    }
    let mut changes = Vec::new();
    for of_study in
        fits.chunk_by(|one, next| (&one.study, one.population) == (&next.study, next.population))
    {
        let NewFit {
            study, population, ..
        } = &of_study[0];
        changes.extend(turn_page(connection, study, *population).await?);
    }
    Ok((ids, changes))
}

/// Stores a fit and drops the oldest ones of its history. Nothing is stored of a fit that counted somebody who has
/// withdrawn since.
async fn save_one(
    connection: &mut SqliteConnection,
    fit: &NewFit,
    at: Timestamp,
) -> Result<Option<FitId>, sqlx::Error> {
    let (result, message) = fit.outcome.columns();
    let id: Option<FitId> = sqlx::query_scalar(
        r#"
        insert into fit (
            study_id, is_simulated, plan, part, model, input_hash, data_version, version_id, seed, program_version,
            state, attempts, is_provisional, result, draws, message, created_at_ms, cpu_ms
        )
        select ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?18
        where not exists (
            select 1
            from population
            where study_id = ?1 and is_simulated = ?2 and erased_version > ?7
        )
        returning id
        "#,
    )
    .bind(fit.study.as_str())
    .bind(fit.population.is_simulated())
    .bind(fit.key.plan.as_str())
    .bind(fit.key.part.as_str())
    .bind(&fit.key.model)
    .bind(&fit.input_hash)
    .bind(fit.data_version)
    .bind(fit.version)
    // All 64 bits are kept; above 2^63 the database shows the seed as a negative number.
    .bind(fit.seed.cast_signed())
    .bind(env!("CARGO_PKG_VERSION"))
    .bind(fit.outcome.state().as_str())
    .bind(fit.attempts)
    .bind(fit.is_provisional)
    .bind(result)
    .bind(fit.draws.as_deref())
    .bind(message)
    .bind(at.0)
    .bind(i64::try_from(fit.cpu_ms).unwrap_or(i64::MAX))
    .fetch_optional(&mut *connection)
    .await?;
    let Some(id) = id else {
        return Ok(None);
    };
    sqlx::query(
        r#"
        delete from fit
        where study_id = ?1 and is_simulated = ?2 and plan = ?3 and part = ?4 and model = ?5
        -- a provisional fit is gone with the next one: nobody can repeat it
        and is_provisional = 1 and id <> ?6
        "#,
    )
    .bind(fit.study.as_str())
    .bind(fit.population.is_simulated())
    .bind(fit.key.plan.as_str())
    .bind(fit.key.part.as_str())
    .bind(&fit.key.model)
    .bind(id)
    .execute(&mut *connection)
    .await?;
    sqlx::query(
        r#"
        delete from fit
        where study_id = ?1 and is_simulated = ?2 and plan = ?3 and part = ?4 and model = ?5
        and id <= (
            select id
            from fit
            where study_id = ?1 and is_simulated = ?2 and plan = ?3 and part = ?4 and model = ?5
            order by id desc
            limit 1 offset ?6
        )
        -- the last final one that converged stays, however many came after it
        and id <> ifnull((
            select max(id)
            from fit
            where study_id = ?1 and is_simulated = ?2 and plan = ?3 and part = ?4 and model = ?5
            and state = 'converged' and is_provisional = 0
        ), 0)
        "#,
    )
    .bind(fit.study.as_str())
    .bind(fit.population.is_simulated())
    .bind(fit.key.plan.as_str())
    .bind(fit.key.part.as_str())
    .bind(&fit.key.model)
    .bind(KEPT)
    .execute(&mut *connection)
    .await?;
    sqlx::query(
        r#"
        update fit
        set draws = null
        where study_id = ?1 and is_simulated = ?2 and plan = ?3 and part = ?4 and model = ?5
        and draws is not null
        -- draws are large: only those of the last final fit that converged are kept
        and id < (
            select max(id)
            from fit
            where study_id = ?1 and is_simulated = ?2 and plan = ?3 and part = ?4 and model = ?5
            and state = 'converged' and is_provisional = 0
        )
        "#,
    )
    .bind(fit.study.as_str())
    .bind(fit.population.is_simulated())
    .bind(fit.key.plan.as_str())
    .bind(fit.key.part.as_str())
    .bind(&fit.key.model)
    .execute(&mut *connection)
    .await?;
    Ok(Some(id))
}
