//! The columns of the tables, described once: headers, codebook and metadata all come from here.

use std::collections::BTreeSet;

use serde::Serialize;

use super::{Export, Ids};
use crate::study::step::{ActionView, Field, FieldKind, InputDevice};
use crate::study::{Asks, BlockId, QuestionId, Study};

/// How many columns of the long table stand before those of the factors.
pub(super) const LONG_BEFORE_FACTORS: usize = 8;

/// A column of a table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
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
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Level {
    /// What stands in the cell.
    pub code: String,
    /// What it means.
    pub label: String,
}

impl Level {
    fn new(code: impl Into<String>, label: impl Into<String>) -> Self {
        Self {
            code: code.into(),
            label: label.into(),
        }
    }
}

impl Column {
    fn new(
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

    fn in_unit(mut self, unit: &str) -> Self {
        self.unit = Some(unit.to_owned());
        self
    }

    fn with_levels(mut self, levels: Vec<Level>) -> Self {
        self.levels = levels;
        self
    }

    fn missing_as(mut self, codes: &[&str]) -> Self {
        self.missing = codes
            .iter()
            .map(|code| Level::new(*code, missing_meaning(code)))
            .collect();
        self
    }
}

const TIMED_OUT: &str = "timed_out";
const SKIPPED: &str = "skipped";
const NOT_SHOWN: &str = "not_shown";
const WITHDRAWN: &str = "withdrawn";
const NOT_ANSWERED: &str = "not_answered";
const NOT_MEASURED: &str = "not_measured";

fn missing_meaning(code: &str) -> &'static str {
    match code {
        TIMED_OUT => "the time ran out without an answer",
        SKIPPED => "passed over on purpose (only in imported answers)",
        NOT_SHOWN => {
            "not shown, or not closed yet when the data were exported; also where the participant's version of the study does not ask it"
        }
        WITHDRAWN => "the person withdrew, and everything they answered is erased",
        NOT_ANSWERED => "shown and left empty",
        NOT_MEASURED => "not measured, for example because the page ran without scripts",
        _ => "",
    }
}

fn answer_statuses() -> Vec<Level> {
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
        RunState::Withdrawn => "withdrew; everything else is erased",
    };
    [
        RunState::Active,
        RunState::Completed,
        RunState::Declined,
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

fn study_column(export: &Export) -> Column {
    Column::new("study", "Study", ColumnKind::Text, "The id of the study").with_levels(vec![
        Level::new(export.study.id().as_str(), export.study.title()),
    ])
}

fn version_column(export: &Export) -> Column {
    let versions = export
        .versions
        .stored()
        .iter()
        .map(|version| {
            Level::new(
                version.id.to_string(),
                format!("study file with SHA-256 {}", version.hash),
            )
        })
        .collect();
    Column::new(
        "version",
        "Version of the study",
        ColumnKind::Integer,
        "The version of the study file under which the participant began",
    )
    .with_levels(versions)
}

fn participant_column() -> Column {
    Column::new(
        "participant",
        "Participant",
        ColumnKind::Integer,
        "The participant's number in this database; says nothing about the person",
    )
}

fn run_state_column() -> Column {
    Column::new(
        "run_state",
        "State",
        ColumnKind::Level,
        "How far the participant was when the data were exported",
    )
    .with_levels(run_states())
}

fn source_column() -> Column {
    Column::new(
        "source",
        "Source",
        ColumnKind::Text,
        "Where the participant came from, as the link's `source` said or an import named it",
    )
    .missing_as(&[NOT_MEASURED])
}

fn simulated_column() -> Column {
    Column::new(
        "simulated",
        "Simulated",
        ColumnKind::Boolean,
        "Whether the program simulated this participant; never mixed with people",
    )
}

/// The actions of all versions, each once.
fn all_actions(export: &Export) -> Vec<Level> {
    let mut seen = BTreeSet::new();
    let mut found = Vec::new();
    for study in export.versions_current_first() {
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
    let mut columns = vec![
        study_column(export),
        version_column(export),
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
    columns.extend(
        factors(export.versions_current_first())
            .into_iter()
            .map(|factor| {
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
            }),
    );
    columns.extend([
        Column::new("action", "Action", ColumnKind::Level, "The chosen action")
            .with_levels(all_actions(export))
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
        .in_unit("ms"),
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

/// A column of the wide table with where its cells come from.
#[derive(Debug, Clone)]
pub(super) struct WideColumn {
    pub(super) column: Column,
    pub(super) cell: WideCell,
}

/// What a cell of the wide table tells.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum WideCell {
    Study,
    Version,
    Participant,
    RunState,
    Condition,
    Source,
    Language,
    Simulated,
    TimeFactor,
    StartedAt,
    FinishedAt,
    Duration,
    Bonus,
    Platform,
    PlatformKey,
    PlatformId,
    /// Of a step: a choice, a form or a consent.
    Step(StepKey, StepCell),
}

/// A step by what the study file calls it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct StepKey {
    pub(super) block: BlockId,
    pub(super) question: Option<QuestionId>,
}

/// What is told of a step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum StepCell {
    Action,
    Status,
    ClientRt,
    ServerMs,
    /// A member of what was sent.
    Member(String),
    /// Whether an attention check was passed.
    Passed(Box<Field>),
}

/// The wide table's columns.
pub(super) fn wide(export: &Export) -> Vec<WideColumn> {
    let mut columns = wide_head(export);
    let mut seen: BTreeSet<String> = columns
        .iter()
        .map(|column| column.column.name.clone())
        .collect();
    for study in export.versions_current_first() {
        for column in study.contents().flat_map(|contents| {
            let block = contents.block;
            match contents.asks {
                Asks::Nothing => Vec::new(),
                Asks::Consent => consent_columns(block),
                Asks::Choices { questions, .. } => questions
                    .iter()
                    .flat_map(|question| {
                        let label = question.label.unwrap_or(question.title);
                        choice_columns(block, question.id, label, question.actions)
                    })
                    .collect(),
                Asks::Fields(fields) => form_columns(block, contents.title.unwrap_or(""), fields),
            }
        }) {
            if seen.insert(column.column.name.clone()) {
                columns.push(column);
            }
        }
    }
    columns
}

fn wide_head(export: &Export) -> Vec<WideColumn> {
    let plain = |column, cell| WideColumn { column, cell };
    let mut columns = vec![
        plain(study_column(export), WideCell::Study),
        plain(version_column(export), WideCell::Version),
        plain(participant_column(), WideCell::Participant),
        plain(run_state_column(), WideCell::RunState),
        plain(
            Column::new(
                "condition",
                "Condition",
                ColumnKind::Text,
                "The levels of the factors that differ between participants, joined by /; empty in a study without such factors",
            ),
            WideCell::Condition,
        ),
        plain(source_column(), WideCell::Source),
        plain(
            Column::new(
                "language",
                "Language",
                ColumnKind::Text,
                "The language of the texts; empty where the study has one language",
            ),
            WideCell::Language,
        ),
        plain(simulated_column(), WideCell::Simulated),
        plain(
            Column::new(
                "time_factor",
                "Extra time",
                ColumnKind::Number,
                "What time limits were multiplied by; 1 is the usual time, and other participants' timed answers are never counted",
            ),
            WideCell::TimeFactor,
        ),
        plain(
            Column::new(
                "started_at_ms",
                "Started at",
                ColumnKind::Integer,
                "When the run began, since 1970 (UTC)",
            )
            .in_unit("ms"),
            WideCell::StartedAt,
        ),
        plain(
            Column::new(
                "finished_at_ms",
                "Ended at",
                ColumnKind::Integer,
                "When the run ended, since 1970 (UTC); empty while it is under way",
            )
            .in_unit("ms"),
            WideCell::FinishedAt,
        ),
        plain(
            Column::new(
                "duration_ms",
                "Duration",
                ColumnKind::Integer,
                "From the start to the end of the run",
            )
            .in_unit("ms"),
            WideCell::Duration,
        ),
        plain(
            Column::new(
                "bonus",
                "Bonus",
                ColumnKind::Number,
                "What the participant is paid beside the fee, in the study's currency; empty without a bonus",
            ),
            WideCell::Bonus,
        ),
    ];
    let platform = plain(
        Column::new(
            "platform",
            "Platform",
            ColumnKind::Text,
            "The recruiting platform that the link named",
        ),
        WideCell::Platform,
    );
    match export.ids {
        Ids::LeftOut => {}
        Ids::Hashed => columns.extend([
            platform,
            plain(
                Column::new(
                    "platform_key",
                    "Hashed id",
                    ColumnKind::Text,
                    "A keyed hash of the person's id at the platform; the same person has the same one throughout the study",
                ),
                WideCell::PlatformKey,
            ),
        ]),
        Ids::Plain => columns.extend([
            platform,
            plain(
                Column::new("platform_id", "Id at the platform", ColumnKind::Text, "The person's id at the platform: personal data"),
                WideCell::PlatformId,
            ),
        ]),
    }
    columns
}

fn step(block: &BlockId, question: Option<&QuestionId>, cell: StepCell) -> WideCell {
    let key = StepKey {
        block: block.clone(),
        question: question.cloned(),
    };
    WideCell::Step(key, cell)
}

fn consent_columns(block: &BlockId) -> Vec<WideColumn> {
    let missing = [NOT_SHOWN, WITHDRAWN];
    vec![
        WideColumn {
            column: Column::new(
                format!("{block}.agreed"),
                "Agreed to take part",
                ColumnKind::Boolean,
                "Whether the person agreed to take part",
            )
            .missing_as(&missing),
            cell: step(block, None, StepCell::Member("agreed".to_owned())),
        },
        WideColumn {
            column: Column::new(
                format!("{block}.version"),
                "Version of the consent text",
                ColumnKind::Text,
                "The version of the text that was agreed to",
            )
            .missing_as(&missing),
            cell: step(block, None, StepCell::Member("version".to_owned())),
        },
    ]
}

fn with_absences(mut statuses: Vec<Level>) -> Vec<Level> {
    statuses.extend([NOT_SHOWN, WITHDRAWN].map(|code| Level::new(code, missing_meaning(code))));
    statuses
}

fn choice_columns(
    block: &BlockId,
    question: &QuestionId,
    label: &str,
    actions: &[ActionView],
) -> Vec<WideColumn> {
    let name = |what: &str| format!("{block}.{question}.{what}");
    let of = |cell| step(block, Some(question), cell);
    let actions = actions
        .iter()
        .map(|action| Level::new(action.id.as_str(), &action.label))
        .collect();
    vec![
        WideColumn {
            column: Column::new(
                name("action"),
                format!("{label}: action"),
                ColumnKind::Level,
                format!("What was chosen in question {question} of block {block} ({label})"),
            )
            .with_levels(actions)
            .missing_as(&[TIMED_OUT, SKIPPED, NOT_SHOWN, WITHDRAWN]),
            cell: of(StepCell::Action),
        },
        WideColumn {
            column: Column::new(
                name("status"),
                format!("{label}: status"),
                ColumnKind::Level,
                format!("What became of question {question} of block {block}"),
            )
            .with_levels(with_absences(answer_statuses())),
            cell: of(StepCell::Status),
        },
        WideColumn {
            column: Column::new(
                name("client_rt_ms"),
                format!("{label}: response time"),
                ColumnKind::Integer,
                "From the frame that showed the question to the choice, as the page measured it",
            )
            .in_unit("ms")
            .missing_as(&[NOT_MEASURED, TIMED_OUT, NOT_SHOWN, WITHDRAWN]),
            cell: of(StepCell::ClientRt),
        },
        WideColumn {
            column: Column::new(
                name("server_ms"),
                format!("{label}: time on the server"),
                ColumnKind::Integer,
                "From showing the question to closing it on the server's clock, the network included",
            )
            .in_unit("ms")
            .missing_as(&[NOT_MEASURED, NOT_SHOWN, WITHDRAWN]),
            cell: of(StepCell::ServerMs),
        },
    ]
}

fn form_columns(block: &BlockId, title: &str, fields: &[Field]) -> Vec<WideColumn> {
    let mut columns = vec![WideColumn {
        column: Column::new(
            format!("{block}.status"),
            format!("{title}: status"),
            ColumnKind::Level,
            format!("What became of form {block}"),
        )
        .with_levels(with_absences(vec![Level::new("answered", "sent")])),
        cell: step(block, None, StepCell::Status),
    }];
    for field in fields {
        columns.extend(field_columns(block, field));
    }
    columns
}

fn field_columns(block: &BlockId, field: &Field) -> Vec<WideColumn> {
    let missing = [NOT_ANSWERED, NOT_SHOWN, WITHDRAWN];
    let member = |name: String| step(block, None, StepCell::Member(name));
    let described = |kind, description: String| {
        Column::new(
            format!("{block}.{}", field.id),
            &field.label,
            kind,
            description,
        )
        .missing_as(&missing)
    };
    let mut columns = Vec::new();
    match &field.kind {
        FieldKind::Integer { min, max } => columns.push(WideColumn {
            column: described(
                ColumnKind::Integer,
                format!("{} A whole number from {min} to {max}", field.label),
            ),
            cell: member(field.id.clone()),
        }),
        FieldKind::Text { max_length } => columns.push(WideColumn {
            column: described(
                ColumnKind::Text,
                format!("{} Own words, at most {max_length} characters", field.label),
            ),
            cell: member(field.id.clone()),
        }),
        FieldKind::Choice {
            options,
            other,
            expected,
        } => {
            let mut levels: Vec<Level> = options
                .iter()
                .map(|option| Level::new(&option.id, &option.label))
                .collect();
            if *other {
                levels.push(Level::new(Field::OTHER, "other, in own words"));
            }
            columns.push(WideColumn {
                column: described(ColumnKind::Level, field.label.clone()).with_levels(levels),
                cell: member(field.id.clone()),
            });
            if *other {
                columns.push(WideColumn {
                    column: Column::new(
                        format!("{block}.{}", field.other_name()),
                        format!("{}: own words", field.label),
                        ColumnKind::Text,
                        format!("Own words where {} is `{}`", field.id, Field::OTHER),
                    )
                    .missing_as(&missing),
                    cell: member(field.other_name()),
                });
            }
            if let Some(expected) = expected {
                columns.push(WideColumn {
                    column: Column::new(
                        format!("{block}.{}.passed", field.id),
                        format!("{}: passed", field.label),
                        ColumnKind::Boolean,
                        format!("Whether this attention check was answered as it asks, with `{expected}`"),
                    )
                    .missing_as(&missing),
                    cell: step(block, None, StepCell::Passed(Box::new(field.clone()))),
                });
            }
        }
    }
    columns
}
