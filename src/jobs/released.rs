//! What strangers are shown of a public study: numbers that move in steps of several people, and never tell of few.
//!
//! Whoever watches aggregates that move with each person learns from the difference what that person did. So a snapshot is
//! released, and stays until several more are analysed, or several fewer, and every question that moved at all moved by
//! several answers. Whoever withdraws or is left out meanwhile is counted in it until then.

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
            // Another version of the study may ask other questions, whose counts begin anew: nothing to compare.
            Some(release) if release.whole.study.hash() != current.study.hash() => {
                is_of_many(current)
            }
            Some(release) => {
                // The same people with newer fits, or so many more or fewer that nobody stands out.
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

/// Whether nobody who was counted since stands out, nor anybody who withdrew or was left out. Both are of the same version of
/// the study, so they have the same questions.
fn has_moved_by_many(before: &Snapshot, now: &Snapshot) -> bool {
    let mut pairs = questions(before).zip(questions(now));
    now.people.analysed().abs_diff(before.people.analysed()) >= FEW
        // One who came in the place of one who left stands out as well, though the number is the same.
        && pairs.all(|(before, now)| {
            now.actions == before.actions || now.n().abs_diff(before.n()) >= FEW
        })
}

/// To the next step below.
fn stepped(n: u64) -> u64 {
    n - n % FEW
}

impl Snapshot {
    /// The same without what tells of few people: counts of people, and of answers that are not analysed, in steps; looks
    /// at the evidence of several more people each.
    ///
    /// What is analysed stays exact, because it moves by several from one release to the next. What contains it is shown as
    /// it and steps of the rest, so that no difference of two numbers tells of few either.
    fn of_many(&self) -> Self {
        let mut shown = self.clone();
        for (_, n) in &mut shown.exclusions {
            *n = stepped(*n);
        }
        shown.exclusions.retain(|&(_, n)| n > 0);
        let left_out: u64 = shown.exclusions.iter().map(|(_, n)| n).sum();
        let people = &mut shown.people;
        for n in [
            &mut people.declined,
            &mut people.screened_out,
            &mut people.failed_check,
            &mut people.timed_out,
            &mut people.withdrawn,
            &mut people.excluded,
        ] {
            *n = stepped(*n);
        }
        // Never more than the reasons add up to, each of which was rounded by itself.
        people.excluded_completed = stepped(people.excluded_completed).min(left_out);
        people.completed = self.people.analysed() + people.excluded_completed;
        let over = people.completed
            + people.declined
            + people.screened_out
            + people.failed_check
            + people.timed_out
            + people.withdrawn;
        people.started = over + stepped(self.people.under_way());
        let counts = &mut shown.counts;
        for question in counts.cells.iter_mut().chain(&mut counts.baseline) {
            let n = question.n();
            question.late = stepped(question.late);
            question.timed_out = stepped(question.timed_out);
            question.before_exclusions = n + stepped(question.before_exclusions.saturating_sub(n));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        jobs::known_fits::KnownFits,
        store::{AnswerStatus, AskedProblem, CellCount, Population, ProblemId, StudyState, Totals},
        study::{Flag, Study},
    };

    const DRIVING: &str = include_str!("../../studies/driving.toml");

    fn driving() -> Study {
        Study::parse("driving.toml", DRIVING).unwrap()
    }

    /// The same with another time limit.
    fn hurried() -> Study {
        let text = DRIVING.replace("limit_s = 8", "limit_s = 4");
        Study::parse("driving.toml", &text).unwrap()
    }

    /// So many people, of whom some are left out of everything.
    fn people(completed: u64, excluded: u64) -> Totals {
        Totals {
            started: completed,
            completed,
            declined: 0,
            screened_out: 0,
            failed_check: 0,
            timed_out: 0,
            withdrawn: 0,
            excluded,
            excluded_completed: excluded,
            exclusion_version: 0,
            data_version: i64::try_from(1000 * completed + excluded).unwrap(),
            page_version: i64::try_from(1000 * completed + excluded).unwrap(),
            erased_version: 0,
        }
    }

    /// How often the first action of each cell was chosen, as `asked` put it.
    fn chosen(asked: &Study, n_before_exclusions: u64, n: u64) -> Vec<CellCount> {
        let cells = asked.cells().iter().zip(1..);
        cells
            .map(|(cell, id)| {
                let asked = AskedProblem::of(cell);
                CellCount {
                    problem: ProblemId::from(id),
                    cell: asked.cell,
                    hash: asked.hash,
                    status: AnswerStatus::Answered,
                    action: cell.actions.first().map(|action| action.id.clone()),
                    n_before_exclusions,
                    n_all: n,
                    n_completed: n,
                }
            })
            .collect()
    }

    fn snapshot(study: Study, people: Totals, counts: &[CellCount]) -> Arc<Snapshot> {
        Arc::new(Snapshot::new(
            Arc::new(study),
            Population::People,
            StudyState::Closed,
            people,
            counts,
            KnownFits::default(),
        ))
    }

    /// The driving study after so many people, of whom some are left out by hand.
    fn after(completed: u64, excluded: u64) -> Arc<Snapshot> {
        let counts = chosen(&driving(), completed, completed - excluded);
        let made = snapshot(driving(), people(completed, excluded), &counts);
        let mut made = Arc::unwrap_or_clone(made);
        made.exclusions = vec![(None, excluded)];
        Arc::new(made)
    }

    #[test]
    fn no_number_and_no_difference_tells_of_few_who_are_left_out() {
        for completed in [5, 11, 22] {
            for excluded in 0..=completed - 5 {
                let shown = after(completed, excluded).of_many();
                let people = &shown.people;
                assert_eq!(people.analysed(), completed - excluded);
                let left_out = people.completed - people.analysed();
                assert_eq!(left_out, stepped(excluded), "{excluded} of {completed}");
                assert_eq!(people.under_way(), 0);
                let expected = match left_out {
                    0 => Vec::new(),
                    n => vec![(None, n)],
                };
                assert_eq!(shown.exclusions, expected);
                for question in &shown.counts.cells {
                    assert_eq!(question.n(), completed - excluded);
                    assert_eq!(question.before_exclusions - question.n(), left_out);
                }
            }
        }
    }

    #[test]
    fn reasons_are_rounded_each_and_add_up_to_what_is_left_out() {
        let mut made = Arc::unwrap_or_clone(after(20, 9));
        made.exclusions = vec![(Some(Flag::LateAnswer), 6), (None, 3)];
        let shown = made.of_many();
        assert_eq!(shown.exclusions, [(Some(Flag::LateAnswer), 5)]);
        assert_eq!(shown.people.excluded_completed, 5);
        made.exclusions = vec![(Some(Flag::LateAnswer), 4), (None, 5)];
        assert_eq!(made.of_many().exclusions, [(None, 5)]);
        assert_eq!(made.of_many().people.analysed(), 11);
    }

    #[test]
    fn a_fall_is_a_step_when_it_is_of_many_and_leaves_many() {
        let released = Released::default();
        let analysed = |current: &Arc<Snapshot>| released.of(current).unwrap().people.analysed();
        assert_eq!(analysed(&after(16, 0)), 16);
        assert_eq!(analysed(&after(16, 4)), 16);
        assert_eq!(analysed(&after(16, 5)), 11);
        assert_eq!(analysed(&after(12, 2)), 11);
        // Six withdrew.
        assert_eq!(analysed(&after(10, 5)), 5);
        assert_eq!(analysed(&after(10, 6)), 5);
        assert_eq!(analysed(&after(10, 1)), 5);
        assert_eq!(analysed(&after(10, 0)), 10);
        assert_eq!(analysed(&after(4, 0)), 10, "nothing of four people");
    }

    #[test]
    fn a_question_moves_by_many_or_not_at_all() {
        let released = Released::default();
        let study = driving();
        let asked = |last: [u64; 2]| {
            let mut counts = chosen(&study, 10, 10);
            let mut other = counts[0].clone();
            other.action = study.cells()[0]
                .actions
                .last()
                .map(|action| action.id.clone());
            (counts[0].n_all, other.n_all) = (last[0], last[1]);
            counts.push(other);
            counts
        };
        let first = snapshot(driving(), people(10, 0), &asked([10, 5]));
        assert!(released.of(&first).is_some());
        let analysed = |counts: &[CellCount]| {
            let current = snapshot(driving(), people(15, 0), counts);
            released.of(&current).unwrap().people.analysed()
        };
        assert_eq!(analysed(&asked([10, 6])), 10);
        assert_eq!(analysed(&asked([9, 6])), 10, "one in the place of another");
        assert_eq!(analysed(&asked([10, 5])), 15);
    }

    #[test]
    fn another_version_of_the_study_is_released_once_it_is_of_many() {
        let released = Released::default();
        let before = after(16, 0);
        assert!(released.of(&before).is_some());
        let version =
            |current: &Arc<Snapshot>| released.of(current).unwrap().study.hash().to_owned();
        let answered = |people: Totals, n: u64| {
            let counts = chosen(&hurried(), n, n);
            snapshot(hurried(), people, &counts)
        };
        // Published, and not a person more: its own answers are few, or none yet.
        let few = answered(people(16, 0), 4);
        assert_eq!(version(&few), before.study.hash());
        let none = answered(people(16, 0), 0);
        assert_eq!(version(&none), hurried().hash());
        // Back to the old one, and to the other with enough answers.
        assert_eq!(version(&after(17, 0)), before.study.hash());
        let many = answered(people(18, 0), 5);
        assert_eq!(version(&many), hurried().hash());
    }
}
