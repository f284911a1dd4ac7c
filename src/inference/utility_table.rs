//! Utilities of many prospects at once, each distinct power and weighting value computed once.

use std::collections::HashMap;

use super::lanes::{exp, ln};
use crate::model::{
    Cumulative, Parameter, Parameters, Prospect, RiskAwareOptions, WeightingFunction, weight_spans,
};

/// Where in the weights w(0) and w(1) stand.
const NEVER: u32 = 0;
const SURELY: u32 = 1;

/// A value of each parameter in each lane, indexed by [`Parameter`] as a number.
pub(super) type ParameterLanes<const W: usize> = [[f64; W]; Parameter::ALL.len()];

/// The same parameters in every lane.
pub(super) fn lanes_of<const W: usize>(parameters: &Parameters) -> ParameterLanes<W> {
    Parameter::ALL.map(|name| [parameters.get(name); W])
}

/// The utilities of fixed prospects as a function of α, β, γ, δ, η⁺, η⁻, λ, in lanes.
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
    terms: Vec<Term>,
    prospects: Vec<Terms>,
    /// One for each number of lanes that was asked for.
    scratches: Vec<Scratch>,
}

/// What the last evaluation with as many lanes computed, lanes beside each other.
#[derive(Debug, Clone)]
struct Scratch {
    /// Gains, then losses before loss aversion.
    values: Vec<f64>,
    /// Never, surely, then gain chances, then loss chances.
    weights: Vec<f64>,
    utilities: Vec<f64>,
    /// The parameters of the last evaluation, NaN before the first.
    at: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Magnitude {
    plain: f64,
    ln: f64,
}

#[derive(Debug, Clone, Copy)]
struct Chance {
    plain: f64,
    ln: f64,
    /// ln(1 − p) for Tversky & Kahneman's function, ln(−ln p) for Prelec's.
    other: f64,
}

/// The terms of a prospect: gains from `start`, losses from `middle`, to `end`.
#[derive(Debug, Clone, Copy)]
struct Terms {
    start: u32,
    middle: u32,
    end: u32,
    /// Indices of the weights that all gains, and all losses, share.
    totals: [u32; 2],
}

#[derive(Debug, Clone, Copy)]
struct Term {
    outer: u32,
    inner: u32,
    value: u32,
}

/// A chance before it has its place among the weights.
#[derive(Clone, Copy)]
enum Slot {
    Never,
    Surely,
    Gain(u32),
    Loss(u32),
}

/// Which distinct magnitudes and chances there are.
#[derive(Default)]
struct Distinct {
    gains: HashMap<u64, u32>,
    losses: HashMap<u64, u32>,
    gain_chances: HashMap<[u64; 2], u32>,
    loss_chances: HashMap<[u64; 2], u32>,
}

impl UtilityTable {
    /// A table for these prospects, in this order.
    pub(super) fn new<'a>(
        prospects: impl IntoIterator<Item = &'a Prospect>,
        options: RiskAwareOptions,
    ) -> Self {
        let mut table = Self {
            normalise: options.normalise,
            weighting: options.weighting_function,
            gains: Vec::new(),
            losses: Vec::new(),
            gain_chances: Vec::new(),
            loss_chances: Vec::new(),
            terms: Vec::new(),
            prospects: Vec::new(),
            scratches: Vec::new(),
        };
        // Distinct magnitudes and chances first: their number decides where losses begin.
        let mut distinct = Distinct::default();
        let mut slots = Vec::new();
        for prospect in prospects {
            let spans = weight_spans(prospect, options.zero);
            let slotted: Vec<_> = spans
                .iter()
                .zip(prospect.outcomes())
                .map(|(span, outcome)| {
                    let outer = table.slot(&mut distinct, span.outer, span.is_gain);
                    let inner = table.slot(&mut distinct, span.inner, span.is_gain);
                    let value = table.magnitude(&mut distinct, outcome.reward);
                    (span.is_gain, outcome.reward, outer, inner, value)
                })
                .collect();
            slots.push(slotted);
        }
        let (gain_chances, gains) = (table.gain_chances.len() as u32, table.gains.len() as u32);
        let place = |slot: Slot| match slot {
            Slot::Never => NEVER,
            Slot::Surely => SURELY,
            Slot::Gain(index) => 2 + index,
            Slot::Loss(index) => 2 + gain_chances + index,
        };
        for slotted in slots {
            let mut totals = [NEVER; 2];
            let start = table.terms.len() as u32;
            let mut losses = Vec::new();
            for (is_gain, reward, outer, inner, value) in slotted {
                let (outer, inner) = (place(outer), place(inner));
                // Gains come best first, so the last total counts; losses come mildest first, so the first does.
                if is_gain {
                    totals[0] = outer;
                } else if totals[1] == NEVER {
                    totals[1] = outer;
                }
                let term = |value| Term {
                    outer,
                    inner,
                    value,
                };
                if reward > 0.0 {
                    table.terms.push(term(value));
                } else if reward < 0.0 {
                    losses.push(term(gains + value));
                }
            }
            let middle = table.terms.len() as u32;
            table.terms.extend(losses);
            let end = table.terms.len() as u32;
            table.prospects.push(Terms {
                start,
                middle,
                end,
                totals,
            });
        }
        table
    }

    /// The utilities at these parameters (θ plays no part), in the order of the prospects.
    #[inline(always)]
    pub(super) fn utilities<const W: usize>(
        &mut self,
        parameters: &ParameterLanes<W>,
    ) -> &[[f64; W]] {
        use Parameter::{Alpha, Beta, Delta, EtaGain, EtaLoss, Gamma, Lambda};
        let size = parameters.len() * W;
        let known = self.scratches.iter().position(|s| s.at.len() == size);
        let index = known.unwrap_or_else(|| {
            let mut scratch = Scratch {
                values: vec![0.0; (self.gains.len() + self.losses.len()) * W],
                weights: vec![0.0; (2 + self.gain_chances.len() + self.loss_chances.len()) * W],
                utilities: vec![0.0; self.prospects.len() * W],
                at: vec![f64::NAN; size],
            };
            scratch.weights[W..2 * W].fill(1.0);
            self.scratches.push(scratch);
            self.scratches.len() - 1
        });
        let is_fresh = known.is_none();
        let scratch = &mut self.scratches[index];
        let at = scratch.at.as_chunks_mut::<W>().0;
        let values = scratch.values.as_chunks_mut::<W>().0;
        let weights = scratch.weights.as_chunks_mut::<W>().0;
        let utilities = scratch.utilities.as_chunks_mut::<W>().0;
        // What no parameter that moves enters stays as it is: inert ones are the same from one evaluation to the next.
        let mut changed = |names: &[Parameter]| {
            let mut any = false;
            for name in names {
                let (before, now) = (&mut at[*name as usize], &parameters[*name as usize]);
                any |= before != now;
                *before = *now;
            }
            any
        };
        let of = |name: Parameter| &parameters[name as usize];
        let (gain_values, loss_values) = values.split_at_mut(self.gains.len());
        let (gain_weights, loss_weights) = weights[2..].split_at_mut(self.gain_chances.len());
        let mut any = is_fresh | changed(&[Lambda]);
        if changed(&[Alpha]) {
            raise(gain_values, &self.gains, of(Alpha));
            any = true;
        }
        if changed(&[Beta]) {
            raise(loss_values, &self.losses, of(Beta));
            any = true;
        }
        if changed(&[Gamma, EtaGain]) {
            weigh(
                self.weighting,
                gain_weights,
                &self.gain_chances,
                [of(Gamma), of(EtaGain)],
            );
            any = true;
        }
        if changed(&[Delta, EtaLoss]) {
            weigh(
                self.weighting,
                loss_weights,
                &self.loss_chances,
                [of(Delta), of(EtaLoss)],
            );
            any = true;
        }
        if any {
            for (utility, prospect) in utilities.iter_mut().zip(&self.prospects) {
                let gains = sum(
                    &self.terms[prospect.start as usize..prospect.middle as usize],
                    weights,
                    values,
                );
                let losses = sum(
                    &self.terms[prospect.middle as usize..prospect.end as usize],
                    weights,
                    values,
                );
                let lambda = of(Lambda);
                for lane in 0..W {
                    utility[lane] = gains[lane] - lambda[lane] * losses[lane];
                }
                if self.normalise {
                    let [gain_total, loss_total] =
                        prospect.totals.map(|index| &weights[index as usize]);
                    for lane in 0..W {
                        let total = gain_total[lane] + loss_total[lane];
                        let total = if total < f64::MIN_POSITIVE {
                            f64::NAN
                        } else {
                            total
                        };
                        utility[lane] /= total;
                    }
                }
            }
        }
        utilities
    }

    fn slot(&mut self, distinct: &mut Distinct, cumulative: Cumulative, is_gain: bool) -> Slot {
        if cumulative.probability <= 0.0 {
            return Slot::Never;
        }
        if cumulative.complement <= 0.0 {
            return Slot::Surely;
        }
        let ln = cumulative.ln();
        let chance = Chance {
            plain: cumulative.probability,
            ln,
            other: match self.weighting {
                WeightingFunction::TverskyKahneman => cumulative.complement.ln(),
                WeightingFunction::Prelec => (-ln).ln(),
            },
        };
        let key = [cumulative.probability, cumulative.complement].map(f64::to_bits);
        if is_gain {
            Slot::Gain(position_of(
                &mut distinct.gain_chances,
                key,
                &mut self.gain_chances,
                chance,
            ))
        } else {
            Slot::Loss(position_of(
                &mut distinct.loss_chances,
                key,
                &mut self.loss_chances,
                chance,
            ))
        }
    }

    fn magnitude(&mut self, distinct: &mut Distinct, reward: f64) -> u32 {
        let magnitude = Magnitude {
            plain: reward.abs(),
            ln: reward.abs().ln(),
        };
        let key = magnitude.plain.to_bits();
        if reward > 0.0 {
            position_of(&mut distinct.gains, key, &mut self.gains, magnitude)
        } else if reward < 0.0 {
            position_of(&mut distinct.losses, key, &mut self.losses, magnitude)
        } else {
            // Nothing is worth nothing, so it is no term.
            0
        }
    }
}

/// Where the item with this key stands, appended if it was not there.
fn position_of<K: std::hash::Hash + Eq, T>(
    known: &mut HashMap<K, u32>,
    key: K,
    items: &mut Vec<T>,
    item: T,
) -> u32 {
    *known.entry(key).or_insert_with(|| {
        items.push(item);
        items.len() as u32 - 1
    })
}

/// Σ (w(outer) − w(inner)) v over the terms.
#[inline(always)]
fn sum<const W: usize>(terms: &[Term], weights: &[[f64; W]], values: &[[f64; W]]) -> [f64; W] {
    let mut sum = [0.0; W];
    for term in terms {
        let (outer, inner) = (&weights[term.outer as usize], &weights[term.inner as usize]);
        let value = &values[term.value as usize];
        for lane in 0..W {
            sum[lane] += (outer[lane] - inner[lane]) * value[lane];
        }
    }
    sum
}

#[inline(always)]
fn raise<const W: usize>(values: &mut [[f64; W]], magnitudes: &[Magnitude], exponent: &[f64; W]) {
    for (value, magnitude) in values.iter_mut().zip(magnitudes) {
        for lane in 0..W {
            let power = exp(exponent[lane] * magnitude.ln);
            // An exponent of 1 changes nothing; going through logarithms would.
            value[lane] = if exponent[lane] == 1.0 {
                magnitude.plain
            } else {
                power
            };
        }
    }
}

#[inline(always)]
fn weigh<const W: usize>(
    function: WeightingFunction,
    weights: &mut [[f64; W]],
    chances: &[Chance],
    [exponent, elevation]: [&[f64; W]; 2],
) {
    match function {
        WeightingFunction::TverskyKahneman => weigh_tversky_kahneman(weights, chances, exponent),
        WeightingFunction::Prelec => weigh_prelec(weights, chances, exponent, elevation),
    }
}

/// w(p) = p^γ / (p^γ + (1−p)^γ)^(1/γ).
#[inline(always)]
fn weigh_tversky_kahneman<const W: usize>(
    weights: &mut [[f64; W]],
    chances: &[Chance],
    exponent: &[f64; W],
) {
    let mut inverse = [0.0; W];
    for lane in 0..W {
        inverse[lane] = 1.0 / exponent[lane];
    }
    for (weight, chance) in weights.iter_mut().zip(chances) {
        for lane in 0..W {
            let mine = exp(exponent[lane] * chance.ln);
            let other = exp(exponent[lane] * chance.other);
            // One of the two is at least ½^γ, so their sum is no subnormal number.
            let value = mine * exp(-ln(mine + other) * inverse[lane]);
            weight[lane] = if exponent[lane] == 1.0 {
                chance.plain
            } else {
                value
            };
        }
    }
}

/// w(p) = exp(−η (−ln p)^γ).
#[inline(always)]
fn weigh_prelec<const W: usize>(
    weights: &mut [[f64; W]],
    chances: &[Chance],
    exponent: &[f64; W],
    elevation: &[f64; W],
) {
    for (weight, chance) in weights.iter_mut().zip(chances) {
        for lane in 0..W {
            let value = exp(-elevation[lane] * exp(exponent[lane] * chance.other));
            let is_plain = (exponent[lane] == 1.0) & (elevation[lane] == 1.0);
            weight[lane] = if is_plain { chance.plain } else { value };
        }
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
        /// Lanes with different parameters, twice, the second time with one parameter kept.
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
            let mut second = second;
            second[keep] = first[keep];
            let people = |values: [f64; 8]| {
                let entries = RISK_AWARE_PRELEC_ELEVATION.parameters.iter().zip(values);
                RISK_AWARE_PRELEC_ELEVATION.parameters_from(entries.map(|(n, v)| (n.key(), v))).unwrap()
            };
            let three: [Parameters; 3] = [people(first), people(second), people([1.0; 8])];
            for turn in 0..2 {
                let lanes: ParameterLanes<3> = std::array::from_fn(|index| {
                    std::array::from_fn(|lane| three[(lane + turn) % 3].get(Parameter::ALL[index]))
                });
                let found = table.utilities(&lanes).to_vec();
                for (index, prospect) in prospects.iter().enumerate() {
                    let pair = [("a".to_owned(), prospect.clone()), ("b".to_owned(), prospects[0].clone())];
                    let problem = ChoiceProblem::new(pair).unwrap();
                    for lane in 0..3 {
                        let plain = utilities(&problem, &three[(lane + turn) % 3], options).unwrap()[0];
                        let found = found[index][lane];
                        prop_assert!((found - plain).abs() <= 1e-11 * (1.0 + plain.abs()), "{index}");
                    }
                }
            }
        }
    }
}
