//! Who is left out of the analysis: by the rule of the study's version when a run ends, or by hand at any time.
//!
//! Exclusion concerns the analysis alone. Answers, places, bonuses and exports stay as they are; counters keep what is
//! left out beside the whole, so that results can tell n before and after.

mod rule;

use std::fmt;

use sqlx::sqlite::SqliteConnection;

pub(super) use self::rule::{apply_rules, misjudged, rule_json};
use super::job::{Job, Rare};
use super::{AnalysisSet, Change, Error, Population, RunId, RunState, Store, json};
use crate::study::{Flag, StudyId, Timestamp};

/// Why somebody is left out of the analysis.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exclusion {
    /// The flags of the study's rule that the run has; empty where it is left out by hand alone.
    pub flags: Vec<Flag>,
    /// Who left it out by hand, if anybody did.
    pub by_hand: Option<ExcludedByHand>,
}

/// Why somebody is left out by hand: one line that says something.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExclusionReason(String);

/// A text that is no reason.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the reason has {found}; allowed: one line of 1 to {} characters",
    ExclusionReason::LONGEST
)]
pub struct ReasonError {
    found: String,
}

impl ExclusionReason {
    /// The longest reason, in characters.
    pub const LONGEST: usize = 200;

    /// Reads a reason; spaces around it are none of it.
    ///
    /// # Errors
    /// When it is empty, too long, or more than a line.
    pub fn new(text: &str) -> Result<Self, ReasonError> {
        let text = text.trim();
        let length = text.chars().count();
        if text.chars().any(char::is_control) {
            let found = "several lines or control characters".to_owned();
            return Err(ReasonError { found });
        }
        if !(1..=Self::LONGEST).contains(&length) {
            let found = format!("{length} characters");
            return Err(ReasonError { found });
        }
        Ok(Self(text.to_owned()))
    }
}

impl fmt::Display for ExclusionReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// That somebody was left out by hand.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExcludedByHand {
    /// Why.
    pub reason: String,
    /// The account, or `command` for a command on the server's machine.
    pub actor: String,
    /// When.
    pub at: Timestamp,
}

/// A change by hand.
#[derive(Debug)]
pub(super) struct ExclusionChange {
    pub(super) study: StudyId,
    pub(super) population: Population,
    pub(super) run: RunId,
    /// Why and by whom they are left out; none takes them in again.
    pub(super) because: Option<(String, String)>,
}

#[derive(sqlx::FromRow)]
struct ExclusionRow {
    flags: Option<String>,
    reason: Option<String>,
    actor: Option<String>,
    at_ms: Option<i64>,
}

impl Store {
    /// Leaves a participant out of the analysis, for a reason that somebody gives. Another reason replaces the first one.
    ///
    /// # Errors
    /// `NotFound` for a run that is not one of this study, `Refused` for one without answers: declined or withdrawn.
    pub async fn exclude(
        &self,
        study: &StudyId,
        population: Population,
        run: RunId,
        reason: ExclusionReason,
        actor: String,
    ) -> Result<(), Error> {
        self.change_exclusion(study, population, run, Some((reason.0, actor)))
            .await
    }

    /// Takes a participant into the analysis again who was left out by hand.
    ///
    /// # Errors
    /// `NotFound` for a run that is not one of this study, `Refused` for one that was not left out by hand.
    pub async fn include(
        &self,
        study: &StudyId,
        population: Population,
        run: RunId,
    ) -> Result<(), Error> {
        self.change_exclusion(study, population, run, None).await
    }

    async fn change_exclusion(
        &self,
        study: &StudyId,
        population: Population,
        run: RunId,
        because: Option<(String, String)>,
    ) -> Result<(), Error> {
        let change = ExclusionChange {
            study: study.clone(),
            population,
            run,
            because,
        };
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::Exclude(Box::new(change), now, ticket)))
            .await
    }

    /// Why a run is left out of the analysis; none for one that is not.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn exclusion(&self, run: RunId) -> Result<Option<Exclusion>, Error> {
        let row: Option<ExclusionRow> =
            sqlx::query_as("select flags, reason, actor, at_ms from exclusion where run_id = ?")
                .bind(run)
                .fetch_optional(&self.pool)
                .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let by_hand = match (row.reason, row.actor, row.at_ms) {
            (Some(reason), Some(actor), Some(at_ms)) => Some(ExcludedByHand {
                reason,
                actor,
                at: Timestamp(at_ms),
            }),
            (None, _, _) | (_, None, _) | (_, _, None) => None,
        };
        Ok(Some(Exclusion {
            flags: flags_of(row.flags.as_deref()),
            by_hand,
        }))
    }

    /// How many people of an analysis set are left out for what: each under the first flag of their study's rule, those
    /// who are left out by hand alone under none, who come last.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn exclusions(
        &self,
        study: &StudyId,
        population: Population,
        set: AnalysisSet,
    ) -> Result<Vec<(Option<Flag>, u64)>, Error> {
        let rows: Vec<(Option<String>, i64)> = sqlx::query_as(
            r#"
            select exclusion.flags, count(*)
            from exclusion
            join run on run.id = exclusion.run_id
            where run.study_id = ?1 and run.is_simulated = ?2
            and (run.state = 'completed' or not ?3)
            group by exclusion.flags
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(set == AnalysisSet::Completed)
        .fetch_all(&self.pool)
        .await?;
        let of = |wanted: Option<Flag>| -> u64 {
            rows.iter()
                .filter(|(flags, _)| flags_of(flags.as_deref()).first().copied() == wanted)
                .map(|(_, n)| u64::try_from(*n).unwrap_or(0))
                .sum()
        };
        let reasons = Flag::ALL.into_iter().map(Some).chain([None]);
        Ok(reasons
            .map(|reason| (reason, of(reason)))
            .filter(|(_, n)| *n > 0)
            .collect())
    }
}

/// The flags of a stored list.
fn flags_of(stored: Option<&str>) -> Vec<Flag> {
    let names = stored.unwrap_or_default().split(' ');
    names.filter_map(Flag::named).collect()
}

/// Whether runs are left out from now on, or counted again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Counted {
    LeftOut,
    Again,
}

/// Moves the answers of runs between what counts and what is left out. The versions stay.
async fn count(
    connection: &mut SqliteConnection,
    runs: &[RunId],
    counted: Counted,
) -> Result<(), sqlx::Error> {
    if runs.is_empty() {
        return Ok(());
    }
    let sign = match counted {
        Counted::LeftOut => 1,
        Counted::Again => -1,
    };
    sqlx::query(
        r#"
        update counter
        set excluded_all = excluded_all + ?2 * own.n, excluded_completed = excluded_completed + ?2 * own.n_completed
        from (
            select
                run.study_id, run.is_simulated, answer.problem_id, answer.status,
                ifnull(answer.action, '') as action, count(*) as n,
                count(*) filter (where run.state = 'completed') as n_completed
            from json_each(?1) as moved
            join run on run.id = moved.value
            join answer on answer.run_id = run.id
            where answer.is_counted = 1
            group by 1, 2, 3, 4, 5
        ) as own
        where counter.study_id = own.study_id
        and counter.is_simulated = own.is_simulated
        and counter.problem_id = own.problem_id
        and counter.status = own.status
        and counter.action = own.action
        "#,
    )
    .bind(json(&runs))
    .bind(sign)
    .execute(&mut *connection)
    .await?;
    sqlx::query(
        r#"
        update population
        set excluded = excluded + ?2 * own.n, excluded_completed = excluded_completed + ?2 * own.n_completed
        from (
            select
                run.study_id, run.is_simulated, count(*) as n,
                count(*) filter (where run.state = 'completed') as n_completed
            from json_each(?1) as moved
            join run on run.id = moved.value
            group by 1, 2
        ) as own
        where population.study_id = own.study_id
        and population.is_simulated = own.is_simulated
        "#,
    )
    .bind(json(&runs))
    .bind(sign)
    .execute(connection)
    .await?;
    Ok(())
}

/// Leaves a run out by hand, or takes it in again. Counts move in the same transaction, and looks at the first people who
/// finished are made anew; fits and comparisons see by the counts that they are behind.
pub(super) async fn change(
    connection: &mut SqliteConnection,
    change: &ExclusionChange,
    at: Timestamp,
) -> Result<(Result<(), Error>, Vec<Change>), sqlx::Error> {
    let found: Option<(String, bool, Option<String>, Option<String>)> = sqlx::query_as(
        r#"
        select run.state, exclusion.run_id is not null, exclusion.flags, exclusion.reason
        from run
        left join exclusion on exclusion.run_id = run.id
        where run.id = ? and run.study_id = ? and run.is_simulated = ? and run.is_preview = 0
        "#,
    )
    .bind(change.run)
    .bind(change.study.as_str())
    .bind(change.population.is_simulated())
    .fetch_optional(&mut *connection)
    .await?;
    let Some((state, was_excluded, flags, reason)) = found else {
        return Ok((Err(Error::NotFound("participant")), Vec::new()));
    };
    let run = change.run;
    let refused = |why: String| Ok((Err(Error::Refused(why)), Vec::new()));
    if let Some((reason, actor)) = &change.because {
        if [RunState::Declined, RunState::Withdrawn]
            .iter()
            .any(|without| state == without.as_str())
        {
            return refused(format!(
                "participant {run} is {state}: there are no answers to leave out"
            ));
        }
        sqlx::query(
            r#"
            insert into exclusion (run_id, reason, actor, at_ms)
            values (?, ?, ?, ?)
            on conflict do update set reason = excluded.reason, actor = excluded.actor, at_ms = excluded.at_ms
            "#,
        )
        .bind(run)
        .bind(reason)
        .bind(actor)
        .bind(at.0)
        .execute(&mut *connection)
        .await?;
    } else {
        if reason.is_none() {
            return refused(match flags {
                Some(_) => format!(
                    "participant {run} is left out by the study's rule, which was fixed when the study was published"
                ),
                None => format!("participant {run} is not left out"),
            });
        }
        let statement = match flags {
            Some(_) => {
                "update exclusion set reason = null, actor = null, at_ms = null where run_id = ?"
            }
            None => "delete from exclusion where run_id = ?",
        };
        sqlx::query(statement)
            .bind(run)
            .execute(&mut *connection)
            .await?;
    }
    let counted = match (&change.because, was_excluded, flags) {
        (Some(_), false, _) => Counted::LeftOut,
        (None, _, None) => Counted::Again,
        // Left out before and after: only the reason is another one.
        (Some(_), true, _) | (None, _, Some(_)) => return Ok((Ok(()), Vec::new())),
    };
    count(connection, &[run], counted).await?;
    let changed: Vec<(String, bool, i64, i64)> = sqlx::query_as(
        r#"
        update population
        set
            data_version = data_version + 1, page_version = page_version + 1, exclusion_version = data_version + 1
        where study_id = ? and is_simulated = ?
        returning study_id, is_simulated, data_version, page_version
        "#,
    )
    .bind(change.study.as_str())
    .bind(change.population.is_simulated())
    .fetch_all(&mut *connection)
    .await?;
    sqlx::query("delete from checkpoint where study_id = ? and is_simulated = ?")
        .bind(change.study.as_str())
        .bind(change.population.is_simulated())
        .execute(connection)
        .await?;
    Ok((Ok(()), changed.into_iter().map(Change::from).collect()))
}
