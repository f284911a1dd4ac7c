//! The columns of the wide table, each with where its cells come from.

use std::collections::BTreeSet;

use super::columns::{
    Column, ColumnKind, Level, NOT_ANSWERED, NOT_MEASURED, NOT_SHOWN, SKIPPED, TIMED_OUT,
    WITHDRAWN, answer_statuses, missing_meaning, participant_column, run_state_column,
    simulated_column, source_column, study_column, version_column,
};
use super::{Export, Ids};
use crate::study::step::{ActionView, Field, FieldKind};
use crate::study::{Asks, BlockId, QuestionId};

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
pub(super) fn all(export: &Export) -> Vec<WideColumn> {
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
