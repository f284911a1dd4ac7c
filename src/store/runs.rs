//! Arrivals and runs, as the pages of a participant need them.

use std::collections::{BTreeMap, BTreeSet};

use super::import;
use super::load::{self, step_kind, time_factor};
use super::rules::Body;
use super::{Error, Population, RunId, RunState, Store, Token, VersionId, json};
use crate::study::{
    BlockId, ConditionId, DEFAULT_GRACE_MS, Deadline, QuestionId, Reply, StepPlan, StudyId,
    TimeFactor, Timestamp,
};

/// How long the button of a landing page works: a day.
pub(super) const ARRIVAL_LIFE_MS: i64 = 24 * 60 * 60 * 1_000;

/// Somebody who followed a link to a study.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ArrivalView {
    /// The study.
    pub study: StudyId,
    /// The link of the run that it led to, if it did.
    pub link: Option<Token>,
    /// The language of the texts, where the study has several.
    pub language: Option<String>,
    /// A look at the study that is never counted.
    pub is_preview: bool,
}

/// A run as its page needs it.
#[derive(Debug, Clone, PartialEq)]
pub struct RunView {
    /// The run.
    pub run: RunId,
    /// Its study.
    pub study: StudyId,
    /// The version of the study that its texts come from.
    pub version: VersionId,
    /// How far it is.
    pub state: RunState,
    /// Whether this link may withdraw: the run was started on it.
    pub is_owner: bool,
    /// Whether this link shows the completion code: the run was started or finished on it.
    pub shows_code: bool,
    /// Real or simulated.
    pub population: Population,
    /// The language of the texts, where the study has several.
    pub language: Option<String>,
    /// A look at the study that is never counted.
    pub is_preview: bool,
    /// Extra time.
    pub factor: TimeFactor,
    /// When it began.
    pub started_at: Timestamp,
    /// When it was completed, declined or withdrawn.
    pub finished_at: Option<Timestamp>,
    /// The current step: the last one (thanks) in a completed run, none in a withdrawn one.
    pub step: Option<StepView>,
    /// How many steps it has, the last one (thanks) included.
    pub steps: u32,
}

/// A step of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct StepView {
    /// Its place in the run, from 0.
    pub position: u32,
    /// What was drawn; [`Study::step`](crate::study::Study::step) makes the page of it.
    pub plan: StepPlan,
    /// When it was first shown, if it is the current one and was.
    pub shown_at: Option<Timestamp>,
    /// For a timed question that was shown: the last moment at which an answer counts, grace included.
    pub deadline: Option<Timestamp>,
    /// The limit as it holds for this person, extra time included.
    pub limit_ms: Option<u64>,
    /// How often it was answered wrongly so far, for a comprehension check.
    pub attempts: u32,
}

/// Whether all answers of a run that has ended are there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredCount {
    /// Steps that ask or tell something; in a run that ended before its last step, those up to its end.
    pub steps: u32,
    /// Answers stored for them.
    pub answers: u32,
}

impl StoredCount {
    /// Whether each step has its answer.
    pub fn is_complete(self) -> bool {
        self.steps > 0 && self.steps == self.answers
    }

    /// Whether no step was closed.
    pub fn is_empty(self) -> bool {
        self.steps == 0 && self.answers == 0
    }
}

#[derive(sqlx::FromRow)]
struct StepRow {
    kind: String,
    block: String,
    question: Option<String>,
    limit_ms: Option<i64>,
    data: String,
}

#[derive(sqlx::FromRow)]
struct RunRow {
    id: RunId,
    study_id: String,
    version_id: VersionId,
    #[sqlx(try_from = "String")]
    state: RunState,
    is_owner: bool,
    is_finisher: bool,
    is_simulated: bool,
    language: Option<String>,
    is_preview: bool,
    time_factor: f64,
    started_at_ms: i64,
    finished_at_ms: Option<i64>,
    shown_at_ms: Option<i64>,
    deadline_ms: Option<i64>,
    attempts: u32,
    steps: u32,
    position: u32,
    kind: Option<String>,
    block: Option<String>,
    question: Option<String>,
    limit_ms: Option<i64>,
    data: Option<String>,
}

impl Store {
    /// An arrival by the token of its page.
    ///
    /// # Errors
    /// `NotFound` for an unknown one, or one of more than a day ago that led nowhere.
    pub async fn arrival(&self, token: &Token) -> Result<ArrivalView, Error> {
        let row: Option<(String, i64, bool, bool, Option<String>)> = sqlx::query_as(
            r#"
            select study_id, created_at_ms, run_id is not null, is_preview, language
            from arrival
            where token_hash = ?
            "#,
        )
        .bind(token.hash().as_bytes())
        .fetch_optional(&self.pool)
        .await?;
        let (study, created_at_ms, is_started, is_preview, language) =
            row.ok_or(Error::NotFound("arrival"))?;
        if !is_started && self.now().0 - created_at_ms > ARRIVAL_LIFE_MS {
            return Err(Error::NotFound("arrival"));
        }
        let link = is_started.then(|| self.shared.secret.run_token(token));
        Ok(ArrivalView {
            study: study.into(),
            link,
            language,
            is_preview,
        })
    }

    /// A run by its link, as it stands.
    ///
    /// # Errors
    /// `NotFound` for an unknown link.
    pub async fn run(&self, link: &Token) -> Result<RunView, Error> {
        let row: Option<RunRow> = sqlx::query_as(
            r#"
            select
                run.id, run.study_id, run.version_id, run.state, run_token.is_owner, run_token.is_finisher, run.is_simulated,
                run.language, run.is_preview, run.time_factor, run.started_at_ms, run.finished_at_ms, run.shown_at_ms,
                run.deadline_ms, run.attempts, run.position,
                (select count(*) from step where step.run_id = run.id) as steps,
                step.kind, step.block, step.question, step.limit_ms, step.data
            from run_token
            join run on run.id = run_token.run_id
            left join step on step.run_id = run.id and step.position = run.position
            where run_token.token_hash = ?
            "#,
        )
        .bind(link.hash().as_bytes())
        .fetch_optional(&self.pool)
        .await?;
        row.ok_or(Error::NotFound("run"))?.view()
    }

    /// A run by its link, for the page that is about to be sent: the current step is marked as shown. Where it is
    /// timed, its clock has started and that is on disk when this returns; where its time has run out, it is closed,
    /// and the step is the next one.
    ///
    /// # Errors
    /// `NotFound` for an unknown link.
    pub async fn visit(&self, link: &Token) -> Result<RunView, Error> {
        loop {
            let view = self.run(link).await?;
            let Some(step) = view
                .step
                .as_ref()
                .filter(|_| view.state == RunState::Active)
            else {
                return Ok(view);
            };
            let has_run_out = step.deadline.is_some_and(|deadline| self.now() > deadline);
            match (step.limit_ms, step.shown_at) {
                // Another look afterwards, because the step that is current then may be another one. Each turn closes
                // a step or starts its clock, so this ends.
                (Some(_), None) => self.show(view.run, step.position).await?,
                (Some(_), Some(_)) if has_run_out => self.show(view.run, step.position).await?,
                (None, None) => {
                    self.show_later(view.run, step.position);
                    return Ok(view);
                }
                (Some(_) | None, Some(_)) => return Ok(view),
            }
        }
    }

    /// How far a run of a study is, by its number.
    ///
    /// # Errors
    /// `NotFound` for a run that is not one of this study, and for previews.
    pub async fn run_state(
        &self,
        study: &StudyId,
        population: Population,
        run: RunId,
    ) -> Result<RunState, Error> {
        let state: Option<String> = sqlx::query_scalar(
            r#"
            select state
            from run
            where id = ? and study_id = ? and is_simulated = ? and is_preview = 0
            "#,
        )
        .bind(run)
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_optional(&self.pool)
        .await?;
        let state = state.ok_or(Error::NotFound("participant"))?;
        Ok(state
            .parse()
            .map_err(|err| sqlx::Error::Decode(Box::new(err)))?)
    }

    /// What was last answered wrongly at a step that may be tried again; nothing where nothing was.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn last_wrong(&self, run: RunId, position: u32) -> Result<Option<Reply>, Error> {
        let body: Option<String> = sqlx::query_scalar(
            r#"
            select body
            from event
            where run_id = ? and position = ? and verdict = 'wrong'
            order by id desc
            limit 1
            "#,
        )
        .bind(run)
        .bind(position)
        .fetch_optional(&self.pool)
        .await?;
        let Some(body) = body else {
            return Ok(None);
        };
        let body: Body =
            serde_json::from_str(&body).map_err(|error| sqlx::Error::Decode(Box::new(error)))?;
        Ok(Some(body.reply))
    }

    /// A step of a run that is closed or current, to read a form with that was sent for it.
    ///
    /// # Errors
    /// `NotFound` for a step that the run does not have.
    pub async fn step(&self, run: RunId, position: u32) -> Result<StepPlan, Error> {
        let row: Option<StepRow> = sqlx::query_as(
            r#"
            select kind, block, question, limit_ms, data
            from step
            where run_id = ? and position = ?
            "#,
        )
        .bind(run)
        .bind(position)
        .fetch_optional(&self.pool)
        .await?;
        Ok(row.ok_or(Error::NotFound("step"))?.plan()?)
    }

    /// Counts the stored answers of a run, for the page that shows its code.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn stored_count(&self, run: RunId) -> Result<StoredCount, Error> {
        let (steps, answers) = sqlx::query_as(
            r#"
            select
                (
                    select count(*)
                    from run
                    join step on step.run_id = run.id
                    where run.id = ?1
                    and step.kind <> 'thanks'
                    -- what a run that ended early never came to is not missing
                    and (run.state in ('active', 'completed') or step.position < run.position)
                ),
                (select count(*) from answer where run_id = ?1)
            "#,
        )
        .bind(run)
        .fetch_one(&self.pool)
        .await?;
        Ok(StoredCount { steps, answers })
    }

    /// The recruiting parameters, as they are stored, with which somebody last came to a run before it ended. Whoever gave
    /// a task back and accepted it again goes on with the same run under another assignment, and that is the one to name.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn recruiting_parameters(
        &self,
        run: RunId,
    ) -> Result<BTreeMap<String, String>, Error> {
        let found: Option<String> = sqlx::query_scalar(
            r#"
            select arrival.recruiting
            from arrival
            join run on run.id = arrival.run_id
            where arrival.run_id = ?
            and arrival.recruiting is not null
            and arrival.created_at_ms <= ifnull(run.finished_at_ms, arrival.created_at_ms)
            order by arrival.created_at_ms desc
            limit 1
            "#,
        )
        .bind(run)
        .fetch_optional(&self.pool)
        .await?;
        found.map_or_else(
            || Ok(BTreeMap::new()),
            |found| {
                serde_json::from_str(&found).map_err(|err| sqlx::Error::Decode(err.into()).into())
            },
        )
    }

    /// How many people are under way or have completed, by condition, in the order of the conditions' ids.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn places_taken(
        &self,
        study: &StudyId,
        population: Population,
    ) -> Result<BTreeMap<Option<ConditionId>, u64>, Error> {
        let mut connection = self.pool.acquire().await?;
        let studies = BTreeSet::from([(study.clone(), population)]);
        let places = load::places(&mut connection, &studies).await?;
        Ok(places
            .into_iter()
            .map(|(place, taken)| (place.condition, taken))
            .collect())
    }

    /// Whether some run under these versions of a study has a link, or tells whom a platform sent.
    pub(super) async fn is_anybody_known(
        &self,
        study: &StudyId,
        versions: &[VersionId],
        before: Timestamp,
    ) -> Result<bool, Error> {
        Ok(sqlx::query_scalar(
            r#"
            select exists (
                select 1
                from run
                where study_id = ?1
                and version_id in (select value from json_each(?2))
                and (state <> 'active' or started_at_ms < ?3)
                and (
                    (platform is not null and platform <> ?4) or recruiting is not null
                    or exists (select 1 from run_token where run_token.run_id = run.id)
                )
            )
            or exists (
                select 1 from withdrawn_person where version_id in (select value from json_each(?2))
            )
            "#,
        )
        .bind(study.as_str())
        .bind(json(&versions))
        .bind(before.0)
        .bind(import::PLATFORM)
        .fetch_one(&self.pool)
        .await?)
    }

    /// Whether a timed question waits to be closed, or a run to be ended.
    pub(super) async fn is_anything_overdue(&self, now: Timestamp) -> Result<bool, Error> {
        Ok(sqlx::query_scalar(
            r#"
            select exists (select 1 from run where deadline_ms < ? and state = 'active')
            or exists (select 1 from run where expires_at_ms < ? and state = 'active')
            "#,
        )
        .bind(now.0 - super::rules::SWEEP_SLACK_MS)
        .bind(now.0)
        .fetch_one(&self.pool)
        .await?)
    }
}

impl RunRow {
    fn view(self) -> Result<RunView, Error> {
        let factor = time_factor(self.time_factor)?;
        let step = match (self.kind, self.block, self.data) {
            (Some(kind), Some(block), Some(data)) => {
                let row = StepRow {
                    kind,
                    block,
                    question: self.question,
                    limit_ms: self.limit_ms,
                    data,
                };
                let plan = row.plan()?;
                let limit_ms = plan
                    .limit_ms
                    .map(|limit_ms| Deadline::new(limit_ms, factor, DEFAULT_GRACE_MS).limit_ms());
                let (shown_at, deadline) = (
                    self.shown_at_ms.map(Timestamp),
                    self.deadline_ms.map(Timestamp),
                );
                Some(StepView {
                    position: self.position,
                    plan,
                    shown_at,
                    deadline,
                    limit_ms,
                    attempts: self.attempts,
                })
            }
            (None, _, _) | (_, None, _) | (_, _, None) => None,
        };
        Ok(RunView {
            run: self.id,
            study: self.study_id.into(),
            version: self.version_id,
            state: self.state,
            is_owner: self.is_owner,
            shows_code: self.is_owner || self.is_finisher,
            population: Population::from_flag(self.is_simulated),
            language: self.language,
            is_preview: self.is_preview,
            factor,
            started_at: Timestamp(self.started_at_ms),
            finished_at: self.finished_at_ms.map(Timestamp),
            step,
            steps: self.steps,
        })
    }
}

impl StepRow {
    fn plan(self) -> Result<StepPlan, sqlx::Error> {
        Ok(StepPlan {
            kind: step_kind(&self.kind)?,
            block: BlockId::from(self.block),
            question: self.question.map(QuestionId::from),
            limit_ms: self
                .limit_ms
                .and_then(|limit_ms| u64::try_from(limit_ms).ok()),
            data: serde_json::from_str(&self.data)
                .map_err(|err| sqlx::Error::Decode(err.into()))?,
        })
    }
}
