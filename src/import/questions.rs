//! The questions of a study that answers from elsewhere can belong to.

use std::collections::BTreeMap;

use crate::store::{DrawnStep, drawn_step};
use crate::study::{ActionId, Asks, Step, StepData, StepKind, StepPlan, Study};

/// A question as an imported run has it.
#[derive(Debug, Clone)]
pub(super) struct Question {
    pub(super) step: DrawnStep,
    pub(super) actions: Vec<ActionId>,
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
                questions
                    .entry(problem)
                    .or_default()
                    .push(Question { step, actions });
            }
        }
        Self(questions)
    }

    /// The question of a problem; where several ask it, the one of this block, or the first.
    pub(super) fn find(&self, problem: &str, block: Option<&str>) -> Option<&Question> {
        let found = self.0.get(problem)?;
        let of_block = found
            .iter()
            .find(|question| block.is_some_and(|block| question.step.plan.block == *block));
        of_block.or_else(|| found.first())
    }

    /// The problems that choices can be imported for.
    pub(super) fn problems(&self) -> impl Iterator<Item = &str> {
        self.0
            .iter()
            .filter(|(_, questions)| questions.iter().any(|question| !question.step.is_practice))
            .map(|(problem, _)| problem.as_str())
    }
}
