//! Which chains stand still, and which stand apart from the others.

use serde::{Deserialize, Serialize};

use super::Note;
use crate::inference::diagnostics::{RHAT_LIMIT, quantile};
use crate::inference::{Draws, ParameterSummary, Source};
use crate::model::OrderedMap;

/// A chain of which fewer of the draws differ from the one before is stuck.
const STUCK: f64 = 0.01;

/// A chain stands apart if the mean rank of its draws is this far from that of the middle chain. For one chain of eight
/// that is about where R̂ reaches 1.01.
const APART: f64 = 0.1;

/// Where one chain's draws lie among those of all chains.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ChainPosition {
    /// Which chain, counted from 1.
    pub chain: usize,
    /// Mean rank of its draws among all, from 0 to 1: 0.5 where chains agree.
    pub rank: f64,
    /// Mean rank of its draws' distances from the median: under 0.5 for a chain that is narrower than the others.
    pub spread_rank: f64,
}

/// Notes on chains that hardly moved, and on quantities about which the chains do not agree.
pub(super) fn notes(draws: &Draws, parameters: &OrderedMap<ParameterSummary>) -> Vec<Note> {
    let moved = draws.columns.iter().filter_map(|(quantity, values)| {
        let summary = parameters.get(quantity.key())?;
        // Independent draws from the prior come from no chain.
        (summary.source == Source::Choices).then_some((*quantity, values, summary.rhat))
    });
    let moved: Vec<_> = moved.collect();
    let mut notes = Vec::new();
    let is_stuck = |chain: usize| {
        moved
            .iter()
            .any(|(_, values, _)| share_of_moves(draws.by_chain(values)[chain]) < STUCK)
    };
    let stuck: Vec<usize> = (0..draws.chains).filter(|chain| is_stuck(*chain)).collect();
    if !stuck.is_empty() {
        notes.push(Note::StuckChains {
            chains: stuck.iter().map(|chain| chain + 1).collect(),
            of: draws.chains,
        });
    }
    for (quantity, values, rhat) in moved {
        if draws.chains > 1 && (rhat.is_nan() || rhat >= RHAT_LIMIT) {
            notes.push(Note::DisagreeingChains {
                quantity,
                rhat: rhat.is_finite().then_some(rhat),
                apart: chains_apart(&draws.by_chain(values)),
            });
        }
    }
    notes
}

fn share_of_moves(chain: &[f64]) -> f64 {
    let moves = chain.windows(2).filter(|pair| pair[0] != pair[1]).count();
    moves as f64 / (chain.len().max(2) - 1) as f64
}

fn chains_apart(chains: &[&[f64]]) -> Vec<ChainPosition> {
    let all = chains.concat();
    let ranks = mean_ranks(&all, chains.len());
    let mut sorted = all.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let distances: Vec<f64> = all.iter().map(|value| (value - median).abs()).collect();
    let spreads = mean_ranks(&distances, chains.len());
    let (middle, middle_spread) = (middle(&ranks), middle(&spreads));
    ranks
        .into_iter()
        .zip(spreads)
        .enumerate()
        .map(|(index, (rank, spread_rank))| ChainPosition {
            chain: index + 1,
            rank,
            spread_rank,
        })
        .filter(|at| {
            (at.rank - middle).abs() > APART || (at.spread_rank - middle_spread).abs() > APART
        })
        .collect()
}

/// The rank of the middle chain: a chain that stands apart moves the ranks of all others, but little that of the middle.
fn middle(ranks: &[f64]) -> f64 {
    let mut sorted = ranks.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    quantile(&sorted, 0.5)
}

/// The mean rank of each of `count` equally long pieces among all values, from 0 to 1; equal values share their ranks.
fn mean_ranks(values: &[f64], count: usize) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_unstable_by(|left, right| values[*left].total_cmp(&values[*right]));
    let length = values.len() / count;
    let mut sums = vec![0.0; count];
    let mut start = 0;
    for ties in order.chunk_by(|left, right| values[*left] == values[*right]) {
        let rank = start as f64 + ties.len() as f64 / 2.0;
        for index in ties {
            sums[index / length] += rank;
        }
        start += ties.len();
    }
    let scale = (length * values.len()) as f64;
    sums.into_iter().map(|sum| sum / scale).collect()
}
