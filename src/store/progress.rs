//! How a study is going: where people are, where they stop, and how long they take.
//!
//! Everything here is counted when it is asked for, in one pass over a study's runs, steps and answers each; withdrawn
//! people have none of these any more, and previews are left out.

use super::{Error, Population, RunState, Store};
use crate::study::{BlockId, QuestionId, StudyId, Timestamp};

/// Answer times are counted in classes of this width, so that a median needs no sorting of all answers.
const CLASS_MS: i64 = 100;

/// Who is at a step for longer than this without answering has left.
pub const LEFT_AFTER_MS: i64 = 30 * 60 * 1_000;

/// What became of the people who came to one step, wherever in their run they met it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StepProgress {
    /// Its kind, as it is stored.
    pub kind: String,
    /// Its block.
    pub block: BlockId,
    /// The question, for choices.
    pub question: Option<QuestionId>,
    /// Who came to it.
    pub reached: u64,
    /// Who answered it, in time where there is a limit.
    pub answered: u64,
    /// Who answered it too late.
    pub late: u64,
    /// For whom its time ran out.
    pub timed_out: u64,
    /// Who is at it now.
    pub here: u64,
    /// Who got no further: their run ended there, or they have been gone for [`LEFT_AFTER_MS`].
    pub left: u64,
    /// The median time from the page to its answer, to a tenth of a second.
    pub median_ms: Option<u64>,
}

#[derive(sqlx::FromRow)]
struct Class {
    kind: String,
    block: String,
    question: Option<String>,
    /// The answer time in classes, for answers in time whose page was seen.
    class: Option<i64>,
    reached: i64,
    answered: i64,
    late: i64,
    timed_out: i64,
    /// The sum of the places at which people met the step.
    places: i64,
}

#[derive(sqlx::FromRow)]
struct Stop {
    kind: String,
    block: String,
    question: Option<String>,
    here: i64,
    n: i64,
}

impl Store {
    /// What became of the people who came to each step, in the order in which people mostly meet the steps.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn step_progress(
        &self,
        study: &StudyId,
        population: Population,
    ) -> Result<Vec<StepProgress>, Error> {
        let classes: Vec<Class> = sqlx::query_as(
            r#"
            select
                step.kind, step.block, step.question,
                iif(answer.status = 'answered', answer.server_ms / ?3, null) as class,
                count(*) as reached,
                count(answer.event_id) filter (where answer.status = 'answered') as answered,
                count(answer.event_id) filter (where answer.status = 'late') as late,
                count(answer.event_id) filter (where answer.status = 'timed_out') as timed_out,
                sum(step.position) as places
            from run
            cross join step on step.run_id = run.id
                -- an answer that ends a run leads on to a step that is never shown
                and step.position <= run.position - (run.state in ('declined', 'screened_out', 'failed_check'))
            left join answer on answer.run_id = step.run_id and answer.position = step.position
            where run.study_id = ?1 and run.is_simulated = ?2 and run.is_preview = 0
            group by step.kind, step.block, step.question, class
            order by class
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(CLASS_MS)
        .fetch_all(&self.pool)
        .await?;
        let stops: Vec<Stop> = sqlx::query_as(
            r#"
            select
                step.kind, step.block, step.question,
                run.state = 'active' and run.has_times
                and ifnull(run.shown_at_ms, run.started_at_ms) >= ?3 as here,
                count(*) as n
            from run
            join step on step.run_id = run.id
                and step.position = run.position - (run.state in ('declined', 'screened_out', 'failed_check'))
            where run.study_id = ?1 and run.is_simulated = ?2 and run.is_preview = 0
            and run.state <> 'completed'
            group by step.kind, step.block, step.question, here
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .bind(self.now().0 - LEFT_AFTER_MS)
        .fetch_all(&self.pool)
        .await?;
        Ok(steps(classes, &stops))
    }

    /// The median time of completed runs from the start to the end.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn median_duration_ms(
        &self,
        study: &StudyId,
        population: Population,
    ) -> Result<Option<u64>, Error> {
        let median: Option<f64> = sqlx::query_scalar(
            r#"
            with
                duration as (
                    select finished_at_ms - started_at_ms as ms
                    from run
                    where study_id = ?1 and is_simulated = ?2 and is_preview = 0
                    and state = 'completed' and finished_at_ms is not null and has_times
                ),
                total as (select count(*) as n from duration)
            select avg(ms)
            from (
                select ms
                from duration
                order by ms
                -- the one in the middle, or the two
                limit (select 2 - n % 2 from total)
                offset (select max(n - 1, 0) / 2 from total)
            )
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_one(&self.pool)
        .await?;
        Ok(median.map(|ms| ms.round() as u64))
    }

    /// When somebody answered last.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn last_answer(
        &self,
        study: &StudyId,
        population: Population,
    ) -> Result<Option<Timestamp>, Error> {
        let at: Option<i64> = sqlx::query_scalar(
            r#"
            select answer.answered_at_ms
            from answer
            -- cross join: the newest answers first, until one is of this study
            cross join run on run.id = answer.run_id
            where run.study_id = ? and run.is_simulated = ? and run.is_preview = 0 and run.has_times
            order by answer.event_id desc
            limit 1
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_optional(&self.pool)
        .await?;
        Ok(at.map(Timestamp))
    }

    /// How many runs each source sent, by what became of them: ordered by source, people without one first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn runs_by_source(
        &self,
        study: &StudyId,
        population: Population,
    ) -> Result<Vec<(Option<String>, RunState, u64)>, Error> {
        let rows: Vec<(Option<String>, String, i64)> = sqlx::query_as(
            r#"
            select source, state, count(*)
            from run
            where study_id = ? and is_simulated = ? and is_preview = 0
            group by source, state
            order by source, state
            "#,
        )
        .bind(study.as_str())
        .bind(population.is_simulated())
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter()
            .map(|(source, state, n)| {
                let state = state
                    .parse()
                    .map_err(|err| sqlx::Error::Decode(Box::new(err)))?;
                Ok((source, state, count(n)))
            })
            .collect()
    }
}

/// A step while its classes are added up.
struct Sums {
    step: StepProgress,
    /// The sum of the places at which people met it.
    places: u64,
    /// Answer times in ascending order, each with how often it was found.
    times: Vec<(u64, u64)>,
}

impl Sums {
    fn of(class: &Class) -> Self {
        let step = StepProgress {
            kind: class.kind.clone(),
            block: BlockId::from(class.block.clone()),
            question: class.question.clone().map(QuestionId::from),
            reached: 0,
            answered: 0,
            late: 0,
            timed_out: 0,
            here: 0,
            left: 0,
            median_ms: None,
        };
        Self {
            step,
            places: 0,
            times: Vec::new(),
        }
    }

    /// Where in their runs people met it on average.
    fn place(&self) -> f64 {
        self.places as f64 / self.step.reached.max(1) as f64
    }
}

/// Adds the classes of each step up; they come in order of time.
fn steps(classes: Vec<Class>, stops: &[Stop]) -> Vec<StepProgress> {
    let mut found: Vec<Sums> = Vec::new();
    for class in classes {
        let question = class.question.as_deref();
        let index = found
            .iter()
            .position(|sums| is_of(&sums.step, &class.kind, &class.block, question));
        let index = index.unwrap_or_else(|| {
            found.push(Sums::of(&class));
            found.len() - 1
        });
        let sums = &mut found[index];
        sums.step.reached += count(class.reached);
        sums.step.answered += count(class.answered);
        sums.step.late += count(class.late);
        sums.step.timed_out += count(class.timed_out);
        sums.places += count(class.places);
        if let Some(time) = class.class {
            let middle = count(time * CLASS_MS + CLASS_MS / 2);
            sums.times.push((middle, count(class.answered)));
        }
    }
    found.sort_by(|one, other| one.place().total_cmp(&other.place()));
    found
        .into_iter()
        .map(|sums| finished(sums, stops))
        .collect()
}

/// The step with its median and with those who are at it or stopped there.
fn finished(sums: Sums, stops: &[Stop]) -> StepProgress {
    let mut step = sums.step;
    step.median_ms = weighted_median(&sums.times);
    for stop in stops {
        if is_of(&step, &stop.kind, &stop.block, stop.question.as_deref()) {
            let n = count(stop.n);
            if stop.here != 0 {
                step.here += n;
            } else {
                step.left += n;
            }
        }
    }
    step
}

fn is_of(step: &StepProgress, kind: &str, block: &str, question: Option<&str>) -> bool {
    step.kind == kind
        && step.block == *block
        && step.question.as_ref().map(QuestionId::as_str) == question
}

/// The value in the middle of values in ascending order, each with how often it was found.
fn weighted_median(values: &[(u64, u64)]) -> Option<u64> {
    let total: u64 = values.iter().map(|(_, n)| n).sum();
    let mut before = 0;
    values
        .iter()
        .find(|(_, n)| {
            before += n;
            2 * before >= total && total > 0
        })
        .map(|(value, _)| *value)
}

fn count(stored: i64) -> u64 {
    u64::try_from(stored).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_classes_lies_in_the_class_of_the_middle_answer() {
        assert_eq!(weighted_median(&[]), None);
        assert_eq!(weighted_median(&[(50, 0)]), None);
        assert_eq!(weighted_median(&[(50, 1)]), Some(50));
        assert_eq!(weighted_median(&[(50, 2), (150, 2), (900, 1)]), Some(150));
        assert_eq!(weighted_median(&[(50, 1), (950, 6)]), Some(950));
    }
}
