//! Hand and gripper: what they are asked to do, and how far they follow.

use super::geometry::{CupId, Point};
use super::motion::{Limits, Motion, Mover, Turner};

/// Length of a time step in milliseconds.
pub const TICK_MS: u32 = 5;
/// The same in seconds.
pub(super) const TICK: f64 = TICK_MS as f64 / 1000.0;
/// The opening of resting fingers, in metres.
pub(super) const OPEN: f64 = 0.11;
/// The opening of fingers around the middle of a cup, in metres.
pub(super) const CLOSED: f64 = 0.07;

/// Who moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum By {
    /// The person's hand.
    Hand,
    /// The arm's gripper.
    Gripper,
}

impl By {
    /// The one beside it.
    pub(super) fn other(self) -> Self {
        match self {
            Self::Hand => Self::Gripper,
            Self::Gripper => Self::Hand,
        }
    }

    /// Where it rests before and after the work.
    pub fn rest(self) -> Point {
        match self {
            Self::Hand => Point::new(0.10, -0.07, 0.06),
            Self::Gripper => Point::new(0.28, 0.47, 0.20),
        }
    }
}

/// What fingers do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grip {
    /// Open and empty.
    Empty,
    /// Closing around a cup.
    Closing(CupId),
    /// Around a cup, which moves along.
    Holding(CupId),
    /// Opening around the cup that was just put down.
    Opening(CupId),
}

impl Grip {
    /// The cup between the fingers.
    pub(super) fn cup(self) -> Option<CupId> {
        match self {
            Self::Empty => None,
            Self::Closing(cup) | Self::Holding(cup) | Self::Opening(cup) => Some(cup),
        }
    }
}

/// The hand or the gripper.
#[derive(Debug, Clone)]
pub struct Effector {
    mover: Mover,
    pub(super) turner: Turner,
    pub(super) opening: f64,
    pub(super) grip: Grip,
    pub(super) towards: Option<CupId>,
    /// The last reach that was noted since it was last empty, and when in milliseconds.
    pub(super) noted: Option<(CupId, u32)>,
    pub(super) limits: Limits,
}

impl Effector {
    pub(super) fn new(by: By, limits: Limits) -> Self {
        Self {
            mover: Mover {
                position: by.rest(),
                velocity: Point::new(0.0, 0.0, 0.0),
            },
            turner: Turner::default(),
            opening: OPEN,
            grip: Grip::Empty,
            towards: None,
            noted: None,
            limits,
        }
    }

    /// Where it grips: the middle of the cup that it carries.
    pub fn position(&self) -> Point {
        self.mover.position
    }

    /// Its velocity in m/s.
    pub fn velocity(&self) -> Point {
        self.mover.velocity
    }

    /// The distance between its fingers in metres.
    pub fn opening(&self) -> f64 {
        self.opening
    }

    /// What its fingers do.
    pub fn grip(&self) -> Grip {
        self.grip
    }

    /// The tilt of the cup that it carries, in degrees.
    pub fn tilt(&self) -> f64 {
        self.turner.tilt
    }

    /// It neither moves nor turns.
    pub fn is_at_rest(&self) -> bool {
        self.mover.is_at_rest() && self.turner.is_at_rest()
    }

    /// It rests at `target`, within a hundredth of a millimetre, its cup turned to `tilt`.
    pub fn rests_at(&self, target: Point, tilt: f64) -> bool {
        self.is_at_rest()
            && self.position().distance(target) < 1e-5
            && (self.tilt() - tilt).abs() < 0.01
    }

    /// Moves for one tick and returns the length of the way.
    pub(super) fn advance(&mut self, drive: &Drive) -> f64 {
        let before = self.mover.position;
        let motion = match self.grip {
            Grip::Closing(_) | Grip::Opening(_) => Motion::Stay,
            Grip::Empty | Grip::Holding(_) => drive.motion.within_workspace(),
        };
        self.mover.advance(motion, drive.pace, &self.limits, TICK);
        if let Grip::Holding(_) = self.grip {
            self.turner.advance(drive.tilt, &self.limits, TICK);
        }
        self.mover.position.distance(before)
    }
}

/// What is asked of the hand or the gripper for one tick. It is followed as far as the limits allow. One in which a number
/// is not finite is followed as [`Drive::STAY`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Where to move.
    pub motion: Motion,
    /// The wanted share of the largest speed, 0 to 1.
    pub pace: f64,
    /// The wanted tilt of a carried cup, in degrees.
    pub tilt: f64,
    /// The cup that the move is meant to reach, if any.
    pub towards: Option<CupId>,
}

impl Drive {
    /// To slow down and stay, a carried cup mouth down.
    pub const STAY: Self = Self {
        motion: Motion::Stay,
        pace: 1.0,
        tilt: 0.0,
        towards: None,
    };

    /// Itself, or to stay where a number is not finite.
    pub(super) fn or_stay(self) -> Self {
        let target = self.motion.target().unwrap_or(Point::new(0.0, 0.0, 0.0));
        let numbers = [self.pace, self.tilt, target.x, target.y, target.z];
        if numbers.into_iter().all(f64::is_finite) {
            self
        } else {
            Self::STAY
        }
    }
}
