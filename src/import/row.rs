//! One row of a file.

use std::str::FromStr;

use csv::StringRecord;

use super::columns::Columns;
use super::questions::{Question, Questions};
use super::{Fault, Mapping};
use crate::store::{AnswerStatus, ImportedAnswer, RunState};
use crate::study::step::{ClientTiming, Fields};
use crate::study::{DEFAULT_GRACE_MS, Deadline, Reply, TimeFactor, Timestamp};

/// A row, and how to read it.
pub(super) struct Row<'a> {
    columns: &'a Columns,
    mapping: &'a Mapping,
    record: &'a StringRecord,
}

/// What a row says, as far as it can be read.
pub(super) struct Read<'a> {
    pub(super) participant: Option<&'a str>,
    pub(super) is_completed: bool,
    pub(super) question: Option<&'a Question>,
    /// None for a practice question, and where something is wrong.
    pub(super) answer: Option<ImportedAnswer>,
    /// Whether it tells when something happened; none where that is wrong.
    pub(super) has_times: Option<bool>,
    /// All that is wrong.
    pub(super) faults: Vec<Fault>,
}

/// When a question was shown and answered.
#[derive(Debug, Clone, Copy)]
struct Times {
    shown_at: Option<Timestamp>,
    at: Timestamp,
    /// Whether the row tells a moment; how long it took may be known without.
    are_moments: bool,
}

impl<'a> Row<'a> {
    pub(super) fn new(
        columns: &'a Columns,
        mapping: &'a Mapping,
        record: &'a StringRecord,
    ) -> Self {
        Self {
            columns,
            mapping,
            record,
        }
    }

    pub(super) fn line(&self) -> u64 {
        self.record.position().map_or(0, csv::Position::line)
    }

    /// Our column that names the question.
    pub(super) fn question_column(&self) -> &'a str {
        match self.columns.of("problem") {
            Some(_) => "problem",
            None => self
                .columns
                .factors()
                .first()
                .map_or("problem", String::as_str),
        }
    }

    /// What is wrong with the value of our column.
    pub(super) fn fault(&self, ours: &str, allowed: impl Into<String>) -> Fault {
        let column = self.columns.of(ours);
        let stands = column.and_then(|column| self.record.get(column.index));
        Fault {
            line: self.line(),
            column: self.columns.called(ours).to_owned(),
            value: stands.unwrap_or("").to_owned(),
            allowed: allowed.into(),
        }
    }

    /// Reads every cell, so that all that is wrong is told at once.
    pub(super) fn read<'q>(&self, questions: &'q Questions, now: Timestamp) -> Read<'q>
    where
        'a: 'q,
    {
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
        let is_completed = self.is_completed(&mut faults);
        let question = self.question(questions, &mut faults);
        let status = self.status(&mut faults);
        let times = self.times(now, &mut faults);
        let timing = self.timing(&mut faults);
        let to_answer = question.filter(|question| !question.step.is_practice);
        let reply = to_answer
            .zip(status)
            .and_then(|(question, status)| self.reply(question, status, &mut faults));
        if let Some(((question, status), times)) = to_answer.zip(status).zip(times) {
            faults.extend(self.limit_fault(question, status, times));
        }
        let answer = to_answer
            .zip(reply)
            .zip(times)
            .filter(|_| faults.is_empty())
            .map(|((question, reply), times)| ImportedAnswer {
                step: question.step.clone(),
                shown_at: times.shown_at,
                at: times.at,
                reply,
                timing,
            });
        Read {
            participant,
            is_completed,
            question,
            answer,
            has_times: times.map(|times| times.are_moments),
            faults,
        }
    }

    /// Our value of a column; none where it is empty or missing.
    fn value(&self, ours: &str) -> Option<&'a str> {
        let column = self.columns.of(ours)?;
        let theirs = self.record.get(column.index)?;
        let value = self.mapping.value(ours, theirs);
        (!value.is_empty()).then_some(value)
    }

    fn is_completed(&self, faults: &mut Vec<Fault>) -> bool {
        match self.value("run_state").map(str::parse::<RunState>) {
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
        }
    }

    fn question<'q>(
        &self,
        questions: &'q Questions,
        faults: &mut Vec<Fault>,
    ) -> Option<&'q Question> {
        let named_by = self.question_column();
        let problem = match self.columns.of("problem") {
            Some(_) => self.value("problem").unwrap_or("").to_owned(),
            None => {
                let levels: Vec<&str> = self
                    .columns
                    .factors()
                    .iter()
                    .map(|factor| self.value(factor).unwrap_or(""))
                    .collect();
                levels.join("/")
            }
        };
        let asked = questions.of_problem(&problem);
        let Some(first) = asked.first() else {
            let known: Vec<String> = questions
                .problems()
                .map(|known| self.mapping.theirs("problem", known))
                .collect();
            faults.push(Fault {
                value: problem,
                ..self.fault(named_by, known.join(", "))
            });
            return None;
        };
        let Some(block) = self.value("block") else {
            return Some(first);
        };
        let found = asked
            .iter()
            .find(|question| question.step.plan.block == *block);
        if found.is_none() {
            let blocks: Vec<String> = asked
                .iter()
                .map(|question| {
                    self.mapping
                        .theirs("block", question.step.plan.block.as_str())
                })
                .collect();
            faults.push(self.fault(
                "block",
                format!("{}, which ask {problem}, or nothing", blocks.join(", ")),
            ));
        }
        found
    }

    fn status(&self, faults: &mut Vec<Fault>) -> Option<AnswerStatus> {
        match self.value("status").map(str::parse::<AnswerStatus>) {
            None => Some(AnswerStatus::Answered),
            Some(Ok(
                status @ (AnswerStatus::Answered | AnswerStatus::Late | AnswerStatus::TimedOut),
            )) => Some(status),
            Some(Ok(AnswerStatus::Skipped) | Err(_)) => {
                faults.push(self.fault("status", "answered, late, timed_out, or nothing"));
                None
            }
        }
    }

    fn reply(
        &self,
        question: &Question,
        status: AnswerStatus,
        faults: &mut Vec<Fault>,
    ) -> Option<Reply> {
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

    /// When the question was shown and answered, as far as the row tells: the moments, or how long it took, from which a
    /// missing moment follows. A row without any gets the time of the import.
    fn times(&self, now: Timestamp, faults: &mut Vec<Fault>) -> Option<Times> {
        let before = faults.len();
        let shown_at = self.moment("shown_at_ms", now, faults);
        let answered_at = self.moment("answered_at_ms", now, faults);
        let took = self.number::<u32>("server_ms", faults).map(i64::from);
        if faults.len() > before {
            return None;
        }
        let (shown_at, at) = match (shown_at, answered_at, took) {
            (Some(shown_at), Some(at), _) if shown_at > at => {
                faults.push(self.fault("shown_at_ms", "a moment before answered_at_ms"));
                return None;
            }
            (Some(shown_at), Some(at), Some(took)) if at - shown_at != took => {
                let allowed = format!(
                    "{}, which lies between shown_at_ms and answered_at_ms, or nothing",
                    at - shown_at
                );
                faults.push(self.fault("server_ms", allowed));
                return None;
            }
            (Some(_), None, None) => {
                faults.push(self.fault(
                    "answered_at_ms",
                    "a moment, or how long it took as server_ms, because shown_at_ms has a moment",
                ));
                return None;
            }
            (Some(shown_at), None, Some(took)) if shown_at + took > now.0 => {
                faults.push(self.fault("server_ms", "a time that was over before now"));
                return None;
            }
            (shown_at, Some(at), took) => (shown_at.or(took.map(|took| at - took)), at),
            (Some(shown_at), None, Some(took)) => (Some(shown_at), shown_at + took),
            (None, None, took) => (took.map(|took| now.0 - took), now.0),
        };
        Some(Times {
            shown_at: shown_at.map(Timestamp),
            at: Timestamp(at),
            are_moments: self
                .value("answered_at_ms")
                .or(self.value("shown_at_ms"))
                .is_some(),
        })
    }

    /// What is wrong with the status for this question's limit, or for a question without one.
    fn limit_fault(
        &self,
        question: &Question,
        status: AnswerStatus,
        times: Times,
    ) -> Option<Fault> {
        let Some(limit_ms) = question.step.plan.limit_ms else {
            return (status != AnswerStatus::Answered)
                .then(|| self.fault("status", "answered, because this question has no limit"));
        };
        let Some(shown_at) = times.shown_at else {
            return Some(self.fault(
                "server_ms",
                "how long it took in milliseconds, here or as shown_at_ms and answered_at_ms, because this question has a limit; \
                 a mapping can take a column of response times for it",
            ));
        };
        let deadline = Deadline::new(limit_ms, TimeFactor::ONE, DEFAULT_GRACE_MS);
        let is_late = times.at > deadline.closes_at(shown_at);
        let (fits, allowed) = match status {
            AnswerStatus::Late => (
                is_late,
                "answered, because it came before the limit and its grace",
            ),
            AnswerStatus::TimedOut => (
                deadline.has_run_out(times.at.millis_since(shown_at)),
                "answered, because the limit had not passed",
            ),
            AnswerStatus::Answered | AnswerStatus::Skipped => (
                !is_late,
                "late or timed_out, because the limit and its grace had passed",
            ),
        };
        (!fits).then(|| self.fault("status", allowed))
    }

    /// A moment in milliseconds since 1970: written so, or as a date and time.
    fn moment(&self, ours: &str, now: Timestamp, faults: &mut Vec<Fault>) -> Option<i64> {
        let value = self.value(ours)?;
        let moment = value.parse().ok().or_else(|| {
            let moment: jiff::Timestamp = value.parse().ok()?;
            Some(moment.as_millisecond())
        });
        let moment = moment.filter(|moment| (0..=now.0).contains(moment));
        if moment.is_none() {
            faults.push(self.fault(
                ours,
                "a moment from 1970 until now in milliseconds since then (UTC), or with its offset as in 2019-05-03T10:15:00Z, or nothing",
            ));
        }
        moment
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
        for (name, is_read, allowed) in [
            (
                "client_rt_ms",
                timing.client_rt_ms.is_some(),
                "a whole number of milliseconds up to a day, or nothing",
            ),
            (
                "hidden_ms",
                timing.hidden_ms.is_some(),
                "a whole number of milliseconds up to a day, or nothing",
            ),
            (
                "input",
                timing.input.is_some(),
                "mouse, touch, pen, keyboard, or nothing",
            ),
        ] {
            if self.value(name).is_some() && !is_read {
                faults.push(self.fault(name, allowed));
            }
        }
        timing
    }
}
