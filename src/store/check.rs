//! Whether answers and counters are what the events make of them: for the doctor, and for tests.
//!
//! The check replays each run's events through the same rules that judged them first.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use sqlx::sqlite::SqliteConnection;

use super::effects::NewAnswer;
use super::load::{step_kind, time_factor};
use super::rules::{Body, EndedBody, KeySeen, RunFacts, StepFacts};
use super::{
    Error, EventId, EventKind, ProblemId, RunId, RunState, Store, Submission, Verdict, exclusions,
};
use crate::study::{BlockId, Timestamp};

/// How many runs are replayed in one read transaction.
const RUNS_AT_ONCE: i64 = 200;

/// Something that does not agree with the events.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Disagreement {
    /// Where.
    pub place: String,
    /// What the events say.
    pub expected: String,
    /// What is stored.
    pub found: String,
}

type CountRow = (String, bool, ProblemId, String, String, i64, i64, i64, i64);
type TotalRow = (String, bool, i64, i64, i64, i64, i64, i64, i64, i64, i64);

#[derive(sqlx::FromRow)]
struct EventToReplay {
    id: EventId,
    position: u32,
    #[sqlx(try_from = "String")]
    kind: EventKind,
    verdict: Option<String>,
    at_ms: i64,
    body: Option<String>,
}

impl Store {
    /// Compares every answer with what replaying its run's events gives, and whom the studies' rules leave out with what
    /// the rules make of the answers.
    ///
    /// # Errors
    /// When the database fails, or holds an event that cannot be read.
    pub async fn check_answers(&self) -> Result<Vec<Disagreement>, Error> {
        let mut disagreements = Vec::new();
        let mut after = RunId(0);
        loop {
            let mut transaction = self.pool.begin().await?;
            let runs: Vec<(RunId, f64, bool, String)> = sqlx::query_as(
                "select id, time_factor, is_preview, state from run where id > ? order by id limit ?",
            )
            .bind(after)
            .bind(RUNS_AT_ONCE)
            .fetch_all(&mut *transaction)
            .await?;
            let Some((last, ..)) = runs.last() else {
                return Ok(disagreements);
            };
            after = *last;
            let ids: Vec<RunId> = runs.iter().map(|(run, ..)| *run).collect();
            let misjudged = exclusions::misjudged(&mut transaction, &ids).await?;
            disagreements.extend(misjudged.into_iter().map(|judged| Disagreement {
                place: format!("exclusion of run {} by the study's rule", judged.run),
                expected: format!("{:?}", judged.flags),
                found: format!("{:?}", judged.stored),
            }));
            for (run, factor, is_preview, state) in runs {
                let facts = at_start(&mut transaction, run, factor, is_preview).await?;
                let (state_then, expected) = rebuild_answers(&mut transaction, run, facts).await?;
                let found = stored_answers(&mut transaction, run).await?;
                if state != RunState::Withdrawn.as_str() && state != state_then.as_str() {
                    disagreements.push(Disagreement {
                        place: format!("state of run {run}"),
                        expected: state_then.to_string(),
                        found: state,
                    });
                }
                if expected != found {
                    disagreements.push(Disagreement {
                        place: format!("answers of run {run}"),
                        expected: format!("{expected:?}"),
                        found: format!("{found:?}"),
                    });
                }
            }
        }
    }

    /// Compares every counter with a count of the answers and runs.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn check_counters(&self) -> Result<Vec<Disagreement>, Error> {
        let mut transaction = self.pool.begin().await?;
        let stored: Vec<CountRow> = sqlx::query_as(
            r#"
            select
                study_id, is_simulated, problem_id, status, action, n_all, n_completed, excluded_all,
                excluded_completed
            from counter
            where n_all > 0
            order by 1, 2, 3, 4, 5
            "#,
        )
        .fetch_all(&mut *transaction)
        .await?;
        let counted: Vec<CountRow> = sqlx::query_as(
            r#"
            select
                run.study_id, run.is_simulated, answer.problem_id, answer.status, ifnull(answer.action, ''),
                count(*), count(*) filter (where run.state = 'completed'), count(exclusion.run_id),
                count(exclusion.run_id) filter (where run.state = 'completed')
            from answer
            join run on run.id = answer.run_id
            left join exclusion on exclusion.run_id = run.id
            where answer.is_counted = 1
            group by 1, 2, 3, 4, 5
            order by 1, 2, 3, 4, 5
            "#,
        )
        .fetch_all(&mut *transaction)
        .await?;
        let stored_totals: Vec<TotalRow> = sqlx::query_as(
            r#"
            select
                study_id, is_simulated, started, completed, declined, screened_out, failed_check, timed_out,
                withdrawn, excluded, excluded_completed
            from population
            order by 1, 2
            "#,
        )
        .fetch_all(&mut *transaction)
        .await?;
        let counted_totals: Vec<TotalRow> = sqlx::query_as(
            r#"
            select
                population.study_id, population.is_simulated, count(run.id),
                count(*) filter (where run.state = 'completed'), count(*) filter (where run.state = 'declined'),
                count(*) filter (where run.state = 'screened_out'),
                count(*) filter (where run.state = 'failed_check'),
                count(*) filter (where run.state = 'timed_out'), count(*) filter (where run.state = 'withdrawn'),
                count(exclusion.run_id), count(exclusion.run_id) filter (where run.state = 'completed')
            from population
            left join run
                on run.study_id = population.study_id
                and run.is_simulated = population.is_simulated
                and run.is_preview = 0
            left join exclusion on exclusion.run_id = run.id
            group by 1, 2
            order by 1, 2
            "#,
        )
        .fetch_all(&mut *transaction)
        .await?;
        let mut disagreements = compare(counted, stored, |row| {
            let what = format!("problem {} {} `{}`", row.2, row.3, row.4);
            let n = (row.5, row.6, row.7, row.8);
            ((row.0.clone(), row.1, what), n)
        });
        disagreements.extend(compare(counted_totals, stored_totals, |row| {
            let place = (row.0.clone(), row.1, "totals".to_owned());
            let ended = (row.2, row.3, row.4, row.5, row.6, row.7, row.8);
            (place, (ended, row.9, row.10))
        }));
        Ok(disagreements)
    }
}

/// A count's study, population and name.
type Place = (String, bool, String);

/// Lists the places at which two sets of counts differ.
fn compare<Row, N: PartialEq + std::fmt::Debug>(
    expected: Vec<Row>,
    found: Vec<Row>,
    split: impl Fn(&Row) -> (Place, N),
) -> Vec<Disagreement> {
    let expected: BTreeMap<Place, N> = expected.iter().map(&split).collect();
    let found: BTreeMap<Place, N> = found.iter().map(&split).collect();
    let places: BTreeSet<&Place> = expected.keys().chain(found.keys()).collect();
    places
        .into_iter()
        .filter(|place| expected.get(*place) != found.get(*place))
        .map(|place| {
            let (study, is_simulated, what) = place;
            Disagreement {
                place: format!("{study}, simulated {is_simulated}: {what}"),
                expected: format!("{:?}", expected.get(place)),
                found: format!("{:?}", found.get(place)),
            }
        })
        .collect()
}

/// A run as it began.
async fn at_start(
    connection: &mut SqliteConnection,
    run: RunId,
    factor: f64,
    is_preview: bool,
) -> Result<RunFacts, Error> {
    let rows: Vec<(String, String, Option<i64>, Option<ProblemId>)> = sqlx::query_as(
        "select kind, block, limit_ms, problem_id from step where run_id = ? order by position",
    )
    .bind(run)
    .fetch_all(connection)
    .await?;
    let ahead: Result<VecDeque<StepFacts>, sqlx::Error> = rows
        .into_iter()
        .map(|(kind, block, limit_ms, problem)| {
            let limit_ms = limit_ms.and_then(|limit_ms| u64::try_from(limit_ms).ok());
            Ok(StepFacts {
                kind: step_kind(&kind)?,
                block: BlockId::from(block),
                limit_ms,
                problem,
            })
        })
        .collect();
    Ok(RunFacts {
        state: RunState::Active,
        position: 0,
        shown_at: None,
        deadline: None,
        attempts: 0,
        expires_at: None,
        ended_at: None,
        factor: time_factor(factor)?,
        is_preview,
        ahead: ahead?,
    })
}

/// The answers that a run's events give.
async fn rebuild_answers(
    connection: &mut SqliteConnection,
    run: RunId,
    mut facts: RunFacts,
) -> Result<(RunState, Vec<NewAnswer>), Error> {
    let events: Vec<EventToReplay> = sqlx::query_as(
        "select id, position, kind, verdict, at_ms, body from event where run_id = ? order by id",
    )
    .bind(run)
    .fetch_all(connection)
    .await?;
    let mut answers = Vec::new();
    for event in events {
        let at = Timestamp(event.at_ms);
        match event.kind {
            EventKind::Started | EventKind::Erased => {}
            EventKind::Ended => {
                let body: EndedBody = serde_json::from_str(event.body.as_deref().unwrap_or(""))
                    .map_err(|err| sqlx::Error::Decode(err.into()))?;
                facts.end(body.state, at);
            }
            EventKind::Shown => {
                facts.show(event.position, at);
            }
            EventKind::RanOut => {
                if let Some(closed) = facts.time_out(at, 0) {
                    answers.push(NewAnswer::of(event.id, run, &closed, None));
                }
            }
            EventKind::Submitted => {
                let body: Body = serde_json::from_str(event.body.as_deref().unwrap_or(""))
                    .map_err(|err| sqlx::Error::Decode(err.into()))?;
                // Repetitions were recognised by their keys, before any rule looked at them.
                let is_repetition = event.verdict.as_deref().is_some_and(|verdict| {
                    verdict == Verdict::Retry.as_str() || verdict == Verdict::Conflict.as_str()
                });
                let submission = Submission {
                    position: event.position,
                    key: String::new(),
                    reply: body.reply.clone(),
                    timing: body.timing,
                    consent_version: body.consent_version.clone(),
                    assessment: body.assessment,
                };
                let seen = if is_repetition {
                    KeySeen::SameBody
                } else {
                    KeySeen::Never
                };
                let judgement = facts
                    .submit(&submission, seen, at)
                    .map_err(|refusal| Error::Refused(format!("event {}: {refusal}", event.id)))?;
                if let Some(closed) = judgement.closed {
                    answers.push(NewAnswer::of(event.id, run, &closed, Some(&body)));
                }
            }
        }
    }
    Ok((facts.state, answers))
}

async fn stored_answers(
    connection: &mut SqliteConnection,
    run: RunId,
) -> Result<Vec<NewAnswer>, Error> {
    Ok(sqlx::query_as(
        r#"
        select
            event_id, run_id, position, status, problem_id, action, is_counted, shown_at_ms, answered_at_ms,
            server_ms, client_rt_ms, limit_ms, deadline_ms, input, hidden_ms, value
        from answer
        where run_id = ?
        order by position
        "#,
    )
    .bind(run)
    .fetch_all(connection)
    .await?)
}
