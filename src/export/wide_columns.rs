//! The columns of the wide table, each with where its cells come from.

use std::collections::{BTreeMap, BTreeSet};

use super::columns::{
    Column, ColumnKind, Level, NOT_MEASURED, NOT_SHOWN, Names, WITHDRAWN, participant_column,
    run_state_column, simulated_column, source_column, study_column, version_column,
};
use super::{Export, Ids, step_columns};
use crate::store::{VersionId, VersionNumber};
use crate::study::step::FieldKind;
use crate::study::{Asks, BlockContents, BlockId, QuestionId, ReplayId, Study};

/// A column of the wide table with where its cells come from.
#[derive(Debug, Clone)]
pub(super) struct WideColumn {
    pub(super) column: Column,
    pub(super) cell: WideCell,
    /// How many points the scale has whose points or scores it holds.
    pub(super) points: Option<usize>,
    /// The versions of the study that have it; none for what every run has.
    pub(super) versions: BTreeSet<VersionId>,
}

impl WideColumn {
    pub(super) fn new(column: Column, cell: WideCell) -> Self {
        Self {
            column,
            cell,
            points: None,
            versions: BTreeSet::new(),
        }
    }

    pub(super) fn on_scale_of(mut self, points: usize) -> Self {
        self.points = Some(points);
        self
    }
}

/// What a cell of the wide table tells.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum WideCell {
    Study,
    Version,
    VersionHash,
    ProgramVersion,
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
    LastPosition,
    Bonus,
    Excluded,
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
    /// Of a replay.
    Replay(ReplayId, ReplayCell),
    /// Whether the attention check in this field was passed, as the participant's version has it.
    Passed(String),
}

/// What is told of how a replay was watched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ReplayCell {
    /// Its place on the page, from 1.
    Place,
    Plays,
    Stills,
    Started,
    Seen,
}

/// The wide table's columns.
pub(super) fn all(export: &Export) -> Vec<WideColumn> {
    let mut columns = Columns::default();
    for column in wide_head(export) {
        columns.add(column, None);
    }
    let scored = reversed_items(export);
    for (version, study) in export.versions.current_first() {
        for column in study
            .contents()
            .flat_map(|contents| of_block(&contents, &scored))
        {
            columns.add(column, Some((version, export.versions.number(version))));
        }
    }
    columns.columns
}

/// What a block asks, as columns.
fn of_block(contents: &BlockContents<'_>, scored: &BTreeSet<(BlockId, String)>) -> Vec<WideColumn> {
    let block = contents.block;
    let mut columns = match &contents.asks {
        Asks::Nothing => Vec::new(),
        Asks::Replays(replays) => step_columns::replays(block, replays),
        Asks::Consent(consent) => step_columns::consent(block, consent.clauses),
        Asks::Choices { questions, .. } => questions
            .iter()
            .flat_map(|question| {
                let label = question.label.unwrap_or(question.title);
                step_columns::choice(block, question.id, label, question.actions)
            })
            .collect(),
        Asks::Fields(fields) => {
            step_columns::form(block, contents.title.unwrap_or(""), fields, |item| {
                scored.contains(&(block.clone(), item.to_owned()))
            })
        }
    };
    // A block of questions has a page of its own where it has a start.
    if let Some(title) = contents.title {
        columns.push(step_columns::page_time(block, title));
    }
    columns
}

/// The items of scales that are reversed in some version: they have scores in all.
fn reversed_items(export: &Export) -> BTreeSet<(BlockId, String)> {
    let mut found = BTreeSet::new();
    for contents in export.versions_current_first().flat_map(Study::contents) {
        let Asks::Fields(fields) = contents.asks else {
            continue;
        };
        for field in fields {
            let FieldKind::Likert { items, .. } = &field.kind else {
                continue;
            };
            let reversed = items.iter().filter(|item| item.reverse);
            found.extend(reversed.map(|item| (contents.block.clone(), item.id.clone())));
        }
    }
    found
}

/// Columns that differ in their names and in what their cells tell.
#[derive(Default)]
struct Columns {
    columns: Vec<WideColumn>,
    names: Names,
    places: BTreeMap<(WideCell, ColumnKind, Option<usize>), usize>,
}

impl Columns {
    /// Adds a column of a version. One that is there already learns what this version adds to it, as most columns of an
    /// earlier version are; where its values are of another kind, or of a scale with more or fewer points, it is a column of its own,
    /// so that no number stands for two things. A field's id may make the name of another column, such as that of its
    /// form's status: the later column is numbered then.
    fn add(&mut self, mut column: WideColumn, version: Option<(VersionId, VersionNumber)>) {
        column.versions.extend(version.map(|(version, _)| version));
        let key = (column.cell.clone(), column.column.kind, column.points);
        match (self.places.get(&key), version) {
            (Some(place), Some((version, number))) => {
                let known = &mut self.columns[*place];
                known.versions.insert(version);
                known.column.join(column.column, number);
            }
            (Some(_), None) => {}
            (None, _) => {
                self.places.insert(key, self.columns.len());
                column.column.name = self.names.distinct(&column.column.name);
                self.columns.push(column);
            }
        }
    }
}

/// The conditions of all versions, by the labels of their levels.
fn condition_column(export: &Export) -> Column {
    let mut levels: Vec<Level> = Vec::new();
    for study in export.versions_current_first() {
        for condition in study.conditions() {
            let id = condition.id.as_str();
            if levels.iter().all(|known| known.code != id) {
                let labels: Vec<&str> = condition
                    .levels
                    .iter()
                    .map(|(factor, level)| study.level_label(factor, level))
                    .collect();
                levels.push(Level::new(id, labels.join(", ")));
            }
        }
    }
    let kind = if levels.is_empty() {
        ColumnKind::Text
    } else {
        ColumnKind::Level
    };
    Column::new(
        "condition",
        "Condition",
        kind,
        "The levels of the factors that differ between participants, joined by /; empty in a study without such factors",
    )
    .with_levels(levels)
}

/// The currencies of bonuses in all versions, each once.
fn currencies(export: &Export) -> Vec<&str> {
    let mut found = Vec::new();
    for bonus in export.versions_current_first().filter_map(Study::bonus) {
        if !found.contains(&bonus.currency.as_str()) {
            found.push(bonus.currency.as_str());
        }
    }
    found
}

fn wide_head(export: &Export) -> Vec<WideColumn> {
    let plain = WideColumn::new;
    let mut columns = vec![
        plain(study_column(export.study()), WideCell::Study),
        plain(version_column(export), WideCell::Version),
        plain(
            Column::new(
                "study_version_hash",
                "Hash of the study file",
                ColumnKind::Text,
                "SHA-256 of the study file under which the participant began: it tells versions apart across databases",
            ),
            WideCell::VersionHash,
        ),
        plain(
            Column::new(
                "program_version",
                "Version of the program",
                ColumnKind::Text,
                "The riskaware under which the participant began; empty where they answered elsewhere, or before the program kept it",
            )
            .missing_as(&[NOT_MEASURED]),
            WideCell::ProgramVersion,
        ),
        plain(participant_column(), WideCell::Participant),
        plain(run_state_column(), WideCell::RunState),
        plain(
            condition_column(export),
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
                "last_position",
                "Last position",
                ColumnKind::Integer,
                "The place of the last step that the participant was shown, as `position` counts: how far they came",
            )
            .missing_as(&[NOT_SHOWN, WITHDRAWN]),
            WideCell::LastPosition,
        ),
        plain(
            Column::new(
                "bonus",
                "Bonus",
                ColumnKind::Number,
                "What the participant is paid beside the fee, in the currency of their version of the study; empty without a bonus",
            )
            .in_units(currencies(export)),
            WideCell::Bonus,
        ),
        plain(
            Column::new(
                "excluded",
                "Left out of the analysis",
                ColumnKind::Text,
                "Why the participant is left out of the analysis: flags of the study's rule joined by spaces, and `by hand: ` with a reason, joined by `; `; empty for those who are not left out",
            ),
            WideCell::Excluded,
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
