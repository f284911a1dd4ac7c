//! Participants one by one, with everything that they answered: for wide exports and bonus payments.

use std::collections::BTreeMap;

use super::{AnswerStatus, Error, Moment, Population, RunId, RunState, VersionId, VersionNumber};
use crate::study::{ActionId, BlockId, QuestionId, ReplayId, StudyId, Timestamp};

/// One run as an export has it.
#[derive(Debug, Clone, PartialEq)]
pub struct ParticipantRow {
    /// The participant's number.
    pub run: RunId,
    /// The version of the study file.
    pub version: VersionId,
    /// SHA-256 of that file.
    pub study_version_hash: String,
    /// The program under which the run was taken; none where that is not known, or it was taken elsewhere.
    pub program_version: Option<String>,
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
    /// The last step that was shown: how far the person came. None where nothing was, and of whoever withdrew.
    pub last_position: Option<u32>,
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
    /// Why they are left out of the analysis, if they are: flags of the study's rule, and a reason that somebody gave.
    pub excluded: Option<String>,
}

/// A step of any kind that was shown.
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
    /// What became of the step; none if it is not closed: it is on the person's screen, or was when they left.
    pub status: Option<AnswerStatus>,
    /// Milliseconds on the server's clock.
    pub server_ms: Option<u64>,
    /// The response time that the page measured.
    pub client_rt_ms: Option<u64>,
    /// The replays in the order in which they stood on the page, where the step shows some.
    pub replays: Vec<ReplayId>,
    /// What was answered where it was no choice, as JSON: the fields of a form, what was agreed to, or how replays were watched.
    pub value: Option<String>,
}

#[derive(sqlx::FromRow)]
struct StoredParticipant {
    id: RunId,
    version_id: VersionId,
    study_version_hash: String,
    program_version: Option<String>,
    version_number: VersionNumber,
    #[sqlx(try_from = "String")]
    state: RunState,
    condition: Option<String>,
    source: Option<String>,
    language: Option<String>,
    time_factor: f64,
    started_at_ms: Option<i64>,
    finished_at_ms: Option<i64>,
    last_position: Option<u32>,
    platform: Option<String>,
    platform_key: Option<String>,
    recruiting: Option<String>,
    bonus: Option<f64>,
    excluded: Option<String>,
}

#[derive(sqlx::FromRow)]
struct StoredStepAnswer {
    run_id: RunId,
    block: String,
    question: Option<String>,
    action: Option<String>,
    status: Option<String>,
    server_ms: Option<i64>,
    client_rt_ms: Option<i64>,
    replays: Option<String>,
    value: Option<String>,
}

impl Moment {
    /// The next participants of a study after `after` up to the run `last`, at most `limit`. Previews are left out; whoever withdrew is there
    /// with nothing but a number and times.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn participants(
        &mut self,
        study: &StudyId,
        population: Population,
        after: RunId,
        last: RunId,
        limit: u32,
    ) -> Result<Vec<ParticipantRow>, Error> {
        let rows: Vec<StoredParticipant> = sqlx::query_as(
            r#"
            select
                run.id, run.version_id, study_version.number as version_number,
                study_version.hash as study_version_hash, run.program_version, run.state, run.condition, run.source,
                run.language, run.time_factor,
                iif(run.has_times, run.started_at_ms, null) as started_at_ms,
                iif(run.has_times, run.finished_at_ms, null) as finished_at_ms,
                case
                    when run.state = 'withdrawn' then null
                    when run.shown_at_ms is not null then run.position
                    when run.position > 0 then run.position - 1
                end as last_position,
                run.platform, run.platform_key, run.recruiting,
                bonus.amount as bonus,
                concat_ws('; ', exclusion.flags, 'by hand: ' || exclusion.reason) as excluded
            from run
            join study_version on study_version.id = run.version_id
            left join bonus on bonus.run_id = run.id
            left join exclusion on exclusion.run_id = run.id
            where run.study_id = ? and run.is_simulated = ? and run.is_preview = 0
            and run.id > ? and run.id <= ?
            order by run.id
            limit ?
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(after)
        .bind(last)
        .bind(limit)
        .fetch_all(self.connection())
        .await?;
        rows.into_iter().map(StoredParticipant::row).collect()
    }

    /// All steps that were shown to the participants from `first` to `last`, by participant, then in the order of the run.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn step_answers(
        &mut self,
        study: &StudyId,
        population: Population,
        first: RunId,
        last: RunId,
    ) -> Result<Vec<StepAnswer>, Error> {
        let rows: Vec<StoredStepAnswer> = sqlx::query_as(
            r#"
            select
                run.id as run_id, step.block, step.question, answer.action, answer.status, answer.server_ms,
                answer.client_rt_ms, step.data -> '$.replays' as replays, answer.value
            from run
            -- cross join: runs in order first, so that nothing is sorted
            cross join step on step.run_id = run.id
            left join answer on answer.run_id = step.run_id and answer.position = step.position
            where run.study_id = ? and run.is_simulated = ? and run.is_preview = 0
            and run.id between ? and ?
            and (
                answer.event_id is not null
                or (step.position = run.position and run.shown_at_ms is not null)
            )
            order by run.id, step.position
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(first)
        .bind(last)
        .fetch_all(self.connection())
        .await?;
        rows.into_iter().map(StoredStepAnswer::answer).collect()
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
            study_version_hash: self.study_version_hash,
            program_version: self.program_version,
            version_number: self.version_number,
            state: self.state,
            condition: self.condition,
            source: self.source,
            language: self.language,
            time_factor: self.time_factor,
            started_at: self.started_at_ms.map(Timestamp),
            finished_at: self.finished_at_ms.map(Timestamp),
            last_position: self.last_position,
            platform: self.platform,
            platform_key: self.platform_key,
            recruiting,
            bonus: self.bonus,
            excluded: self.excluded.filter(|reason| !reason.is_empty()),
        })
    }
}

impl StoredStepAnswer {
    fn answer(self) -> Result<StepAnswer, Error> {
        let millis = |stored: Option<i64>| stored.and_then(|stored| u64::try_from(stored).ok());
        let replays = self
            .replays
            .as_deref()
            .map(serde_json::from_str)
            .transpose();
        let status = self.status.map(|status| status.parse()).transpose();
        Ok(StepAnswer {
            run: self.run_id,
            block: self.block.into(),
            question: self.question.map(QuestionId::from),
            action: self.action.map(ActionId::from),
            status: status.map_err(|err| sqlx::Error::Decode(Box::new(err)))?,
            server_ms: millis(self.server_ms),
            client_rt_ms: millis(self.client_rt_ms),
            replays: replays
                .map_err(|err| sqlx::Error::Decode(err.into()))?
                .unwrap_or_default(),
            value: self.value,
        })
    }
}
