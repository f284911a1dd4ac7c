//! The bonus: one of a person's choices, drawn after the last answer, is played out for money.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use super::ActionId;
use crate::model::{ChoiceProblem, Outcome};

/// What a study pays beside its fee.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bonus {
    /// The currency's code by ISO 4217, such as `GBP`.
    pub currency: String,
    /// How much of the currency a unit of reward is worth.
    pub rate: f64,
    /// What is paid before the reward is added, in the currency.
    pub endowment: f64,
}

/// A run's bonus as its last step carries it. The seed is drawn when the run begins and shown to nobody, so that nothing
/// that a person sends can change what is drawn, whenever and by whatever the run is completed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BonusTerms {
    /// What is paid.
    #[serde(flatten)]
    pub bonus: Bonus,
    /// What the draw is made from.
    pub seed: u64,
}

/// A choice that may be drawn: in time, of a known problem, and no practice.
#[derive(Debug, Clone, PartialEq)]
pub struct PayableChoice {
    /// The step that asked.
    pub position: u32,
    /// What was chosen.
    pub action: ActionId,
    /// What it could lead to.
    pub problem: ChoiceProblem,
}

/// What was drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnChoice {
    /// The step that asked.
    pub position: u32,
    /// What was chosen.
    pub action: ActionId,
    /// The reward of the outcome that came out.
    pub reward: f64,
}

impl Bonus {
    /// The amount for a reward R in the reward unit, in the currency:
    ///
    /// ```text
    /// max(0, endowment + rate · R), rounded to the currency's smallest unit
    /// ```
    ///
    /// Nobody pays for having taken part, so that it is never below 0.
    pub fn amount(&self, reward: f64) -> f64 {
        let units = 10_f64.powi(minor_digits(&self.currency) as i32);
        let amount = (self.endowment + self.rate * reward).max(0.0);
        (amount * units).round() / units
    }

    /// An amount with its currency, such as `GBP 4.50`.
    pub fn format(&self, amount: f64) -> String {
        format!("{} {}", self.currency, self.digits(amount))
    }

    /// An amount without its currency, to the currency's smallest unit, such as `4.50`.
    pub fn digits(&self, amount: f64) -> String {
        let digits = minor_digits(&self.currency);
        format!("{amount:.digits$}")
    }
}

impl BonusTerms {
    /// The draw for the choices of a run, in the order of their steps; `None` where there is none to draw from, and the
    /// endowment alone is paid.
    pub fn draw(&self, choices: &[PayableChoice]) -> Option<DrawnChoice> {
        draw(choices, &mut ChaCha12Rng::seed_from_u64(self.seed))
    }
}

/// Draws one of the choices, each with the same probability, and then an outcome of the chosen action with the
/// outcome's own probability. `None` where there is no choice that names an action of its problem.
pub fn draw(choices: &[PayableChoice], rng: &mut impl Rng) -> Option<DrawnChoice> {
    let payable: Vec<(&PayableChoice, &[Outcome])> = choices
        .iter()
        .filter_map(|choice| {
            let position = choice.problem.position(choice.action.as_str())?;
            let action = &choice.problem.actions()[position];
            Some((choice, action.prospect.outcomes()))
        })
        .collect();
    if payable.is_empty() {
        return None;
    }
    let (choice, outcomes) = payable[rng.random_range(0..payable.len())];
    let at: f64 = rng.random();
    let mut below = 0.0;
    let mut drawn = outcomes.iter().filter(|outcome| outcome.probability > 0.0);
    // Probabilities sum to 1 up to rounding: what is left over belongs to the last outcome that can happen.
    let last = drawn.clone().next_back()?;
    let outcome = drawn
        .find(|outcome| {
            below += outcome.probability;
            at < below
        })
        .unwrap_or(last);
    Some(DrawnChoice {
        position: choice.position,
        action: choice.action.clone(),
        reward: outcome.reward,
    })
}

/// How many digits a currency's smallest unit has (ISO 4217).
fn minor_digits(currency: &str) -> usize {
    match currency {
        "CLP" | "ISK" | "JPY" | "KRW" | "PYG" | "UGX" | "VND" | "XAF" | "XOF" | "XPF" => 0,
        "BHD" | "IQD" | "JOD" | "KWD" | "LYD" | "OMR" | "TND" => 3,
        _ => 2,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    fn bonus(currency: &str) -> Bonus {
        Bonus {
            currency: currency.to_owned(),
            rate: 0.01,
            endowment: 5.0,
        }
    }

    fn choice(position: u32, action: &str, risk: f64) -> PayableChoice {
        let problem = ChoiceProblem::from_outcomes([
            ("risky", vec![(risk, -500.0), (1.0 - risk, 0.0)]),
            ("sure", vec![(1.0, -50.0)]),
        ]);
        PayableChoice {
            position,
            action: action.into(),
            problem: problem.unwrap(),
        }
    }

    #[test]
    fn amounts_are_rounded_to_the_smallest_unit_and_never_below_zero() {
        let pounds = bonus("GBP");
        assert_eq!(pounds.amount(-50.0), 4.5);
        assert_eq!(pounds.amount(-501.0), 0.0);
        assert_eq!(pounds.amount(33.4), 5.33);
        assert_eq!(pounds.format(4.5), "GBP 4.50");
        let yen = bonus("JPY");
        assert_eq!((yen.amount(60.0), yen.format(6.0).as_str()), (6.0, "JPY 6"));
        assert_eq!(bonus("KWD").format(1.5), "KWD 1.500");
    }

    #[test]
    fn nothing_is_drawn_where_nothing_was_chosen() {
        let terms = BonusTerms {
            bonus: bonus("GBP"),
            seed: 1,
        };
        assert_eq!(terms.draw(&[]), None);
        assert_eq!(terms.draw(&[choice(1, "unknown", 0.5)]), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn the_same_seed_draws_the_same(seed: u64, risk in 0.0..1.0) {
            let choices = [choice(1, "risky", risk), choice(4, "sure", risk)];
            let terms = BonusTerms { bonus: bonus("GBP"), seed };
            prop_assert_eq!(terms.draw(&choices), terms.draw(&choices));
        }

        #[test]
        fn frequencies_are_the_probabilities(seed: u64, risk in 0.0_f64..1.0) {
            const DRAWS: f64 = 4_000.0;
            let choices = [choice(1, "risky", risk), choice(4, "sure", risk), choice(7, "risky", 0.0)];
            let mut rng = ChaCha12Rng::seed_from_u64(seed);
            let mut found: BTreeMap<(u32, String), f64> = BTreeMap::new();
            for _ in 0..DRAWS as usize {
                let drawn = draw(&choices, &mut rng).unwrap();
                *found.entry((drawn.position, drawn.reward.to_string())).or_default() += 1.0;
            }
            let third = 1.0 / 3.0;
            let expected = [
                ((1, "-500"), third * risk),
                ((1, "0"), third * (1.0 - risk)),
                ((4, "-50"), third),
                ((7, "0"), third),
                ((7, "-500"), 0.0),
            ];
            for ((position, reward), probability) in expected {
                let share = found.get(&(position, reward.to_owned())).copied().unwrap_or(0.0) / DRAWS;
                // Five standard errors, and five draws where so few are expected that the normal law says nothing.
                let error = 5.0 * (probability * (1.0 - probability) / DRAWS).sqrt() + 5.0 / DRAWS;
                let is_near = (share - probability).abs() <= error;
                prop_assert!(
                    if probability == 0.0 { share == 0.0 } else { is_near },
                    "{position}, {reward}: {share} for {probability}"
                );
            }
        }
    }
}
