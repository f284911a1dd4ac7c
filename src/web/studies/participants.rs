//! The participants of a study one by one, and erasing one of them.

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Path, Query, State},
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;

use super::{
    super::{
        Error,
        access::{self, Caller, Written},
        accounts::Who,
        assets,
        results::rfc3339,
    },
    Head, Parts, current, words,
};
use crate::web::query;
use crate::{
    store::{ParticipantFilter, RunId, RunState, WatchedParticipant},
    study::{Flag, StudyId},
};

/// Participants on one page.
const PAGE: u32 = 50;

/// Stands among the flags for everybody who is left out of the analysis.
const LEFT_OUT: &str = "left-out";

const STATES: [RunState; 7] = [
    RunState::Active,
    RunState::Completed,
    RunState::Declined,
    RunState::ScreenedOut,
    RunState::FailedCheck,
    RunState::TimedOut,
    RunState::Withdrawn,
];

#[derive(Template, WebTemplate)]
#[template(path = "studies/participants.html")]
pub(super) struct ParticipantsPage {
    head: Head,
    /// The filter's choices: value, text, whether it is chosen.
    states: Vec<Choice>,
    flags: Vec<Choice>,
    sources: Vec<Choice>,
    is_filtered: bool,
    has_conditions: bool,
    rows: Vec<Line>,
    /// The query of the next page.
    older: Option<String>,
}

struct Choice {
    value: String,
    text: String,
    is_chosen: bool,
}

struct Line {
    run: i64,
    state: &'static str,
    condition: String,
    source: String,
    started: String,
    started_at: Option<String>,
    duration: String,
    answered: String,
    flags: Vec<&'static str>,
    /// Why they are left out of the analysis; empty where they are not.
    excluded: String,
    has_answers: bool,
    is_withdrawn: bool,
}

#[derive(Template, WebTemplate)]
#[template(path = "studies/erase.html")]
pub(super) struct ErasePage {
    head: Head,
    run: i64,
    /// Whether nothing is left to erase.
    is_erased: bool,
    state: &'static str,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct ParticipantsQuery {
    #[serde(default)]
    state: String,
    #[serde(default)]
    flag: String,
    #[serde(default)]
    source: String,
    before: Option<i64>,
}

impl ParticipantsQuery {
    /// Empty values are those of a form in which nothing was chosen.
    fn filter(&self) -> Result<ParticipantFilter, Error> {
        let state = match self.state.as_str() {
            "" => None,
            text => Some(text.parse().map_err(|_| {
                let allowed = STATES.map(RunState::as_str).join(", ");
                Error::BadRequest(format!("state `{text}` does not exist; allowed: {allowed}"))
            })?),
        };
        let flag = match self.flag.as_str() {
            "" | LEFT_OUT => None,
            text => Some(Flag::named(text).ok_or_else(|| {
                let allowed = Flag::ALL.map(Flag::as_str).join(", ");
                Error::BadRequest(format!(
                    "flag `{text}` does not exist; allowed: {allowed}, {LEFT_OUT}"
                ))
            })?),
        };
        Ok(ParticipantFilter {
            state,
            flag,
            is_excluded: self.flag == LEFT_OUT,
            source: Some(self.source.clone()).filter(|source| !source.is_empty()),
        })
    }
}

/// GET `/studies/STUDY/participants`.
pub(super) async fn show(
    (State(store), State(catalogue), State(settings)): Parts,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
    Query(query): Query<ParticipantsQuery>,
) -> Result<ParticipantsPage, Error> {
    let served = current(&catalogue, &study)?;
    let filter = query.filter()?;
    let population = settings.population;
    let median = store.median_duration_ms(&study, population).await?;
    let rows = store
        .participants_before(
            (&study, population),
            &filter,
            (median, &served.instructed_items()),
            query.before.map(RunId::from),
            PAGE,
        )
        .await?;
    let last = rows.last().filter(|_| rows.len() == PAGE as usize);
    let older = last.map(|last| query.older(last.run));
    let mut sources: Vec<String> = store
        .runs_by_source(&study, population)
        .await?
        .into_iter()
        .filter_map(|(source, ..)| source)
        .collect();
    sources.dedup();
    let choice = |value: &str, text: &str, chosen: &str| Choice {
        value: value.to_owned(),
        text: text.to_owned(),
        is_chosen: value == chosen,
    };
    let now = store.clock().now();
    Ok(ParticipantsPage {
        head: Head::new(&store, &settings, &caller, &served, "/participants").await?,
        states: STATES
            .iter()
            .map(|state| choice(state.as_str(), words::run_state(*state), &query.state))
            .collect(),
        flags: Flag::ALL
            .iter()
            .map(|flag| choice(flag.as_str(), words::flag(*flag), &query.flag))
            .chain([choice(LEFT_OUT, "left out of the analysis", &query.flag)])
            .collect(),
        sources: sources
            .iter()
            .map(|source| choice(source, source, &query.source))
            .collect(),
        is_filtered: filter.state.is_some()
            || filter.flag.is_some()
            || filter.source.is_some()
            || filter.is_excluded,
        has_conditions: !served.conditions().is_empty(),
        rows: rows.into_iter().map(|row| Line::new(row, now.0)).collect(),
        older,
    })
}

impl ParticipantsQuery {
    fn older(&self, before: RunId) -> String {
        let before = before.to_string();
        [
            ("state", &self.state),
            ("flag", &self.flag),
            ("source", &self.source),
            ("before", &before),
        ]
        .iter()
        .filter(|(_, value)| !value.is_empty())
        .map(|(name, value)| format!("{name}={}", query::percent_encoded(value)))
        .collect::<Vec<_>>()
        .join("&")
    }
}

impl Line {
    fn new(row: WatchedParticipant, now_ms: i64) -> Self {
        let end_ms = match row.state {
            RunState::Active => Some(now_ms),
            RunState::Completed
            | RunState::Declined
            | RunState::ScreenedOut
            | RunState::FailedCheck
            | RunState::TimedOut
            | RunState::Withdrawn => row.finished_at.map(|at| at.0),
        };
        let took_ms = end_ms
            .zip(row.started_at)
            .map(|(end_ms, start)| (end_ms - start.0).max(0).unsigned_abs());
        let is_withdrawn = row.state == RunState::Withdrawn;
        Self {
            run: row.run.get(),
            state: words::run_state(row.state),
            condition: row
                .condition
                .map_or_else(|| words::NONE.to_owned(), |condition| condition.to_string()),
            source: row.source.unwrap_or_else(|| words::NONE.to_owned()),
            started: row
                .started_at
                .map_or_else(|| words::NONE.to_owned(), words::moment),
            started_at: row.started_at.map(rfc3339),
            duration: words::duration_or_none(took_ms.filter(|_| !is_withdrawn)),
            answered: if is_withdrawn {
                "erased".to_owned()
            } else {
                format!("{} of {}", row.answered, row.steps)
            },
            flags: row.flags.into_iter().map(words::flag).collect(),
            excluded: row.excluded.unwrap_or_default(),
            has_answers: !is_withdrawn && row.state != RunState::Declined,
            is_withdrawn,
        }
    }
}

/// GET `/studies/STUDY/participants/RUN/erase`: asks whether it is meant.
pub(super) async fn ask_erase(
    (State(store), State(catalogue), State(settings)): Parts,
    Extension(caller): Extension<Caller>,
    Path((study, run)): Path<(StudyId, i64)>,
) -> Result<ErasePage, Error> {
    let served = current(&catalogue, &study)?;
    let state = store
        .run_state(&study, settings.population, RunId::from(run))
        .await?;
    Ok(ErasePage {
        head: Head::new(&store, &settings, &caller, &served, "/participants").await?,
        run,
        is_erased: state == RunState::Withdrawn,
        state: words::run_state(state),
    })
}

/// POST `/studies/STUDY/participants/RUN/erase`.
pub(super) async fn erase(
    (State(store), _, State(settings)): Parts,
    Extension(caller): Extension<Caller>,
    Path((study, run)): Path<(StudyId, i64)>,
) -> Result<Response, Error> {
    let detail = Some(format!("participant {run}"));
    let entry = access::entry(&caller, "erase a participant", Some(&study), detail);
    store
        .recording(entry)
        .erase(&study, settings.population, RunId::from(run))
        .await?;
    let back = Redirect::to(&format!("/studies/{study}/participants"));
    Ok((Extension(Written), back).into_response())
}
