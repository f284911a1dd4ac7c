//! What a group of jobs changes; `write` puts it on disk.

mod write;

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde_json::{Map, Value};

use super::job::AskedProblem;
use super::rules::{Body, Closed};
use super::{AnswerStatus, EventId, Population, ProblemId, RunId, Verdict, VersionId, json};
use crate::study::step::FormStep;
use crate::study::{ConditionId, Reply, StudyId, Timestamp};

#[derive(Debug, Default)]
pub(super) struct Effects {
    pub(super) arrivals: Vec<NewArrivalRow>,
    pub(super) problems: BTreeSet<(StudyId, AskedProblem)>,
    pub(super) runs: Vec<NewRunRow>,
    pub(super) steps: Vec<NewStepRow>,
    pub(super) links: Vec<NewLink>,
    /// Runs that ended, each with the hash of the link on which its last step was answered.
    pub(super) finishers: Vec<(RunId, String)>,
    /// Runs that ended without a form: their newest link is the one that their person went on with.
    pub(super) ended_alone: Vec<RunId>,
    /// Runs whose person did not consent.
    pub(super) declined: Vec<RunId>,
    pub(super) events: Vec<NewEvent>,
    pub(super) answers: Vec<NewAnswer>,
    /// Runs whose row changed.
    pub(super) touched: BTreeSet<RunId>,
    pub(super) counts: BTreeMap<CountKey, u64>,
    /// Runs whose answers count as completed from now on.
    pub(super) completed: Vec<RunId>,
    pub(super) populations: BTreeMap<(StudyId, Population), PopulationDelta>,
    /// Runs that were completed, whether they count or not, and when.
    pub(super) paid: Vec<(RunId, Timestamp)>,
}

#[derive(Debug, Serialize)]
pub(super) struct NewArrivalRow {
    pub(super) token: String,
    pub(super) study_id: StudyId,
    pub(super) platform: Option<String>,
    pub(super) platform_key: Option<String>,
    pub(super) recruiting: Option<String>,
    pub(super) source: Option<String>,
    pub(super) language: Option<String>,
    pub(super) is_preview: bool,
    pub(super) at: i64,
}

#[derive(Debug, Serialize)]
pub(super) struct NewRunRow {
    pub(super) id: RunId,
    pub(super) study_id: StudyId,
    pub(super) version_id: VersionId,
    pub(super) platform: Option<String>,
    pub(super) platform_key: Option<String>,
    pub(super) recruiting: Option<String>,
    pub(super) source: Option<String>,
    pub(super) language: Option<String>,
    pub(super) is_simulated: bool,
    pub(super) is_preview: bool,
    pub(super) time_factor: f64,
    pub(super) condition: Option<ConditionId>,
    pub(super) expires_at: Option<i64>,
    pub(super) has_times: bool,
    pub(super) at: i64,
}

#[derive(Debug, Serialize)]
pub(super) struct NewStepRow {
    pub(super) run_id: RunId,
    pub(super) position: u32,
    pub(super) kind: &'static str,
    pub(super) block: String,
    pub(super) question: Option<String>,
    pub(super) limit_ms: Option<u64>,
    pub(super) study_id: StudyId,
    pub(super) cell: Option<String>,
    pub(super) hash: Option<String>,
    pub(super) is_fitted: bool,
    pub(super) is_practice: bool,
    pub(super) data: String,
}

/// A link to a run, made from an arrival.
#[derive(Debug, Serialize)]
pub(super) struct NewLink {
    pub(super) link: String,
    pub(super) arrival: String,
    pub(super) run_id: RunId,
    pub(super) is_owner: bool,
    pub(super) at: i64,
}

#[derive(Debug, Serialize)]
pub(super) struct NewEvent {
    pub(super) id: EventId,
    pub(super) run_id: RunId,
    pub(super) position: u32,
    pub(super) kind: &'static str,
    pub(super) key: Option<String>,
    pub(super) repeat_of: Option<EventId>,
    pub(super) body_hash: Option<String>,
    pub(super) verdict: Option<Verdict>,
    pub(super) at: i64,
    pub(super) body: Option<String>,
}

/// A row of `answer`, to be written or read back for comparison.
#[derive(Debug, Clone, PartialEq, Serialize, sqlx::FromRow)]
pub(super) struct NewAnswer {
    pub(super) event_id: EventId,
    pub(super) run_id: RunId,
    pub(super) position: u32,
    #[sqlx(try_from = "String")]
    pub(super) status: AnswerStatus,
    pub(super) problem_id: Option<ProblemId>,
    pub(super) action: Option<String>,
    pub(super) is_counted: bool,
    pub(super) shown_at_ms: Option<i64>,
    pub(super) answered_at_ms: i64,
    pub(super) server_ms: Option<i64>,
    pub(super) client_rt_ms: Option<i64>,
    pub(super) limit_ms: Option<i64>,
    pub(super) deadline_ms: Option<i64>,
    pub(super) input: Option<String>,
    pub(super) hidden_ms: Option<i64>,
    pub(super) value: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct CountKey {
    pub(super) study: StudyId,
    pub(super) population: Population,
    pub(super) problem: ProblemId,
    pub(super) status: AnswerStatus,
    /// Empty where the time ran out.
    pub(super) action: String,
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PopulationDelta {
    pub(super) started: u32,
    pub(super) completed: u32,
    pub(super) declined: u32,
    pub(super) screened_out: u32,
    pub(super) failed_check: u32,
    pub(super) timed_out: u32,
}

impl NewAnswer {
    /// The answer that a closed step becomes; `body` is what was sent, if anything was.
    pub(super) fn of(event: EventId, run: RunId, closed: &Closed, body: Option<&Body>) -> Self {
        let millis = |value: Option<u64>| value.and_then(|value| i64::try_from(value).ok());
        let timing = body.map(|body| body.timing).unwrap_or_default();
        let (action, value) = match body.map(|body| (&body.reply, &body.consent_version)) {
            Some((Reply::Chose { action }, _)) => (Some(action.to_string()), None),
            Some((Reply::Filled { values }, _)) => (None, Some(filled(values, closed.attempts))),
            Some((Reply::Watched { viewings }, _)) => (None, Some(json(viewings))),
            Some((Reply::Agreed, version)) => (None, Some(consent(true, version.as_deref(), None))),
            Some((Reply::AgreedTo { clauses }, version)) => {
                (None, Some(consent(true, version.as_deref(), Some(clauses))))
            }
            Some((Reply::Declined, version)) => {
                (None, Some(consent(false, version.as_deref(), None)))
            }
            Some((Reply::Continued | Reply::GaveUp, _)) | None => (None, None),
        };
        Self {
            event_id: event,
            run_id: run,
            position: closed.position,
            status: closed.status,
            problem_id: closed.problem,
            action,
            is_counted: closed.is_counted,
            shown_at_ms: closed.shown_at.map(|shown_at| shown_at.0),
            answered_at_ms: closed.at.0,
            server_ms: millis(closed.server_ms),
            client_rt_ms: millis(timing.client_rt_ms),
            limit_ms: millis(closed.limit_ms),
            deadline_ms: closed.deadline.map(|deadline| deadline.0),
            input: timing.input.map(|input| input.as_str().to_owned()),
            hidden_ms: millis(timing.hidden_ms),
            value,
        }
    }
}

fn consent(
    agreed: bool,
    version: Option<&str>,
    clauses: Option<&BTreeMap<String, bool>>,
) -> String {
    let mut consent = serde_json::json!({ "agreed": agreed, "version": version });
    if let Some(clauses) = clauses {
        consent["clauses"] = serde_json::json!(clauses);
    }
    consent.to_string()
}

/// The values of a form; those of a comprehension check with the number of attempts.
fn filled(values: &Map<String, Value>, attempts: u32) -> String {
    let mut values = values.clone();
    if values.contains_key(FormStep::PASSED) {
        values.insert(FormStep::ATTEMPTS.to_owned(), Value::from(attempts));
    }
    json(&values)
}
