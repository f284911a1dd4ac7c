//! A table as plain text, made here so that the page works without scripts. static/js/figures/tables.mjs replaces its rows when
//! the numbers change.

use serde::{Serialize, Serializer, ser::SerializeStruct};

/// One table.
#[derive(Debug, Default, Serialize)]
pub(in crate::web) struct Table {
    pub columns: Vec<Column>,
    pub rows: Vec<Vec<Cell>>,
}

#[derive(Debug)]
pub(in crate::web) struct Column {
    pub label: &'static str,
    pub align: Align,
}

/// How a column is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::web) enum Align {
    Words,
    Numbers,
    /// Long texts that may take several lines.
    Prose,
}

#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(in crate::web) enum Cell {
    Text(String),
    /// A state, marked by colour and shape as well as by its word.
    State {
        #[serde(rename = "state")]
        id: &'static str,
        #[serde(rename = "text")]
        word: &'static str,
    },
}

impl Table {
    pub(in crate::web) fn new(columns: &[(&'static str, Align)]) -> Self {
        Self {
            columns: columns
                .iter()
                .map(|&(label, align)| Column { label, align })
                .collect(),
            rows: Vec::new(),
        }
    }

    pub(in crate::web) fn row(&mut self, cells: impl IntoIterator<Item = impl Into<Cell>>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// The class of the column with this number, as the style sheet names it.
    pub(in crate::web) fn class(&self, index: &usize) -> &'static str {
        match self.columns.get(*index).map(|column| column.align) {
            Some(Align::Numbers) => "numeric",
            Some(Align::Prose) => "wraps",
            Some(Align::Words) | None => "",
        }
    }
}

/// As static/js/figures/table-view.mjs reads it.
impl Serialize for Column {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut column = serializer.serialize_struct("Column", 3)?;
        column.serialize_field("label", self.label)?;
        column.serialize_field("numeric", &(self.align == Align::Numbers))?;
        column.serialize_field("wraps", &(self.align == Align::Prose))?;
        column.end()
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}
