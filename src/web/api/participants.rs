//! How a study goes: its participants one by one, and how far people come.

use axum::{
    Json,
    extract::State,
    response::{IntoResponse, Response},
};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::{
    NoQuery, Parts, StudyPath, cursor,
    extract::{Path, Query},
    served,
};
use crate::{
    store::{Flag, ParticipantFilter, RunId, RunState, StepProgress, WatchedParticipant},
    study::StudyId,
    web::{ApiError, results::rfc3339},
};

const PAGE_ROWS: u32 = 100;
const MAX_PAGE_ROWS: u32 = 1_000;

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ParticipantsQuery {
    /// Where the page before ended, as its link says.
    #[param(nullable = false)]
    after: Option<String>,
    /// Participants on a page, 100 if left out.
    #[param(minimum = 1, maximum = 1000, nullable = false)]
    limit: Option<u32>,
}

#[derive(Serialize, utoipa::ToSchema)]
struct ParticipantsPage {
    participants: Vec<Participant>,
    /// The cursor of the next page; null on the last.
    next: Option<String>,
}

#[derive(Serialize, utoipa::ToSchema)]
struct Participant {
    /// The number under which exports have them.
    participant: i64,
    state: RunState,
    /// The levels of the between-subjects factors, joined by `/`.
    condition: Option<String>,
    /// The label of their link.
    source: Option<String>,
    /// RFC 3339; null where an import did not tell.
    started_at: Option<String>,
    /// RFC 3339; null while they are under way, and where an import did not tell.
    finished_at: Option<String>,
    /// Steps that were closed.
    answered: u64,
    /// Steps that their run has, the last page left out. Nothing is left of withdrawn people.
    steps: u64,
    /// What is notable; it excludes nobody.
    flags: Vec<Flag>,
}

/// The participants in pages, the newest first.
#[utoipa::path(
    get, path = "/studies/{study}/participants", tag = "data", params(StudyPath, ParticipantsQuery),
    responses((status = 200, description = "A page of participants", body = ParticipantsPage,
        headers(("Link" = String, description = "`next` and `first` page (RFC 8288)")))),
    security((), ("token" = ["data"])),
)]
pub(super) async fn page(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(ParticipantsQuery { after, limit }): Query<ParticipantsQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let limit = cursor::rows(limit, PAGE_ROWS, MAX_PAGE_ROWS)?;
    let before = match after.as_deref().map(cursor::key) {
        Some(key) => {
            let [run] = key?;
            Some(RunId::from(run))
        }
        None => None,
    };
    let of = (study.id(), settings.population);
    let median = store.median_duration_ms(of.0, of.1).await?;
    let mut rows = store
        .participants_before(
            of,
            &ParticipantFilter::default(),
            (median, &study.instructed_items()),
            before,
            // One more than asked for tells whether there is a next page.
            limit + 1,
        )
        .await?;
    let has_more = rows.len() > limit as usize;
    rows.truncate(limit as usize);
    let next = rows
        .last()
        .filter(|_| has_more)
        .map(|row| cursor::cursor(&[row.run.get()]));
    let page = Json(ParticipantsPage {
        participants: rows.into_iter().map(Participant::from).collect(),
        next: next.clone(),
    });
    let first = format!("/api/v1/studies/{}/participants?limit={limit}", study.id());
    Ok(cursor::linked(page, &first, next.as_deref()))
}

impl From<WatchedParticipant> for Participant {
    fn from(row: WatchedParticipant) -> Self {
        Self {
            participant: row.run.get(),
            state: row.state,
            condition: row.condition.map(|condition| condition.to_string()),
            source: row.source,
            started_at: row.started_at.map(rfc3339),
            finished_at: row.finished_at.map(rfc3339),
            answered: row.answered,
            steps: row.steps,
            flags: row.flags,
        }
    }
}

#[derive(Serialize, utoipa::ToSchema)]
struct Funnel {
    started: u64,
    completed: u64,
    declined: u64,
    screened_out: u64,
    failed_check: u64,
    timed_out: u64,
    withdrawn: u64,
    /// Under way, or gone without a word.
    under_way: u64,
    /// Median of completed runs.
    median_ms: Option<u64>,
    /// In the order in which people mostly meet them.
    steps: Vec<FunnelStep>,
}

#[derive(Serialize, utoipa::ToSchema)]
struct FunnelStep {
    /// Such as `consent`, `info`, `choice`, `form`; the end is `thanks`.
    kind: String,
    block: String,
    question: Option<String>,
    /// People who came to it; withdrawn ones left out, here and below.
    reached: u64,
    /// Those who answered in time.
    answered: u64,
    late: u64,
    timed_out: u64,
    /// Those who are at it now.
    here: u64,
    /// Those whose run ended there, or who have been gone for half an hour.
    left: u64,
    /// Median from the page to its answer, to a tenth of a second.
    median_ms: Option<u64>,
}

/// How far people come, and where they stop.
#[utoipa::path(
    get, path = "/studies/{study}/funnel", tag = "studies", params(StudyPath),
    responses((status = 200, description = "What became of people, step by step", body = Funnel)),
    security((), ("token" = ["results"])),
)]
pub(super) async fn funnel(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let study = served(&catalogue, &study)?;
    let (id, population) = (study.id(), settings.population);
    let people = store.totals(id, population).await?;
    let funnel = Funnel {
        started: people.started,
        completed: people.completed,
        declined: people.declined,
        screened_out: people.screened_out,
        failed_check: people.failed_check,
        timed_out: people.timed_out,
        withdrawn: people.withdrawn,
        under_way: people.under_way(),
        median_ms: store.median_duration_ms(id, population).await?,
        steps: store
            .step_progress(id, population)
            .await?
            .into_iter()
            .map(FunnelStep::from)
            .collect(),
    };
    Ok(Json(funnel).into_response())
}

impl From<StepProgress> for FunnelStep {
    fn from(step: StepProgress) -> Self {
        Self {
            kind: step.kind,
            block: step.block.to_string(),
            question: step.question.map(|question| question.to_string()),
            reached: step.reached,
            answered: step.answered,
            late: step.late,
            timed_out: step.timed_out,
            here: step.here,
            left: step.left,
            median_ms: step.median_ms,
        }
    }
}
