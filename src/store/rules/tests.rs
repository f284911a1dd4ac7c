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
        attempts: 0,
        expires_at: None,
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
        assessment: Assessment::Passes,
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
    assert_eq!(run.time_out(after(14_500), SWEEP_SLACK_MS), None);
    let closed = run.time_out(after(14_501), SWEEP_SLACK_MS).unwrap();
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

/// A check, a question, thanks.
fn at_check() -> RunFacts {
    RunFacts {
        ahead: VecDeque::from([
            step(StepKind::Form, "check", None),
            step(StepKind::Choice, "untimed", None),
            step(StepKind::Thanks, "thanks", None),
        ]),
        ..run()
    }
}

fn fills(assessment: Assessment) -> Submission {
    let values = serde_json::Map::new();
    Submission {
        assessment,
        ..says(0, Reply::Filled { values })
    }
}

fn wrong(then: AfterFailure) -> Submission {
    fills(Assessment::Wrong {
        last_attempt: 2,
        then,
    })
}

#[test]
fn a_wrong_attempt_leaves_the_check_open_and_the_last_one_ends_the_run() {
    let mut run = at_check();
    let first = run
        .submit(&wrong(AfterFailure::End), KeySeen::Never, START)
        .unwrap();
    assert_eq!((first.verdict, first.closed), (Verdict::Wrong, None));
    assert_eq!(
        (run.state, run.position, run.attempts),
        (RunState::Active, 0, 1)
    );
    let last = run
        .submit(&wrong(AfterFailure::End), KeySeen::Never, after(5))
        .unwrap();
    assert_eq!(last.closed.unwrap().attempts, 2);
    assert_eq!(
        (run.state, run.ended_at),
        (RunState::FailedCheck, Some(after(5)))
    );
}

#[test]
fn a_retry_of_a_wrong_attempt_is_no_second_attempt() {
    let mut run = at_check();
    run.submit(&wrong(AfterFailure::End), KeySeen::Never, START)
        .unwrap();
    let again = run
        .submit(&wrong(AfterFailure::End), KeySeen::SameBody, START)
        .unwrap();
    assert_eq!(again.verdict, Verdict::Retry);
    assert_eq!((run.state, run.attempts), (RunState::Active, 1));
}

#[test]
fn a_failed_check_can_go_on_and_attempts_start_anew_at_the_next_step() {
    let mut run = at_check();
    for _ in 0..2 {
        run.submit(&wrong(AfterFailure::GoOn), KeySeen::Never, START)
            .unwrap();
    }
    assert_eq!(
        (run.state, run.position, run.attempts),
        (RunState::Active, 1, 0)
    );
}

#[test]
fn a_check_that_is_passed_at_the_second_attempt_goes_on() {
    let mut run = at_check();
    run.submit(&wrong(AfterFailure::End), KeySeen::Never, START)
        .unwrap();
    let passed = run
        .submit(&fills(Assessment::Passes), KeySeen::Never, START)
        .unwrap();
    assert_eq!(passed.closed.unwrap().attempts, 2);
    assert_eq!((run.state, run.position), (RunState::Active, 1));
}

#[test]
fn screening_ends_the_run_even_at_its_last_step() {
    let mut run = at_check();
    run.ahead.remove(1);
    run.submit(&fills(Assessment::ScreensOut), KeySeen::Never, START)
        .unwrap();
    assert_eq!(run.state, RunState::ScreenedOut);
    let more = run.submit(&says(1, Reply::Continued), KeySeen::Never, START);
    assert_eq!(more, Err(Refusal::Over(RunState::ScreenedOut)));
}

#[test]
fn a_run_that_ends_by_itself_remembers_what_was_on_the_screen() {
    let mut run = at_first_timed();
    run.expires_at = Some(after(60_000));
    assert_eq!(run.shown_at, Some(START));
    assert!(run.expire(after(60_001)));
    assert_eq!((run.shown_at, run.deadline), (Some(START), None));
    // Nothing can be done to it any more.
    assert!(!run.show(2, after(60_002)));
    assert_eq!(run.time_out(after(600_000), 0), None);
}
