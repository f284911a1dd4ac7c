//! Replays: a simulated person and arm build a tower, which then stands or falls as the caller decided.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use super::collapse::{Collapse, Push, collapse};
use super::conduct::Conductor;
use super::effector::{By, TICK_MS};
use super::engine::{Refusal, Table};
use super::geometry::{CUPS, Point};
use super::plan;
use super::timeline::{FRAME_MS, Frame, Timeline, TowerState};
use super::tower::{SlotId, Tower};

/// The shortest replay in milliseconds.
const SHORTEST_MS: u32 = 6000;
/// The longest replay in milliseconds.
const LONGEST_MS: u32 = 10_000;
/// The outcome is seen at least so long, in milliseconds.
const OUTCOME_MS: u32 = 1000;
/// Plans that are tried for one replay. One in two fits, one in six where a pyramid has to fall.
const PLANS: usize = 200;

/// What becomes of the tower.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// It stands.
    Stands,
    /// It falls.
    Falls,
}

impl Outcome {
    /// The name used in study files and addresses.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Stands => "stands",
            Self::Falls => "falls",
        }
    }
}

/// A replay, named by all that it depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Replay {
    /// What is built.
    pub tower: Tower,
    /// What becomes of it.
    pub outcome: Outcome,
    /// Decides everything else: who takes which cup, when, how fast, and how the tower falls.
    pub seed: u64,
}

/// Why a replay could not be made. No seed is known for which that happens.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ReplayError {
    /// The engine refused what the simulated person or arm did.
    #[error("the table refused a step of the replay: {0}")]
    Refused(#[from] Refusal),
    /// No plan kept to the length of a replay with hand and gripper out of each other's way.
    #[error(
        "none of {PLANS} plans for the {tower:?} tower with seed {seed} fits into {SHORTEST_MS} to {LONGEST_MS} ms without interference"
    )]
    NoPlan {
        /// The tower.
        tower: Tower,
        /// The seed.
        seed: u64,
    },
}

impl Replay {
    /// Plays it through. The same replay gives the same timeline on every machine, for one version of this program.
    ///
    /// Plans are drawn from the seed until one works out without interference and within 6 to 10 s.
    pub fn timeline(self) -> Result<Timeline, ReplayError> {
        let mut rng = ChaCha12Rng::seed_from_u64(self.seed);
        for _ in 0..PLANS {
            let timeline = self.attempt(&mut rng)?;
            if let Some(timeline) = timeline {
                return Ok(timeline);
            }
        }
        Err(ReplayError::NoPlan {
            tower: self.tower,
            seed: self.seed,
        })
    }

    fn attempt(self, rng: &mut impl Rng) -> Result<Option<Timeline>, ReplayError> {
        let mut show = Show::new(self.tower, rng);
        while show.table.placed() < CUPS {
            if show.table.time_ms() > LONGEST_MS {
                return Ok(None);
            }
            show.tick()?;
        }
        let tower = match self.outcome {
            Outcome::Stands => {
                show.table.stand()?;
                show.run_for(OUTCOME_MS + rng.random_range(0..400))?;
                TowerState::Standing
            }
            Outcome::Falls => {
                show.run_for(rng.random_range(350..650))?;
                let Some(collapse) = drawn_collapse(self.tower, rng) else {
                    return Ok(None);
                };
                let fall_ms = collapse.steps() as u32 * TICK_MS;
                let in_slots = collapse.standing();
                show.table.topple(collapse)?;
                show.draw_back();
                show.run_for(fall_ms + OUTCOME_MS)?;
                TowerState::Fallen { in_slots }
            }
        };
        show.finish_frame()?;
        let timeline = Timeline {
            replay: self,
            events: show.table.events().to_vec(),
            measures: show.table.measures(),
            frames: show.frames,
            tower,
        };
        let fits = (SHORTEST_MS..=LONGEST_MS).contains(&timeline.duration_ms())
            && timeline.measures.interferences == 0;
        Ok(fits.then_some(timeline))
    }
}

/// The table with both at work, filmed.
struct Show {
    table: Table,
    hand: Conductor,
    gripper: Conductor,
    frames: Vec<Frame>,
}

impl Show {
    fn new(tower: Tower, rng: &mut impl Rng) -> Self {
        let table = Table::default();
        let [hand, gripper] = plan::draw(tower, rng).map(Conductor::new);
        let frames = vec![Frame::of(&table)];
        Self {
            table,
            hand,
            gripper,
            frames,
        }
    }

    fn tick(&mut self) -> Result<(), Refusal> {
        let hand = self.hand.drive(&mut self.table)?;
        let gripper = self.gripper.drive(&mut self.table)?;
        self.table.advance(hand, gripper);
        if self.table.time_ms().is_multiple_of(FRAME_MS) {
            self.frames.push(Frame::of(&self.table));
        }
        Ok(())
    }

    fn run_for(&mut self, ms: u32) -> Result<(), Refusal> {
        let end = self.table.time_ms() + ms;
        while self.table.time_ms() < end {
            self.tick()?;
        }
        Ok(())
    }

    /// Runs on to the next frame, so that the last frame is the end.
    fn finish_frame(&mut self) -> Result<(), Refusal> {
        while !self.table.time_ms().is_multiple_of(FRAME_MS) {
            self.tick()?;
        }
        Ok(())
    }

    fn draw_back(&mut self) {
        self.hand
            .draw_back(By::Hand.rest() + Point::new(0.06, -0.05, 0.06));
        self.gripper
            .draw_back(By::Gripper.rest() + Point::new(0.05, 0.06, 0.06));
    }
}

/// How much stronger each push is than the drawn one, in the order in which they are tried.
const STRENGTHS: [f64; 8] = [1.0, 1.2, 1.45, 1.75, 2.1, 2.5, 3.0, 3.6];

/// The first collapse among pushes of growing strength, of the drawn kind.
fn drawn_collapse(tower: Tower, rng: &mut impl Rng) -> Option<Collapse> {
    let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let push = Push {
        slot: SlotId::ALL[rng.random_range(0..CUPS)],
        speed: side * rng.random_range(0.25..0.5),
        above: rng.random_range(-0.8..0.5),
        below: rng.random_range(-1.6..0.2),
    };
    let pushes = STRENGTHS.iter().map(|strength| push.times(*strength));
    pushes.into_iter().find_map(|push| collapse(tower, push))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn study_files_and_addresses_use_the_same_names() {
        for tower in [Tower::Stable, Tower::Unstable] {
            assert_eq!(serde_json::to_value(tower).unwrap(), tower.as_str());
        }
        for outcome in [Outcome::Stands, Outcome::Falls] {
            assert_eq!(serde_json::to_value(outcome).unwrap(), outcome.as_str());
        }
    }
}
