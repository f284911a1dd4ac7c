//! One row of a file.

use std::str::FromStr;

use csv::StringRecord;

use super::questions::{Question, Questions};
use super::{Fault, Mapping};
use crate::store::{AnswerStatus, ImportedAnswer, RunState};
use crate::study::step::{ClientTiming, Fields};
use crate::study::{DEFAULT_GRACE_MS, Deadline, Reply, Study, TimeFactor, Timestamp};

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

struct Column {
    ours: String,
    theirs: String,
    index: usize,
}

/// What a row is about.
pub(super) enum Asked {
    /// Nothing that is imported: a practice question, or one that nobody answered.
    LeftOut,
    /// A choice.
    Choice(Box<Answer>),
}

/// A row that was understood.
pub(super) struct Answer {
    pub(super) participant: String,
    pub(super) is_completed: bool,
    pub(super) answer: ImportedAnswer,
    /// The fault that it is if the participant has answered this question before.
    pub(super) twice: Fault,
}

impl Columns {
    pub(super) fn find(
        study: &Study,
        mapping: &Mapping,
        header: &StringRecord,
    ) -> Result<Self, Vec<Fault>> {
        let factors: Vec<String> = study
            .factors()
            .iter()
            .map(|factor| factor.id.to_string())
            .collect();
        let mut found = Vec::new();
        let mut faults = Vec::new();
        let missing = |theirs: &str| Fault {
            line: 1,
            column: theirs.to_owned(),
            value: header.iter().collect::<Vec<_>>().join(","),
            allowed: format!("a header with the column {theirs}"),
        };
        for ours in KNOWN.into_iter().chain(factors.iter().map(String::as_str)) {
            let theirs = mapping.column(ours);
            // Spreadsheets put a byte order mark before the first name.
            let mut places = header
                .iter()
                .map(|name| name.trim_start_matches('\u{feff}'))
                .enumerate()
                .filter(|(_, name)| *name == theirs)
                .map(|(index, _)| index);
            match places.next() {
                Some(_) if places.next().is_some() => faults.push(Fault {
                    allowed: format!("a header that names the column {theirs} once"),
                    ..missing(theirs)
                }),
                Some(index) => found.push(Column {
                    ours: ours.to_owned(),
                    theirs: theirs.to_owned(),
                    index,
                }),
                None if mapping.names(ours) || ["participant", "action"].contains(&ours) => {
                    faults.push(missing(theirs));
                }
                None => {}
            }
        }
        let has = |ours: &str| found.iter().any(|column| column.ours == ours);
        let by_levels = !factors.is_empty() && factors.iter().all(|factor| has(factor));
        if !has("problem") && !by_levels {
            faults.push(Fault {
                allowed: format!(
                    "a header with the column {}, or with one for each factor ({})",
                    mapping.column("problem"),
                    factors.join(", ")
                ),
                ..missing(mapping.column("problem"))
            });
        }
        if faults.is_empty() {
            Ok(Self { found, factors })
        } else {
            Err(faults)
        }
    }

    pub(super) fn participant_name(&self) -> &str {
        self.of("participant")
            .map_or("participant", |column| column.theirs.as_str())
    }

    fn of(&self, ours: &str) -> Option<&Column> {
        self.found.iter().find(|column| column.ours == ours)
    }

    pub(super) fn read(
        &self,
        mapping: &Mapping,
        questions: &Questions,
        record: &StringRecord,
        now: Timestamp,
    ) -> Result<Asked, Vec<Fault>> {
        let row = Row {
            columns: self,
            mapping,
            record,
            line: record.position().map_or(0, csv::Position::line),
        };
        row.read(questions, now)
    }
}

struct Row<'a> {
    columns: &'a Columns,
    mapping: &'a Mapping,
    record: &'a StringRecord,
    line: u64,
}

impl<'a> Row<'a> {
    /// Our value of a column; none where it is empty or missing.
    fn value(&self, ours: &str) -> Option<&'a str> {
        let column = self.columns.of(ours)?;
        let theirs = self.record.get(column.index)?;
        let value = self.mapping.value(ours, theirs);
        (!value.is_empty()).then_some(value)
    }

    fn fault(&self, ours: &str, allowed: impl Into<String>) -> Fault {
        let column = self.columns.of(ours);
        let stands = column.and_then(|column| self.record.get(column.index));
        Fault {
            line: self.line,
            column: column.map_or(ours, |column| &column.theirs).to_owned(),
            value: stands.unwrap_or("").to_owned(),
            allowed: allowed.into(),
        }
    }

    fn read(&self, questions: &Questions, now: Timestamp) -> Result<Asked, Vec<Fault>> {
        let mut faults = Vec::new();
        let participant = self.value("participant");
        if participant.is_none() {
            faults.push(self.fault("participant", "the participant's id"));
        }
        if self
            .value("simulated")
            .is_some_and(|value| value != "false")
        {
            faults.push(self.fault("simulated", "false; simulated people are not imported"));
        }
        let is_completed = match self.value("run_state").map(str::parse::<RunState>) {
            None | Some(Ok(RunState::Completed)) => true,
            Some(Ok(RunState::Active)) => false,
            Some(
                Ok(
                    RunState::Declined
                    | RunState::ScreenedOut
                    | RunState::FailedCheck
                    | RunState::TimedOut
                    | RunState::Withdrawn,
                )
                | Err(_),
            ) => {
                faults.push(self.fault(
                    "run_state",
                    "completed, active, or empty; `[values.run_state]` of a mapping can take another state for one of them",
                ));
                true
            }
        };
        let Some(question) = self.question(questions, &mut faults) else {
            return Err(faults);
        };
        let is_skipped = self.value("status") == Some(AnswerStatus::Skipped.as_str());
        if is_skipped && self.value("action").is_some() {
            faults.push(self.fault("action", "nothing, because the question was never answered"));
        }
        if question.step.is_practice || is_skipped {
            return if faults.is_empty() {
                Ok(Asked::LeftOut)
            } else {
                Err(faults)
            };
        }
        let reply = self.reply(question, &mut faults);
        let times = self.times(question, now, &mut faults);
        let timing = self.timing(&mut faults);
        match (participant, reply, times) {
            (Some(participant), Some(reply), Some((shown_at, at))) if faults.is_empty() => {
                let name = match self.columns.of("problem") {
                    Some(_) => "problem",
                    None => "participant",
                };
                Ok(Asked::Choice(Box::new(Answer {
                    participant: participant.to_owned(),
                    is_completed,
                    twice: self.fault(name, "one answer per participant and question"),
                    answer: ImportedAnswer {
                        step: question.step.clone(),
                        shown_at,
                        at,
                        reply,
                        timing,
                    },
                })))
            }
            _ => Err(faults),
        }
    }

    fn question<'q>(
        &self,
        questions: &'q Questions,
        faults: &mut Vec<Fault>,
    ) -> Option<&'q Question> {
        let (problem, named_by) = match self.columns.of("problem") {
            Some(_) => (self.value("problem").unwrap_or("").to_owned(), "problem"),
            None => {
                let levels: Vec<&str> = self
                    .columns
                    .factors
                    .iter()
                    .map(|factor| self.value(factor).unwrap_or(""))
                    .collect();
                let first = self
                    .columns
                    .factors
                    .first()
                    .map_or("problem", String::as_str);
                (levels.join("/"), first)
            }
        };
        let found = questions.find(&problem, self.value("block"));
        if found.is_none() {
            let known: Vec<String> = questions
                .problems()
                .map(|known| self.mapping.theirs("problem", known))
                .collect();
            faults.push(Fault {
                value: problem,
                ..self.fault(named_by, known.join(", "))
            });
        }
        found
    }

    fn reply(&self, question: &Question, faults: &mut Vec<Fault>) -> Option<Reply> {
        let status = match self.value("status").map(str::parse::<AnswerStatus>) {
            None => AnswerStatus::Answered,
            Some(Ok(
                status @ (AnswerStatus::Answered | AnswerStatus::Late | AnswerStatus::TimedOut),
            )) => status,
            Some(Ok(AnswerStatus::Skipped) | Err(_)) => {
                faults.push(self.fault("status", "answered, late, timed_out, skipped"));
                return None;
            }
        };
        let is_timed = question.step.plan.limit_ms.is_some();
        if !is_timed && status != AnswerStatus::Answered {
            faults.push(self.fault("status", "answered, because this question has no limit"));
            return None;
        }
        let action = self.value("action");
        if status == AnswerStatus::TimedOut {
            if action.is_some() {
                faults.push(self.fault("action", "nothing, because the time ran out"));
                return None;
            }
            return Some(Reply::GaveUp);
        }
        let chosen = question
            .actions
            .iter()
            .find(|known| action.is_some_and(|action| **known == *action));
        if chosen.is_none() {
            let known: Vec<String> = question
                .actions
                .iter()
                .map(|known| self.mapping.theirs("action", known.as_str()))
                .collect();
            faults.push(self.fault("action", known.join(", ")));
        }
        chosen.map(|action| Reply::Chose {
            action: action.clone(),
        })
    }

    /// When the question was shown and answered.
    fn times(
        &self,
        question: &Question,
        now: Timestamp,
        faults: &mut Vec<Fault>,
    ) -> Option<(Option<Timestamp>, Timestamp)> {
        let before = faults.len();
        let at = self
            .number::<i64>("answered_at_ms", faults)
            .map_or(now, Timestamp);
        let server_ms = self.number::<u32>("server_ms", faults);
        let shown_at = self
            .number::<i64>("shown_at_ms", faults)
            .or_else(|| Some(at.0 - i64::from(server_ms?)));
        let shown_at = match (shown_at, question.step.plan.limit_ms) {
            (Some(shown_at), _) => Some(shown_at),
            (None, None) => None,
            (None, Some(_)) => self
                .number::<u32>("client_rt_ms", faults)
                .map(|rt_ms| at.0 - i64::from(rt_ms)),
        };
        if shown_at.is_some_and(|shown_at| shown_at > at.0) {
            faults.push(self.fault("shown_at_ms", "a time before answered_at_ms"));
        }
        if faults.len() > before {
            return None;
        }
        let Some(limit_ms) = question.step.plan.limit_ms else {
            return Some((shown_at.map(Timestamp), at));
        };
        let Some(shown_at) = shown_at.map(Timestamp) else {
            faults.push(self.fault(
                "server_ms",
                "a time in milliseconds, here, as shown_at_ms or as client_rt_ms, because this question has a limit",
            ));
            return None;
        };
        let deadline = Deadline::new(limit_ms, TimeFactor::ONE, DEFAULT_GRACE_MS);
        let is_late = at > deadline.closes_at(shown_at);
        let has_run_out = deadline.has_run_out(at.millis_since(shown_at));
        let (fits, allowed) = match self.value("status") {
            Some("late") => (
                is_late,
                "answered, because it came before the limit and its grace",
            ),
            Some("timed_out") => (has_run_out, "answered, because the limit had not passed"),
            Some(_) | None => (
                !is_late,
                "late or timed_out, because the limit and its grace had passed",
            ),
        };
        if !fits {
            faults.push(self.fault("status", allowed));
            return None;
        }
        Some((Some(shown_at), at))
    }

    fn number<N: FromStr>(&self, ours: &str, faults: &mut Vec<Fault>) -> Option<N> {
        let parsed = self.value(ours)?.parse();
        if parsed.is_err() {
            faults.push(self.fault(ours, "a whole number of milliseconds, or nothing"));
        }
        parsed.ok()
    }

    fn timing(&self, faults: &mut Vec<Fault>) -> ClientTiming {
        let fields: Fields = ["client_rt_ms", "input", "hidden_ms"]
            .into_iter()
            .filter_map(|name| Some((name.to_owned(), self.value(name)?.to_owned())))
            .collect();
        let timing = ClientTiming::read(&fields);
        // A page's claim that makes no sense is no measurement; a file's is a mistake in the file.
        for (name, is_read) in [
            ("client_rt_ms", timing.client_rt_ms.is_some()),
            ("hidden_ms", timing.hidden_ms.is_some()),
        ] {
            let is_told = faults
                .iter()
                .any(|fault| fault.column == self.fault(name, "").column);
            if self.value(name).is_some() && !is_read && !is_told {
                faults.push(self.fault(
                    name,
                    "a whole number of milliseconds up to a day, or nothing",
                ));
            }
        }
        if self.value("input").is_some() && timing.input.is_none() {
            faults.push(self.fault("input", "mouse, touch, pen, keyboard, or nothing"));
        }
        timing
    }
}
