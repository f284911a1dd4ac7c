//! How a file's columns and values are called here.

use std::collections::BTreeMap;

use serde::Deserialize;

/// Names and values of a file in other words. Whatever it does not mention is taken as it is.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mapping {
    /// Our column, and what the file calls it.
    #[serde(default)]
    columns: BTreeMap<String, String>,
    /// For our column: the file's value, and ours.
    #[serde(default)]
    values: BTreeMap<String, BTreeMap<String, String>>,
}

/// Why a mapping is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct MappingError(String);

impl Mapping {
    /// Parses a mapping file (TOML) for a study whose columns are `allowed`.
    ///
    /// # Errors
    /// When it is no TOML, or names a column that does not exist.
    pub fn parse(text: &str, allowed: &[String]) -> Result<Self, MappingError> {
        let mapping: Self =
            toml::from_str(text).map_err(|error| MappingError(error.to_string()))?;
        for column in mapping.columns.keys().chain(mapping.values.keys()) {
            if !allowed.contains(column) {
                return Err(MappingError(format!(
                    "column `{column}` is none of ours; allowed: {}",
                    allowed.join(", ")
                )));
            }
        }
        Ok(mapping)
    }

    /// What the file calls our column.
    pub(super) fn column<'a>(&'a self, ours: &'a str) -> &'a str {
        self.columns.get(ours).map_or(ours, String::as_str)
    }

    /// Whether the file must have this column, because the mapping speaks of it.
    pub(super) fn names(&self, ours: &str) -> bool {
        self.columns.contains_key(ours)
    }

    /// Our value for the file's.
    pub(super) fn value<'a>(&'a self, ours: &str, theirs: &'a str) -> &'a str {
        self.values
            .get(ours)
            .and_then(|values| values.get(theirs))
            .map_or(theirs, String::as_str)
    }

    /// What the file may hold for our value.
    pub(super) fn theirs(&self, column: &str, ours: &str) -> String {
        let mapped = self.values.get(column).and_then(|values| {
            let found = values.iter().find(|(_, known)| *known == ours);
            found.map(|(theirs, _)| theirs.clone())
        });
        mapped.unwrap_or_else(|| ours.to_owned())
    }
}
