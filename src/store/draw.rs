//! What a run would be, drawn before its start is queued: the steps of each condition, with the problems that they ask.

use data_encoding::HEXLOWER;
use rand::Rng;
use rand::seq::SliceRandom;
use sha2::{Digest, Sha256};

use super::job::{AskedProblem, CandidateRun, DrawnStep};
use super::json;
use crate::model::ChoiceProblem;
use crate::study::{Cell, Condition, Step, StepError, StepPlan, Study};

/// Draws the steps of one run, with the problems that its choices put before the person: once for each condition, in
/// random order, so that of equally filled conditions chance decides.
///
/// # Errors
/// When the study cannot make a step of what it drew itself.
pub fn draw_run(study: &Study, rng: &mut impl Rng) -> Result<Vec<CandidateRun>, StepError> {
    if study.conditions().is_empty() {
        return Ok(vec![candidate(study, None, rng)?]);
    }
    let candidates: Result<Vec<CandidateRun>, StepError> = study
        .conditions()
        .iter()
        .map(|condition| candidate(study, Some(condition), rng))
        .collect();
    let mut candidates = candidates?;
    candidates.shuffle(rng);
    Ok(candidates)
}

fn candidate(
    study: &Study,
    condition: Option<&Condition>,
    rng: &mut impl Rng,
) -> Result<CandidateRun, StepError> {
    let steps: Result<Vec<DrawnStep>, StepError> = study
        .draw_steps(condition, rng)
        .into_iter()
        .map(|plan| drawn_step(study, plan))
        .collect();
    Ok(CandidateRun {
        condition: condition.map(|condition| condition.id.clone()),
        steps: steps?,
    })
}

/// A step with the problem that it puts before the person.
///
/// # Errors
/// When the study has no such step.
pub fn drawn_step(study: &Study, plan: StepPlan) -> Result<DrawnStep, StepError> {
    let (asked, is_fitted, is_practice) = match study.step(&plan)? {
        Step::Choice(choice) => {
            let cell = match (choice.cell, &plan.question) {
                (Some(cell), _) => cell.to_string(),
                // No level id holds a colon, so this is no cell of any design.
                (None, Some(question)) => format!("{}:{question}", plan.block),
                (None, None) => plan.block.to_string(),
            };
            let asked =
                (!choice.practice).then(|| AskedProblem::new(cell, choice.problem, plan.limit_ms));
            (asked, choice.fitted, choice.practice)
        }
        Step::Consent(_) | Step::Info(_) | Step::Replays(_) | Step::Form(_) | Step::Thanks(_) => {
            (None, false, false)
        }
    };
    Ok(DrawnStep {
        plan,
        asked,
        is_fitted,
        is_practice,
    })
}

impl AskedProblem {
    /// The problem of a cell, or of a `block:question` outside the design. Equal prospects under the same time limit have
    /// equal hashes: SHA-256 of the prospects, followed where there is a limit by a colon and its milliseconds, so that a
    /// migration could tell the limits of problems apart that were stored before limits were part of it.
    pub fn new(cell: String, problem: Option<&ChoiceProblem>, limit_ms: Option<u64>) -> Self {
        let prospects = problem.map(json);
        let mut hash = HEXLOWER.encode(&Sha256::digest(prospects.as_deref().unwrap_or("withheld")));
        if let Some(limit_ms) = limit_ms {
            hash = format!("{hash}:{limit_ms}");
        }
        Self {
            cell,
            hash,
            prospects,
        }
    }

    /// The problem of a cell as this version of its study asks it.
    pub fn of(cell: &Cell) -> Self {
        Self::new(cell.id.to_string(), cell.problem.as_ref(), cell.limit_ms)
    }
}
