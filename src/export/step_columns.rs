//! The columns of the wide table that tell of one step: a consent, a page, a question, a form.

use super::columns::{
    Column, ColumnKind, Level, NOT_ANSWERED, NOT_MEASURED, NOT_SHOWN, OPEN, SKIPPED, TIMED_OUT,
    WITHDRAWN, answer_statuses, missing_meaning,
};
use super::wide_columns::{ReplayCell, StepCell, StepKey, WideCell, WideColumn};
use crate::study::step::{
    ActionView, Clause, Field, FieldKind, FieldOption, FormStep, LikertItem, NamedReplay,
};
use crate::study::{BlockId, QuestionId};

fn step(block: &BlockId, question: Option<&QuestionId>, cell: StepCell) -> WideCell {
    let key = StepKey {
        block: block.clone(),
        question: question.cloned(),
    };
    WideCell::Step(key, cell)
}

pub(super) fn consent(block: &BlockId, clauses: &[Clause]) -> Vec<WideColumn> {
    let missing = [SKIPPED, OPEN, NOT_SHOWN, WITHDRAWN];
    let mut columns = vec![
        WideColumn::new(
            Column::new(
                format!("{block}.agreed"),
                "Agreed to take part",
                ColumnKind::Boolean,
                "Whether the person agreed to take part",
            )
            .missing_as(&missing),
            step(block, None, StepCell::Member("agreed".to_owned())),
        ),
        WideColumn::new(
            Column::new(
                format!("{block}.version"),
                "Version of the consent text",
                ColumnKind::Text,
                "The version of the text that was agreed to",
            )
            .missing_as(&missing),
            step(block, None, StepCell::Member("version".to_owned())),
        ),
    ];
    columns.extend(clauses.iter().map(|clause| {
        WideColumn::new(
            Column::new(
                format!("{block}.{}", clause.id),
                &clause.text,
                ColumnKind::Boolean,
                format!("Whether the person agreed to: {}", clause.text),
            )
            .missing_as(&FIELD_MISSING),
            step(block, None, StepCell::Clause(clause.id.clone())),
        )
    }));
    columns
}

/// How long somebody was on the page of a block.
pub(super) fn page_time(block: &BlockId, title: &str) -> WideColumn {
    WideColumn::new(
        Column::new(
            format!("{block}.server_ms"),
            format!("{title}: time on the page"),
            ColumnKind::Integer,
            format!(
                "From showing the page of {block} to leaving it on the server's clock, the network and all attempts at a check \
                 included; of a block of questions it is the page before them"
            ),
        )
        .in_unit("ms")
        .missing_as(&[NOT_MEASURED, SKIPPED, OPEN, NOT_SHOWN, WITHDRAWN]),
        step(block, None, StepCell::ServerMs),
    )
}

/// Columns of a page of replays: for each its place in this run, and how it was watched.
pub(super) fn replays(block: &BlockId, replays: &[NamedReplay]) -> Vec<WideColumn> {
    replays
        .iter()
        .flat_map(|replay| {
            let id = &replay.id;
            let of = |cell, what: &str, kind, unit: Option<&str>, description: &str| {
                let name = format!("{block}.{id}.{what}");
                let mut column = Column::new(name, format!("{id}: {description}"), kind, description);
                if let Some(unit) = unit {
                    column = column.in_unit(unit);
                }
                WideColumn::new(
                    column.missing_as(&[NOT_MEASURED, SKIPPED, OPEN, NOT_SHOWN, WITHDRAWN]),
                    step(block, None, StepCell::Replay(id.clone(), cell)),
                )
            };
            [
                of(
                    ReplayCell::Place,
                    "place",
                    ColumnKind::Integer,
                    None,
                    "Where this replay stood among those of the page, from 1",
                ),
                of(
                    ReplayCell::Plays,
                    "plays",
                    ColumnKind::Integer,
                    None,
                    "How often this replay was played to its end",
                ),
                of(
                    ReplayCell::Started,
                    "started_ms",
                    ColumnKind::Integer,
                    Some("ms"),
                    "When this replay was first started, since the page was opened, as the page measured it",
                ),
                of(
                    ReplayCell::Seen,
                    "seen_ms",
                    ColumnKind::Integer,
                    Some("ms"),
                    "When the end of this replay was first seen, since the page was opened, as the page measured it",
                ),
                of(
                    ReplayCell::Stills,
                    "stills",
                    ColumnKind::Boolean,
                    None,
                    "Whether this replay was shown as still frames, to somebody who asked for less motion",
                ),
            ]
        })
        .collect()
}

fn with_absences(mut statuses: Vec<Level>) -> Vec<Level> {
    statuses
        .extend([OPEN, NOT_SHOWN, WITHDRAWN].map(|code| Level::new(code, missing_meaning(code))));
    statuses
}

pub(super) fn choice(
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
        WideColumn::new(Column::new(
                name("action"),
                format!("{label}: action"),
                ColumnKind::Level,
                format!("What was chosen in question {question} of block {block} ({label})"),
            )
            .with_levels(actions)
            .missing_as(&[TIMED_OUT, SKIPPED, OPEN, NOT_SHOWN, WITHDRAWN]), of(StepCell::Action)),
        WideColumn::new(Column::new(
                name("status"),
                format!("{label}: status"),
                ColumnKind::Level,
                format!("What became of question {question} of block {block}"),
            )
            .with_levels(with_absences(answer_statuses())), of(StepCell::Status)),
        WideColumn::new(Column::new(
                name("client_rt_ms"),
                format!("{label}: response time"),
                ColumnKind::Integer,
                "From the frame that showed the question to the choice, as the page measured it",
            )
            .in_unit("ms")
            .missing_as(&[
                NOT_MEASURED,
                TIMED_OUT,
                SKIPPED,
                OPEN,
                NOT_SHOWN,
                WITHDRAWN,
            ]), of(StepCell::ClientRt)),
        WideColumn::new(Column::new(
                name("server_ms"),
                format!("{label}: time on the server"),
                ColumnKind::Integer,
                "From showing the question to closing it on the server's clock, the network included",
            )
            .in_unit("ms")
            .missing_as(&[NOT_MEASURED, SKIPPED, OPEN, NOT_SHOWN, WITHDRAWN]), of(StepCell::ServerMs)),
    ]
}

/// Columns of a form; `is_scored` says which items of scales have a score.
pub(super) fn form(
    block: &BlockId,
    title: &str,
    fields: &[Field],
    is_scored: impl Fn(&str) -> bool,
) -> Vec<WideColumn> {
    let mut columns = vec![WideColumn::new(
        Column::new(
            format!("{block}.status"),
            format!("{title}: status"),
            ColumnKind::Level,
            format!("What became of form {block}"),
        )
        .with_levels(with_absences(vec![
            Level::new("answered", "sent"),
            Level::new(SKIPPED, missing_meaning(SKIPPED)),
        ])),
        step(block, None, StepCell::Status),
    )];
    if fields.iter().any(|field| field.correct.is_some()) {
        columns.extend(check_columns(block, title));
    }
    for field in fields {
        columns.extend(field_columns(block, field, &is_scored));
    }
    columns
}

fn check_columns(block: &BlockId, title: &str) -> [WideColumn; 2] {
    let missing = [SKIPPED, OPEN, NOT_SHOWN, WITHDRAWN];
    let member = |name: &str| step(block, None, StepCell::Member(name.to_owned()));
    [
        WideColumn::new(
            Column::new(
                format!("{block}.passed"),
                format!("{title}: passed"),
                ColumnKind::Boolean,
                format!("Whether comprehension check {block} was answered rightly in the end"),
            )
            .missing_as(&missing),
            member(FormStep::PASSED),
        ),
        WideColumn::new(
            Column::new(
                format!("{block}.attempts"),
                format!("{title}: attempts"),
                ColumnKind::Integer,
                format!("How often comprehension check {block} was tried"),
            )
            .missing_as(&missing),
            member(FormStep::ATTEMPTS),
        ),
    ]
}

const FIELD_MISSING: [&str; 5] = [NOT_ANSWERED, SKIPPED, OPEN, NOT_SHOWN, WITHDRAWN];

fn field_columns(
    block: &BlockId,
    field: &Field,
    is_scored: impl Fn(&str) -> bool,
) -> Vec<WideColumn> {
    let label = &field.label;
    let one = |kind, description: String| {
        let column = Column::new(format!("{block}.{}", field.id), label, kind, description);
        WideColumn::new(
            column.missing_as(&FIELD_MISSING),
            step(block, None, StepCell::Member(field.id.clone())),
        )
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
            .flat_map(|item| item_columns(block, points, item, is_scored(&item.id)))
            .collect(),
    };
    if field.is_attention_check() {
        columns.push(WideColumn::new(
            Column::new(
                format!("{block}.{}.passed", field.id),
                format!("{label}: passed"),
                ColumnKind::Boolean,
                "Whether this attention check was answered as it asks",
            )
            .missing_as(&FIELD_MISSING),
            step(block, None, StepCell::Passed(field.id.clone())),
        ));
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
    let mut columns = vec![WideColumn::new(
        chosen.column.with_levels(levels),
        chosen.cell,
    )];
    if other {
        columns.push(WideColumn::new(
            Column::new(
                format!("{block}.{}", field.other_name()),
                format!("{}: own words", field.label),
                ColumnKind::Text,
                format!("Own words where {} is `{}`", field.id, Field::OTHER),
            )
            .missing_as(&FIELD_MISSING),
            step(block, None, StepCell::Member(field.other_name())),
        ));
    }
    columns
}

fn chosen_column(block: &BlockId, field: &Field, option: &FieldOption) -> WideColumn {
    WideColumn::new(
        Column::new(
            format!("{block}.{}.{}", field.id, option.id),
            format!("{}: {}", field.label, option.label),
            ColumnKind::Boolean,
            format!(
                "Whether `{}` was among what was chosen in {}",
                option.id, field.id
            ),
        )
        .missing_as(&FIELD_MISSING),
        step(
            block,
            None,
            StepCell::Chosen {
                field: field.id.clone(),
                option: option.id.clone(),
            },
        ),
    )
}

/// The point that was chosen, and the score of an item that is reversed.
fn item_columns(
    block: &BlockId,
    points: &[String],
    item: &LikertItem,
    is_scored: bool,
) -> Vec<WideColumn> {
    let levels = || {
        (1..)
            .zip(points)
            .map(|(point, text): (usize, _)| Level::new(point.to_string(), text))
            .collect()
    };
    let mut columns = vec![
        WideColumn::new(
            Column::new(
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
            step(block, None, StepCell::Member(item.id.clone())),
        )
        .on_scale_of(points.len()),
    ];
    if is_scored {
        columns.push(WideColumn::new(Column::new(
                format!("{block}.{}.score", item.id),
                format!("{}: score", item.text),
                ColumnKind::Integer,
                format!(
                    "How much of what the scale measures, from 1 to {0}: {0} plus 1 minus the point where the participant's \
                     version of the study reverses this item, else the point",
                    points.len()
                ),
            )
            .missing_as(&FIELD_MISSING), step(block, None, StepCell::Score(item.id.clone()))).on_scale_of(points.len()));
    }
    columns
}
