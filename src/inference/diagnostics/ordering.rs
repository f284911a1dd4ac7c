//! The order of draws, by which they have ranks.

use super::half_chains::HalfChains;
use super::scores::NormalScores;
use crate::inference::lanes::{InstructionSet, Kernel};

/// Bits of a key that one pass sorts by.
const PASS_BITS: u32 = 10;
const BUCKETS: usize = 1 << PASS_BITS;

/// Up to this many values rarely agree in the bits of two passes, unless they are equal.
const FEW: usize = 1 << 13;

/// Puts values in increasing order, as [`f64::total_cmp`] has it; the buffers serve again for the next ones.
///
/// A radix sort by the leading bits in which the values differ at all, in two passes or, if there are many values, three; then by
/// comparison among those that agree in them. Several times as fast as comparing.
#[derive(Debug, Clone, Default)]
pub(super) struct Sorter {
    /// The leading bits above, the place below.
    items: Vec<u64>,
    passed: Vec<u64>,
}

impl Sorter {
    /// The values in increasing order, and where each stood.
    pub(super) fn sort(&mut self, values: &[f64], sorted: &mut Vec<f64>, places: &mut Vec<u32>) {
        let Self { items, passed } = self;
        InstructionSet::widest().run(Keys { values, items });
        passed.resize(items.len(), 0);
        let passes = if values.len() <= FEW { 2 } else { 3 };
        let compared = u64::BITS - passes * PASS_BITS;
        for pass in 0..passes {
            distribute(items, passed, compared + pass * PASS_BITS);
            std::mem::swap(items, passed);
        }
        places.clear();
        places.extend(items.iter().map(|item| *item as u32));
        sorted.clear();
        sorted.extend(places.iter().map(|place| values[*place as usize]));
        let mut index = 1;
        while index < sorted.len() {
            if sorted[index - 1].total_cmp(&sorted[index]).is_le() {
                index += 1;
                continue;
            }
            // Some that agree in the bits compared: rare, for those that are equal are in order.
            let prefix = items[index] >> compared;
            let agrees = |item: &&u64| **item >> compared == prefix;
            let start = index - items[..index].iter().rev().take_while(agrees).count();
            let end = index + items[index..].iter().take_while(agrees).count();
            places[start..end].sort_unstable_by(|left, right| {
                values[*left as usize].total_cmp(&values[*right as usize])
            });
            for (value, place) in sorted[start..end].iter_mut().zip(&places[start..end]) {
                *value = values[*place as usize];
            }
            index = end;
        }
    }
}

/// One pass of a radix sort: by the bits from `shift` on.
fn distribute(items: &[u64], passed: &mut [u64], shift: u32) {
    let digit = |item: u64| (item >> shift) as usize & (BUCKETS - 1);
    let mut starts = [0_u32; BUCKETS];
    for item in items {
        starts[digit(*item)] += 1;
    }
    let mut start = 0;
    for entry in &mut starts {
        start += std::mem::replace(entry, start);
    }
    for item in items {
        let place = &mut starts[digit(*item)];
        passed[*place as usize] = *item;
        *place += 1;
    }
}

/// Integers in the order of values, above the place of each.
struct Keys<'a> {
    values: &'a [f64],
    items: &'a mut Vec<u64>,
}

impl Kernel for Keys<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let items = self.items;
        items.clear();
        items.extend(self.values.iter().map(|value| {
            let bits = value.to_bits();
            bits ^ (((bits as i64 >> 63) as u64) | 1 << 63)
        }));
        let lowest = items.iter().copied().min().unwrap_or(0);
        let highest = items.iter().copied().max().unwrap_or(0);
        let spare = (highest - lowest).leading_zeros().min(32);
        for (item, place) in items.iter_mut().zip(0_u64..) {
            *item = (((*item - lowest) << spare) & !0xffff_ffff) | place;
        }
    }
}

/// Draws in increasing order.
#[derive(Debug, Clone, Default)]
pub(super) struct Ranking {
    pub(super) values: Vec<f64>,
    /// Where each stands, chain after chain.
    places: Vec<u32>,
    /// Of the last of the draws that are tied with each.
    ends: Vec<u32>,
}

impl Ranking {
    pub(super) fn sort(&mut self, sorter: &mut Sorter, draws: &[f64]) {
        sorter.sort(draws, &mut self.values, &mut self.places);
    }

    /// Leaves out the middle draw of each chain of odd length, which is in neither half.
    pub(super) fn halve(&mut self, length: usize) {
        if length.is_multiple_of(2) {
            return;
        }
        let middle = length / 2;
        let mut kept = 0;
        for index in 0..self.places.len() {
            let place = self.places[index] as usize;
            let (chain, at) = (place / length, place % length);
            if at != middle {
                self.values[kept] = self.values[index];
                self.places[kept] = (place - chain - usize::from(at > middle)) as u32;
                kept += 1;
            }
        }
        self.values.truncate(kept);
        self.places.truncate(kept);
    }

    /// Normal scores of the average ranks, in half chains.
    pub(super) fn scores(&mut self, scores: &NormalScores, halves: &mut HalfChains) {
        debug_assert_eq!(self.values.len(), scores.size());
        let size = self.values.len();
        self.ends.resize(size, 0);
        // Nothing here branches on the draws, of which any number may be tied. NaN equals nothing, itself included.
        let (mut end, mut after) = (0, f64::NAN);
        for ((index, value), known) in self.values.iter().enumerate().zip(&mut self.ends).rev() {
            end = if *value == after { end } else { index as u32 };
            *known = end;
            after = *value;
        }
        let (mut start, mut before) = (0, f64::NAN);
        let draws = self.values.iter().zip(&self.places).zip(&self.ends);
        for (index, ((value, place), end)) in draws.enumerate() {
            start = if *value == before { start } else { index };
            before = *value;
            halves.values[*place as usize] = scores.of(start + *end as usize + 2);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn places_are_in_the_order_of_values(
            values in prop::collection::vec(prop_oneof![
                any::<f64>(), -1.0..1.0, 0.999_999..1.000_001, Just(0.5), Just(-0.0), Just(0.0),
            ], 0..200)
        ) {
            let (mut sorted, mut places) = (Vec::new(), Vec::new());
            Sorter::default().sort(&values, &mut sorted, &mut places);
            let found: Vec<u64> = places.iter().map(|place| values[*place as usize].to_bits()).collect();
            let mut sorted = values;
            sorted.sort_by(f64::total_cmp);
            let sorted: Vec<u64> = sorted.iter().map(|value| value.to_bits()).collect();
            prop_assert_eq!(found, sorted);
        }
    }
}
