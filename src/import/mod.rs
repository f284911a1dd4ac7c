//! Answers from elsewhere: a table in the long form, or in other words with a [`Mapping`], read into runs that the store can
//! take.
//!
//! A file is read as a whole: either every row is understood, or all [`Fault`]s are told and nothing is stored.

mod mapping;
mod questions;
mod row;

use std::collections::HashMap;
use std::io;

pub use mapping::{Mapping, MappingError};
use questions::Questions;
use row::{Asked, Columns};

use crate::store::ImportedRun;
use crate::study::{Study, Timestamp};

/// A cell that cannot be taken.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: found `{value}`; allowed: {allowed}")]
pub struct Fault {
    /// The line in the file, from 1.
    pub line: u64,
    /// The column as the file calls it.
    pub column: String,
    /// What stands there.
    pub value: String,
    /// What could.
    pub allowed: String,
}

/// A file that was understood.
#[derive(Debug)]
pub struct Imported {
    /// Everybody in it, in the order of their first rows.
    pub runs: Vec<ImportedRun>,
    /// Rows that became answers.
    pub answers: u64,
    /// Rows of practice questions and of questions that were never answered, which are not imported.
    pub left_out: u64,
}

/// Reads a table. `now` stands for times that it does not tell.
///
/// # Errors
/// Every faulty cell.
pub fn read(
    study: &Study,
    mapping: &Mapping,
    now: Timestamp,
    file: impl io::Read,
) -> Result<Imported, Vec<Fault>> {
    let questions = Questions::of(study);
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(file);
    let columns = match reader.headers() {
        Ok(header) => Columns::find(study, mapping, header)?,
        Err(error) => return Err(vec![unreadable(&error)]),
    };
    let mut people = People::default();
    let mut faults = Vec::new();
    for record in reader.records() {
        let record = match record {
            Ok(record) => record,
            Err(error) => {
                faults.push(unreadable(&error));
                continue;
            }
        };
        match columns.read(mapping, &questions, &record, now) {
            Ok(Asked::LeftOut) => people.left_out += 1,
            Ok(Asked::Choice(answer)) => faults.extend(people.add(*answer)),
            Err(found) => {
                debug_assert!(!found.is_empty(), "a refused row without a fault is lost");
                faults.extend(found);
            }
        }
    }
    if faults.is_empty() && people.runs.is_empty() {
        faults.push(Fault {
            line: 1,
            column: columns.participant_name().to_owned(),
            value: "no rows".to_owned(),
            allowed: "at least one answer to a question that is no practice".to_owned(),
        });
    }
    if !faults.is_empty() {
        faults.sort_by_key(|fault| fault.line);
        return Err(faults);
    }
    Ok(Imported {
        answers: people.runs.iter().map(|run| run.answers.len() as u64).sum(),
        runs: people.runs,
        left_out: people.left_out,
    })
}

/// People by what the file calls them.
#[derive(Default)]
struct People {
    runs: Vec<ImportedRun>,
    places: HashMap<String, usize>,
    left_out: u64,
}

impl People {
    fn add(&mut self, answer: row::Answer) -> Option<Fault> {
        let place = *self
            .places
            .entry(answer.participant.clone())
            .or_insert_with(|| {
                self.runs.push(ImportedRun {
                    participant: answer.participant.clone(),
                    answers: Vec::new(),
                    is_completed: answer.is_completed,
                });
                self.runs.len() - 1
            });
        let run = &mut self.runs[place];
        let plan = &answer.answer.step.plan;
        let is_second = run.answers.iter().any(|known| {
            known.step.plan.block == plan.block && known.step.plan.question == plan.question
        });
        if is_second {
            return Some(answer.twice);
        }
        run.is_completed &= answer.is_completed;
        run.answers.push(answer.answer);
        None
    }
}

fn unreadable(error: &csv::Error) -> Fault {
    Fault {
        line: error.position().map_or(1, csv::Position::line),
        column: "(the whole line)".to_owned(),
        value: error.to_string(),
        allowed: "UTF-8, comma-separated, as many cells as the header has".to_owned(),
    }
}
