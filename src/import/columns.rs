//! Where our columns stand in a file.

use csv::StringRecord;

use super::{Fault, Faults, Mapping};
use crate::study::Study;

/// Columns that are read beside those of the factors.
const KNOWN: [&str; 13] = [
    "participant",
    "problem",
    "block",
    "action",
    "status",
    "shown_at_ms",
    "answered_at_ms",
    "server_ms",
    "client_rt_ms",
    "input",
    "hidden_ms",
    "run_state",
    "simulated",
];

impl Mapping {
    /// The columns that a mapping for this study may name.
    pub fn allowed(study: &Study) -> Vec<String> {
        let factors = study.factors().iter().map(|factor| factor.id.to_string());
        KNOWN
            .map(str::to_owned)
            .into_iter()
            .chain(factors)
            .collect()
    }
}

/// Where each of our columns stands in the file.
pub(super) struct Columns {
    found: Vec<Column>,
    factors: Vec<String>,
}

pub(super) struct Column {
    ours: String,
    pub(super) theirs: String,
    pub(super) index: usize,
}

impl Columns {
    pub(super) fn find(
        study: &Study,
        mapping: &Mapping,
        header: &StringRecord,
    ) -> Result<Self, Faults> {
        let factors: Vec<String> = study
            .factors()
            .iter()
            .map(|factor| factor.id.to_string())
            .collect();
        let mut found = Vec::new();
        let mut faults = Faults::default();
        let of_header = |column: &str, allowed: String| Fault {
            line: 1,
            column: column.to_owned(),
            value: header.iter().collect::<Vec<_>>().join(","),
            allowed,
        };
        for ours in KNOWN.into_iter().chain(factors.iter().map(String::as_str)) {
            let theirs = mapping.column(ours);
            let mut places = header
                .iter()
                .enumerate()
                .filter(|(_, name)| *name == theirs);
            let place = places.next();
            if place.is_some() && places.next().is_some() {
                faults.extend([of_header(
                    theirs,
                    format!("a header with the column {theirs} once"),
                )]);
            }
            match place {
                Some((index, _)) => found.push(Column {
                    ours: ours.to_owned(),
                    theirs: theirs.to_owned(),
                    index,
                }),
                None if mapping.names(ours) || ["participant", "action"].contains(&ours) => {
                    faults.extend([of_header(
                        theirs,
                        format!("a header with the column {theirs}"),
                    )]);
                }
                None => {}
            }
        }
        let has = |ours: &str| found.iter().any(|column| column.ours == ours);
        let by_levels = !factors.is_empty() && factors.iter().all(|factor| has(factor));
        if !has("problem") && !by_levels {
            let problem = mapping.column("problem");
            let mut allowed = format!("a header with the column {problem}");
            if !factors.is_empty() {
                allowed = format!(
                    "{allowed}, or with one for each factor ({})",
                    factors.join(", ")
                );
            }
            faults.extend([of_header(problem, allowed)]);
        }
        if faults.is_empty() {
            Ok(Self { found, factors })
        } else {
            Err(faults)
        }
    }

    pub(super) fn of(&self, ours: &str) -> Option<&Column> {
        self.found.iter().find(|column| column.ours == ours)
    }

    /// What the file calls our column.
    pub(super) fn called<'a>(&'a self, ours: &'a str) -> &'a str {
        self.of(ours).map_or(ours, |column| column.theirs.as_str())
    }

    /// The factors of the study.
    pub(super) fn factors(&self) -> &[String] {
        &self.factors
    }
}
