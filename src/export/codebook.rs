//! The codebook: what every column of every table holds.

use std::io;

use serde::Serialize;

use super::columns::{self, Column, Level};
use super::{Export, ExportError, wide_columns};

/// Every column of the tables.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct Codebook {
    /// The study.
    pub study: String,
    /// Its title.
    pub title: String,
    /// SHA-256 of its current file.
    pub study_hash: String,
    /// The program that describes the columns.
    pub program_version: &'static str,
    /// The tables.
    pub tables: Vec<Table>,
}

/// A table of the data.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct Table {
    /// Its name.
    pub name: &'static str,
    /// What a row of it is.
    pub rows: &'static str,
    /// Its columns in order.
    pub columns: Vec<Column>,
}

impl Codebook {
    pub(super) fn new(export: &Export) -> Self {
        Self {
            study: export.study.id().to_string(),
            title: export.study.title().to_owned(),
            study_hash: export.study.hash().to_owned(),
            program_version: env!("CARGO_PKG_VERSION"),
            tables: vec![
                Table {
                    name: "answers",
                    rows: "one row per question shown to a participant (long form)",
                    columns: columns::long(export),
                },
                Table {
                    name: "participants",
                    rows: "one row per participant (wide form)",
                    columns: wide_columns::all(export)
                        .into_iter()
                        .map(|column| column.column)
                        .collect(),
                },
            ],
        }
    }

    /// One row per column of each table.
    pub(super) fn write_csv(&self, out: &mut dyn io::Write) -> Result<u64, ExportError> {
        let mut writer = csv::Writer::from_writer(out);
        writer.write_record([
            "table",
            "column",
            "label",
            "type",
            "unit",
            "description",
            "levels",
            "missing",
        ])?;
        let mut count = 0;
        for table in &self.tables {
            for column in &table.columns {
                writer.write_record([
                    table.name,
                    &super::cell::text(&column.name),
                    &super::cell::text(&column.label),
                    column.kind.as_str(),
                    column.unit.as_deref().unwrap_or_default(),
                    &super::cell::text(&column.description),
                    &super::cell::text(&listed(&column.levels)),
                    &super::cell::text(&listed(&column.missing)),
                ])?;
                count += 1;
            }
        }
        writer.flush()?;
        Ok(count)
    }

    /// The same with its nesting.
    pub(super) fn write_json(&self, out: &mut dyn io::Write) -> Result<u64, ExportError> {
        serde_json::to_writer_pretty(&mut *out, self)?;
        out.write_all(b"\n")?;
        Ok(self
            .tables
            .iter()
            .map(|table| table.columns.len() as u64)
            .sum())
    }
}

/// Levels in one cell.
fn listed(levels: &[Level]) -> String {
    let parts: Vec<String> = levels
        .iter()
        .map(|level| format!("{} = {}", level.code, level.label))
        .collect();
    parts.join("; ")
}
