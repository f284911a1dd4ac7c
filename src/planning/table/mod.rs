//! The cup table: one deterministic engine with a fixed time step, and the replays made with it.
//!
//! In reading order:
//!
//! * [`Point`], [`Pose`], [`CupId`]: where things are, and what the table and its cups measure.
//! * [`Tower`], [`SlotId`]: the two towers, where their cups stand and what carries what.
//! * [`Limits`], [`Motion`]: how fast hand and gripper may move. The arm follows its gripper ([`elbow`]).
//! * [`Table`]: the authoritative state. Whoever moves hand or gripper is a client of it, bounded by it.
//! * [`collapse`]: how a pushed tower falls.
//! * [`Replay`], [`Timeline`], [`Tracks`]: a simulated person and arm at the table, as frames and events.
//!
//! All state follows from commands and seeds by additions, multiplications, divisions and square roots, and by a physics
//! engine built for the same results on every machine: the same replay has the same frames wherever it is made.

pub mod collapse;

mod arm;
mod conduct;
mod effector;
mod engine;
mod geometry;
mod measures;
mod motion;
mod plan;
mod projection;
#[cfg(test)]
mod properties;
mod replay;
#[cfg(test)]
mod replay_properties;
#[cfg(test)]
mod stimuli;
mod timeline;
mod tower;
mod tracks;
#[cfg(test)]
mod trial;

pub use arm::{SHOULDER, elbow};
pub use effector::{By, Drive, Effector, Grip, TICK_MS};
pub use engine::{Event, INTERFERENCE_DISTANCE, Refusal, Table, TimedEvent};
pub use geometry::{
    BOTTOM_RADIUS, CUP_HEIGHT, CUPS, CupId, MOUTH_RADIUS, Point, Pose, TABLE_END, workspace,
};
pub use measures::Measures;
pub use motion::{GRIPPER, HAND, Limits, Motion};
pub use projection::{PROJECTION, Projection};
pub use replay::{Outcome, Replay, ReplayError};
pub use timeline::{FRAME_MS, Frame, Timeline, TowerState};
pub use tower::{SlotId, TOWER_Y, Tower};
pub use tracks::{CupTrack, GripperTrack, PointTrack, Tracks};
