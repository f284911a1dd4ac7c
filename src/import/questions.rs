//! The questions of a study that answers from elsewhere can belong to.

use std::collections::BTreeMap;

use crate::store::{DrawnStep, drawn_step};
use crate::study::{ActionId, Asks, ConditionId, Step, StepData, StepKind, StepPlan, Study};

/// A question as an imported run has it.
#[derive(Debug, Clone)]
pub(super) struct Question {
    pub(super) step: DrawnStep,
    pub(super) actions: Vec<ActionId>,
    /// The condition whose people are asked it; none in a study without conditions, and outside the design.
    pub(super) condition: Option<ConditionId>,
}

/// All questions by the problem that they ask.
#[derive(Debug)]
pub(super) struct Questions(BTreeMap<String, Vec<Question>>);

impl Questions {
    pub(super) fn of(study: &Study) -> Self {
        let mut questions: BTreeMap<String, Vec<Question>> = BTreeMap::new();
        for contents in study.contents() {
            let Asks::Choices {
                limit_ms,
                questions: asked,
            } = contents.asks
            else {
                continue;
            };
            for question in asked {
                let actions: Vec<ActionId> = question
                    .actions
                    .iter()
                    .map(|action| action.id.clone())
                    .collect();
                let mut plan = StepPlan {
                    kind: StepKind::Choice,
                    block: contents.block.clone(),
                    question: Some(question.id.clone()),
                    limit_ms,
                    data: StepData::default(),
                };
                if let Ok(Step::Choice(choice)) = study.step(&plan) {
                    plan.data.levels = choice.levels.iter().cloned().collect();
                }
                let fallback = format!("{}:{}", contents.block, question.id);
                // A study makes a step of each of its own questions.
                let Ok(step) = drawn_step(study, plan) else {
                    continue;
                };
                let problem = match &step.asked {
                    Some(asked) => asked.cell.clone(),
                    None => fallback,
                };
                let condition = study
                    .cell(&problem)
                    .and_then(|cell| study.condition_of(cell));
                let condition = condition.map(|condition| condition.id.clone());
                questions.entry(problem).or_default().push(Question {
                    step,
                    actions,
                    condition,
                });
            }
        }
        Self(questions)
    }

    /// The questions that ask a problem, one per block; none for a problem that is not asked.
    pub(super) fn of_problem(&self, problem: &str) -> &[Question] {
        self.0.get(problem).map_or(&[], Vec::as_slice)
    }

    /// The problems that choices can be imported for.
    pub(super) fn problems(&self) -> impl Iterator<Item = &str> {
        self.0
            .iter()
            .filter(|(_, questions)| questions.iter().any(|question| !question.step.is_practice))
            .map(|(problem, _)| problem.as_str())
    }
}
