//! The rules of a run: what a form, a look at a page and the passing of time make of it.
//!
//! Pure: no database, no clock. The writer loads [`RunFacts`], lets them judge its jobs one after the other and stores
//! what changed, so jobs of one run inside one commit see each other's effects. Replaying a run's events through the
//! same rules gives its answers again.
//!
//! 1. The same key with the same body is a retry, with another body a conflict. Neither changes anything.
//! 2. A form for a closed step is a duplicate: kept, and without effect. One for a step not reached yet is refused.
//! 3. An answer to a timed question counts until its deadline, which was fixed when the question was shown; after
//!    that it is late. The page's word that the time ran out is believed once the limit has passed, and not before.
//! 4. A wrong answer to a comprehension check leaves the step open while attempts are left; the last one ends the run or
//!    goes on, as the study says. An answer of somebody whom the study does not look for ends the run.
//! 5. A closed step leads to the next. Where that one is timed and of the same block, its clock starts at once,
//!    because the page that follows shows it.
//! 6. A run that has an end and is not finished by then is ended by the sweep. An answer that comes before the sweep
//!    still counts.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::{AnswerStatus, ProblemId, RunState, Verdict};
use crate::study::step::{AfterFailure, Assessment, ClientTiming};
use crate::study::{BlockId, DEFAULT_GRACE_MS, Deadline, Reply, StepKind, TimeFactor, Timestamp};

/// How long after a deadline the sweep waits: an answer that was received in time and still waits to be written comes
/// first, and one that is a few seconds late is kept as late, not as a repetition of a question that is closed. It
/// delays nobody, since a page that somebody looks at does not wait for the sweep.
pub(super) const SWEEP_SLACK_MS: i64 = 5_000;

/// A form that was sent, read by the step's own rules ([`Step::read`](crate::study::Step::read)).
#[derive(Debug, Clone, PartialEq)]
pub struct Submission {
    /// The step that it answers.
    pub position: u32,
    /// The form's idempotency key: 1 to 64 bytes, new for each form that is shown.
    pub key: String,
    /// What it said.
    pub reply: Reply,
    /// What the page measured, for choices.
    pub timing: ClientTiming,
    /// The version of the consent text, for consent steps.
    pub consent_version: Option<String>,
    /// What the study makes of it ([`Step::assess`](crate::study::Step::assess)).
    pub assessment: Assessment,
}

/// What is kept of a form as the event's body, and compared where its key is used again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Body {
    #[serde(flatten)]
    pub(super) reply: Reply,
    pub(super) timing: ClientTiming,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) consent_version: Option<String>,
    #[serde(default, skip_serializing_if = "Assessment::passes")]
    pub(super) assessment: Assessment,
}

impl Body {
    pub(super) fn of(submission: &Submission) -> Self {
        let Submission {
            position: _,
            key: _,
            reply,
            timing,
            consent_version,
            assessment,
        } = submission.clone();
        Self {
            reply,
            timing,
            consent_version,
            assessment,
        }
    }
}

/// What is kept of the end of a run that the server ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct EndedBody {
    /// How it ended.
    pub(super) state: RunState,
}

/// Why a form is refused. Nothing is stored of it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    #[error("the run is {0}")]
    Over(RunState),
    #[error("step {asked} is not reached yet; the current one is step {current}")]
    Ahead { asked: u32, current: u32 },
    #[error("step {0} has a time limit and was not shown yet")]
    NotShown(u32),
    #[error("step {position} is of kind {kind}, which takes {takes}")]
    Misfit {
        position: u32,
        kind: &'static str,
        takes: &'static str,
    },
    #[error("step {0} is missing in the run")]
    Missing(u32),
}

/// How a key that was sent before compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KeySeen {
    Never,
    SameBody,
    OtherBody,
}

/// What the rules need to know of a run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RunFacts {
    pub(super) state: RunState,
    /// The first step that is not closed.
    pub(super) position: u32,
    /// When that step was first shown; in a run that has ended, the step that was shown and never answered.
    pub(super) shown_at: Option<Timestamp>,
    /// The last moment at which its answer counts.
    pub(super) deadline: Option<Timestamp>,
    /// How often the current step was answered wrongly.
    pub(super) attempts: u32,
    /// When the run gives its place back if it is not finished.
    pub(super) expires_at: Option<Timestamp>,
    /// When the run ended, if that has just happened.
    pub(super) ended_at: Option<Timestamp>,
    pub(super) factor: TimeFactor,
    pub(super) is_preview: bool,
    /// The current step and those that follow it, as far as they are needed.
    pub(super) ahead: VecDeque<StepFacts>,
}

/// What the rules need to know of a step.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StepFacts {
    pub(super) kind: StepKind,
    pub(super) block: BlockId,
    pub(super) limit_ms: Option<u64>,
    /// Set for choices that are no practice.
    pub(super) problem: Option<ProblemId>,
}

/// A step that was closed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Closed {
    pub(super) position: u32,
    pub(super) status: AnswerStatus,
    pub(super) problem: Option<ProblemId>,
    pub(super) is_counted: bool,
    pub(super) shown_at: Option<Timestamp>,
    pub(super) at: Timestamp,
    pub(super) server_ms: Option<u64>,
    pub(super) limit_ms: Option<u64>,
    pub(super) deadline: Option<Timestamp>,
    /// How often it was answered: more than once for a comprehension check only.
    pub(super) attempts: u32,
}

/// What a form did.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Judgement {
    pub(super) verdict: Verdict,
    pub(super) closed: Option<Closed>,
    /// The next step, if its clock was started.
    pub(super) shown: Option<u32>,
}

impl Judgement {
    fn without_effect(verdict: Verdict) -> Self {
        Self {
            verdict,
            closed: None,
            shown: None,
        }
    }
}

impl RunFacts {
    /// A form arrived.
    pub(super) fn submit(
        &mut self,
        submission: &Submission,
        seen: KeySeen,
        at: Timestamp,
    ) -> Result<Judgement, Refusal> {
        match seen {
            KeySeen::SameBody => return Ok(Judgement::without_effect(Verdict::Retry)),
            KeySeen::OtherBody => return Ok(Judgement::without_effect(Verdict::Conflict)),
            KeySeen::Never => {}
        }
        if self.state != RunState::Withdrawn && submission.position < self.position {
            return Ok(Judgement::without_effect(Verdict::Duplicate));
        }
        if self.state != RunState::Active {
            return Err(Refusal::Over(self.state));
        }
        if submission.position > self.position {
            return Err(Refusal::Ahead {
                asked: submission.position,
                current: self.position,
            });
        }
        let step = self.ahead.front().ok_or(Refusal::Missing(self.position))?;
        require_fit(self.position, step, &submission.reply)?;
        if step.limit_ms.is_some() && self.deadline.is_none() {
            return Err(Refusal::NotShown(self.position));
        }
        let failure = match submission.assessment {
            Assessment::Wrong { last_attempt, then } => {
                if self.attempts.saturating_add(1) < last_attempt {
                    self.attempts += 1;
                    return Ok(Judgement::without_effect(Verdict::Wrong));
                }
                Some(then)
            }
            Assessment::Passes | Assessment::ScreensOut => None,
        };
        let is_late = self.deadline.is_some_and(|deadline| at > deadline);
        let status = match &submission.reply {
            Reply::GaveUp if !self.has_run_out(step, at) => {
                return Ok(Judgement::without_effect(Verdict::Early));
            }
            Reply::GaveUp => AnswerStatus::TimedOut,
            Reply::Chose { .. } if is_late => AnswerStatus::Late,
            Reply::Agreed
            | Reply::AgreedTo { .. }
            | Reply::Declined
            | Reply::Continued
            | Reply::Watched { .. }
            | Reply::Chose { .. }
            | Reply::Filled { .. } => AnswerStatus::Answered,
        };
        let block = step.block.clone();
        let closed = self.close(status, at);
        if submission.reply == Reply::Declined {
            self.end(RunState::Declined, at);
        }
        if submission.assessment == Assessment::ScreensOut {
            self.end(RunState::ScreenedOut, at);
        }
        if failure == Some(AfterFailure::End) {
            self.end(RunState::FailedCheck, at);
        }
        let shown = self.start_clock_of_next(&block, at);
        Ok(Judgement {
            verdict: verdict_of(status),
            closed: Some(closed),
            shown,
        })
    }

    /// The page of the step at `position` is about to be sent. Returns whether this is the first time.
    ///
    /// Another position than the current one is a page that was overtaken by another tab: nothing happens.
    pub(super) fn show(&mut self, position: u32, at: Timestamp) -> bool {
        if self.state != RunState::Active || position != self.position || self.shown_at.is_some() {
            return false;
        }
        let limit_ms = self.ahead.front().and_then(|step| step.limit_ms);
        self.deadline = limit_ms.map(|limit_ms| self.limit(limit_ms).closes_at(at));
        self.shown_at = Some(at);
        true
    }

    /// Closes the current step if its deadline passed more than `slack_ms` ago. The next one is not shown, because
    /// nobody may be there.
    pub(super) fn time_out(&mut self, at: Timestamp, slack_ms: i64) -> Option<Closed> {
        let deadline = self.deadline?;
        let is_over = at.0 > deadline.0.saturating_add(slack_ms);
        (self.state == RunState::Active && is_over).then(|| self.close(AnswerStatus::TimedOut, at))
    }

    /// Ends the run if it was not finished in its time. What was answered stays.
    pub(super) fn expire(&mut self, at: Timestamp) -> bool {
        let is_over = self.expires_at.is_some_and(|expires_at| at > expires_at);
        let ends = self.state == RunState::Active && is_over;
        if ends {
            self.end(RunState::TimedOut, at);
        }
        ends
    }

    fn has_run_out(&self, step: &StepFacts, at: Timestamp) -> bool {
        match (step.limit_ms, self.shown_at) {
            (Some(limit_ms), Some(shown_at)) => {
                self.limit(limit_ms).has_run_out(at.millis_since(shown_at))
            }
            (None, _) | (_, None) => false,
        }
    }

    fn limit(&self, limit_ms: u64) -> Deadline {
        Deadline::new(limit_ms, self.factor, DEFAULT_GRACE_MS)
    }

    fn close(&mut self, status: AnswerStatus, at: Timestamp) -> Closed {
        let step = self.ahead.pop_front();
        let limit_ms = step.as_ref().and_then(|step| step.limit_ms);
        let problem = step.and_then(|step| step.problem);
        // More time on request is a condition of its own, which is not mixed with the usual one.
        let has_usual_time = limit_ms.is_none() || self.factor == TimeFactor::ONE;
        let closed = Closed {
            position: self.position,
            status,
            problem,
            is_counted: problem.is_some() && has_usual_time && !self.is_preview,
            shown_at: self.shown_at.take(),
            at,
            server_ms: None,
            limit_ms: limit_ms.map(|limit_ms| self.limit(limit_ms).limit_ms()),
            deadline: self.deadline.take(),
            attempts: self.attempts + 1,
        };
        self.attempts = 0;
        self.position += 1;
        if self
            .ahead
            .front()
            .is_some_and(|next| next.kind == StepKind::Thanks)
        {
            self.end(RunState::Completed, at);
        }
        Closed {
            server_ms: closed.shown_at.map(|shown_at| at.millis_since(shown_at)),
            ..closed
        }
    }

    /// The run ends, at whatever step it is. When that was shown stays, because it tells what the person left.
    pub(super) fn end(&mut self, state: RunState, at: Timestamp) {
        self.state = state;
        self.deadline = None;
        self.ended_at = Some(at);
    }

    fn start_clock_of_next(&mut self, block: &BlockId, at: Timestamp) -> Option<u32> {
        let next = self.ahead.front()?;
        let follows = next.limit_ms.is_some() && next.block == *block;
        (follows && self.show(self.position, at)).then_some(self.position)
    }
}

fn verdict_of(status: AnswerStatus) -> Verdict {
    match status {
        AnswerStatus::Answered => Verdict::Answered,
        AnswerStatus::Late => Verdict::Late,
        AnswerStatus::TimedOut => Verdict::TimedOut,
        AnswerStatus::Skipped => Verdict::Skipped,
    }
}

fn require_fit(position: u32, step: &StepFacts, reply: &Reply) -> Result<(), Refusal> {
    let (fits, takes) = match step.kind {
        StepKind::Consent => (
            matches!(
                reply,
                Reply::Agreed | Reply::AgreedTo { .. } | Reply::Declined
            ),
            "agreement or refusal",
        ),
        StepKind::Info => (matches!(reply, Reply::Continued), "going on"),
        StepKind::Replays => (matches!(reply, Reply::Watched { .. }), "what was watched"),
        StepKind::Form => (matches!(reply, Reply::Filled { .. }), "the form's fields"),
        StepKind::Choice if step.limit_ms.is_some() => (
            matches!(reply, Reply::Chose { .. } | Reply::GaveUp),
            "an action, or the end of its time",
        ),
        StepKind::Choice => (matches!(reply, Reply::Chose { .. }), "an action"),
        StepKind::Thanks => (false, "nothing"),
    };
    if fits {
        Ok(())
    } else {
        Err(Refusal::Misfit {
            position,
            kind: step.kind.as_str(),
            takes,
        })
    }
}

#[cfg(test)]
mod tests;
