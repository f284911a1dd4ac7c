//! Outcomes and prospects: what may follow from one action.

use serde::{Deserialize, Serialize};

/// How far the probabilities of a prospect may be from summing to 1.
const SUM_TOLERANCE: f64 = 1e-9;

/// One thing that may happen: a probability and a reward. In JSON `[probability, reward]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "(f64, f64)", into = "(f64, f64)")]
pub struct Outcome {
    /// Probability p, in [0, 1].
    pub probability: f64,
    /// Reward R, in the study's own unit; negative for a loss.
    pub reward: f64,
}

impl From<(f64, f64)> for Outcome {
    fn from((probability, reward): (f64, f64)) -> Self {
        Self {
            probability,
            reward,
        }
    }
}

impl From<Outcome> for (f64, f64) {
    fn from(outcome: Outcome) -> Self {
        (outcome.probability, outcome.reward)
    }
}

/// The outcomes of one action, C(a) in the paper: sorted by decreasing reward, equal rewards merged.
///
/// Probabilities are finite, in [0, 1] and sum to 1 within 1e-9; rewards are finite; −0.0 is stored as 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Outcome>", into = "Vec<Outcome>")]
pub struct Prospect {
    outcomes: Vec<Outcome>,
}

impl Prospect {
    /// A prospect from outcomes in any order.
    ///
    /// # Errors
    /// When there is no outcome, a probability or reward is out of range, or the probabilities do not sum to 1.
    pub fn new(outcomes: impl IntoIterator<Item = Outcome>) -> Result<Self, ProspectError> {
        let mut outcomes: Vec<Outcome> = outcomes.into_iter().collect();
        if outcomes.is_empty() {
            return Err(ProspectError::Empty);
        }
        for (index, outcome) in outcomes.iter_mut().enumerate() {
            let Outcome {
                probability,
                reward,
            } = *outcome;
            if !(0.0..=1.0).contains(&probability) {
                return Err(ProspectError::Probability {
                    outcome: index + 1,
                    probability,
                });
            }
            if !reward.is_finite() {
                return Err(ProspectError::Reward {
                    outcome: index + 1,
                    reward,
                });
            }
            // Adding +0.0 turns −0.0 into 0.0 and changes nothing else.
            *outcome = Outcome {
                probability: probability + 0.0,
                reward: reward + 0.0,
            };
        }
        let sum: f64 = outcomes.iter().map(|outcome| outcome.probability).sum();
        if (sum - 1.0).abs() > SUM_TOLERANCE {
            return Err(ProspectError::Sum { sum });
        }
        outcomes.sort_by(|left, right| {
            right
                .reward
                .total_cmp(&left.reward)
                .then(right.probability.total_cmp(&left.probability))
        });
        outcomes.dedup_by(|later, kept| {
            let same = later.reward == kept.reward;
            if same {
                kept.probability = (kept.probability + later.probability).min(1.0);
            }
            same
        });
        Ok(Self { outcomes })
    }

    /// A reward that comes for sure.
    ///
    /// # Errors
    /// When the reward is not finite.
    pub fn sure(reward: f64) -> Result<Self, ProspectError> {
        Self::new([Outcome {
            probability: 1.0,
            reward,
        }])
    }

    /// Outcomes by decreasing reward, every reward once.
    pub fn outcomes(&self) -> &[Outcome] {
        &self.outcomes
    }

    /// The expected reward Σ p R.
    pub fn expected_reward(&self) -> f64 {
        self.outcomes
            .iter()
            .map(|outcome| outcome.probability * outcome.reward)
            .sum()
    }

    /// Whether one reward comes for sure.
    pub fn is_sure(&self) -> bool {
        self.outcomes
            .iter()
            .filter(|outcome| outcome.probability > 0.0)
            .count()
            == 1
    }
}

impl TryFrom<Vec<Outcome>> for Prospect {
    type Error = ProspectError;

    fn try_from(outcomes: Vec<Outcome>) -> Result<Self, ProspectError> {
        Self::new(outcomes)
    }
}

impl From<Prospect> for Vec<Outcome> {
    fn from(prospect: Prospect) -> Self {
        prospect.outcomes
    }
}

/// Why outcomes make no prospect.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProspectError {
    /// There is nothing that can happen.
    #[error("a prospect needs at least one outcome")]
    Empty,
    /// A probability is not finite or outside its range.
    #[error("probability {probability} of outcome {outcome} is not a number from 0 to 1")]
    Probability {
        /// Which outcome, counted from 1.
        outcome: usize,
        /// What was found.
        probability: f64,
    },
    /// A reward is infinite or not a number.
    #[error("reward {reward} of outcome {outcome} is not a finite number")]
    Reward {
        /// Which outcome, counted from 1.
        outcome: usize,
        /// What was found.
        reward: f64,
    },
    /// The probabilities do not make a distribution.
    #[error("probabilities sum to {sum}, not 1")]
    Sum {
        /// Their sum.
        sum: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prospect(outcomes: &[(f64, f64)]) -> Result<Prospect, ProspectError> {
        Prospect::new(outcomes.iter().copied().map(Outcome::from))
    }

    #[test]
    fn outcomes_are_sorted_and_merged() {
        let built = prospect(&[(0.25, -1.0), (0.25, 5.0), (0.5, -1.0)]).unwrap();
        assert_eq!(
            built.outcomes(),
            [Outcome::from((0.25, 5.0)), Outcome::from((0.75, -1.0))]
        );
    }

    #[test]
    fn negative_zero_is_zero() {
        let built = prospect(&[(0.5, -0.0), (0.5, 0.0), (-0.0, 3.0)]).unwrap();
        assert_eq!(built.outcomes().len(), 2);
        assert!(
            built
                .outcomes()
                .iter()
                .all(|o| o.reward.is_sign_positive() && o.probability.is_sign_positive())
        );
    }

    #[test]
    fn nonsense_is_refused_with_its_value() {
        assert_eq!(prospect(&[]), Err(ProspectError::Empty));
        assert_eq!(
            prospect(&[(0.5, 1.0), (0.4, 0.0)]),
            Err(ProspectError::Sum { sum: 0.9 })
        );
        for probability in [-0.1, 1.1, f64::INFINITY, f64::NAN] {
            let error = prospect(&[(1.0, 0.0), (probability, 1.0)]).unwrap_err();
            assert!(
                matches!(error, ProspectError::Probability { outcome: 2, .. }),
                "{error}"
            );
        }
        for reward in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
            let error = prospect(&[(1.0, reward)]).unwrap_err();
            assert!(
                matches!(error, ProspectError::Reward { outcome: 1, .. }),
                "{error}"
            );
        }
        assert!(prospect(&[(0.5, 1.0), (0.5 + 2e-9, 0.0)]).is_err());
        assert!(prospect(&[(0.5, 1.0), (0.5 + 5e-10, 0.0)]).is_ok());
    }
}
