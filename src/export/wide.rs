//! One row per participant.

use std::collections::BTreeMap;
use std::io;

use serde_json::{Map, Value};

use super::cell::{number, text, value};
use super::columns::{NOT_SHOWN, OPEN, SKIPPED};
use super::rows::Rows;
use super::wide_columns::{ReplayCell, StepCell, StepKey, WideCell, WideColumn};
use super::{Export, ExportError, bonus, wide_columns};
use crate::store::{self, Moment, ParticipantRow, RunId, RunState, StepAnswer, VersionId};
use crate::study::step::{Field, Viewing};
use crate::study::{Asks, BlockId, ReplayId};

/// Participants that are read at once, with all of their answers.
const PAGE_PARTICIPANTS: u32 = 200;

pub(super) fn csv(
    export: &Export,
    rows: &mut Rows,
    out: &mut dyn io::Write,
) -> Result<u64, ExportError> {
    let columns = wide_columns::all(export);
    let forms = forms(export);
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(columns.iter().map(|column| column.column.name.as_str()))?;
    let mut count = 0;
    let answers = async |moment: &mut Moment, participants: &[ParticipantRow]| {
        let (Some(first), Some(last)) = (participants.first(), participants.last()) else {
            return Ok(Vec::new());
        };
        let study = export.study.id();
        moment
            .step_answers(study, export.population, first.run, last.run)
            .await
    };
    each_page(export, rows, answers, |participants, answers| {
        let mut answers = answers.as_slice();
        for participant in participants {
            // A run that began since then is not on this page, but its answers may stand between.
            while answers
                .first()
                .is_some_and(|answer| answer.run < participant.run)
            {
                answers = &answers[1..];
            }
            let own = answers
                .iter()
                .take_while(|answer| answer.run == participant.run)
                .count();
            let (of_this, others) = answers.split_at(own);
            answers = others;
            let row = Row::new(export, &forms, participant, of_this)?;
            writer.write_record(columns.iter().map(|column| row.cell(column)))?;
            count += 1;
        }
        Ok(())
    })?;
    writer.flush()?;
    Ok(count)
}

/// Reads all participants page by page, each with what `more` reads of the same moment.
pub(super) fn each_page<T>(
    export: &Export,
    rows: &mut Rows,
    more: impl AsyncFn(&mut Moment, &[ParticipantRow]) -> Result<T, store::Error>,
    mut write: impl FnMut(&[ParticipantRow], T) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let mut after = RunId::from(0);
    loop {
        let (page, with) = rows.page(export, async |moment| {
            let (study, last) = (export.study.id(), export.last_run);
            let page = moment
                .participants(study, export.population, after, last, PAGE_PARTICIPANTS)
                .await?;
            let with = more(moment, &page).await?;
            Ok((page, with))
        })?;
        write(&page, with)?;
        match page.last() {
            Some(last) if page.len() == PAGE_PARTICIPANTS as usize => after = last.run,
            Some(_) | None => return Ok(()),
        }
    }
}

/// The fields of every form of every readable version.
type Forms<'a> = BTreeMap<(VersionId, &'a BlockId), &'a [Field]>;

fn forms(export: &Export) -> Forms<'_> {
    let contents = export
        .versions
        .iter()
        .flat_map(|(version, study)| study.contents().map(move |contents| (version, contents)));
    contents
        .filter_map(|(version, contents)| match contents.asks {
            Asks::Fields(fields) => Some(((version, contents.block), fields)),
            Asks::Nothing | Asks::Replays(_) | Asks::Consent(_) | Asks::Choices { .. } => None,
        })
        .collect()
}

/// A step with what was sent for it.
struct Answered<'a> {
    answer: &'a StepAnswer,
    members: Map<String, Value>,
    viewings: Vec<Viewing>,
}

impl<'a> Answered<'a> {
    fn read(answer: &'a StepAnswer) -> Result<Self, ExportError> {
        let sent = answer.value.as_deref().map(serde_json::from_str);
        let (members, viewings) = match sent.transpose()? {
            Some(Value::Object(members)) => (members, Vec::new()),
            Some(viewings @ Value::Array(_)) => (Map::new(), serde_json::from_value(viewings)?),
            Some(Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_)) | None => {
                (Map::new(), Vec::new())
            }
        };
        Ok(Self {
            answer,
            members,
            viewings,
        })
    }

    fn of_replay(&self, replay: &ReplayId, cell: ReplayCell) -> String {
        let viewing = self
            .viewings
            .iter()
            .find(|viewing| viewing.replay == *replay);
        match cell {
            ReplayCell::Place => {
                let place = self.answer.replays.iter().position(|shown| shown == replay);
                number(place.map(|place| place + 1))
            }
            ReplayCell::Plays => number(viewing.map(|viewing| viewing.plays)),
            ReplayCell::Started => number(viewing.map(|viewing| viewing.started_ms)),
            ReplayCell::Seen => number(viewing.map(|viewing| viewing.seen_ms)),
            ReplayCell::Stills => number(viewing.map(|viewing| viewing.stills)),
        }
    }
}

/// A participant with their steps by name.
struct Row<'a> {
    export: &'a Export,
    forms: &'a Forms<'a>,
    participant: &'a ParticipantRow,
    steps: BTreeMap<StepKey, Answered<'a>>,
}

impl<'a> Row<'a> {
    fn new(
        export: &'a Export,
        forms: &'a Forms<'a>,
        participant: &'a ParticipantRow,
        answers: &'a [StepAnswer],
    ) -> Result<Self, ExportError> {
        let mut steps = BTreeMap::new();
        for answer in answers {
            let key = StepKey {
                block: answer.block.clone(),
                question: answer.question.clone(),
            };
            steps.insert(key, Answered::read(answer)?);
        }
        Ok(Self {
            export,
            forms,
            participant,
            steps,
        })
    }

    fn cell(&self, column: &WideColumn) -> String {
        let participant = self.participant;
        let words = |words: Option<&str>| words.map(text).unwrap_or_default();
        match &column.cell {
            WideCell::Study => text(self.export.study.id().as_str()),
            WideCell::Version => participant.version_number.to_string(),
            WideCell::VersionHash => participant.study_version_hash.clone(),
            WideCell::ProgramVersion => words(participant.program_version.as_deref()),
            WideCell::Participant => participant.run.to_string(),
            WideCell::RunState => participant.state.to_string(),
            WideCell::Condition => words(participant.condition.as_deref()),
            WideCell::Source => words(participant.source.as_deref()),
            WideCell::Language => words(participant.language.as_deref()),
            WideCell::Simulated => self.export.population.is_simulated().to_string(),
            WideCell::TimeFactor => participant.time_factor.to_string(),
            // When somebody came and went could be matched with what a platform knows of them.
            WideCell::StartedAt | WideCell::FinishedAt | WideCell::Duration
                if participant.state == RunState::Withdrawn =>
            {
                String::new()
            }
            WideCell::StartedAt => number(participant.started_at.map(|at| at.0)),
            WideCell::FinishedAt => number(participant.finished_at.map(|at| at.0)),
            WideCell::Duration => number(
                participant
                    .finished_at
                    .zip(participant.started_at)
                    .map(|(end, start)| end.millis_since(start)),
            ),
            WideCell::LastPosition => number(participant.last_position),
            WideCell::Bonus => number(bonus::amount(self.export, participant)),
            WideCell::Excluded => words(participant.excluded.as_deref()),
            WideCell::Platform => words(participant.platform.as_deref()),
            WideCell::PlatformKey => words(participant.platform_key.as_deref()),
            WideCell::PlatformId => words(
                self.export
                    .store
                    .plain_platform_id(self.export.study.id(), participant),
            ),
            WideCell::Step(key, cell) => self.of_step(column, key, cell),
        }
    }

    fn of_step(&self, column: &WideColumn, key: &StepKey, cell: &StepCell) -> String {
        let Some(answered) = self.steps.get(key) else {
            return match cell {
                StepCell::Status if self.participant.state == RunState::Withdrawn => {
                    RunState::Withdrawn.to_string()
                }
                StepCell::Status => NOT_SHOWN.to_owned(),
                StepCell::Action
                | StepCell::ClientRt
                | StepCell::ServerMs
                | StepCell::Member(_)
                | StepCell::Clause(_)
                | StepCell::Chosen { .. }
                | StepCell::Score(_)
                | StepCell::Replay(..)
                | StepCell::Passed(_) => String::new(),
            };
        };
        // Where the version asks for something of another kind under this name, that is a column of its own.
        let version = self.export.versions.readable(self.participant.version);
        if *cell != StepCell::Status && !column.versions.contains(&version) {
            return String::new();
        }
        let Answered {
            answer, members, ..
        } = answered;
        match cell {
            StepCell::Action => answer
                .action
                .as_ref()
                .map_or_else(String::new, |action| text(action.as_str())),
            StepCell::Status => match answer.status {
                Some(status) => status.to_string(),
                None if self.participant.state == RunState::Active => OPEN.to_owned(),
                None => SKIPPED.to_owned(),
            },
            StepCell::ClientRt => number(answer.client_rt_ms),
            StepCell::ServerMs => number(answer.server_ms),
            StepCell::Member(name) => value(members.get(name)),
            StepCell::Clause(id) => {
                value(members.get("clauses").and_then(|clauses| clauses.get(id)))
            }
            StepCell::Chosen { field, option } => number(
                members
                    .get(field)
                    .and_then(Value::as_array)
                    .map(|chosen| chosen.iter().any(|chosen| chosen == option.as_str())),
            ),
            StepCell::Replay(replay, cell) => answered.of_replay(replay, *cell),
            StepCell::Score(item) => number(
                self.fields(key)
                    .iter()
                    .find_map(|field| field.score(item, members)),
            ),
            StepCell::Passed(id) => number(
                self.fields(key)
                    .iter()
                    .find(|field| field.id == *id)
                    .and_then(|field| field.passes(members)),
            ),
        }
    }

    /// The fields of a form as the participant saw them; none where their version has no such form.
    fn fields(&self, key: &StepKey) -> &[Field] {
        let form = (self.participant.version, &key.block);
        self.forms.get(&form).copied().unwrap_or_default()
    }
}
