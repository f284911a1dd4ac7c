//! The columns of the wide table, each with where its cells come from.

use std::collections::BTreeSet;

use super::columns::{
    Column, ColumnKind, Level, NOT_ANSWERED, NOT_MEASURED, NOT_SHOWN, SKIPPED, TIMED_OUT,
    WITHDRAWN, answer_statuses, missing_meaning, participant_column, run_state_column,
    simulated_column, source_column, study_column, version_column,
};
use super::{Export, Ids};
use crate::study::step::{ActionView, Clause, Field, FieldKind, FieldOption, FormStep, LikertItem};
use crate::study::{Asks, BlockId, QuestionId};

/// A column of the wide table with where its cells come from.
#[derive(Debug, Clone)]
pub(super) struct WideColumn {
    pub(super) column: Column,
    pub(super) cell: WideCell,
}

/// What a cell of the wide table tells.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
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
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum StepCell {
    Action,
    Status,
    ClientRt,
    ServerMs,
    /// A member of what was sent.
    Member(String),
    /// Whether a clause was agreed to.
    Clause(String),
    /// Whether the option of a field with several was chosen.
    Chosen {
        field: String,
        option: String,
    },
    /// The score of this item of a scale, as the participant's version has the scale.
    Score(String),
    /// Whether the attention check in this field was passed, as the participant's version has it.
    Passed(String),
}

/// The wide table's columns.
pub(super) fn all(export: &Export) -> Vec<WideColumn> {
    let mut columns = Columns::default();
    for column in wide_head(export) {
        columns.add(column);
    }
    for study in export.versions_current_first() {
        for column in study.contents().flat_map(|contents| {
            let block = contents.block;
            match contents.asks {
                Asks::Nothing => Vec::new(),
                Asks::Consent(clauses) => consent_columns(block, clauses),
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
            columns.add(column);
        }
    }
    columns.columns
}

/// Columns that differ in their names and in what their cells tell.
#[derive(Default)]
struct Columns {
    columns: Vec<WideColumn>,
    names: BTreeSet<String>,
    cells: BTreeSet<WideCell>,
}

impl Columns {
    /// Adds a column unless it is there, as most columns of an earlier version are. A field's id may make the name of
    /// another column, such as that of its form's status, or in another version its block asked something else: the
    /// later column is numbered then. No id holds `_`, so that this name is nobody's.
    fn add(&mut self, mut column: WideColumn) {
        if !self.cells.insert(column.cell.clone()) {
            return;
        }
        let wanted = column.column.name.clone();
        let mut number = 1;
        while !self.names.insert(column.column.name.clone()) {
            number += 1;
            column.column.name = format!("{wanted}_{number}");
        }
        self.columns.push(column);
    }
}

fn wide_head(export: &Export) -> Vec<WideColumn> {
    let plain = |column, cell| WideColumn { column, cell };
    let mut columns = vec![
        plain(study_column(export.study()), WideCell::Study),
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
            .in_unit("ms")
            .missing_as(&[WITHDRAWN, NOT_MEASURED]),
            WideCell::StartedAt,
        ),
        plain(
            Column::new(
                "finished_at_ms",
                "Ended at",
                ColumnKind::Integer,
                "When the run ended, since 1970 (UTC); empty while it is under way",
            )
            .in_unit("ms")
            .missing_as(&[WITHDRAWN, NOT_MEASURED]),
            WideCell::FinishedAt,
        ),
        plain(
            Column::new(
                "duration_ms",
                "Duration",
                ColumnKind::Integer,
                "From the start to the end of the run",
            )
            .in_unit("ms")
            .missing_as(&[WITHDRAWN, NOT_MEASURED]),
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

fn consent_columns(block: &BlockId, clauses: &[Clause]) -> Vec<WideColumn> {
    let missing = [NOT_SHOWN, WITHDRAWN];
    let mut columns = vec![
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
    ];
    columns.extend(clauses.iter().map(|clause| {
        WideColumn {
            column: Column::new(
                format!("{block}.{}", clause.id),
                &clause.text,
                ColumnKind::Boolean,
                format!("Whether the person agreed to: {}", clause.text),
            )
            .missing_as(&[NOT_ANSWERED, NOT_SHOWN, WITHDRAWN]),
            cell: step(block, None, StepCell::Clause(clause.id.clone())),
        }
    }));
    columns
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
    if fields.iter().any(|field| field.correct.is_some()) {
        columns.extend(check_columns(block, title));
    }
    for field in fields {
        columns.extend(field_columns(block, field));
    }
    columns
}

fn check_columns(block: &BlockId, title: &str) -> [WideColumn; 2] {
    let missing = [NOT_SHOWN, WITHDRAWN];
    let member = |name: &str| step(block, None, StepCell::Member(name.to_owned()));
    [
        WideColumn {
            column: Column::new(
                format!("{block}.passed"),
                format!("{title}: passed"),
                ColumnKind::Boolean,
                format!("Whether comprehension check {block} was answered rightly in the end"),
            )
            .missing_as(&missing),
            cell: member(FormStep::PASSED),
        },
        WideColumn {
            column: Column::new(
                format!("{block}.attempts"),
                format!("{title}: attempts"),
                ColumnKind::Integer,
                format!("How often comprehension check {block} was tried"),
            )
            .missing_as(&missing),
            cell: member(FormStep::ATTEMPTS),
        },
    ]
}

const FIELD_MISSING: [&str; 3] = [NOT_ANSWERED, NOT_SHOWN, WITHDRAWN];

fn field_columns(block: &BlockId, field: &Field) -> Vec<WideColumn> {
    let label = &field.label;
    let one = |kind, description: String| {
        let column = Column::new(format!("{block}.{}", field.id), label, kind, description);
        WideColumn {
            column: column.missing_as(&FIELD_MISSING),
            cell: step(block, None, StepCell::Member(field.id.clone())),
        }
    };
    let mut columns = match &field.kind {
        FieldKind::Integer { min, max } => vec![one(
            ColumnKind::Integer,
            format!("{label} A whole number from {min} to {max}"),
        )],
        FieldKind::Number { min, max, .. } => vec![one(
            ColumnKind::Number,
            format!("{label} A number from {min} to {max}"),
        )],
        FieldKind::Text { max_length } | FieldKind::LongText { max_length } => vec![one(
            ColumnKind::Text,
            format!("{label} Own words, at most {max_length} characters"),
        )],
        FieldKind::Choice { options, other } => {
            choice_field_columns(block, field, options, *other, one)
        }
        FieldKind::Choices { options, .. } => options
            .iter()
            .map(|option| chosen_column(block, field, option))
            .collect(),
        FieldKind::Likert { points, items } => items
            .iter()
            .flat_map(|item| item_columns(block, points, item))
            .collect(),
    };
    if field.is_attention_check() {
        columns.push(WideColumn {
            column: Column::new(
                format!("{block}.{}.passed", field.id),
                format!("{label}: passed"),
                ColumnKind::Boolean,
                "Whether this attention check was answered as it asks",
            )
            .missing_as(&FIELD_MISSING),
            cell: step(block, None, StepCell::Passed(field.id.clone())),
        });
    }
    columns
}

fn choice_field_columns(
    block: &BlockId,
    field: &Field,
    options: &[FieldOption],
    other: bool,
    one: impl Fn(ColumnKind, String) -> WideColumn,
) -> Vec<WideColumn> {
    let mut levels: Vec<Level> = options
        .iter()
        .map(|option| Level::new(&option.id, &option.label))
        .collect();
    if other {
        levels.push(Level::new(Field::OTHER, "other, in own words"));
    }
    let chosen = one(ColumnKind::Level, field.label.clone());
    let mut columns = vec![WideColumn {
        column: chosen.column.with_levels(levels),
        cell: chosen.cell,
    }];
    if other {
        columns.push(WideColumn {
            column: Column::new(
                format!("{block}.{}", field.other_name()),
                format!("{}: own words", field.label),
                ColumnKind::Text,
                format!("Own words where {} is `{}`", field.id, Field::OTHER),
            )
            .missing_as(&FIELD_MISSING),
            cell: step(block, None, StepCell::Member(field.other_name())),
        });
    }
    columns
}

fn chosen_column(block: &BlockId, field: &Field, option: &FieldOption) -> WideColumn {
    WideColumn {
        column: Column::new(
            format!("{block}.{}.{}", field.id, option.id),
            format!("{}: {}", field.label, option.label),
            ColumnKind::Boolean,
            format!(
                "Whether `{}` was among what was chosen in {}",
                option.id, field.id
            ),
        )
        .missing_as(&FIELD_MISSING),
        cell: step(
            block,
            None,
            StepCell::Chosen {
                field: field.id.clone(),
                option: option.id.clone(),
            },
        ),
    }
}

/// The point that was chosen, and for a reversed item the score as well.
fn item_columns(block: &BlockId, points: &[String], item: &LikertItem) -> Vec<WideColumn> {
    let levels = || {
        (1..)
            .zip(points)
            .map(|(point, text): (usize, _)| Level::new(point.to_string(), text))
            .collect()
    };
    let mut columns = vec![WideColumn {
        column: Column::new(
            format!("{block}.{}", item.id),
            &item.text,
            ColumnKind::Integer,
            format!(
                "{} The point on the scale, from 1 to {}",
                item.text,
                points.len()
            ),
        )
        .with_levels(levels())
        .missing_as(&FIELD_MISSING),
        cell: step(block, None, StepCell::Member(item.id.clone())),
    }];
    if item.reverse {
        columns.push(WideColumn {
            column: Column::new(
                format!("{block}.{}.score", item.id),
                format!("{}: score", item.text),
                ColumnKind::Integer,
                format!(
                    "{} plus 1 minus the point: this item is reversed; on the scale of the participant's version of the \
                     study, where it had another one",
                    points.len()
                ),
            )
            .missing_as(&FIELD_MISSING),
            cell: step(block, None, StepCell::Score(item.id.clone())),
        });
    }
    columns
}
