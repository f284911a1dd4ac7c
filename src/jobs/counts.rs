//! What was chosen, question by question, in the study's own order.

use crate::{
    store::{AnalysisSet, AnswerStatus, AskedProblem, CellCount},
    study::{ActionId, Include, Study},
};

/// How often each action of one question was chosen.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct QuestionCounts {
    /// Answers of the analysis set by action, in the order of the question's actions.
    pub actions: Vec<u64>,
    /// Answers that came after limit and grace; never counted as choices.
    pub late: u64,
    /// Questions whose time ran out without an answer.
    pub timed_out: u64,
    /// Valid answers of everybody, before the study's rule of inclusion was applied and anybody was left out.
    pub before_exclusions: u64,
}

impl QuestionCounts {
    /// Answers of the analysis set.
    pub fn n(&self) -> u64 {
        self.actions.iter().sum()
    }
}

/// The counts of all questions that are analysed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StudyCounts {
    /// One entry per cell of [`Study::cells`].
    pub cells: Vec<QuestionCounts>,
    /// One entry per question of [`Study::baseline`].
    pub baseline: Vec<QuestionCounts>,
}

impl StudyCounts {
    /// Sorts stored counts into the questions of this version of the study. Counts of questions that the version no
    /// longer asks, or asks with other outcomes, stay out.
    pub fn new(study: &Study, stored: &[CellCount]) -> Self {
        let cells = study
            .cells()
            .iter()
            .map(|cell| {
                let actions: Vec<&ActionId> =
                    cell.actions.iter().map(|action| &action.id).collect();
                let asked = AskedProblem::of(cell);
                count(analysis_set(study), &asked, &actions, stored)
            })
            .collect();
        let baseline = study
            .baseline()
            .iter()
            .map(|question| {
                let name = format!("{}:{}", question.block, question.question);
                let actions: Vec<ActionId> = question.problem.names().map(ActionId::from).collect();
                let asked = AskedProblem::new(name, Some(&question.problem), question.limit_ms);
                count(
                    analysis_set(study),
                    &asked,
                    &actions.iter().collect::<Vec<_>>(),
                    stored,
                )
            })
            .collect();
        Self { cells, baseline }
    }
}

/// Whose answers the study analyses.
pub(super) fn analysis_set(study: &Study) -> AnalysisSet {
    match study.include() {
        Include::All => AnalysisSet::All,
        Include::Completed => AnalysisSet::Completed,
    }
}

fn count(
    set: AnalysisSet,
    asked: &AskedProblem,
    actions: &[&ActionId],
    stored: &[CellCount],
) -> QuestionCounts {
    let mut counts = QuestionCounts {
        actions: vec![0; actions.len()],
        ..QuestionCounts::default()
    };
    for row in stored
        .iter()
        .filter(|row| row.cell == asked.cell && row.hash == asked.hash)
    {
        let n = row.n(set);
        match row.status {
            AnswerStatus::Answered => {
                if let Some(position) = actions
                    .iter()
                    .position(|action| Some(*action) == row.action.as_ref())
                {
                    counts.actions[position] += n;
                    counts.before_exclusions += row.n_before_exclusions;
                }
            }
            AnswerStatus::Late => counts.late += n,
            AnswerStatus::TimedOut => counts.timed_out += n,
            AnswerStatus::Skipped => {}
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::ProblemId;

    const TWO_LIMITS: &str = include_str!("../../studies/driving.toml");

    /// One answer to each cell, as it was put before people by `study`.
    fn one_answer_each(study: &Study) -> Vec<CellCount> {
        let cells = study.cells().iter().zip(1..);
        cells
            .map(|(cell, id)| {
                let asked = AskedProblem::of(cell);
                CellCount {
                    problem: ProblemId::from(id),
                    cell: asked.cell,
                    hash: asked.hash,
                    status: AnswerStatus::Answered,
                    action: cell.actions.first().map(|action| action.id.clone()),
                    n_all: 1,
                    n_completed: 1,
                    n_before_exclusions: 1,
                }
            })
            .collect()
    }

    #[test]
    fn answers_under_another_time_limit_are_no_answers_to_this_question() {
        let before = Study::parse("driving.toml", TWO_LIMITS).unwrap();
        let shorter = TWO_LIMITS.replace("limit_s = 8", "limit_s = 4");
        let after = Study::parse("driving.toml", &shorter).unwrap();
        let stored = one_answer_each(&before);
        let same = StudyCounts::new(&before, &stored);
        assert!(same.cells.iter().all(|cell| cell.n() == 1));
        let changed = StudyCounts::new(&after, &stored);
        for (cell, counts) in after.cells().iter().zip(&changed.cells) {
            let expected = u64::from(cell.limit_ms.is_none());
            assert_eq!(counts.n(), expected, "{}", cell.id);
        }
        assert!(changed.cells.iter().any(|cell| cell.n() == 0));
    }
}
