//! The rows of a file by person.

use std::collections::{HashMap, HashSet};

use super::row::{Read, Row};
use super::{Fault, Imported};
use crate::store::ImportedRun;
use crate::study::{BlockId, ConditionId, QuestionId};

/// People by what the file calls them.
#[derive(Default)]
pub(super) struct People {
    runs: Vec<ImportedRun>,
    known: HashMap<String, Known>,
    left_out: u64,
}

/// What is known of a person from the rows before.
struct Known {
    /// Where their run is.
    place: usize,
    answered: HashSet<(BlockId, QuestionId)>,
    /// The condition of their questions, and the line that told it.
    condition: Option<(ConditionId, u64)>,
    /// Whether their rows tell moments, and the line that told it.
    has_times: Option<(bool, u64)>,
}

impl People {
    pub(super) fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Takes a row, or says all that is wrong with it: in itself, and beside the person's other rows.
    pub(super) fn add(&mut self, read: Read, row: &Row<'_>) -> Vec<Fault> {
        let Read {
            participant,
            is_completed,
            question,
            answer,
            has_times,
            mut faults,
        } = read;
        let is_practice = question
            .as_ref()
            .is_some_and(|question| question.step.is_practice);
        if is_practice {
            self.left_out += u64::from(faults.is_empty());
            return faults;
        }
        let Some(participant) = participant else {
            return faults;
        };
        let place = self.runs.len();
        let known = self.known.entry(participant.to_owned()).or_insert_with(|| {
            self.runs.push(ImportedRun {
                participant: participant.to_owned(),
                answers: Vec::new(),
                condition: None,
                has_times: true,
                is_completed: true,
            });
            Known {
                place,
                answered: HashSet::new(),
                condition: None,
                has_times: None,
            }
        });
        if let Some(question) = &question {
            let plan = &question.step.plan;
            if let Some(id) = &plan.question
                && !known.answered.insert((plan.block.clone(), id.clone()))
            {
                faults.push(row.fault(
                    row.question_column(),
                    "one answer per participant and question",
                ));
            }
            match (&known.condition, &question.condition) {
                (Some((condition, line)), Some(other)) if condition != other => {
                    faults.push(row.fault(
                        row.question_column(),
                        format!(
                            "questions of the condition {condition}, in which line {line} puts this participant; this one is of {other}"
                        ),
                    ));
                }
                (None, Some(condition)) => {
                    known.condition = Some((condition.clone(), row.line()));
                }
                (Some(_) | None, _) => {}
            }
        }
        match (known.has_times, has_times) {
            (Some((true, line)), Some(false)) => faults.push(row.fault(
                "answered_at_ms",
                format!("a moment, because the participant's row in line {line} has one"),
            )),
            (Some((false, line)), Some(true)) => faults.push(row.fault(
                "answered_at_ms",
                format!("nothing, because the participant's row in line {line} has no moment"),
            )),
            (None, Some(has_times)) => known.has_times = Some((has_times, row.line())),
            (Some(_), Some(_)) | (_, None) => {}
        }
        let run = &mut self.runs[known.place];
        run.is_completed &= is_completed;
        run.answers.extend(answer);
        faults
    }

    /// Everybody, each with their answers in the order in which they were given, as far as that is known.
    pub(super) fn imported(self) -> Imported {
        let Self {
            mut runs,
            known,
            left_out,
        } = self;
        for known in known.into_values() {
            let run = &mut runs[known.place];
            run.condition = known.condition.map(|(condition, _)| condition);
            run.has_times = known.has_times.is_some_and(|(has_times, _)| has_times);
            run.answers.sort_by_key(|answer| answer.at);
        }
        Imported {
            answers: runs.iter().map(|run| run.answers.len() as u64).sum(),
            runs,
            left_out,
        }
    }
}
