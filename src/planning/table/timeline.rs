//! What a replay shows: frames at a fixed distance, events, and how it ended.

use super::arm::elbow;
use super::effector::By;
use super::engine::{Table, TimedEvent};
use super::geometry::{CUPS, Point, Pose};
use super::measures::Measures;
use super::replay::Replay;

/// Time between two frames in milliseconds.
pub const FRAME_MS: u32 = 30;

/// Where everything is at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The hand: where it grips.
    pub hand: Point,
    /// The gripper: where it grips.
    pub gripper: Point,
    /// The distance between the gripper's fingers in metres.
    pub opening: f64,
    /// The arm's elbow.
    pub elbow: Point,
    /// The cups, the orange one first.
    pub cups: [Pose; CUPS],
}

impl Frame {
    /// The table as it is.
    pub fn of(table: &Table) -> Self {
        let gripper = table.effector(By::Gripper);
        Self {
            hand: table.effector(By::Hand).position(),
            gripper: gripper.position(),
            opening: gripper.opening(),
            elbow: elbow(gripper.position()),
            cups: table.poses(),
        }
    }
}

/// How a replay's tower ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TowerState {
    /// All five cups stand in their slots.
    Standing,
    /// It fell.
    Fallen {
        /// How many slots still hold a cup.
        in_slots: usize,
    },
}

/// A whole replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Timeline {
    /// What it is a replay of.
    pub replay: Replay,
    /// The frames at 0, [`FRAME_MS`], … milliseconds, the last one at [`Self::duration_ms`].
    pub frames: Vec<Frame>,
    /// What happened, in order.
    pub events: Vec<TimedEvent>,
    /// How it ended.
    pub tower: TowerState,
    /// Its measures.
    pub measures: Measures,
}

impl Timeline {
    /// The time of the last frame in milliseconds.
    pub fn duration_ms(&self) -> u32 {
        (self.frames.len() as u32 - 1) * FRAME_MS
    }
}
