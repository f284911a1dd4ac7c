//! The columns of the tables, described once: headers, codebook and metadata all come from here. Those of the wide table
//! are in `wide_columns`.

use std::collections::BTreeSet;

use serde::Serialize;

use super::Export;
use crate::study::step::InputDevice;
use crate::study::{Asks, Study};

/// How many columns of the long table stand before those of the factors.
pub(super) const LONG_BEFORE_FACTORS: usize = 8;

/// A column of a table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct Column {
    /// The text in the table's header.
    pub name: String,
    /// A short text for tables and figures.
    pub label: String,
    /// What it holds.
    pub description: String,
    /// The unit of its numbers.
    pub unit: Option<String>,
    /// What its cells are.
    #[serde(rename = "type")]
    pub kind: ColumnKind,
    /// Its possible values, where there are few.
    pub levels: Vec<Level>,
    /// Why a cell is empty. The code stands in the column of the status that belongs to it.
    pub missing: Vec<Level>,
}

/// What the cells of a column are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum ColumnKind {
    /// Words.
    Text,
    /// One of the column's levels.
    Level,
    /// A whole number.
    Integer,
    /// Any number.
    Number,
    /// `true` or `false`.
    Boolean,
}

impl ColumnKind {
    /// Its name in the codebook.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Text => "text",
            Self::Level => "level",
            Self::Integer => "integer",
            Self::Number => "number",
            Self::Boolean => "boolean",
        }
    }
}

/// A value with its meaning.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct Level {
    /// What stands in the cell.
    pub code: String,
    /// What it means.
    pub label: String,
}

impl Level {
    pub(super) fn new(code: impl Into<String>, label: impl Into<String>) -> Self {
        Self {
            code: code.into(),
            label: label.into(),
        }
    }
}

impl Column {
    pub(super) fn new(
        name: impl Into<String>,
        label: impl Into<String>,
        kind: ColumnKind,
        description: impl Into<String>,
    ) -> Self {
        Self {
            name: name.into(),
            label: label.into(),
            description: description.into(),
            unit: None,
            kind,
            levels: Vec::new(),
            missing: Vec::new(),
        }
    }

    pub(super) fn in_unit(mut self, unit: &str) -> Self {
        self.unit = Some(unit.to_owned());
        self
    }

    pub(super) fn with_levels(mut self, levels: Vec<Level>) -> Self {
        self.levels = levels;
        self
    }

    pub(super) fn missing_as(mut self, codes: &[&str]) -> Self {
        self.missing = codes
            .iter()
            .map(|code| Level::new(*code, missing_meaning(code)))
            .collect();
        self
    }
}

pub(super) const TIMED_OUT: &str = "timed_out";
pub(super) const SKIPPED: &str = "skipped";
pub(super) const NOT_SHOWN: &str = "not_shown";
pub(super) const WITHDRAWN: &str = "withdrawn";
pub(super) const NOT_ANSWERED: &str = "not_answered";
pub(super) const NOT_MEASURED: &str = "not_measured";

pub(super) fn missing_meaning(code: &str) -> &'static str {
    match code {
        TIMED_OUT => "the time ran out without an answer",
        SKIPPED => "passed over on purpose (only in imported answers)",
        NOT_SHOWN => {
            "not shown, or not closed yet when the data were exported; also where the participant's version of the study does not ask it"
        }
        WITHDRAWN => "the person withdrew, and everything they answered is erased",
        NOT_ANSWERED => "shown and left empty",
        NOT_MEASURED => {
            "not measured, for example because the page ran without scripts, or not told where answers were imported"
        }
        _ => "",
    }
}

pub(super) fn answer_statuses() -> Vec<Level> {
    vec![
        Level::new("answered", "answered, in time where there is a limit"),
        Level::new(
            "late",
            "answered after the limit and its grace: kept, and never counted as a choice",
        ),
        Level::new(TIMED_OUT, missing_meaning(TIMED_OUT)),
        Level::new(SKIPPED, missing_meaning(SKIPPED)),
    ]
}

fn run_states() -> Vec<Level> {
    use crate::store::RunState;
    let meaning = |state: RunState| match state {
        RunState::Active => "under way",
        RunState::Completed => "all steps are closed",
        RunState::Declined => "did not consent",
        RunState::ScreenedOut => "an answer showed that the study is not for this person",
        RunState::FailedCheck => "failed a comprehension check as often as it may be tried",
        RunState::TimedOut => "did not finish in the time that the study gives",
        RunState::Withdrawn => "withdrew; everything else is erased",
    };
    [
        RunState::Active,
        RunState::Completed,
        RunState::Declined,
        RunState::ScreenedOut,
        RunState::FailedCheck,
        RunState::TimedOut,
        RunState::Withdrawn,
    ]
    .into_iter()
    .map(|state| Level::new(state.as_str(), meaning(state)))
    .collect()
}

/// A factor with the levels that it has in any version.
pub(super) struct FactorColumn {
    pub(super) id: String,
    label: String,
    levels: Vec<Level>,
}

/// The factors of all versions, each once: those of the first version given come first.
pub(super) fn factors<'a>(studies: impl Iterator<Item = &'a Study>) -> Vec<FactorColumn> {
    let mut found: Vec<FactorColumn> = Vec::new();
    for factor in studies.flat_map(Study::factors) {
        let levels = factor
            .levels
            .iter()
            .map(|level| Level::new(level.id.as_str(), &level.label));
        match found.iter_mut().find(|known| factor.id == *known.id) {
            Some(known) => {
                for level in levels {
                    if known.levels.iter().all(|known| known.code != level.code) {
                        known.levels.push(level);
                    }
                }
            }
            None => found.push(FactorColumn {
                id: factor.id.to_string(),
                label: factor.label.clone(),
                levels: levels.collect(),
            }),
        }
    }
    found
}

pub(super) fn study_column(study: &Study) -> Column {
    Column::new("study", "Study", ColumnKind::Text, "The id of the study")
        .with_levels(vec![Level::new(study.id().as_str(), study.title())])
}

pub(super) fn version_column(export: &Export) -> Column {
    let versions = export
        .versions
        .stored()
        .iter()
        .map(|version| {
            Level::new(
                version.number.to_string(),
                format!("study file with SHA-256 {}", version.hash),
            )
        })
        .collect();
    version_column_of(versions)
}

fn version_column_of(versions: Vec<Level>) -> Column {
    Column::new(
        "version",
        "Version of the study",
        ColumnKind::Integer,
        "The version of the study file under which the participant began",
    )
    .with_levels(versions)
}

pub(super) fn participant_column() -> Column {
    Column::new(
        "participant",
        "Participant",
        ColumnKind::Integer,
        "The participant's number in this database; says nothing about the person",
    )
}

pub(super) fn run_state_column() -> Column {
    Column::new(
        "run_state",
        "State",
        ColumnKind::Level,
        "How far the participant was when the data were exported",
    )
    .with_levels(run_states())
}

pub(super) fn source_column() -> Column {
    Column::new(
        "source",
        "Source",
        ColumnKind::Text,
        "Where the participant came from, as the link's `source` said or an import named it",
    )
    .missing_as(&[NOT_MEASURED])
}

pub(super) fn simulated_column() -> Column {
    Column::new(
        "simulated",
        "Simulated",
        ColumnKind::Boolean,
        "Whether the program simulated this participant; never mixed with people",
    )
}

/// The actions of all versions, each once.
fn all_actions(studies: &[&Study]) -> Vec<Level> {
    let mut seen = BTreeSet::new();
    let mut found = Vec::new();
    for study in studies {
        for contents in study.contents() {
            let Asks::Choices { questions, .. } = contents.asks else {
                continue;
            };
            for action in questions.iter().flat_map(|question| question.actions) {
                if seen.insert(action.id.clone()) {
                    found.push(Level::new(action.id.as_str(), &action.label));
                }
            }
        }
    }
    found
}

/// The long table's columns.
pub(super) fn long(export: &Export) -> Vec<Column> {
    let studies: Vec<&Study> = export.versions_current_first().collect();
    long_of(&studies, version_column(export))
}

/// The long table's columns for answers to one study file that no database holds.
pub(super) fn long_unstored(study: &Study) -> Vec<Column> {
    long_of(&[study], version_column_of(Vec::new()))
}

/// The current version of the study comes first; there is at least one.
fn long_of(studies: &[&Study], version_column: Column) -> Vec<Column> {
    let mut columns = vec![
        study_column(studies[0]),
        version_column,
        participant_column(),
        run_state_column(),
        Column::new(
            "block",
            "Block",
            ColumnKind::Text,
            "The block of the study file that asked the question",
        ),
        Column::new(
            "position",
            "Position",
            ColumnKind::Integer,
            "The place of the question among all steps of the participant, from 0",
        ),
        Column::new(
            "question",
            "Question",
            ColumnKind::Text,
            "The question's id, unique in its block",
        ),
        Column::new(
            "problem",
            "Choice problem",
            ColumnKind::Text,
            "The cell's id (its levels joined by /), or block:question outside the design; the `problem` of fits",
        ),
    ];
    columns.extend(factors(studies.iter().copied()).into_iter().map(|factor| {
        Column::new(
            factor.id,
            &factor.label,
            ColumnKind::Level,
            format!(
                "The level of the factor {}; empty outside the design",
                factor.label
            ),
        )
        .with_levels(factor.levels)
    }));
    columns.extend([
        Column::new("action", "Action", ColumnKind::Level, "The chosen action")
            .with_levels(all_actions(studies))
            .missing_as(&[TIMED_OUT, SKIPPED]),
        Column::new("status", "Status", ColumnKind::Level, "What became of the question").with_levels(answer_statuses()),
        Column::new(
            "shown_at_ms",
            "Shown at",
            ColumnKind::Integer,
            "When the question was first shown, on the server's clock, since 1970 (UTC)",
        )
        .in_unit("ms")
        .missing_as(&[NOT_MEASURED]),
        Column::new(
            "answered_at_ms",
            "Closed at",
            ColumnKind::Integer,
            "When the question was answered or closed, on the server's clock, since 1970 (UTC)",
        )
        .in_unit("ms")
        .missing_as(&[NOT_MEASURED]),
        Column::new(
            "server_ms",
            "Time on the server",
            ColumnKind::Integer,
            "From showing the question to closing it on the server's clock, the network included",
        )
        .in_unit("ms")
        .missing_as(&[NOT_MEASURED]),
        Column::new(
            "client_rt_ms",
            "Response time",
            ColumnKind::Integer,
            "From the frame that showed the question to the choice, as the page measured it",
        )
        .in_unit("ms")
        .missing_as(&[NOT_MEASURED, TIMED_OUT]),
        Column::new(
            "limit_ms",
            "Time limit",
            ColumnKind::Integer,
            "The time limit as it held for this participant, extra time included; empty without a limit",
        )
        .in_unit("ms"),
        Column::new("input", "Input", ColumnKind::Level, "What the choice was made with")
            .with_levels(
                [
                    (InputDevice::Mouse, "a mouse"),
                    (InputDevice::Touch, "a finger on a screen"),
                    (InputDevice::Pen, "a pen"),
                    (InputDevice::Keyboard, "a keyboard, or what acts like one"),
                ]
                .map(|(device, label)| Level::new(device.as_str(), label))
                .to_vec(),
            )
            .missing_as(&[NOT_MEASURED]),
        Column::new(
            "hidden_ms",
            "Hidden",
            ColumnKind::Integer,
            "How long the page was hidden or out of focus before the choice",
        )
        .in_unit("ms")
        .missing_as(&[NOT_MEASURED]),
        source_column(),
        simulated_column(),
    ]);
    columns
}
