//! Participants one by one, with everything that they answered: for wide exports and bonus payments.

use std::collections::BTreeMap;

use super::{AnswerStatus, Error, Population, RunId, RunState, Store, VersionId, VersionNumber};
use crate::study::{ActionId, BlockId, QuestionId, StudyId, Timestamp};

/// One run as an export has it.
#[derive(Debug, Clone, PartialEq)]
pub struct ParticipantRow {
    /// The participant's number.
    pub run: RunId,
    /// The version of the study file.
    pub version: VersionId,
    /// Its number.
    pub version_number: VersionNumber,
    /// How far the run is.
    pub state: RunState,
    /// The levels of the between-subjects factors, joined by `/`; none in a study without such factors.
    pub condition: Option<String>,
    /// Where the person came from, as the link said.
    pub source: Option<String>,
    /// The language of the texts, where the study has several.
    pub language: Option<String>,
    /// Extra time for timed questions: 1 is the usual time.
    pub time_factor: f64,
    /// When the run began; none where an import did not tell.
    pub started_at: Option<Timestamp>,
    /// When it ended, if it has and that is known.
    pub finished_at: Option<Timestamp>,
    /// The recruiting platform, if the link named one.
    pub platform: Option<String>,
    /// The keyed hash of the person's id there.
    pub platform_key: Option<String>,
    /// The link's recruiting parameters as the study stores them: plain or hashed.
    pub recruiting: BTreeMap<String, String>,
    /// What the person is paid beside the fee.
    pub bonus: Option<f64>,
}

/// A closed step of any kind.
#[derive(Debug, Clone, PartialEq)]
pub struct StepAnswer {
    /// The participant's number.
    pub run: RunId,
    /// The block.
    pub block: BlockId,
    /// The question, for choices.
    pub question: Option<QuestionId>,
    /// The action, where one was chosen.
    pub action: Option<ActionId>,
    /// What became of the step.
    pub status: AnswerStatus,
    /// Milliseconds on the server's clock.
    pub server_ms: Option<u64>,
    /// The response time that the page measured.
    pub client_rt_ms: Option<u64>,
    /// What was answered where it was no choice, as JSON: the fields of a form, or what was agreed to.
    pub value: Option<String>,
}

#[derive(sqlx::FromRow)]
struct StoredParticipant {
    id: RunId,
    version_id: VersionId,
    version_number: VersionNumber,
    #[sqlx(try_from = "String")]
    state: RunState,
    condition: Option<String>,
    source: Option<String>,
    language: Option<String>,
    time_factor: f64,
    started_at_ms: Option<i64>,
    finished_at_ms: Option<i64>,
    platform: Option<String>,
    platform_key: Option<String>,
    recruiting: Option<String>,
    bonus: Option<f64>,
}

#[derive(sqlx::FromRow)]
struct StoredStepAnswer {
    run_id: RunId,
    block: String,
    question: Option<String>,
    action: Option<String>,
    #[sqlx(try_from = "String")]
    status: AnswerStatus,
    server_ms: Option<i64>,
    client_rt_ms: Option<i64>,
    value: Option<String>,
}

impl Store {
    /// The next participants of a study after `after`, at most `limit`. Previews are left out; whoever withdrew is there
    /// with nothing but a number and times.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn participants(
        &self,
        study: &StudyId,
        population: Population,
        after: RunId,
        limit: u32,
    ) -> Result<Vec<ParticipantRow>, Error> {
        let rows: Vec<StoredParticipant> = sqlx::query_as(
            r#"
            select
                run.id, run.version_id, study_version.number as version_number, run.state, run.condition, run.source,
                run.language, run.time_factor, run.platform, run.platform_key, run.recruiting,
                iif(run.has_times, run.started_at_ms, null) as started_at_ms,
                iif(run.has_times, run.finished_at_ms, null) as finished_at_ms,
                bonus.amount as bonus
            from run
            join study_version on study_version.id = run.version_id
            left join bonus on bonus.run_id = run.id
            where run.study_id = ? and run.is_simulated = ? and run.is_preview = 0
            and run.id > ?
            order by run.id
            limit ?
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(after)
        .bind(limit)
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter().map(StoredParticipant::row).collect()
    }

    /// All closed steps of the participants from `first` to `last`, by participant, then in the order of the run.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn step_answers(
        &self,
        study: &StudyId,
        population: Population,
        first: RunId,
        last: RunId,
    ) -> Result<Vec<StepAnswer>, Error> {
        let rows: Vec<StoredStepAnswer> = sqlx::query_as(
            r#"
            select
                answer.run_id, step.block, step.question, answer.action, answer.status, answer.server_ms,
                answer.client_rt_ms, answer.value
            from run
            -- cross join: runs in order first, so that nothing is sorted
            cross join answer on answer.run_id = run.id
            cross join step on step.run_id = answer.run_id and step.position = answer.position
            where run.study_id = ? and run.is_simulated = ? and run.is_preview = 0
            and run.id between ? and ?
            order by run.id, answer.position
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(first)
        .bind(last)
        .fetch_all(&self.pool)
        .await?;
        Ok(rows.into_iter().map(StepAnswer::from).collect())
    }
}

impl StoredParticipant {
    fn row(self) -> Result<ParticipantRow, Error> {
        let recruiting = match &self.recruiting {
            Some(text) => {
                serde_json::from_str(text).map_err(|err| sqlx::Error::Decode(err.into()))?
            }
            None => BTreeMap::new(),
        };
        Ok(ParticipantRow {
            run: self.id,
            version: self.version_id,
            version_number: self.version_number,
            state: self.state,
            condition: self.condition,
            source: self.source,
            language: self.language,
            time_factor: self.time_factor,
            started_at: self.started_at_ms.map(Timestamp),
            finished_at: self.finished_at_ms.map(Timestamp),
            platform: self.platform,
            platform_key: self.platform_key,
            recruiting,
            bonus: self.bonus,
        })
    }
}

impl From<StoredStepAnswer> for StepAnswer {
    fn from(row: StoredStepAnswer) -> Self {
        let millis = |stored: Option<i64>| stored.and_then(|stored| u64::try_from(stored).ok());
        Self {
            run: row.run_id,
            block: row.block.into(),
            question: row.question.map(QuestionId::from),
            action: row.action.map(ActionId::from),
            status: row.status,
            server_ms: millis(row.server_ms),
            client_rt_ms: millis(row.client_rt_ms),
            value: row.value,
        }
    }
}
