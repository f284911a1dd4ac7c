//! Answers one by one, for exports and summaries of forms.

use std::collections::BTreeMap;

use super::load::time_factor;
use super::{
    AnalysisSet, AnswerStatus, Error, EventId, EventKind, Moment, Population, RunId, RunState,
    Store, Verdict, VersionId, VersionNumber,
};
use crate::study::{
    ActionId, BlockId, DEFAULT_GRACE_MS, Deadline, FactorId, LevelId, QuestionId, StudyId,
    Timestamp,
};

/// Where an answer stands in an export: by run, then by step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct AnswerKey {
    /// The run.
    pub run: RunId,
    /// The step.
    pub position: u32,
}

impl AnswerKey {
    /// Before the first answer.
    pub const START: Self = Self {
        run: RunId(0),
        position: 0,
    };
}

/// A question that was shown, as the long CSV has it. A question that is on somebody's screen is not among them until it is
/// closed, or until the run has ended without an answer to it.
#[derive(Debug, Clone, PartialEq)]
pub struct AnswerRow {
    /// The participant's number and the position.
    pub key: AnswerKey,
    /// The version of the study file.
    pub version: VersionId,
    /// SHA-256 of that file.
    pub study_version_hash: String,
    /// The program under which the run was taken; none where that is not known, or it was taken elsewhere.
    pub program_version: Option<String>,
    /// Its number.
    pub version_number: VersionNumber,
    /// The state of the run now.
    pub run_state: RunState,
    /// The block.
    pub block: BlockId,
    /// The question in it.
    pub question: Option<QuestionId>,
    /// The cell's id, or `block:question` outside the design; none for practice questions.
    pub problem: Option<String>,
    /// The levels that the question has; not all factors have one outside the design.
    pub levels: BTreeMap<FactorId, LevelId>,
    /// The action, where one was chosen.
    pub action: Option<ActionId>,
    /// What became of the question.
    pub status: AnswerStatus,
    /// Whether it is in the counts.
    pub is_counted: bool,
    /// Whether the study fits this question.
    pub is_fitted: bool,
    /// Whether it was for practice.
    pub is_practice: bool,
    /// When the question was first shown.
    pub shown_at: Option<Timestamp>,
    /// When it was answered or closed; none for a question that the run ended without, and where an import did not tell.
    pub answered_at: Option<Timestamp>,
    /// Milliseconds between the two on the server's clock.
    pub server_ms: Option<u64>,
    /// The response time that the page measured.
    pub client_rt_ms: Option<u64>,
    /// The limit as it held for this person.
    pub limit_ms: Option<u64>,
    /// What the choice was made with.
    pub input: Option<String>,
    /// Milliseconds during which the page was hidden.
    pub hidden_ms: Option<u64>,
    /// What time limits were multiplied by for this person.
    pub time_factor: f64,
    /// The levels of the between-subjects factors, joined by `/`; none in a study without such factors.
    pub condition: Option<String>,
    /// Where the person came from.
    pub source: Option<String>,
    /// Why the person is left out of the analysis, if they are.
    pub excluded: Option<String>,
    /// Real or simulated.
    pub population: Population,
}

/// How many people gave one answer to a field of a form.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FormAnswer {
    /// The answer: a whole number, a text, or an option's id; none where the field was left empty.
    pub value: Option<String>,
    /// How many.
    pub n: u64,
}

/// Something that happened to a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventRow {
    /// Its id, in the order in which events were judged.
    pub id: EventId,
    /// The run.
    pub run: RunId,
    /// The step.
    pub position: u32,
    /// What it is about.
    pub kind: EventKind,
    /// What the rules made of it, for forms.
    pub verdict: Option<Verdict>,
    /// The first event with the same form key, for repetitions.
    pub repeat_of: Option<EventId>,
    /// When.
    pub at: Timestamp,
    /// What was sent, as JSON.
    pub body: Option<String>,
}

#[derive(sqlx::FromRow)]
struct ExportRow {
    run_id: RunId,
    position: u32,
    version_id: VersionId,
    study_version_hash: String,
    program_version: Option<String>,
    version_number: VersionNumber,
    #[sqlx(try_from = "String")]
    run_state: RunState,
    block: String,
    question: Option<String>,
    cell: Option<String>,
    levels: Option<String>,
    action: Option<String>,
    #[sqlx(try_from = "String")]
    status: AnswerStatus,
    is_counted: bool,
    is_fitted: bool,
    is_practice: bool,
    shown_at_ms: Option<i64>,
    answered_at_ms: Option<i64>,
    server_ms: Option<i64>,
    client_rt_ms: Option<i64>,
    limit_ms: Option<i64>,
    step_limit_ms: Option<i64>,
    time_factor: f64,
    condition: Option<String>,
    input: Option<String>,
    hidden_ms: Option<i64>,
    source: Option<String>,
    excluded: Option<String>,
}

#[derive(sqlx::FromRow)]
struct StoredEvent {
    id: EventId,
    run_id: RunId,
    position: u32,
    #[sqlx(try_from = "String")]
    kind: EventKind,
    verdict: Option<String>,
    repeat_of: Option<EventId>,
    at_ms: i64,
    body: Option<String>,
}

impl Moment {
    /// The next questions of a study after `after` up to the run `last`, at most `limit`: an export pages through them, so that no read
    /// transaction stays open while a client is slow. Previews are left out.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn answers(
        &mut self,
        study: &StudyId,
        population: Population,
        after: AnswerKey,
        last: RunId,
        limit: u32,
    ) -> Result<Vec<AnswerRow>, Error> {
        let rows: Vec<ExportRow> = sqlx::query_as(
            r#"
            select
                run.id as run_id, step.position, run.version_id, study_version.number as version_number,
                study_version.hash as study_version_hash, run.program_version, run.state as run_state, step.block, step.question,
                problem.cell, step.data -> '$.levels' as levels, answer.action, ifnull(answer.status, 'skipped') as status,
                ifnull(answer.is_counted, 0) as is_counted, step.is_fitted, step.is_practice,
                case
                    when answer.event_id is null then run.shown_at_ms
                    when run.has_times then answer.shown_at_ms
                end as shown_at_ms,
                iif(run.has_times, answer.answered_at_ms, null) as answered_at_ms, answer.server_ms, answer.client_rt_ms, answer.limit_ms,
                step.limit_ms as step_limit_ms, run.time_factor, run.condition, answer.input, answer.hidden_ms, run.source,
                concat_ws('; ', exclusion.flags, 'by hand: ' || exclusion.reason) as excluded
            from run
            -- cross join: runs in order first, so that a page stops after its rows and sorts nothing
            cross join study_version on study_version.id = run.version_id
            cross join step on step.run_id = run.id
            left join answer on answer.run_id = step.run_id and answer.position = step.position
            left join problem on problem.id = step.problem_id
            left join exclusion on exclusion.run_id = run.id
            where run.study_id = ?1 and run.is_simulated = ?2 and run.is_preview = 0
            and run.id between ?3 and ?6
            and (run.id > ?3 or step.position > ?4)
            and step.kind = 'choice'
            and (
                answer.event_id is not null
                or (step.position = run.position and run.shown_at_ms is not null and run.state <> 'active')
            )
            order by run.id, step.position
            limit ?5
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(after.run)
        // The start lies before the first step of a run that no database has.
        .bind(after.position)
        .bind(limit)
        .bind(last)
        .fetch_all(self.connection())
        .await?;
        rows.into_iter().map(|row| row.answer(population)).collect()
    }
}

impl Store {
    /// A page as [`Moment::answers`] reads it, up to the newest run.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn answers(
        &self,
        study: &StudyId,
        population: Population,
        after: AnswerKey,
        limit: u32,
    ) -> Result<Vec<AnswerRow>, Error> {
        let mut moment = self.moment().await?;
        moment
            .answers(study, population, after, RunId(i64::MAX), limit)
            .await
    }

    /// How often each answer was given to a field of a form, by the people of an analysis set; with those who are left out
    /// of it where `with_excluded` says so.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn form_answers(
        &self,
        study: &StudyId,
        population: Population,
        set: AnalysisSet,
        block: &BlockId,
        field: &str,
        with_excluded: bool,
    ) -> Result<Vec<FormAnswer>, Error> {
        let rows: Vec<(Option<String>, i64)> = sqlx::query_as(
            r#"
            select cast(answer.value ->> ?5 as text) as given, count(*)
            from run
            join step on step.run_id = run.id and step.kind = 'form' and step.block = ?4
            join answer on answer.run_id = step.run_id and answer.position = step.position
            where run.study_id = ?1 and run.is_simulated = ?2 and run.is_preview = 0
            and (run.state = 'completed' or not ?3)
            and (?6 or not exists (select 1 from exclusion where exclusion.run_id = run.id))
            group by given
            order by count(*) desc, given
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(set == AnalysisSet::Completed)
        .bind(block.as_str())
        .bind(field)
        .bind(with_excluded)
        .fetch_all(&self.pool)
        .await?;
        Ok(rows
            .into_iter()
            .map(|(value, n)| FormAnswer {
                value,
                n: u64::try_from(n).unwrap_or(0),
            })
            .collect())
    }

    /// Everything that happened to a run.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn events(&self, run: RunId) -> Result<Vec<EventRow>, Error> {
        let rows: Vec<StoredEvent> = sqlx::query_as(
            r#"
            select id, run_id, position, kind, verdict, repeat_of, at_ms, body
            from event
            where run_id = ?
            order by id
            "#,
        )
        .bind(run)
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter().map(StoredEvent::event).collect()
    }
}

impl ExportRow {
    fn answer(self, population: Population) -> Result<AnswerRow, Error> {
        let millis = |stored: Option<i64>| stored.and_then(|stored| u64::try_from(stored).ok());
        let factor = time_factor(self.time_factor)?;
        let limit_ms = millis(self.limit_ms).or_else(|| {
            let limit_ms = millis(self.step_limit_ms)?;
            Some(Deadline::new(limit_ms, factor, DEFAULT_GRACE_MS).limit_ms())
        });
        let levels = self.levels.as_deref().map(serde_json::from_str).transpose();
        Ok(AnswerRow {
            key: AnswerKey {
                run: self.run_id,
                position: self.position,
            },
            version: self.version_id,
            study_version_hash: self.study_version_hash,
            program_version: self.program_version,
            version_number: self.version_number,
            run_state: self.run_state,
            block: self.block.into(),
            question: self.question.map(QuestionId::from),
            problem: self.cell,
            levels: levels
                .map_err(|err| sqlx::Error::Decode(err.into()))?
                .unwrap_or_default(),
            action: self.action.map(ActionId::from),
            status: self.status,
            is_counted: self.is_counted,
            is_fitted: self.is_fitted,
            is_practice: self.is_practice,
            shown_at: self.shown_at_ms.map(Timestamp),
            answered_at: self.answered_at_ms.map(Timestamp),
            server_ms: millis(self.server_ms),
            client_rt_ms: millis(self.client_rt_ms),
            limit_ms,
            input: self.input,
            hidden_ms: millis(self.hidden_ms),
            time_factor: self.time_factor,
            condition: self.condition,
            source: self.source,
            excluded: self.excluded.filter(|reason| !reason.is_empty()),
            population,
        })
    }
}

impl StoredEvent {
    fn event(self) -> Result<EventRow, Error> {
        let verdict = self
            .verdict
            .map(|verdict| {
                verdict
                    .parse()
                    .map_err(|err| sqlx::Error::Decode(Box::new(err)))
            })
            .transpose()?;
        Ok(EventRow {
            id: self.id,
            run: self.run_id,
            position: self.position,
            kind: self.kind,
            verdict,
            repeat_of: self.repeat_of,
            at: Timestamp(self.at_ms),
            body: self.body,
        })
    }
}
