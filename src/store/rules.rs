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
//! 4. A closed step leads to the next. Where that one is timed and of the same block, its clock starts at once,
//!    because the page that follows shows it.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::{AnswerStatus, ProblemId, RunState, Verdict};
use crate::study::step::ClientTiming;
use crate::study::{BlockId, DEFAULT_GRACE_MS, Deadline, Reply, StepKind, TimeFactor, Timestamp};

/// How long after a deadline the sweep waits, so that an answer which was received in time and still waits to be
/// written comes first.
pub(super) const SWEEP_SLACK_MS: i64 = 1_000;

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
}

/// What is kept of a form as the event's body, and compared where its key is used again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Body {
    #[serde(flatten)]
    pub(super) reply: Reply,
    pub(super) timing: ClientTiming,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) consent_version: Option<String>,
}

impl Body {
    pub(super) fn of(submission: &Submission) -> Self {
        let Submission {
            position: _,
            key: _,
            reply,
            timing,
            consent_version,
        } = submission.clone();
        Self {
            reply,
            timing,
            consent_version,
        }
    }
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
    /// When that step was first shown.
    pub(super) shown_at: Option<Timestamp>,
    /// The last moment at which its answer counts.
    pub(super) deadline: Option<Timestamp>,
    /// When the run was completed or declined, if that has just happened.
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
        let is_late = self.deadline.is_some_and(|deadline| at > deadline);
        let status = match &submission.reply {
            Reply::GaveUp if !self.has_run_out(step, at) => {
                return Ok(Judgement::without_effect(Verdict::Early));
            }
            Reply::GaveUp => AnswerStatus::TimedOut,
            Reply::Chose { .. } if is_late => AnswerStatus::Late,
            Reply::Agreed
            | Reply::Declined
            | Reply::Continued
            | Reply::Chose { .. }
            | Reply::Filled { .. } => AnswerStatus::Answered,
        };
        let block = step.block.clone();
        let closed = self.close(status, at);
        if submission.reply == Reply::Declined {
            self.end(RunState::Declined, at);
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
        };
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

    fn end(&mut self, state: RunState, at: Timestamp) {
        self.state = state;
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
            matches!(reply, Reply::Agreed | Reply::Declined),
            "agreement or refusal",
        ),
        StepKind::Info => (matches!(reply, Reply::Continued), "going on"),
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
mod tests {
    use super::*;
    use crate::study::ActionId;

    const START: Timestamp = Timestamp(1_000_000);

    fn after(millis: i64) -> Timestamp {
        Timestamp(START.0 + millis)
    }

    fn step(kind: StepKind, block: &str, limit_ms: Option<u64>) -> StepFacts {
        let problem = (kind == StepKind::Choice).then_some(ProblemId::from(7));
        StepFacts {
            kind,
            block: BlockId::from(block),
            limit_ms,
            problem,
        }
    }

    /// consent, start page, two timed questions, one untimed, thanks.
    fn run() -> RunFacts {
        RunFacts {
            state: RunState::Active,
            position: 0,
            shown_at: None,
            deadline: None,
            ended_at: None,
            factor: TimeFactor::ONE,
            is_preview: false,
            ahead: VecDeque::from([
                step(StepKind::Consent, "consent", None),
                step(StepKind::Info, "timed", None),
                step(StepKind::Choice, "timed", Some(8_000)),
                step(StepKind::Choice, "timed", Some(8_000)),
                step(StepKind::Choice, "untimed", None),
                step(StepKind::Thanks, "thanks", None),
            ]),
        }
    }

    fn at_first_timed() -> RunFacts {
        let mut run = run();
        run.submit(&says(0, Reply::Agreed), KeySeen::Never, START)
            .unwrap();
        run.submit(&says(1, Reply::Continued), KeySeen::Never, START)
            .unwrap();
        run
    }

    fn says(position: u32, reply: Reply) -> Submission {
        let timing = ClientTiming::default();
        Submission {
            position,
            key: "k".into(),
            reply,
            timing,
            consent_version: None,
        }
    }

    fn stop() -> Reply {
        Reply::Chose {
            action: ActionId::from("stop"),
        }
    }

    #[track_caller]
    fn check_timed(reply: Reply, at: Timestamp, factor: f64, expected: Verdict) -> RunFacts {
        let mut run = run();
        run.factor = TimeFactor::new(factor).unwrap();
        run.submit(&says(0, Reply::Agreed), KeySeen::Never, START)
            .unwrap();
        run.submit(&says(1, Reply::Continued), KeySeen::Never, START)
            .unwrap();
        let judgement = run.submit(&says(2, reply), KeySeen::Never, at).unwrap();
        assert_eq!(judgement.verdict, expected);
        run
    }

    #[test]
    fn the_start_page_starts_the_clock_of_the_first_timed_question() {
        let mut run = run();
        let consent = run
            .submit(&says(0, Reply::Agreed), KeySeen::Never, START)
            .unwrap();
        assert_eq!(
            consent.shown, None,
            "the start page belongs to another block and has no limit"
        );
        let start = run
            .submit(&says(1, Reply::Continued), KeySeen::Never, after(5))
            .unwrap();
        assert_eq!(start.shown, Some(2));
        assert_eq!(run.deadline, Some(after(5 + 8_000 + 1_500)));
    }

    #[test]
    fn an_answer_counts_until_limit_and_grace_and_is_late_afterwards() {
        check_timed(stop(), after(7_900), 1.0, Verdict::Answered);
        check_timed(stop(), after(9_500), 1.0, Verdict::Answered);
        check_timed(stop(), after(9_501), 1.0, Verdict::Late);
        check_timed(stop(), after(10_000), 1.0, Verdict::Late);
        check_timed(stop(), after(13_500), 1.5, Verdict::Answered);
        check_timed(stop(), after(13_501), 1.5, Verdict::Late);
        check_timed(stop(), after(-50), 1.0, Verdict::Answered);
    }

    #[test]
    fn the_page_is_believed_about_the_end_of_time_only_once_it_has_come() {
        let mut run = check_timed(Reply::GaveUp, after(7_999), 1.0, Verdict::Early);
        assert_eq!(
            (run.position, run.shown_at),
            (2, Some(START)),
            "the question goes on"
        );
        assert_eq!(
            run.submit(&says(2, stop()), KeySeen::Never, after(8_100))
                .unwrap()
                .verdict,
            Verdict::Answered
        );
        check_timed(Reply::GaveUp, after(8_000), 1.0, Verdict::TimedOut);
        check_timed(Reply::GaveUp, after(8_000), 1.5, Verdict::Early);
        check_timed(Reply::GaveUp, after(12_000), 1.5, Verdict::TimedOut);
    }

    #[test]
    fn a_timed_answer_is_measured_and_the_next_clock_starts_within_the_block_only() {
        let mut run = at_first_timed();
        let first = run
            .submit(&says(2, stop()), KeySeen::Never, after(2_000))
            .unwrap();
        let closed = first.closed.unwrap();
        assert_eq!(
            (closed.server_ms, closed.limit_ms),
            (Some(2_000), Some(8_000))
        );
        assert!(closed.is_counted);
        assert_eq!((first.shown, run.deadline), (Some(3), Some(after(11_500))));
        let second = run
            .submit(&says(3, stop()), KeySeen::Never, after(3_000))
            .unwrap();
        assert_eq!(
            (second.shown, run.shown_at, run.deadline),
            (None, None, None),
            "the next block is untimed"
        );
    }

    #[test]
    fn neither_a_reload_nor_a_second_tab_moves_the_deadline() {
        let mut run = at_first_timed();
        let deadline = run.deadline;
        assert!(!run.show(2, after(4_000)));
        assert!(!run.show(1, after(4_000)));
        assert!(!run.show(3, after(4_000)));
        assert_eq!(run.deadline, deadline);
    }

    #[test]
    fn the_same_key_changes_nothing_and_a_closed_step_keeps_its_first_answer() {
        let mut run = at_first_timed();
        run.submit(&says(2, stop()), KeySeen::Never, after(10))
            .unwrap();
        let before = run.clone();
        for (seen, verdict) in [
            (KeySeen::SameBody, Verdict::Retry),
            (KeySeen::OtherBody, Verdict::Conflict),
            (KeySeen::Never, Verdict::Duplicate),
        ] {
            let judgement = run.submit(&says(2, stop()), seen, after(20)).unwrap();
            assert_eq!(
                judgement,
                Judgement {
                    verdict,
                    closed: None,
                    shown: None
                }
            );
        }
        assert_eq!(run, before);
    }

    #[test]
    fn steps_ahead_unseen_timed_questions_and_wrong_forms_are_refused() {
        let mut run = run();
        let ahead = run
            .submit(&says(3, stop()), KeySeen::Never, START)
            .unwrap_err();
        assert_eq!(
            ahead,
            Refusal::Ahead {
                asked: 3,
                current: 0
            }
        );
        let misfit = run
            .submit(&says(0, stop()), KeySeen::Never, START)
            .unwrap_err();
        assert_eq!(
            misfit.to_string(),
            "step 0 is of kind consent, which takes agreement or refusal"
        );
        run.position = 2;
        run.ahead.drain(..2);
        let unseen = run
            .submit(&says(2, stop()), KeySeen::Never, START)
            .unwrap_err();
        assert_eq!(unseen, Refusal::NotShown(2));
        run.position = 4;
        run.ahead.drain(..2);
        let untimed = run
            .submit(&says(4, Reply::GaveUp), KeySeen::Never, START)
            .unwrap_err();
        assert_eq!(
            untimed.to_string(),
            "step 4 is of kind choice, which takes an action"
        );
    }

    #[test]
    fn the_last_answer_completes_the_run_and_a_refusal_ends_it() {
        let mut finished = at_first_timed();
        for position in 2..5 {
            finished
                .submit(&says(position, stop()), KeySeen::Never, after(10))
                .unwrap();
        }
        assert_eq!(
            (finished.state, finished.position),
            (RunState::Completed, 5)
        );
        let over = finished
            .submit(&says(5, stop()), KeySeen::Never, after(20))
            .unwrap_err();
        assert_eq!(over, Refusal::Over(RunState::Completed));
        let again = finished
            .submit(&says(4, stop()), KeySeen::Never, after(20))
            .unwrap();
        assert_eq!(again.verdict, Verdict::Duplicate);

        let mut declined = run();
        declined
            .submit(&says(0, Reply::Declined), KeySeen::Never, START)
            .unwrap();
        assert_eq!(declined.state, RunState::Declined);
        assert!(!declined.show(1, after(1)));
        let on = declined
            .submit(&says(1, Reply::Continued), KeySeen::Never, START)
            .unwrap_err();
        assert_eq!(on, Refusal::Over(RunState::Declined));
    }

    #[test]
    fn an_abandoned_question_is_closed_after_its_deadline_and_the_next_is_not_shown() {
        let mut run = at_first_timed();
        assert_eq!(run.time_out(after(9_500), 0), None);
        assert_eq!(run.time_out(after(10_500), SWEEP_SLACK_MS), None);
        let closed = run.time_out(after(10_501), SWEEP_SLACK_MS).unwrap();
        assert_eq!(
            (closed.status, closed.position),
            (AnswerStatus::TimedOut, 2)
        );
        assert_eq!((run.position, run.shown_at, run.deadline), (3, None, None));
        assert_eq!(
            run.time_out(after(99_999), SWEEP_SLACK_MS),
            None,
            "a question that nobody saw does not run out"
        );
    }

    #[test]
    fn previews_and_timed_questions_with_extra_time_are_not_counted() {
        let timed = |factor: f64, is_preview: bool| {
            let mut run = at_first_timed();
            run.factor = TimeFactor::new(factor).unwrap();
            run.is_preview = is_preview;
            run.submit(&says(2, stop()), KeySeen::Never, after(10))
                .unwrap()
                .closed
                .unwrap()
                .is_counted
        };
        assert!(timed(1.0, false));
        assert!(!timed(1.5, false));
        assert!(!timed(1.0, true));
        let mut untimed = at_first_timed();
        untimed.factor = TimeFactor::new(1.5).unwrap();
        untimed
            .submit(&says(2, stop()), KeySeen::Never, after(10))
            .unwrap();
        untimed
            .submit(&says(3, stop()), KeySeen::Never, after(10))
            .unwrap();
        let closed = untimed
            .submit(&says(4, stop()), KeySeen::Never, after(10))
            .unwrap()
            .closed
            .unwrap();
        assert!(
            closed.is_counted,
            "extra time makes no difference where there is no limit"
        );
    }
}
