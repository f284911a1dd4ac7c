//! What each richer model adds to the prediction of answers that it has not seen.

use serde::{Deserialize, Serialize};

use super::held_out::{Exam, RANDOM};
use super::plan::PlanData;
use super::score::{ScoreDifference, Weighted, sum_and_se};
use crate::inference::summary::null_as_nan;

/// One rung: a model, and what it gains over the one before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LadderStep {
    /// The model's id, or `random`.
    pub id: String,
    /// The name for people.
    pub label: String,
    /// On problems that were held out; missing where there were none, or a fit did not converge.
    pub problems: Option<StepScore>,
    /// On people (or answers) that were left out.
    pub units: Option<StepScore>,
}

/// A score, and its distance from the step before.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct StepScore {
    /// Expected log score, in nats.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub score: f64,
    /// The same per answer; chance among A actions has −ln A.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub per_answer: f64,
    /// What it gains over the step before; missing for the first, and after a step without a score.
    pub gain: Option<ScoreDifference>,
    /// The gain per answer.
    pub gain_per_answer: Option<f64>,
}

/// One rung before it is put among others.
pub(super) struct Rung {
    pub(super) id: String,
    pub(super) label: String,
    pub(super) units: Option<Vec<Weighted>>,
}

impl Rung {
    /// Chance: every action of a problem is equally likely.
    pub(super) fn random(plan: &PlanData) -> Self {
        let totals = plan.data().totals();
        let units = plan
            .patterns()
            .iter()
            .map(|pattern| {
                let answers = pattern.answers.iter();
                let score = answers
                    .map(|answers| {
                        let actions = totals[answers.problem].len() as f64;
                        -(answers.count as f64) * actions.ln()
                    })
                    .sum();
                (pattern.weight, score)
            })
            .collect();
        Self {
            id: RANDOM.to_owned(),
            label: "Random".to_owned(),
            units: Some(units),
        }
    }
}

/// The ladder over rungs in order. Empty if neither problems nor units were left out.
pub(super) fn ladder(rungs: &[Rung], exam: Option<&Exam>, n: u64) -> Vec<LadderStep> {
    let mut steps: Vec<LadderStep> = Vec::with_capacity(rungs.len());
    for (place, rung) in rungs.iter().enumerate() {
        let before = place.checked_sub(1).map(|place| &rungs[place]);
        let problems = exam.and_then(|exam| {
            let before = before.and_then(|before| exam.units(&before.id));
            Some(StepScore::of(
                &exam.units(&rung.id)?,
                before.as_deref(),
                exam.n(),
            ))
        });
        let units = rung.units.as_ref().map(|units| {
            let before = before.and_then(|before| before.units.as_deref());
            StepScore::of(units, before, n)
        });
        steps.push(LadderStep {
            id: rung.id.clone(),
            label: rung.label.clone(),
            problems,
            units,
        });
    }
    steps
}

impl StepScore {
    fn of(units: &[Weighted], before: Option<&[Weighted]>, n: u64) -> Self {
        let (score, _) = sum_and_se(units);
        let gain = before.map(|before| ScoreDifference::of(units, before));
        Self {
            score,
            per_answer: score / n as f64,
            gain,
            gain_per_answer: gain.map(|gain| gain.value / n as f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_over_the_step_before() {
        let rung = |id: &str, units: Option<Vec<Weighted>>| Rung {
            id: id.to_owned(),
            label: id.to_owned(),
            units,
        };
        let rungs = [
            rung("random", Some(vec![(2, -1.0), (1, -2.0)])),
            rung("better", Some(vec![(2, -0.5), (1, -1.0)])),
            rung("unknown", None),
            rung("best", Some(vec![(2, 0.0), (1, 0.0)])),
        ];
        let steps = ladder(&rungs, None, 8);
        assert_eq!(steps[0].units.unwrap().per_answer, -0.5);
        let gain = steps[1].units.unwrap();
        assert_eq!(
            (gain.gain.unwrap().value, gain.gain_per_answer),
            (2.0, Some(0.25))
        );
        assert!(steps[0].units.unwrap().gain.is_none() && steps[2].units.is_none());
        assert!(steps[3].units.unwrap().gain.is_none());
    }
}
