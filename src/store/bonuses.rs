//! Bonuses: drawn in the commit that completes a run.

use std::collections::BTreeMap;

use serde::Serialize;
use sqlx::sqlite::SqliteConnection;

use super::{Error, RunId, Store, json};
use crate::study::{BlockId, BonusTerms, PayableChoice, QuestionId, StepData, Timestamp};

/// The bonus of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct BonusRow {
    /// The run.
    pub run: RunId,
    /// The choice that was drawn; none where no choice could be, and the endowment alone is paid.
    pub choice: Option<PaidChoice>,
    /// What is paid, in `currency`.
    pub amount: f64,
    /// The currency's code by ISO 4217.
    pub currency: String,
    /// When it was drawn.
    pub drawn_at: Timestamp,
}

/// The choice that a bonus comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct PaidChoice {
    /// The step that asked.
    pub position: u32,
    /// Its block.
    pub block: BlockId,
    /// Its question.
    pub question: Option<QuestionId>,
    /// What was chosen.
    pub action: String,
    /// The reward of the outcome that came out, in the study's reward unit.
    pub reward: f64,
}

#[derive(sqlx::FromRow)]
struct Row {
    run_id: RunId,
    position: Option<u32>,
    block: Option<String>,
    question: Option<String>,
    action: Option<String>,
    reward: Option<f64>,
    amount: f64,
    currency: Option<String>,
    drawn_at_ms: i64,
}

impl From<Row> for BonusRow {
    fn from(row: Row) -> Self {
        let choice = match (row.position, row.block, row.action, row.reward) {
            (Some(position), Some(block), Some(action), Some(reward)) => Some(PaidChoice {
                position,
                block: block.into(),
                question: row.question.map(QuestionId::from),
                action,
                reward,
            }),
            (None, _, _, _) | (_, None, _, _) | (_, _, None, _) | (_, _, _, None) => None,
        };
        Self {
            run: row.run_id,
            choice,
            amount: row.amount,
            currency: row.currency.unwrap_or_default(),
            drawn_at: Timestamp(row.drawn_at_ms),
        }
    }
}

impl Store {
    /// The bonus of a run; `None` while it is under way, and in a study without one.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn bonus(&self, run: RunId) -> Result<Option<BonusRow>, Error> {
        let row: Option<Row> = sqlx::query_as(
            r#"
            select
                bonus.run_id, bonus.position, step.block, step.question, bonus.action, bonus.reward,
                bonus.amount, thanks.data ->> '$.bonus.currency' as currency, bonus.drawn_at_ms
            from bonus
            join run on run.id = bonus.run_id
            left join step as thanks on thanks.run_id = run.id and thanks.position = run.position
            left join step on step.run_id = run.id and step.position = bonus.position
            where bonus.run_id = ?
            "#,
        )
        .bind(run)
        .fetch_optional(&self.pool)
        .await?;
        Ok(row.map(BonusRow::from))
    }
}

#[derive(Serialize)]
struct NewBonus {
    run: RunId,
    position: Option<u32>,
    action: Option<String>,
    reward: Option<f64>,
    amount: f64,
    at: i64,
}

/// Draws the bonuses of runs that were just completed, after their answers were written. A run has one draw ever, made
/// from the seed that it began with.
pub(super) async fn draw(
    connection: &mut SqliteConnection,
    completed: &[(RunId, Timestamp)],
) -> Result<(), sqlx::Error> {
    if completed.is_empty() {
        return Ok(());
    }
    let runs: Vec<RunId> = completed.iter().map(|(run, _)| *run).collect();
    let terms = terms(connection, &runs).await?;
    if terms.is_empty() {
        return Ok(());
    }
    let paid: Vec<RunId> = terms.keys().copied().collect();
    let choices = payable_choices(connection, &paid).await?;
    let rows: Vec<NewBonus> = completed
        .iter()
        .filter_map(|(run, at)| Some((run, at, terms.get(run)?)))
        .map(|(run, at, terms)| {
            let drawn = terms.draw(choices.get(run).map_or(&[], Vec::as_slice));
            NewBonus {
                run: *run,
                position: drawn.as_ref().map(|drawn| drawn.position),
                reward: drawn.as_ref().map(|drawn| drawn.reward),
                amount: terms
                    .bonus
                    .amount(drawn.as_ref().map_or(0.0, |drawn| drawn.reward)),
                action: drawn.map(|drawn| drawn.action.to_string()),
                at: at.0,
            }
        })
        .collect();
    sqlx::query(
        r#"
        insert into bonus (run_id, position, action, reward, amount, drawn_at_ms)
        select
            value ->> 'run', value ->> 'position', value ->> 'action', value ->> 'reward', value ->> 'amount',
            value ->> 'at'
        from json_each(?)
        "#,
    )
    .bind(json(&rows))
    .execute(connection)
    .await?;
    Ok(())
}

/// What is paid for each run, where something is.
async fn terms(
    connection: &mut SqliteConnection,
    runs: &[RunId],
) -> Result<BTreeMap<RunId, BonusTerms>, sqlx::Error> {
    let rows: Vec<(RunId, String)> = sqlx::query_as(
        r#"
        select run.id, step.data
        from json_each(?) as asked
        join run on run.id = asked.value
        join step on step.run_id = run.id and step.position = run.position
        where step.kind = 'thanks'
        and step.data ->> 'bonus' is not null
        "#,
    )
    .bind(json(&runs))
    .fetch_all(connection)
    .await?;
    let mut terms = BTreeMap::new();
    for (run, data) in rows {
        let data: StepData =
            serde_json::from_str(&data).map_err(|err| sqlx::Error::Decode(err.into()))?;
        terms.extend(data.bonus.map(|bonus| (run, bonus)));
    }
    Ok(terms)
}

/// The choices of runs that may be drawn, in the order of their steps.
async fn payable_choices(
    connection: &mut SqliteConnection,
    runs: &[RunId],
) -> Result<BTreeMap<RunId, Vec<PayableChoice>>, sqlx::Error> {
    let rows: Vec<(RunId, u32, String, String)> = sqlx::query_as(
        r#"
        select answer.run_id, answer.position, answer.action, problem.prospects
        from json_each(?) as asked
        join answer on answer.run_id = asked.value
        -- practice has no problem, and a question that withholds something has no prospects
        join problem on problem.id = answer.problem_id
        where answer.status = 'answered'
        and answer.action is not null
        and problem.prospects is not null
        order by answer.run_id, answer.position
        "#,
    )
    .bind(json(&runs))
    .fetch_all(connection)
    .await?;
    let mut choices: BTreeMap<RunId, Vec<PayableChoice>> = BTreeMap::new();
    for (run, position, action, prospects) in rows {
        let problem =
            serde_json::from_str(&prospects).map_err(|err| sqlx::Error::Decode(err.into()))?;
        choices.entry(run).or_default().push(PayableChoice {
            position,
            action: action.into(),
            problem,
        });
    }
    Ok(choices)
}
