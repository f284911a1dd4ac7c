//! What strangers are shown of a public study: numbers that move in steps of several people, and never tell of few.
//!
//! Whoever watches aggregates that move with each person learns from the difference what that person did. So a snapshot is
//! released, and stays until several more have finished and every question that moved at all moved by several answers.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

use super::{QuestionCounts, Snapshot};
use crate::study::StudyId;

/// Fewer people than this stand for nobody but themselves.
const FEW: u64 = 5;

/// The released snapshot of each study, until the server ends.
#[derive(Debug, Default)]
pub struct Released {
    studies: Mutex<HashMap<StudyId, Release>>,
}

#[derive(Debug)]
struct Release {
    /// What it was made of.
    whole: Arc<Snapshot>,
    /// What is shown of that.
    shown: Arc<Snapshot>,
}

impl Released {
    /// What strangers are shown now; nothing while too few people have finished, or answered a question.
    pub fn of(&self, current: &Arc<Snapshot>) -> Option<Arc<Snapshot>> {
        // Nothing can be left half done under this lock.
        let mut studies = self.studies.lock().unwrap_or_else(PoisonError::into_inner);
        let release = studies.get(current.study.id());
        let is_due = match release {
            None => is_of_many(current),
            Some(release) => {
                // The same people with newer fits, or so many more that nobody stands out.
                release.whole.version.data_version == current.version.data_version
                    || is_of_many(current) && has_moved_by_many(&release.whole, current)
            }
        };
        if !is_due {
            return release.map(|release| release.shown.clone());
        }
        let is_new = release.is_none_or(|release| !Arc::ptr_eq(&release.whole, current));
        if is_new {
            let shown = Arc::new(current.of_many());
            let release = Release {
                whole: current.clone(),
                shown,
            };
            studies.insert(current.study.id().clone(), release);
        }
        let release = studies.get(current.study.id())?;
        Some(release.shown.clone())
    }
}

fn questions(snapshot: &Snapshot) -> impl Iterator<Item = &QuestionCounts> {
    snapshot
        .counts
        .cells
        .iter()
        .chain(&snapshot.counts.baseline)
}

fn is_of_many(snapshot: &Snapshot) -> bool {
    snapshot.people.analysed() >= FEW
        && questions(snapshot).all(|counts| counts.n() == 0 || counts.n() >= FEW)
}

/// Whether nobody who was counted since stands out, nor anybody who withdrew.
fn has_moved_by_many(before: &Snapshot, now: &Snapshot) -> bool {
    let pairs = questions(before).zip(questions(now));
    now.people.analysed() >= before.people.analysed() + FEW
        && pairs
            .map(|(before, now)| (before.n(), now.n()))
            .all(|(before, now)| now == before || now >= before + FEW)
}

/// To the next step below.
fn stepped(n: u64) -> u64 {
    n - n % FEW
}

impl Snapshot {
    /// The same without what tells of few people: counts of people, and of answers that are not analysed, in steps; looks
    /// at the evidence of several more people each.
    fn of_many(&self) -> Self {
        let mut shown = self.clone();
        let people = &mut shown.people;
        for n in [
            &mut people.started,
            &mut people.completed,
            &mut people.declined,
            &mut people.screened_out,
            &mut people.failed_check,
            &mut people.timed_out,
            &mut people.withdrawn,
            &mut people.excluded,
            &mut people.excluded_completed,
        ] {
            *n = stepped(*n);
        }
        let counts = &mut shown.counts;
        for question in counts.cells.iter_mut().chain(&mut counts.baseline) {
            question.late = stepped(question.late);
            question.timed_out = stepped(question.timed_out);
            question.before_exclusions = stepped(question.before_exclusions).max(question.n());
        }
        if let Some(evidence) = &mut shown.sequential {
            let mut last = 0;
            evidence.looks.retain(|look| {
                let is_kept = look.n >= last + FEW;
                if is_kept {
                    last = look.n;
                }
                is_kept
            });
            evidence.reached = evidence.reached.filter(|reached| reached.n >= FEW);
        }
        shown.is_of_many = true;
        shown
    }
}
