//! Answers that were given elsewhere, written as if they had been given here: runs, steps, events, answers and counters, so
//! that everything that is checked, counted and fitted finds them.

use std::collections::{BTreeMap, HashMap, VecDeque};

use data_encoding::HEXLOWER;
use sha2::{Digest, Sha256};
use sqlx::sqlite::SqliteConnection;

use super::effects::{CountKey, Effects, NewAnswer, NewEvent, NewRunRow, NewStepRow};
use super::job::{DrawnStep, Job, Rare};
use super::load::next_ids;
use super::rules::{Body, Closed, KeySeen, RunFacts, StepFacts};
use super::{
    Change, Error, EventId, EventKind, Population, ProblemId, RunId, RunState, Store, Submission,
    Verdict, VersionId, json,
};
use crate::study::step::{Assessment, ClientTiming};
use crate::study::{
    BlockId, ConditionId, Reply, StepData, StepKind, StepPlan, StudyId, TimeFactor, Timestamp,
};

/// The platform under which imported people are known.
pub(super) const PLATFORM: &str = "import";

/// Somebody who answered elsewhere.
#[derive(Debug, Clone)]
pub struct ImportedRun {
    /// What the other program called them; only its keyed hash is stored.
    pub participant: String,
    /// Their answers in order.
    pub answers: Vec<ImportedAnswer>,
    /// The condition that their questions belong to, in a study with conditions.
    pub condition: Option<ConditionId>,
    /// Whether the times are those at which things happened. Else nobody knows, and they are that of the import.
    pub has_times: bool,
    /// Whether they finished.
    pub is_completed: bool,
}

/// A choice that was made elsewhere.
#[derive(Debug, Clone)]
pub struct ImportedAnswer {
    /// The question.
    pub step: DrawnStep,
    /// When it was shown, if that is known. A timed question needs it.
    pub shown_at: Option<Timestamp>,
    /// When it was answered.
    pub at: Timestamp,
    /// The choice, or that the time ran out.
    pub reply: Reply,
    /// What was measured.
    pub timing: ClientTiming,
}

/// Everything of one import.
#[derive(Debug)]
pub(super) struct Import {
    study: StudyId,
    version: VersionId,
    source: String,
    people: Vec<(String, Judged)>,
}

/// What the rules make of one run.
#[derive(Debug)]
struct Judged {
    condition: Option<ConditionId>,
    has_times: bool,
    steps: Vec<DrawnStep>,
    started_at: Timestamp,
    facts: RunFacts,
    moments: Vec<Moment>,
}

#[derive(Debug)]
enum Moment {
    Shown(u32, Timestamp),
    Submitted(Box<Sent>),
}

/// A form with what it did, as it is stored.
#[derive(Debug)]
struct Sent {
    key: String,
    body: Body,
    text: String,
    body_hash: String,
    verdict: Verdict,
    closed: Closed,
    at: Timestamp,
}

impl Store {
    /// Stores answers from elsewhere in one transaction: all of them or none. `source` is what tables by source show.
    ///
    /// The rules judge every run before the transaction begins: while it lasts, no server that shares the file can store
    /// an answer, so that nothing is done in it but writing.
    ///
    /// # Errors
    /// `Refused` where somebody was imported before or a rule of runs does not allow an answer, `NotFound` for an unknown study; nothing is stored
    /// then.
    pub async fn import(
        &self,
        study: &StudyId,
        version: VersionId,
        source: &str,
        runs: Vec<ImportedRun>,
    ) -> Result<u64, Error> {
        let secret = &self.shared.secret;
        let people = runs
            .into_iter()
            .map(|run| {
                let key = secret.platform_key(study, PLATFORM, &named(source, &run.participant));
                Ok((key, judge(&run)?))
            })
            .collect::<Result<_, Error>>()?;
        let import = Box::new(Import {
            study: study.clone(),
            version,
            source: source.to_owned(),
            people,
        });
        self.wait_for(|ticket| Job::Rare(Rare::Import(import, ticket)))
            .await
    }

    /// Which of these people were imported before under the same label, those who were erased since among them.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn imported_before<'a>(
        &self,
        study: &StudyId,
        source: &str,
        participants: impl Iterator<Item = &'a str>,
    ) -> Result<Vec<&'a str>, Error> {
        let known: Vec<String> = sqlx::query_scalar(
            r#"
            select platform_key
            from run
            where study_id = ?1 and platform = ?2 and platform_key is not null and is_preview = 0
            union all
            select platform_key
            from withdrawn_person
            where study_id = ?1
            "#,
        )
        .bind(study.as_str())
        .bind(PLATFORM)
        .fetch_all(&self.pool)
        .await?;
        let known: std::collections::HashSet<String> = known.into_iter().collect();
        let secret = &self.shared.secret;
        Ok(participants
            .filter(|participant| {
                known.contains(&secret.platform_key(study, PLATFORM, &named(source, participant)))
            })
            .collect())
    }
}

/// A person by label and name: two labs number their people from 1.
fn named(source: &str, participant: &str) -> String {
    format!("{source}/{participant}")
}

/// Writes all runs, unless somebody was imported before.
pub(super) async fn write(
    connection: &mut SqliteConnection,
    import: &Import,
) -> Result<(Result<u64, Error>, Vec<Change>), sqlx::Error> {
    let known: Vec<String> = sqlx::query_scalar(
        r#"
        select new.value
        from json_each(?1) as new
        where exists (
            select 1
            from run
            where study_id = ?2 and platform = ?3 and platform_key = new.value and is_preview = 0
        )
        -- whoever was erased does not come back by the same file
        or exists (select 1 from withdrawn_person where study_id = ?2 and platform_key = new.value)
        "#,
    )
    .bind(json(
        &import.people.iter().map(|(key, _)| key).collect::<Vec<_>>(),
    ))
    .bind(import.study.as_str())
    .bind(PLATFORM)
    .fetch_all(&mut *connection)
    .await?;
    if !known.is_empty() {
        let refused = format!("{} of these people were imported before", known.len());
        return Ok((Err(Error::Refused(refused)), Vec::new()));
    }
    let next = next_ids(connection).await?;
    begin(connection, import, next.run).await?;
    let problems = problems_of(connection, next.run).await?;
    let changes = answer(connection, import, next.run, next.event, &problems).await?;
    if changes.is_empty() {
        return Ok((Err(Error::NotFound("study")), Vec::new()));
    }
    Ok((Ok(import.people.len() as u64), changes))
}

/// The steps of a run: its questions, an end, and what keeps clocks apart.
fn steps_of(run: &ImportedRun) -> (Vec<DrawnStep>, Vec<Option<&ImportedAnswer>>) {
    let (mut steps, mut answers): (Vec<DrawnStep>, Vec<Option<&ImportedAnswer>>) =
        (Vec::new(), Vec::new());
    for answer in &run.answers {
        let plan = &answer.step.plan;
        // The clock of a timed question starts with the answer to the one before it in its block. Elsewhere it may have
        // started later, so that a page stands between.
        let runs_on = steps.last().is_some_and(|last| {
            last.plan.limit_ms.is_some() && plan.limit_ms.is_some() && last.plan.block == plan.block
        });
        if runs_on {
            steps.push(plain(StepKind::Info));
            answers.push(None);
        }
        steps.push(answer.step.clone());
        answers.push(Some(answer));
    }
    if !run.is_completed {
        // Never answered: the run stays under way.
        steps.push(plain(StepKind::Info));
    }
    steps.push(plain(StepKind::Thanks));
    (steps, answers)
}

fn plain(kind: StepKind) -> DrawnStep {
    let block = match kind {
        StepKind::Thanks => "thanks",
        StepKind::Consent
        | StepKind::Info
        | StepKind::Replays
        | StepKind::Choice
        | StepKind::Form => PLATFORM,
    };
    DrawnStep {
        plan: StepPlan {
            kind,
            block: BlockId::from(block),
            question: None,
            limit_ms: None,
            data: StepData::default(),
        },
        asked: None,
        is_fitted: false,
        is_practice: false,
    }
}

fn judge(run: &ImportedRun) -> Result<Judged, Error> {
    let (steps, answers) = steps_of(run);
    let first = run
        .answers
        .first()
        .ok_or_else(|| Error::Refused("a participant has no answers".to_owned()))?;
    let started_at = first.shown_at.unwrap_or(first.at);
    let mut facts = RunFacts {
        state: RunState::Active,
        position: 0,
        shown_at: None,
        deadline: None,
        attempts: 0,
        expires_at: None,
        ended_at: None,
        factor: TimeFactor::ONE,
        is_preview: false,
        ahead: steps.iter().map(facts_of).collect::<VecDeque<_>>(),
    };
    let mut moments = Vec::new();
    let mut last_at = started_at;
    for (position, answer) in (0..).zip(answers) {
        let (reply, timing, at) = match answer {
            Some(answer) => {
                if let Some(shown_at) = answer.shown_at
                    && facts.show(position, shown_at)
                {
                    moments.push(Moment::Shown(position, shown_at));
                }
                (answer.reply.clone(), answer.timing, answer.at)
            }
            None => (Reply::Continued, ClientTiming::default(), last_at),
        };
        let submission = Submission {
            position,
            key: format!("{PLATFORM} {position}"),
            reply,
            timing,
            consent_version: None,
            assessment: Assessment::Passes,
        };
        let judgement = facts
            .submit(&submission, KeySeen::Never, at)
            .map_err(|refusal| Error::Refused(refusal.to_string()))?;
        let closed = judgement.closed.ok_or_else(|| {
            Error::Refused(format!(
                "the answer at position {position} does not close its question"
            ))
        })?;
        let body = Body::of(&submission);
        let text = json(&body);
        moments.push(Moment::Submitted(Box::new(Sent {
            key: submission.key,
            body,
            body_hash: HEXLOWER.encode(&Sha256::digest(&text)),
            text,
            verdict: judgement.verdict,
            closed,
            at,
        })));
        last_at = at;
    }
    Ok(Judged {
        condition: run.condition.clone(),
        has_times: run.has_times,
        steps,
        started_at,
        facts,
        moments,
    })
}

fn facts_of(step: &DrawnStep) -> StepFacts {
    StepFacts {
        kind: step.plan.kind,
        block: step.plan.block.clone(),
        limit_ms: step.plan.limit_ms,
        // The database gives the number once the problem is stored; until then it only says that there is one.
        problem: step.asked.as_ref().map(|_| ProblemId(0)),
    }
}

async fn begin(
    connection: &mut SqliteConnection,
    import: &Import,
    first_run: i64,
) -> Result<(), sqlx::Error> {
    let mut effects = Effects::default();
    for (id, (key, judged)) in (first_run..).zip(&import.people) {
        effects.runs.push(NewRunRow {
            id: RunId(id),
            study_id: import.study.clone(),
            version_id: import.version,
            platform: Some(PLATFORM.to_owned()),
            platform_key: Some(key.clone()),
            recruiting: None,
            source: Some(import.source.clone()),
            language: None,
            is_simulated: false,
            is_preview: false,
            time_factor: TimeFactor::ONE.get(),
            condition: judged.condition.clone(),
            has_times: judged.has_times,
            expires_at: None,
            program_version: None,
            at: judged.started_at.0,
        });
        for (position, step) in (0..).zip(&judged.steps) {
            if let Some(asked) = &step.asked {
                effects
                    .problems
                    .insert((import.study.clone(), asked.clone()));
            }
            effects.steps.push(NewStepRow {
                run_id: RunId(id),
                position,
                kind: step.plan.kind.as_str(),
                block: step.plan.block.to_string(),
                question: step.plan.question.as_ref().map(ToString::to_string),
                limit_ms: step.plan.limit_ms,
                study_id: import.study.clone(),
                cell: step.asked.as_ref().map(|asked| asked.cell.clone()),
                hash: step.asked.as_ref().map(|asked| asked.hash.clone()),
                is_fitted: step.is_fitted,
                is_practice: step.is_practice,
                data: json(&step.plan.data),
            });
        }
    }
    effects.write(connection, |_| None).await?;
    Ok(())
}

/// The problem of each step that was just stored.
async fn problems_of(
    connection: &mut SqliteConnection,
    first_run: i64,
) -> Result<HashMap<(RunId, u32), ProblemId>, sqlx::Error> {
    let rows: Vec<(RunId, u32, ProblemId)> = sqlx::query_as(
        "select run_id, position, problem_id from step where run_id >= ? and problem_id is not null",
    )
    .bind(first_run)
    .fetch_all(connection)
    .await?;
    Ok(rows
        .into_iter()
        .map(|(run, position, problem)| ((run, position), problem))
        .collect())
}

async fn answer(
    connection: &mut SqliteConnection,
    import: &Import,
    first_run: i64,
    first_event: i64,
    problems: &HashMap<(RunId, u32), ProblemId>,
) -> Result<Vec<Change>, sqlx::Error> {
    let mut effects = Effects::default();
    let mut next_event = first_event;
    let mut event = |effects: &mut Effects, new: NewEvent| {
        let id = EventId(next_event);
        next_event += 1;
        effects.events.push(NewEvent { id, ..new });
        id
    };
    let mut facts = BTreeMap::new();
    for (id, (_, judged)) in (first_run..).map(RunId).zip(&import.people) {
        let total = effects
            .populations
            .entry((import.study.clone(), Population::People))
            .or_default();
        total.started += 1;
        if judged.facts.state == RunState::Completed {
            total.completed += 1;
            effects.completed.push(id);
            effects.ended.push(id);
        }
        effects.touched.insert(id);
        event(
            &mut effects,
            of_server(id, 0, EventKind::Started, judged.started_at),
        );
        for moment in &judged.moments {
            match moment {
                Moment::Shown(position, at) => {
                    event(
                        &mut effects,
                        of_server(id, *position, EventKind::Shown, *at),
                    );
                }
                Moment::Submitted(sent) => {
                    let mut closed = sent.closed.clone();
                    closed.problem = problems.get(&(id, closed.position)).copied();
                    let event = event(
                        &mut effects,
                        NewEvent {
                            key: Some(sent.key.clone()),
                            body_hash: Some(sent.body_hash.clone()),
                            verdict: Some(sent.verdict),
                            body: Some(sent.text.clone()),
                            ..of_server(id, closed.position, EventKind::Submitted, sent.at)
                        },
                    );
                    count(&mut effects, import, &closed, &sent.body.reply);
                    effects
                        .answers
                        .push(NewAnswer::of(event, id, &closed, Some(&sent.body)));
                }
            }
        }
        facts.insert(id, &judged.facts);
    }
    effects
        .write(connection, |run| facts.get(&run).copied())
        .await
}

/// An event without a form.
fn of_server(run: RunId, position: u32, kind: EventKind, at: Timestamp) -> NewEvent {
    NewEvent {
        id: EventId(0),
        run_id: run,
        position,
        kind: kind.as_str(),
        key: None,
        repeat_of: None,
        body_hash: None,
        verdict: None,
        at: at.0,
        body: None,
    }
}

fn count(effects: &mut Effects, import: &Import, closed: &Closed, reply: &Reply) {
    let (Some(problem), true) = (closed.problem, closed.is_counted) else {
        return;
    };
    let action = match reply {
        Reply::Chose { action } => action.to_string(),
        Reply::Agreed
        | Reply::AgreedTo { .. }
        | Reply::Declined
        | Reply::Continued
        | Reply::Watched { .. }
        | Reply::GaveUp
        | Reply::Filled { .. } => String::new(),
    };
    let key = CountKey {
        study: import.study.clone(),
        population: Population::People,
        problem,
        status: closed.status,
        action,
    };
    effects.counts.entry(key).or_default().n += 1;
}
