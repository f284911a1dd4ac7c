//! One row per participant.

use std::collections::BTreeMap;
use std::io;

use serde_json::{Map, Value};

use super::cell::{number, text, value};
use super::wide_columns::{StepCell, StepKey, WideCell, WideColumn};
use super::{Export, ExportError, bonus, wide_columns};
use crate::store::{ParticipantRow, RunId, RunState, StepAnswer, VersionId};
use crate::study::step::Field;
use crate::study::{Asks, BlockId};

/// Participants that are read at once, with all of their answers.
const PAGE_PARTICIPANTS: u32 = 200;

pub(super) fn csv(export: &Export, out: &mut dyn io::Write) -> Result<u64, ExportError> {
    let columns = wide_columns::all(export);
    let forms = forms(export);
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(columns.iter().map(|column| column.column.name.as_str()))?;
    let mut count = 0;
    each_page(export, |participants| {
        let (Some(first), Some(last)) = (participants.first(), participants.last()) else {
            return Ok(());
        };
        let answers = export.runtime.block_on(export.store.step_answers(
            export.study.id(),
            export.population,
            first.run,
            last.run,
        ))?;
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

/// Reads all participants page by page.
pub(super) fn each_page(
    export: &Export,
    mut write: impl FnMut(&[ParticipantRow]) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let mut after = RunId::from(0);
    loop {
        let page = export.runtime.block_on(export.store.participants(
            export.study.id(),
            export.population,
            after,
            PAGE_PARTICIPANTS,
        ))?;
        write(&page)?;
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
            Asks::Nothing | Asks::Consent(_) | Asks::Choices { .. } => None,
        })
        .collect()
}

/// A participant with their steps by name.
struct Row<'a> {
    export: &'a Export,
    forms: &'a Forms<'a>,
    participant: &'a ParticipantRow,
    steps: BTreeMap<StepKey, (&'a StepAnswer, Map<String, Value>)>,
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
            let members = match answer.value.as_deref().map(serde_json::from_str) {
                Some(Ok(Value::Object(members))) => members,
                Some(Ok(_)) | None => Map::new(),
                Some(Err(error)) => return Err(error.into()),
            };
            steps.insert(key, (answer, members));
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
            WideCell::Bonus => number(bonus::amount(self.export, participant)),
            WideCell::Platform => words(participant.platform.as_deref()),
            WideCell::PlatformKey => words(participant.platform_key.as_deref()),
            WideCell::PlatformId => words(
                self.export
                    .store
                    .plain_platform_id(self.export.study.id(), participant),
            ),
            WideCell::Step(key, cell) => self.of_step(key, cell),
        }
    }

    fn of_step(&self, key: &StepKey, cell: &StepCell) -> String {
        let Some((answer, members)) = self.steps.get(key) else {
            return match cell {
                StepCell::Status if self.participant.state == RunState::Withdrawn => {
                    RunState::Withdrawn.to_string()
                }
                StepCell::Status => "not_shown".to_owned(),
                StepCell::Action
                | StepCell::ClientRt
                | StepCell::ServerMs
                | StepCell::Member(_)
                | StepCell::Clause(_)
                | StepCell::Chosen { .. }
                | StepCell::Score(_)
                | StepCell::Passed(_) => String::new(),
            };
        };
        match cell {
            StepCell::Action => answer
                .action
                .as_ref()
                .map_or_else(String::new, |action| text(action.as_str())),
            StepCell::Status => answer.status.to_string(),
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
