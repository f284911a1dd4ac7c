//! One row per question shown: `answers.csv` and `answers.ndjson`.

use std::io;

use serde::Serialize;

use super::cell::{number, text};
use super::columns::LONG_BEFORE_FACTORS;
use super::{Column, Export, ExportError, columns};
use crate::model::OrderedMap;
use crate::store::{AnswerKey, AnswerRow, AnswerStatus, RunState};
use crate::study::Study;

/// Rows that are read at once.
const PAGE_ROWS: u32 = 2_000;

/// An answer in the long form.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Answer<'a> {
    study: &'a str,
    version: i64,
    participant: i64,
    run_state: RunState,
    block: &'a str,
    position: u32,
    question: &'a str,
    problem: String,
    #[schema(value_type = HashMap<String, String>)]
    levels: OrderedMap<&'a str>,
    #[schema(value_type = Option<String>)]
    action: Option<&'a str>,
    status: AnswerStatus,
    shown_at_ms: Option<i64>,
    /// Null where an import did not tell.
    answered_at_ms: Option<i64>,
    server_ms: Option<u64>,
    client_rt_ms: Option<u64>,
    limit_ms: Option<u64>,
    #[schema(value_type = Option<String>)]
    input: Option<&'a str>,
    hidden_ms: Option<u64>,
    #[schema(value_type = Option<String>)]
    source: Option<&'a str>,
    simulated: bool,
}

impl<'a> Answer<'a> {
    /// `study` is the version that the answer was given under.
    pub fn new(study: &'a Study, row: &'a AnswerRow) -> Self {
        let question = row
            .question
            .as_ref()
            .map_or("", |question| question.as_str());
        let problem = row
            .problem
            .clone()
            .unwrap_or_else(|| format!("{}:{question}", row.block));
        let levels = study
            .cell(&problem)
            .map(|cell| cell.levels.as_slice())
            .unwrap_or_default();
        Self {
            study: study.id().as_str(),
            version: row.version_number.get(),
            participant: row.key.run.get(),
            run_state: row.run_state,
            block: row.block.as_str(),
            position: row.key.position,
            question,
            levels: levels
                .iter()
                .map(|(factor, level)| (factor.to_string(), level.as_str()))
                .collect(),
            problem,
            action: row.action.as_ref().map(|action| action.as_str()),
            status: row.status,
            shown_at_ms: row.shown_at.map(|at| at.0),
            answered_at_ms: row.answered_at.map(|at| at.0),
            server_ms: row.server_ms,
            client_rt_ms: row.client_rt_ms,
            limit_ms: row.limit_ms,
            input: row.input.as_deref(),
            hidden_ms: row.hidden_ms,
            source: row.source.as_deref(),
            simulated: row.population.is_simulated(),
        }
    }

    /// The cells of its row, in the order of [`columns::long`].
    fn record(&self, factors: &[String]) -> Vec<String> {
        let mut record = Vec::with_capacity(LONG_BEFORE_FACTORS + factors.len() + 11);
        record.extend([
            text(self.study),
            self.version.to_string(),
            self.participant.to_string(),
            self.run_state.to_string(),
            text(self.block),
            self.position.to_string(),
            text(self.question),
            text(&self.problem),
        ]);
        record.extend(
            factors
                .iter()
                .map(|factor| text(self.levels.get(factor).copied().unwrap_or_default())),
        );
        record.extend([
            text(self.action.unwrap_or_default()),
            self.status.to_string(),
            number(self.shown_at_ms),
            number(self.answered_at_ms),
            number(self.server_ms),
            number(self.client_rt_ms),
            number(self.limit_ms),
            text(self.input.unwrap_or_default()),
            number(self.hidden_ms),
            text(self.source.unwrap_or_default()),
            self.simulated.to_string(),
        ]);
        record
    }
}

pub(super) fn csv(export: &Export, out: &mut dyn io::Write) -> Result<u64, ExportError> {
    let factors = factor_ids(export.versions_current_first());
    let mut writer = headed(&columns::long(export), out)?;
    let rows = each(export, |answer| {
        writer.write_record(answer.record(&factors))?;
        Ok(())
    })?;
    writer.flush()?;
    Ok(rows)
}

/// Writes answers that no database holds, such as those of simulated people, as an export would write them, and says how many
/// there are. All were given under one version of the study.
///
/// # Errors
/// When an answer fails to come, or `out` takes no more.
pub fn write_unstored<E: From<csv::Error> + From<io::Error>>(
    study: &Study,
    answers: impl IntoIterator<Item = Result<AnswerRow, E>>,
    out: &mut dyn io::Write,
) -> Result<u64, E> {
    let factors = factor_ids(std::iter::once(study));
    let mut writer = headed(&columns::long_unstored(study), out)?;
    let mut rows = 0;
    for row in answers {
        writer.write_record(Answer::new(study, &row?).record(&factors))?;
        rows += 1;
    }
    writer.flush()?;
    Ok(rows)
}

fn factor_ids<'a>(studies: impl Iterator<Item = &'a Study>) -> Vec<String> {
    let factors = columns::factors(studies);
    factors.into_iter().map(|factor| factor.id).collect()
}

fn headed<'a>(
    header: &[Column],
    out: &'a mut dyn io::Write,
) -> Result<csv::Writer<&'a mut dyn io::Write>, csv::Error> {
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(header.iter().map(|column| column.name.as_str()))?;
    Ok(writer)
}

pub(super) fn ndjson(export: &Export, out: &mut dyn io::Write) -> Result<u64, ExportError> {
    let mut out = io::BufWriter::new(out);
    let rows = each(export, |answer| {
        serde_json::to_writer(&mut out, &answer)?;
        io::Write::write_all(&mut out, b"\n")?;
        Ok(())
    })?;
    io::Write::flush(&mut out)?;
    Ok(rows)
}

/// Reads all answers page by page.
fn each(
    export: &Export,
    mut write: impl FnMut(Answer<'_>) -> Result<(), ExportError>,
) -> Result<u64, ExportError> {
    let mut after = AnswerKey::START;
    let mut count = 0;
    loop {
        let rows = export.runtime.block_on(export.store.answers(
            export.study.id(),
            export.population,
            after,
            PAGE_ROWS,
        ))?;
        for row in &rows {
            write(Answer::new(export.versions.of(row.version), row))?;
        }
        count += rows.len() as u64;
        match rows.last() {
            Some(last) if rows.len() == PAGE_ROWS as usize => after = last.key,
            Some(_) | None => return Ok(count),
        }
    }
}
