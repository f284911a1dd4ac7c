//! What a group of jobs needs to know, loaded with one statement for each kind of thing.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet, VecDeque};

use sqlx::sqlite::SqliteConnection;

use super::import;
use super::rules::{KeySeen, RunFacts, SWEEP_SLACK_MS, StepFacts};
use super::token::TokenHash;
use super::{EventId, Population, ProblemId, Receipt, RunId, RunState, StudyState, Verdict, json};
use crate::study::{BlockId, ConditionId, StepKind, StudyId, TimeFactor, Timestamp};

/// A run as the batch changes it.
#[derive(Debug, Clone)]
pub(super) struct LoadedRun {
    pub(super) study: StudyId,
    pub(super) population: Population,
    /// Whether it is left out of the analysis already, by hand.
    pub(super) is_excluded: bool,
    /// The condition, where it takes a place: previews and runs without an end take none.
    pub(super) place: Option<Place>,
    pub(super) facts: RunFacts,
}

/// What a run that is under way or completed takes up: one place in its condition.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Place {
    pub(super) study: StudyId,
    pub(super) population: Population,
    pub(super) condition: Option<ConditionId>,
}

/// A form that was sent before.
#[derive(Debug, Clone)]
pub(super) struct PastForm {
    pub(super) receipt: Receipt,
    pub(super) body_hash: String,
}

impl PastForm {
    pub(super) fn compare(&self, body_hash: &str) -> KeySeen {
        if self.body_hash == body_hash {
            KeySeen::SameBody
        } else {
            KeySeen::OtherBody
        }
    }
}

/// An arrival with the runs that it may lead to.
#[derive(Debug, Clone)]
pub(super) struct LoadedArrival {
    pub(super) study: StudyId,
    pub(super) study_state: StudyState,
    pub(super) platform: Option<String>,
    pub(super) platform_key: Option<String>,
    pub(super) recruiting: Option<String>,
    pub(super) source: Option<String>,
    pub(super) language: Option<String>,
    pub(super) is_preview: bool,
    pub(super) created_at: Timestamp,
    /// The run that this arrival started or resumed before.
    pub(super) own: Option<FoundRun>,
    /// The run of the same person of a recruiting platform.
    pub(super) person: Option<FoundRun>,
    /// Whether the same person withdrew after their part had ended.
    pub(super) has_withdrawn: bool,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct FoundRun {
    pub(super) run: RunId,
    pub(super) state: RunState,
    pub(super) is_owner: bool,
}

/// The first free ids.
#[derive(Debug, Clone, Copy)]
pub(super) struct NextIds {
    pub(super) event: i64,
    pub(super) run: i64,
}

pub(super) async fn next_ids(connection: &mut SqliteConnection) -> Result<NextIds, sqlx::Error> {
    let (event, run) =
        sqlx::query_as("select (select ifnull(max(id), 0) + 1 from event), (select ifnull(max(id), 0) + 1 from run)")
            .fetch_one(connection)
            .await?;
    Ok(NextIds { event, run })
}

#[derive(sqlx::FromRow)]
struct RunStepRow {
    id: i64,
    study_id: String,
    #[sqlx(try_from = "String")]
    state: RunState,
    current: u32,
    shown_at_ms: Option<i64>,
    deadline_ms: Option<i64>,
    attempts: u32,
    time_factor: f64,
    is_simulated: bool,
    is_preview: bool,
    condition: Option<String>,
    expires_at_ms: Option<i64>,
    kind: Option<String>,
    block: Option<String>,
    limit_ms: Option<i64>,
    problem_id: Option<ProblemId>,
    is_excluded: bool,
}

/// The runs in question, each with its current step and as many after it as there are jobs for it.
pub(super) async fn runs(
    connection: &mut SqliteConnection,
    jobs_by_run: &BTreeMap<RunId, u32>,
) -> Result<HashMap<RunId, LoadedRun>, sqlx::Error> {
    if jobs_by_run.is_empty() {
        return Ok(HashMap::new());
    }
    let asked: Vec<(RunId, u32)> = jobs_by_run
        .iter()
        .map(|(run, jobs)| (*run, *jobs))
        .collect();
    let rows: Vec<RunStepRow> = sqlx::query_as(
        r#"
        select
            run.id, run.study_id, run.state, run.position as current, run.shown_at_ms, run.deadline_ms,
            run.attempts, run.time_factor, run.is_simulated, run.is_preview, run.condition, run.expires_at_ms,
            step.kind, step.block, step.limit_ms, step.problem_id,
            exists (select 1 from exclusion where exclusion.run_id = run.id) as is_excluded
        from json_each(?) as asked
        join run on run.id = asked.value ->> 0
        left join step
            on step.run_id = run.id
            -- each job closes at most one step, and the rules look at the one that follows
            and step.position between run.position and run.position + (asked.value ->> 1)
        order by run.id, step.position
        "#,
    )
    .bind(json(&asked))
    .fetch_all(connection)
    .await?;
    let mut runs: HashMap<RunId, LoadedRun> = HashMap::with_capacity(jobs_by_run.len());
    for row in rows {
        let step = step_facts(&row)?;
        let run = match runs.entry(RunId(row.id)) {
            std::collections::hash_map::Entry::Occupied(known) => known.into_mut(),
            std::collections::hash_map::Entry::Vacant(vacant) => vacant.insert(LoadedRun {
                place: (!row.is_preview && row.expires_at_ms.is_some()).then(|| Place {
                    study: row.study_id.as_str().into(),
                    population: Population::from_flag(row.is_simulated),
                    condition: row.condition.as_deref().map(ConditionId::from),
                }),
                study: row.study_id.into(),
                population: Population::from_flag(row.is_simulated),
                is_excluded: row.is_excluded,
                facts: RunFacts {
                    state: row.state,
                    position: row.current,
                    shown_at: row.shown_at_ms.map(Timestamp),
                    deadline: row.deadline_ms.map(Timestamp),
                    attempts: row.attempts,
                    expires_at: row.expires_at_ms.map(Timestamp),
                    ended_at: None,
                    factor: time_factor(row.time_factor)?,
                    is_preview: row.is_preview,
                    ahead: VecDeque::new(),
                },
            }),
        };
        run.facts.ahead.extend(step);
    }
    Ok(runs)
}

fn step_facts(row: &RunStepRow) -> Result<Option<StepFacts>, sqlx::Error> {
    let (Some(kind), Some(block)) = (&row.kind, &row.block) else {
        return Ok(None);
    };
    Ok(Some(StepFacts {
        kind: step_kind(kind)?,
        block: BlockId::from(block.as_str()),
        limit_ms: row
            .limit_ms
            .and_then(|limit_ms| u64::try_from(limit_ms).ok()),
        problem: row.problem_id,
    }))
}

/// Reads a stored kind of step.
pub(super) fn step_kind(text: &str) -> Result<StepKind, sqlx::Error> {
    let kinds = [
        StepKind::Consent,
        StepKind::Info,
        StepKind::Replays,
        StepKind::Choice,
        StepKind::Form,
        StepKind::Thanks,
    ];
    kinds
        .into_iter()
        .find(|kind| kind.as_str() == text)
        .ok_or_else(|| sqlx::Error::Decode(format!("unknown kind of step `{text}`").into()))
}

/// Reads a stored time factor.
pub(super) fn time_factor(factor: f64) -> Result<TimeFactor, sqlx::Error> {
    TimeFactor::new(factor).map_err(|err| sqlx::Error::Decode(err.into()))
}

/// The runs that are to be looked at: at a timed question whose deadline has passed for longer than the sweep waits, or
/// not finished in their time.
pub(super) async fn overdue_runs(
    connection: &mut SqliteConnection,
    now: Timestamp,
) -> Result<Vec<RunId>, sqlx::Error> {
    sqlx::query_scalar(
        r#"
        select id
        from run
        where deadline_ms < ?
        and state = 'active'
        union
        select id
        from run
        where expires_at_ms < ?
        and state = 'active'
        "#,
    )
    .bind(now.0 - SWEEP_SLACK_MS)
    .bind(now.0)
    .fetch_all(connection)
    .await
}

/// How many places are taken, by study, population and condition. A run without an end would hold its place for ever, and
/// who answered elsewhere never had one: neither counts.
pub(super) async fn places(
    connection: &mut SqliteConnection,
    studies: &BTreeSet<(StudyId, Population)>,
) -> Result<HashMap<Place, u64>, sqlx::Error> {
    if studies.is_empty() {
        return Ok(HashMap::new());
    }
    let asked: Vec<(&StudyId, bool)> = studies
        .iter()
        .map(|(study, population)| (study, population.is_simulated()))
        .collect();
    let rows: Vec<(String, bool, Option<String>, i64)> = sqlx::query_as(
        r#"
        select run.study_id, run.is_simulated, run.condition, count(*)
        from json_each(?) as asked
        cross join run indexed by run_place
            on run.study_id = asked.value ->> 0
            and run.is_simulated = asked.value ->> 1
        where run.state in ('active', 'completed')
        and run.is_preview = 0
        and (run.state = 'completed' or run.expires_at_ms is not null)
        and run.platform is not ?
        group by 1, 2, 3
        "#,
    )
    .bind(json(&asked))
    .bind(import::PLATFORM)
    .fetch_all(connection)
    .await?;
    Ok(rows
        .into_iter()
        .map(|(study, is_simulated, condition, taken)| {
            let place = Place {
                study: study.into(),
                population: Population::from_flag(is_simulated),
                condition: condition.as_deref().map(ConditionId::from),
            };
            (place, u64::try_from(taken).unwrap_or(0))
        })
        .collect())
}

/// The forms among `keys` (run and key) that were sent before.
pub(super) async fn past_forms(
    connection: &mut SqliteConnection,
    keys: &[(RunId, &str)],
) -> Result<HashMap<(RunId, String), PastForm>, sqlx::Error> {
    if keys.is_empty() {
        return Ok(HashMap::new());
    }
    let rows: Vec<(RunId, String, EventId, u32, String, i64, String)> = sqlx::query_as(
        r#"
        select event.run_id, event.key, event.id, event.position, event.verdict, event.at_ms, lower(hex(event.body_hash))
        from json_each(?) as asked
        join event on event.run_id = asked.value ->> 0 and event.key = asked.value ->> 1
        "#,
    )
    .bind(json(&keys))
    .fetch_all(connection)
    .await?;
    rows.into_iter()
        .map(|(run, key, event, position, verdict, at_ms, body_hash)| {
            let verdict: Verdict = verdict
                .parse()
                .map_err(|err| sqlx::Error::Decode(Box::new(err)))?;
            let receipt = Receipt {
                event,
                position,
                verdict,
                at: Timestamp(at_ms),
            };
            Ok(((run, key), PastForm { receipt, body_hash }))
        })
        .collect()
}

/// The state of each study.
pub(super) async fn study_states(
    connection: &mut SqliteConnection,
) -> Result<HashMap<String, StudyState>, sqlx::Error> {
    let rows: Vec<(String, String)> = sqlx::query_as("select id, state from study")
        .fetch_all(connection)
        .await?;
    rows.into_iter()
        .map(|(id, state)| {
            Ok((
                id,
                state
                    .parse()
                    .map_err(|err| sqlx::Error::Decode(Box::new(err)))?,
            ))
        })
        .collect()
}

/// Those among `people` (study, platform, key of the person) who have a run there.
pub(super) async fn known_people(
    connection: &mut SqliteConnection,
    people: &[(StudyId, String, String)],
) -> Result<HashSet<(StudyId, String, String)>, sqlx::Error> {
    if people.is_empty() {
        return Ok(HashSet::new());
    }
    let rows: Vec<(String, String, String)> = sqlx::query_as(
        r#"
        select run.study_id, run.platform, run.platform_key
        from json_each(?) as asked
        join run
            on run.study_id = asked.value ->> 0
            and run.platform = asked.value ->> 1
            and run.platform_key = asked.value ->> 2
        where run.platform_key is not null
        and run.state <> 'withdrawn'
        and run.is_preview = 0
        "#,
    )
    .bind(json(&people))
    .fetch_all(connection)
    .await?;
    Ok(rows
        .into_iter()
        .map(|(study, platform, key)| (study.into(), platform, key))
        .collect())
}

/// Those among `people` (study, platform, key of the person) who withdrew there after their part had ended.
pub(super) async fn withdrawn_people(
    connection: &mut SqliteConnection,
    people: &[(StudyId, String, String)],
) -> Result<HashSet<(StudyId, String, String)>, sqlx::Error> {
    if people.is_empty() {
        return Ok(HashSet::new());
    }
    let rows: Vec<(String, String, String)> = sqlx::query_as(
        r#"
        select asked.value ->> 0, asked.value ->> 1, asked.value ->> 2
        from json_each(?) as asked
        join withdrawn_person
            on withdrawn_person.study_id = asked.value ->> 0
            and withdrawn_person.platform_key = asked.value ->> 2
        "#,
    )
    .bind(json(&people))
    .fetch_all(connection)
    .await?;
    Ok(rows
        .into_iter()
        .map(|(study, platform, key)| (study.into(), platform, key))
        .collect())
}

#[derive(sqlx::FromRow)]
struct ArrivalRow {
    ordinal: i64,
    study_id: String,
    #[sqlx(try_from = "String")]
    study_state: StudyState,
    platform: Option<String>,
    platform_key: Option<String>,
    recruiting: Option<String>,
    source: Option<String>,
    language: Option<String>,
    is_preview: bool,
    created_at_ms: i64,
    own_id: Option<RunId>,
    own_state: Option<String>,
    own_is_owner: Option<bool>,
    person_id: Option<RunId>,
    person_state: Option<String>,
    has_withdrawn: bool,
}

/// The arrivals among `asked` (the hash of the arrival, the hash of the link that it leads to), by their place there.
pub(super) async fn arrivals(
    connection: &mut SqliteConnection,
    asked: &[(TokenHash, TokenHash)],
) -> Result<HashMap<usize, LoadedArrival>, sqlx::Error> {
    if asked.is_empty() {
        return Ok(HashMap::new());
    }
    let hashes: Vec<(String, String)> = asked
        .iter()
        .map(|(arrival, link)| (arrival.to_hex(), link.to_hex()))
        .collect();
    let rows: Vec<ArrivalRow> = sqlx::query_as(
        r#"
        select
            asked.key as ordinal, arrival.study_id, study.state as study_state, arrival.platform,
            arrival.platform_key, arrival.recruiting, arrival.source, arrival.language, arrival.is_preview,
            arrival.created_at_ms,
            own.id as own_id, own.state as own_state, run_token.is_owner as own_is_owner,
            person.id as person_id, person.state as person_state,
            exists (
                select 1
                from withdrawn_person
                where withdrawn_person.study_id = arrival.study_id
                and withdrawn_person.platform_key = arrival.platform_key
            ) as has_withdrawn
        from json_each(?) as asked
        join arrival on arrival.token_hash = unhex(asked.value ->> 0)
        join study on study.id = arrival.study_id
        left join run_token on run_token.token_hash = unhex(asked.value ->> 1)
        left join run as own on own.id = run_token.run_id
        left join run as person
            on person.study_id = arrival.study_id
            and person.platform = arrival.platform
            and person.platform_key = arrival.platform_key
            and person.platform_key is not null
            and person.state <> 'withdrawn'
            and person.is_preview = 0
        "#,
    )
    .bind(json(&hashes))
    .fetch_all(connection)
    .await?;
    rows.into_iter()
        .map(|row| {
            let found =
                |run: Option<RunId>, state: Option<String>, is_owner: bool| match (run, state) {
                    (Some(run), Some(state)) => {
                        let state = state
                            .parse()
                            .map_err(|err| sqlx::Error::Decode(Box::new(err)))?;
                        Ok(Some(FoundRun {
                            run,
                            state,
                            is_owner,
                        }))
                    }
                    (None, _) | (_, None) => Ok::<_, sqlx::Error>(None),
                };
            let arrival = LoadedArrival {
                study: row.study_id.into(),
                study_state: row.study_state,
                platform: row.platform,
                platform_key: row.platform_key,
                recruiting: row.recruiting,
                source: row.source,
                language: row.language,
                is_preview: row.is_preview,
                created_at: Timestamp(row.created_at_ms),
                own: found(row.own_id, row.own_state, row.own_is_owner.unwrap_or(false))?,
                person: found(row.person_id, row.person_state, false)?,
                has_withdrawn: row.has_withdrawn,
            };
            Ok((usize::try_from(row.ordinal).unwrap_or(usize::MAX), arrival))
        })
        .collect()
}
