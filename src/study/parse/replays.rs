//! Replays blocks.

use super::blocks::block_id;
use super::rules;
use crate::planning::table::Replay;
use crate::study::ReplayId;
use crate::study::document::{Fault, KeyPath};
use crate::study::file::{RawReplay, RawReplays};
use crate::study::step::{NamedReplay, ReplaysText};
use crate::study::template::Scope;

/// How many replays one block may show: more than anybody would sit through.
const MOST_REPLAYS: usize = 50;

/// The largest seed: whole numbers up to here survive JSON readers that know only floating-point numbers.
const LARGEST_SEED: u64 = (1 << 53) - 1;

/// Reads a replays block: its id and its text.
pub(super) fn read(
    raw: &RawReplays,
    scope: &Scope<'_>,
    at: &KeyPath,
) -> Result<(String, ReplaysText), Fault> {
    let id = block_id(&raw.id, at)?;
    let list = at.key("replay");
    if !(1..=MOST_REPLAYS).contains(&raw.replay.len()) {
        return Err(list.fault(
            format!("{} replays", raw.replay.len()),
            format!("1 to {MOST_REPLAYS} replays"),
        ));
    }
    let mut replays: Vec<NamedReplay> = Vec::with_capacity(raw.replay.len());
    for (index, raw) in raw.replay.iter().enumerate() {
        let at = list.index(index);
        let named = replay(raw, &at)?;
        if replays.contains(&named) {
            return Err(at.key("seed").fault(
                format!("{} for the second time", rules::shown(named.id.as_str())),
                "another seed for each replay of the same tower and outcome",
            ));
        }
        replays.push(named);
    }
    let text = ReplaysText {
        title: rules::filled_line(&raw.title, scope, &at.key("title"))?,
        text_html: rules::filled_markdown(&raw.text, scope, &at.key("text"))?,
        button: rules::filled_line(&raw.button, scope, &at.key("button"))?,
        order: raw.order,
        replays,
    };
    Ok((id, text))
}

fn replay(raw: &RawReplay, at: &KeyPath) -> Result<NamedReplay, Fault> {
    let seed = u64::try_from(raw.seed)
        .ok()
        .filter(|seed| *seed <= LARGEST_SEED)
        .ok_or_else(|| {
            let allowed = format!("a whole number from 0 to {LARGEST_SEED}");
            at.key("seed").fault(raw.seed, allowed)
        })?;
    let replay = Replay {
        tower: raw.tower,
        outcome: raw.outcome,
        seed,
    };
    Ok(NamedReplay {
        id: ReplayId::from(format!(
            "{}-{}-{seed}",
            replay.tower.as_str(),
            replay.outcome.as_str()
        )),
        replay,
    })
}
