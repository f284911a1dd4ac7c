//! Answers from elsewhere: a table in the long form, or in other words with a [`Mapping`], read into runs that the store can
//! take.
//!
//! A file is read as a whole: either every row is understood, or all that is wrong is told ([`Faults`]) and nothing is stored.

mod columns;
mod fault;
mod mapping;
mod people;
mod questions;
mod row;

use columns::Columns;
pub use fault::{Fault, Faults};
pub use mapping::{Mapping, MappingError};
use people::People;
use questions::Questions;
use row::Row;

use crate::store::ImportedRun;
use crate::study::{Study, Timestamp};

const UTF_8: &str = "UTF-8; save the file as CSV in UTF-8";
/// What spreadsheets write before UTF-8.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// A file that was understood.
#[derive(Debug)]
pub struct Imported {
    /// Everybody in it, in the order of their first rows.
    pub runs: Vec<ImportedRun>,
    /// Rows that became answers.
    pub answers: u64,
    /// Rows of practice questions, which are not imported.
    pub left_out: u64,
}

/// Reads a table: CSV in UTF-8, separated by commas, semicolons or tabs, whichever its first line has most of. Runs whose
/// rows tell no moments get `now`, and are marked.
///
/// # Errors
/// Every faulty cell.
pub fn read(
    study: &Study,
    mapping: &Mapping,
    now: Timestamp,
    file: &[u8],
) -> Result<Imported, Faults> {
    let text = text_of(file)?;
    let questions = Questions::of(study);
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator(&text))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let header = match reader.headers() {
        Ok(header) => header.clone(),
        Err(error) => return Err(unreadable(&error).into()),
    };
    let columns = Columns::find(study, mapping, &header)?;
    let mut people = People::default();
    let mut faults = Faults::default();
    for record in reader.records() {
        match record {
            Ok(record) => {
                let row = Row::new(&columns, mapping, &record);
                faults.extend(people.add(row.read(&questions, now), &row));
            }
            Err(error) => faults.extend([unreadable(&error)]),
        }
    }
    if faults.is_empty() && people.is_empty() {
        faults.extend([Fault {
            line: 1,
            column: columns.called("participant").to_owned(),
            value: "no rows".to_owned(),
            allowed: "at least one answer to a question that is no practice".to_owned(),
        }]);
    }
    if faults.is_empty() {
        Ok(people.imported())
    } else {
        Err(faults)
    }
}

/// The file as text with line feeds alone: the reader of CSV counts a line's carriage return to the line before.
fn text_of(file: &[u8]) -> Result<String, Fault> {
    if file.starts_with(&[0xff, 0xfe]) || file.starts_with(&[0xfe, 0xff]) {
        return Err(of_file("text in UTF-16", UTF_8));
    }
    let text = std::str::from_utf8(file).map_err(|error| {
        let before = &file[..error.valid_up_to()];
        let lines = before.iter().filter(|byte| **byte == b'\n').count();
        Fault {
            line: lines as u64 + 1,
            ..of_file("bytes that are no UTF-8", UTF_8)
        }
    })?;
    let text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text);
    if text.trim().is_empty() {
        return Err(of_file("an empty file", "a header and a row per answer"));
    }
    Ok(text.replace("\r\n", "\n").replace('\r', "\n"))
}

/// What stands between the cells: spreadsheets write semicolons where a comma is the decimal sign.
fn separator(text: &str) -> u8 {
    let header = text.lines().next().unwrap_or("");
    let count = |separator: u8| header.bytes().filter(|byte| *byte == separator).count();
    let mut found = b',';
    for other in [b';', b'\t'] {
        if count(other) > count(found) {
            found = other;
        }
    }
    found
}

fn of_file(value: &str, allowed: &str) -> Fault {
    Fault {
        line: 1,
        column: "(the whole file)".to_owned(),
        value: value.to_owned(),
        allowed: allowed.to_owned(),
    }
}

fn unreadable(error: &csv::Error) -> Fault {
    let (value, allowed) = match error.kind() {
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => (
            format!("{len} cells"),
            format!("{expected_len} cells, as the header has"),
        ),
        _ => (error.to_string(), "CSV".to_owned()),
    };
    Fault {
        line: error.position().map_or(1, csv::Position::line),
        column: "(the whole line)".to_owned(),
        value,
        allowed,
    }
}
