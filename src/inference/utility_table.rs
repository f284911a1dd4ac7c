//! Utilities of many prospects at once, each distinct power and weighting value computed once.

use crate::model::{
    Cumulative, Parameter, Parameters, Prospect, RiskAwareOptions, WeightingFunction, weight_spans,
};

/// Where in `values` the value of nothing stands.
const NOTHING: usize = 0;

/// Where in `weights` w(0) and w(1) stand.
const NEVER: usize = 0;
const SURELY: usize = 1;

/// The utilities of fixed prospects as a function of α, β, γ, δ, η⁺, η⁻, λ.
///
/// Agrees with [`utilities`](crate::model::utilities); where that reports an error, a utility here is NaN.
#[derive(Debug, Clone)]
pub(super) struct UtilityTable {
    normalise: bool,
    weighting: WeightingFunction,
    gains: Vec<Magnitude>,
    losses: Vec<Magnitude>,
    gain_chances: Vec<Chance>,
    loss_chances: Vec<Chance>,
    prospects: Vec<Terms>,
    /// Nothing, then gains, then losses before loss aversion.
    values: Vec<f64>,
    /// Never, surely, then gain chances, then loss chances.
    weights: Vec<f64>,
    utilities: Vec<f64>,
    /// What the caches were computed at, none at first.
    at: Option<[f64; 7]>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Magnitude {
    plain: f64,
    ln: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Chance {
    plain: f64,
    ln: f64,
    ln_complement: f64,
}

#[derive(Debug, Clone, Default)]
struct Terms {
    gains: Vec<Term>,
    losses: Vec<Term>,
    /// Indices of the weights that all gains, and all losses, share.
    totals: [usize; 2],
}

#[derive(Debug, Clone, Copy)]
struct Term {
    outer: usize,
    inner: usize,
    value: usize,
}

/// A chance before it has its place in `weights`.
#[derive(Clone, Copy)]
enum Slot {
    Never,
    Surely,
    Gain(usize),
    Loss(usize),
}

impl UtilityTable {
    /// A table for these prospects, in this order.
    pub(super) fn new(prospects: &[Prospect], options: RiskAwareOptions) -> Self {
        let mut table = Self {
            normalise: options.normalise,
            weighting: options.weighting_function,
            gains: Vec::new(),
            losses: Vec::new(),
            gain_chances: Vec::new(),
            loss_chances: Vec::new(),
            prospects: Vec::new(),
            values: Vec::new(),
            weights: Vec::new(),
            utilities: vec![0.0; prospects.len()],
            at: None,
        };
        // Distinct magnitudes and chances first: their number decides where losses begin.
        let mut slots = Vec::with_capacity(prospects.len());
        for prospect in prospects {
            let spans = weight_spans(prospect, options.zero);
            let slotted: Vec<_> = spans
                .iter()
                .zip(prospect.outcomes())
                .map(|(span, outcome)| {
                    let outer = table.slot(span.outer, span.is_gain);
                    let inner = table.slot(span.inner, span.is_gain);
                    let value = table.magnitude(outcome.reward);
                    (span.is_gain, outcome.reward, outer, inner, value)
                })
                .collect();
            slots.push(slotted);
        }
        let (gain_chances, gains) = (table.gain_chances.len(), table.gains.len());
        let place = |slot: Slot| match slot {
            Slot::Never => NEVER,
            Slot::Surely => SURELY,
            Slot::Gain(index) => 2 + index,
            Slot::Loss(index) => 2 + gain_chances + index,
        };
        for slotted in slots {
            let mut terms = Terms {
                totals: [NEVER; 2],
                ..Terms::default()
            };
            for (is_gain, reward, outer, inner, value) in slotted {
                let (outer, inner) = (place(outer), place(inner));
                // Gains come best first, so the last total counts; losses come mildest first, so the first does.
                if is_gain {
                    terms.totals[0] = outer;
                } else if terms.totals[1] == NEVER {
                    terms.totals[1] = outer;
                }
                if reward > 0.0 {
                    terms.gains.push(Term {
                        outer,
                        inner,
                        value: 1 + value,
                    });
                } else if reward < 0.0 {
                    terms.losses.push(Term {
                        outer,
                        inner,
                        value: 1 + gains + value,
                    });
                }
            }
            table.prospects.push(terms);
        }
        table.values = vec![0.0; 1 + gains + table.losses.len()];
        table.values[NOTHING] = 0.0;
        table.weights = vec![0.0; 2 + gain_chances + table.loss_chances.len()];
        table.weights[SURELY] = 1.0;
        table
    }

    /// The utilities at these parameters (θ plays no part), in the order of the prospects.
    pub(super) fn utilities(&mut self, parameters: &Parameters) -> &[f64] {
        use Parameter::{Alpha, Beta, Delta, EtaGain, EtaLoss, Gamma, Lambda};
        let now =
            [Alpha, Beta, Gamma, EtaGain, Delta, EtaLoss, Lambda].map(|name| parameters.get(name));
        if self.at != Some(now) {
            self.refresh(now);
        }
        &self.utilities
    }

    fn refresh(&mut self, now: [f64; 7]) {
        let [alpha, beta, gamma, eta_gain, delta, eta_loss, lambda] = now;
        let before = self.at.replace(now);
        let changed = |index: usize| before.is_none_or(|before| before[index] != now[index]);
        let (first_loss, first_loss_chance) = (1 + self.gains.len(), 2 + self.gain_chances.len());
        if changed(0) {
            raise(&mut self.values[1..first_loss], &self.gains, alpha);
        }
        if changed(1) {
            raise(&mut self.values[first_loss..], &self.losses, beta);
        }
        if changed(2) || changed(3) {
            weigh(
                self.weighting,
                &mut self.weights[2..first_loss_chance],
                &self.gain_chances,
                [gamma, eta_gain],
            );
        }
        if changed(4) || changed(5) {
            weigh(
                self.weighting,
                &mut self.weights[first_loss_chance..],
                &self.loss_chances,
                [delta, eta_loss],
            );
        }
        let (values, weights) = (&self.values, &self.weights);
        let sum = |terms: &[Term]| -> f64 {
            terms
                .iter()
                .map(|t| (weights[t.outer] - weights[t.inner]) * values[t.value])
                .sum()
        };
        for (utility, terms) in self.utilities.iter_mut().zip(&self.prospects) {
            *utility = sum(&terms.gains) - lambda * sum(&terms.losses);
            if self.normalise {
                let total = weights[terms.totals[0]] + weights[terms.totals[1]];
                *utility = if total < f64::MIN_POSITIVE {
                    f64::NAN
                } else {
                    *utility / total
                };
            }
        }
    }

    fn slot(&mut self, cumulative: Cumulative, is_gain: bool) -> Slot {
        if cumulative.probability <= 0.0 {
            return Slot::Never;
        }
        if cumulative.complement <= 0.0 {
            return Slot::Surely;
        }
        let chance = Chance {
            plain: cumulative.probability,
            ln: cumulative.ln(),
            ln_complement: cumulative.complement.ln(),
        };
        if is_gain {
            Slot::Gain(position_of(&mut self.gain_chances, chance))
        } else {
            Slot::Loss(position_of(&mut self.loss_chances, chance))
        }
    }

    fn magnitude(&mut self, reward: f64) -> usize {
        let magnitude = Magnitude {
            plain: reward.abs(),
            ln: reward.abs().ln(),
        };
        if reward > 0.0 {
            position_of(&mut self.gains, magnitude)
        } else if reward < 0.0 {
            position_of(&mut self.losses, magnitude)
        } else {
            NOTHING
        }
    }
}

/// Where the item stands, appended if it was not there.
fn position_of<T: PartialEq>(items: &mut Vec<T>, item: T) -> usize {
    items
        .iter()
        .position(|known| *known == item)
        .unwrap_or_else(|| {
            items.push(item);
            items.len() - 1
        })
}

fn raise(values: &mut [f64], magnitudes: &[Magnitude], exponent: f64) {
    for (value, magnitude) in values.iter_mut().zip(magnitudes) {
        // An exponent of 1 changes nothing; going through logarithms would.
        *value = if exponent == 1.0 {
            magnitude.plain
        } else {
            (exponent * magnitude.ln).exp()
        };
    }
}

fn weigh(
    function: WeightingFunction,
    weights: &mut [f64],
    chances: &[Chance],
    [exponent, elevation]: [f64; 2],
) {
    for (weight, chance) in weights.iter_mut().zip(chances) {
        *weight = if (exponent, elevation) == (1.0, 1.0) {
            chance.plain
        } else {
            function
                .ln_weight(chance.ln, chance.ln_complement, exponent, elevation)
                .exp()
        };
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::{ChoiceProblem, RISK_AWARE_PRELEC_ELEVATION, ZeroOutcome, utilities};

    fn prospects() -> Vec<Prospect> {
        let text = r#"[[[1,20]], [[0.2,105],[0.8,0]], [[0.05,-500],[0.95,0]], [[1,-100]], [[1,0]],
            [[0.1,7],[0.2,20],[0.3,0],[0.15,-3],[0.25,-500]], [[0.5,3],[0.5,-3]]]"#;
        serde_json::from_str(text).unwrap()
    }

    proptest! {
        #[test]
        fn the_table_says_what_the_model_says(
            first in prop::array::uniform8(0.05..=1.0), second in prop::array::uniform8(0.05..=1.0),
            normalise: bool, same_sign: bool, prelec: bool, keep in 0_usize..7,
        ) {
            let zero = if same_sign { ZeroOutcome::SameSign } else { ZeroOutcome::Gain };
            let weighting_function =
                if prelec { WeightingFunction::Prelec } else { WeightingFunction::TverskyKahneman };
            let options = RiskAwareOptions { normalise, zero, weighting_function };
            let prospects = prospects();
            let mut table = UtilityTable::new(&prospects, options);
            // The second set shares one value with the first, so that a cache is kept in between.
            let mut second = second;
            second[keep] = first[keep];
            for values in [first, second, [1.0; 8]] {
                let entries = Parameter::ALL.iter().zip(values);
                let parameters = RISK_AWARE_PRELEC_ELEVATION
                    .parameters_from(entries.map(|(n, v)| (n.key(), v)))
                    .unwrap();
                let found = table.utilities(&parameters);
                for (index, prospect) in prospects.iter().enumerate() {
                    let pair = [("a".to_owned(), prospect.clone()), ("b".to_owned(), prospects[0].clone())];
                    let plain = utilities(&ChoiceProblem::new(pair).unwrap(), &parameters, options).unwrap()[0];
                    prop_assert!((found[index] - plain).abs() <= 1e-11 * (1.0 + plain.abs()), "{index}");
                }
            }
        }
    }
}
