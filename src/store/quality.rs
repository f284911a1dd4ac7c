//! The participants of a study one by one, with what is notable about their answers.
//!
//! What is notable excludes nobody: it is for whoever looks at the data.

use serde::{Deserialize, Serialize};

use super::{Error, Population, RunId, RunState, Store, json};
use crate::study::{ConditionId, InstructedItem, StudyId, Timestamp};

/// A choice that the page measured to be faster than this was hardly read. (decision)
pub const FAST_CHOICE_MS: i64 = 300;

/// Something notable about a participant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Flag {
    /// Some choice took less than [`FAST_CHOICE_MS`] on the page's clock.
    FastChoice,
    /// The whole run took less than a third of the median of all completed ones.
    ShortRun,
    /// The page was hidden while a question was shown.
    HiddenPage,
    /// A comprehension check was answered wrongly, or an attention check not as asked.
    FailedCheck,
    /// Some timed question was answered too late.
    LateAnswer,
    /// The person came by several links.
    SeveralArrivals,
}

impl Flag {
    /// All flags.
    pub const ALL: [Self; 6] = [
        Self::FastChoice,
        Self::ShortRun,
        Self::HiddenPage,
        Self::FailedCheck,
        Self::LateAnswer,
        Self::SeveralArrivals,
    ];

    /// The name in addresses and in the API.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::FastChoice => "fast-choice",
            Self::ShortRun => "short-run",
            Self::HiddenPage => "hidden-page",
            Self::FailedCheck => "failed-check",
            Self::LateAnswer => "late-answer",
            Self::SeveralArrivals => "several-arrivals",
        }
    }
}

/// Which participants are asked for.
#[derive(Debug, Clone, Default)]
pub struct ParticipantFilter {
    /// Those in this state alone.
    pub state: Option<RunState>,
    /// Those from this source alone.
    pub source: Option<String>,
    /// Those with this flag alone.
    pub flag: Option<Flag>,
}

/// One participant with how far they are and what is notable.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WatchedParticipant {
    /// The number under which exports have them.
    pub run: RunId,
    /// How far they are.
    pub state: RunState,
    /// The condition, in a study with conditions.
    pub condition: Option<ConditionId>,
    /// Where they came from.
    pub source: Option<String>,
    /// When they started; none where an import did not tell.
    pub started_at: Option<Timestamp>,
    /// When their run ended, if it has and that is known.
    pub finished_at: Option<Timestamp>,
    /// How many steps they have closed.
    pub answered: u64,
    /// How many steps their run has.
    pub steps: u64,
    /// What is notable.
    pub flags: Vec<Flag>,
}

#[derive(sqlx::FromRow)]
struct Row {
    id: RunId,
    #[sqlx(try_from = "String")]
    state: RunState,
    condition: Option<String>,
    source: Option<String>,
    started_at_ms: Option<i64>,
    finished_at_ms: Option<i64>,
    answered: i64,
    steps: i64,
    fast_choice: bool,
    short_run: bool,
    hidden_page: bool,
    failed_check: bool,
    late_answer: bool,
    several_arrivals: bool,
}

impl Store {
    /// The participants of a study before `before`, the newest first, at most `limit`. `median_ms` is the median time of
    /// completed runs, `checks` are the study's attention checks.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn participants_before(
        &self,
        (study, population): (&StudyId, Population),
        filter: &ParticipantFilter,
        (median_ms, checks): (Option<u64>, &[InstructedItem]),
        before: Option<RunId>,
        limit: u32,
    ) -> Result<Vec<WatchedParticipant>, Error> {
        let checks: Vec<_> = checks
            .iter()
            .map(|check| {
                serde_json::json!({
                    "block": check.block, "field": check.field, "expected": check.expected,
                })
            })
            .collect();
        let rows: Vec<Row> = sqlx::query_as(
            r#"
            select *
            from (
                select
                    run.id, run.state, run.condition, run.source,
                    iif(run.has_times, run.started_at_ms, null) as started_at_ms,
                    iif(run.has_times, run.finished_at_ms, null) as finished_at_ms,
                    count(answer.event_id) as answered,
                    (select count(*) from step where step.run_id = run.id and step.kind <> 'thanks') as steps,
                    ifnull(max(answer.action is not null and answer.client_rt_ms < ?5), 0) as fast_choice,
                    run.state = 'completed' and run.has_times
                    and run.finished_at_ms - run.started_at_ms < ?6 as short_run,
                    ifnull(max(answer.hidden_ms > 0), 0) as hidden_page,
                    run.state = 'failed_check'
                    or ifnull(max(answer.value ->> '_passed' = 0 or answer.value ->> '_attempts' > 1), 0)
                    or exists (
                        select 1
                        from json_each(?7) as item
                        join step on step.run_id = run.id and step.kind = 'form'
                            and step.block = item.value ->> 'block'
                        join answer as given on given.run_id = step.run_id and given.position = step.position
                        where given.value -> (item.value ->> 'field') <> item.value -> 'expected'
                        and given.value ->> (item.value ->> 'field') is not null
                    ) as failed_check,
                    ifnull(max(answer.status = 'late'), 0) as late_answer,
                    (select count(*) from arrival where arrival.run_id = run.id) > 1 as several_arrivals
                from run
                left join answer on answer.run_id = run.id
                where run.study_id = ?1 and run.is_simulated = ?2 and run.is_preview = 0
                and run.id < ?3
                and (?8 is null or run.state = ?8)
                and (?9 is null or run.source = ?9)
                group by run.id
                order by run.id desc
            )
            where case ?10
                when 'fast-choice' then fast_choice
                when 'short-run' then short_run
                when 'hidden-page' then hidden_page
                when 'failed-check' then failed_check
                when 'late-answer' then late_answer
                when 'several-arrivals' then several_arrivals
                else 1
            end
            order by id desc
            limit ?4
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(before.map_or(i64::MAX, RunId::get))
        .bind(limit)
        .bind(FAST_CHOICE_MS)
        .bind(median_ms.map_or(0, |ms| i64::try_from(ms / 3).unwrap_or(0)))
        .bind(json(&checks))
        .bind(filter.state.map(RunState::as_str))
        .bind(&filter.source)
        .bind(filter.flag.map(Flag::as_str))
        .fetch_all(&self.pool)
        .await?;
        Ok(rows.into_iter().map(WatchedParticipant::from).collect())
    }
}

impl From<Row> for WatchedParticipant {
    fn from(row: Row) -> Self {
        let flags = [
            (row.fast_choice, Flag::FastChoice),
            (row.short_run, Flag::ShortRun),
            (row.hidden_page, Flag::HiddenPage),
            (row.failed_check, Flag::FailedCheck),
            (row.late_answer, Flag::LateAnswer),
            (row.several_arrivals, Flag::SeveralArrivals),
        ];
        let count = |stored: i64| u64::try_from(stored).unwrap_or(0);
        Self {
            run: row.id,
            state: row.state,
            condition: row.condition.as_deref().map(ConditionId::from),
            source: row.source,
            started_at: row.started_at_ms.map(Timestamp),
            finished_at: row.finished_at_ms.map(Timestamp),
            answered: count(row.answered),
            steps: count(row.steps),
            flags: flags
                .into_iter()
                .filter(|(is_set, _)| *is_set)
                .map(|(_, flag)| flag)
                .collect(),
        }
    }
}
