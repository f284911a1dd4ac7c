//! The answers of simulated people without a server: what an export of them would hold.

use crate::{
    inference::sampler::random_stream,
    model::{ChoiceError, Parameters, RiskAwareOptions},
    store::{
        AnswerKey, AnswerRow, AnswerStatus, Population, RunId, RunState, VersionId, VersionNumber,
        drawn_step,
    },
    study::{Condition, Step, StepError, Study},
};

use super::choice::choice;

/// People who follow a model with the same parameters.
#[derive(Debug, Clone)]
pub struct SimulatedGroup<'a> {
    /// The study that they take.
    pub study: &'a Study,
    /// How they choose.
    pub parameters: Parameters,
    /// The options of the model that they follow.
    pub options: RiskAwareOptions,
    /// Where they come from.
    pub source: Option<String>,
    /// Seed of orders and choices.
    pub seed: u64,
}

/// Why nobody could be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulatedAnswersError {
    /// The study cannot make its own steps.
    #[error("question: {0}")]
    Step(#[from] StepError),
    /// The model cannot say what the person would do.
    #[error("choice: {0}")]
    Choice(#[from] ChoiceError),
}

impl SimulatedGroup<'_> {
    /// All answers of one person to the study's choice questions, practice included, in the order in which this person
    /// meets them. Everything is answered, and in time; they have no clock.
    ///
    /// A pure function of the group and the number, which is also the person's number in the export. Conditions take
    /// turns.
    ///
    /// # Errors
    /// When the model gives no probabilities for a question.
    pub fn answers(&self, participant: u32) -> Result<Vec<AnswerRow>, SimulatedAnswersError> {
        let mut rng = random_stream(self.seed, participant.into());
        let steps = self.study.draw_steps(self.condition(participant), &mut rng);
        let mut rows = Vec::new();
        for (position, plan) in (0_u32..).zip(steps) {
            let drawn = drawn_step(self.study, plan)?;
            let Step::Choice(asked) = self.study.step(&drawn.plan)? else {
                continue;
            };
            let actions: Vec<String> = asked
                .actions
                .iter()
                .map(|action| action.id.to_string())
                .collect();
            let chosen = choice(
                asked.problem,
                &actions,
                &self.parameters,
                self.options,
                &mut rng,
            )?;
            rows.push(AnswerRow {
                key: AnswerKey {
                    run: RunId::from(i64::from(participant)),
                    position,
                },
                version: VersionId::from(1),
                version_number: VersionNumber::from(1),
                run_state: RunState::Completed,
                block: drawn.plan.block,
                question: drawn.plan.question,
                problem: drawn.asked.map(|asked| asked.cell),
                action: Some(chosen.as_str().into()),
                status: AnswerStatus::Answered,
                is_counted: !drawn.is_practice,
                is_fitted: drawn.is_fitted,
                is_practice: drawn.is_practice,
                shown_at: None,
                answered_at: None,
                server_ms: None,
                client_rt_ms: None,
                limit_ms: drawn.plan.limit_ms,
                input: None,
                hidden_ms: None,
                source: self.source.clone(),
                population: Population::Simulated,
            });
        }
        Ok(rows)
    }

    fn condition(&self, participant: u32) -> Option<&Condition> {
        let conditions = self.study.conditions();
        let turn = participant as usize % conditions.len().max(1);
        conditions.get(turn)
    }
}
