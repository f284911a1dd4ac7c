//! The reference reward: the constant of a study that gives sensitivity its unit.

use super::FittedProblem;

/// The reward of largest magnitude over all problems; a gain if a gain and a loss tie.
///
/// Sensitivity is learned as τ = θ |v(R_ref)|, the number of logits that separate this reward for sure from nothing,
/// because θ alone means nothing without the unit of v (Stewart, Scheibehenne & Pachur 2018).
///
/// # Errors
/// When every reward is 0.
pub fn default_reference_reward(problems: &[FittedProblem]) -> Result<f64, ReferenceRewardError> {
    let mut reference = 0.0_f64;
    for problem in problems {
        for action in problem.problem.actions() {
            for outcome in action.prospect.outcomes() {
                let (size, known) = (outcome.reward.abs(), reference.abs());
                if size > known || (size == known && outcome.reward > reference) {
                    reference = outcome.reward;
                }
            }
        }
    }
    check_reference_reward(reference)
}

/// The reward itself if it can serve as a reference.
///
/// # Errors
/// When it is 0 or not finite.
pub(crate) fn check_reference_reward(reward: f64) -> Result<f64, ReferenceRewardError> {
    if reward == 0.0 {
        Err(ReferenceRewardError::Zero)
    } else if reward.is_finite() {
        Ok(reward)
    } else {
        Err(ReferenceRewardError::NotFinite { reward })
    }
}

/// Why there is no reference reward.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ReferenceRewardError {
    /// Nothing can be gained or lost.
    #[error("the reference reward is 0, it must be a gain or a loss (are all rewards 0?)")]
    Zero,
    /// It is infinite or not a number.
    #[error("the reference reward {reward} is not a finite number")]
    NotFinite {
        /// What was found.
        reward: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::choice_data::tests::data;

    #[track_caller]
    fn check(rewards: &[f64], expected: Result<f64, ReferenceRewardError>) {
        let share = 1.0 / rewards.len() as f64;
        let outcomes: Vec<(f64, f64)> = rewards.iter().map(|reward| (share, *reward)).collect();
        let data = data(&[("one", &[("a", &outcomes), ("b", &[(1.0, 0.0)])], &[0, 0])]);
        assert_eq!(default_reference_reward(data.problems()), expected);
    }

    #[test]
    fn the_largest_reward_counts_and_ties_are_gains() {
        check(&[105.0, 0.0], Ok(105.0));
        check(&[-500.0, 100.0], Ok(-500.0));
        check(&[-500.0, 500.0], Ok(500.0));
        check(&[0.0, -0.0], Err(ReferenceRewardError::Zero));
    }
}
