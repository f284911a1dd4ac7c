//! Bounded motion: where a point that wants to be elsewhere gets in one time step.

use super::geometry::{Point, workspace};

/// The largest speeds and accelerations of one who moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Speed in m/s.
    pub speed: f64,
    /// Change of velocity in m/s².
    pub acceleration: f64,
    /// Turning of a carried cup in °/s.
    pub turn_speed: f64,
    /// Change of the turning in °/s².
    pub turn_acceleration: f64,
    /// Opening and closing of the fingers in m/s.
    pub finger_speed: f64,
}

/// A person's hand. Chosen, not measured: faster than the arm, and slow enough to be followed by eye.
pub const HAND: Limits = Limits {
    speed: 1.4,
    acceleration: 11.0,
    turn_speed: 540.0,
    turn_acceleration: 3600.0,
    finger_speed: 0.5,
};

/// The gripper of a light table-top arm. Chosen likewise.
pub const GRIPPER: Limits = Limits {
    speed: 1.1,
    acceleration: 7.0,
    turn_speed: 360.0,
    turn_acceleration: 1800.0,
    finger_speed: 0.35,
};

/// Share of the acceleration that braking uses; the rest takes out sideways motion on the way.
const BRAKING: f64 = 0.8;

/// Beyond the workspace by less than this, in metres, is not beyond it.
const ROUNDING: f64 = 1e-9;

/// Where to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Slow down and stay.
    Stay,
    /// To a point, and come to rest there.
    To(Point),
    /// Towards a point without slowing down for it.
    Through(Point),
}

impl Motion {
    /// Where it leads, if anywhere.
    pub(super) fn target(self) -> Option<Point> {
        match self {
            Self::Stay => None,
            Self::To(target) | Self::Through(target) => Some(target),
        }
    }

    /// The same to a point of the [`workspace`].
    pub(super) fn within_workspace(self) -> Self {
        match self {
            Self::Stay => Self::Stay,
            Self::To(target) => Self::To(workspace(target)),
            Self::Through(target) => Self::Through(workspace(target)),
        }
    }
}

/// A moving point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mover {
    /// Where it is.
    pub position: Point,
    /// Its velocity in m/s.
    pub velocity: Point,
}

impl Mover {
    /// Moves for `step` seconds. `pace` is the share of the largest speed that is wanted; values outside 0 … 1 are clamped.
    ///
    /// From rest to a point straight ahead the speed is a trapezoid: it rises by `acceleration · step` each step, stays at
    /// `pace · speed`, and falls by 0.8 `acceleration · step` each step until the point is reached exactly.
    /// A wish that changes on the way bends the path; neither speed nor acceleration exceeds its limit.
    /// A step after which it could no longer stop within the [`workspace`] is not taken; it brakes instead.
    pub fn advance(&mut self, motion: Motion, pace: f64, limits: &Limits, step: f64) {
        let fastest = pace.clamp(0.0, 1.0) * limits.speed;
        let wanted = self.wanted_velocity(motion, fastest, limits, step);
        let largest = limits.acceleration * step;
        let next = self.changed(wanted, largest, step);
        let stop = next.stop(largest, step);
        *self = if stop.distance(workspace(stop)) < ROUNDING {
            next
        } else {
            self.changed(Point::new(0.0, 0.0, 0.0), largest, step)
        };
        self.position = workspace(self.position);
    }

    /// One step later, its velocity changed towards `wanted` by at most `largest`.
    fn changed(&self, wanted: Point, largest: f64, step: f64) -> Self {
        let change = wanted - self.velocity;
        let size = change.length();
        let velocity = if size <= largest {
            wanted
        } else {
            self.velocity + change * (largest / size)
        };
        Self {
            position: self.position + velocity * step,
            velocity,
        }
    }

    /// Where it comes to rest if each step from now on takes `largest` from its speed.
    ///
    /// From speed v it moves on with v − u, v − 2u, … for the n = ⌊v/u⌋ steps in which that is positive, u being `largest`:
    /// together n·v − u·n(n + 1)/2 steps.
    fn stop(&self, largest: f64, step: f64) -> Point {
        let speed = self.velocity.length();
        if speed < largest {
            return self.position;
        }
        let steps = (speed / largest).floor();
        let way = steps * (speed - largest * (steps + 1.0) / 2.0) * step;
        self.position + self.velocity * (way / speed)
    }

    fn wanted_velocity(&self, motion: Motion, fastest: f64, limits: &Limits, step: f64) -> Point {
        let (target, stops) = match motion {
            Motion::Stay => return Point::new(0.0, 0.0, 0.0),
            Motion::To(target) => (target, true),
            Motion::Through(target) => (target, false),
        };
        let way = target - self.position;
        let distance = way.length();
        if distance == 0.0 {
            return Point::new(0.0, 0.0, 0.0);
        }
        let speed = if stops {
            braking_speed(distance, limits.acceleration, step).min(fastest)
        } else {
            fastest
        };
        way * (speed / distance)
    }

    /// It does not move: what is left of its speed would be a millimetre in a second.
    pub fn is_at_rest(&self) -> bool {
        self.velocity.length() < 1e-3
    }
}

/// The turning of a carried cup.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Turner {
    /// The angle in degrees.
    pub tilt: f64,
    /// Its rate of change in °/s.
    pub rate: f64,
}

impl Turner {
    /// Turns towards `wanted` for `step` seconds, as [`Mover::advance`] moves.
    pub fn advance(&mut self, wanted: f64, limits: &Limits, step: f64) {
        let way = wanted - self.tilt;
        let speed = braking_speed(way.abs(), limits.turn_acceleration, step).min(limits.turn_speed);
        let change = speed.copysign(way) - self.rate;
        let largest = limits.turn_acceleration * step;
        self.rate += change.clamp(-largest, largest);
        self.tilt += self.rate * step;
    }

    /// It does not turn.
    pub fn is_at_rest(&self) -> bool {
        self.rate.abs() < 0.1
    }
}

/// The largest speed from which the rest of the way suffices to stop.
///
/// A point that slows down by `b · step` each step, `b` being the braking share of `acceleration`, covers
/// `v²/(2b) + v·step/2` from speed v, the present step included. In the last step it covers what is left.
fn braking_speed(distance: f64, acceleration: f64, step: f64) -> f64 {
    let unit = BRAKING * acceleration * step;
    let steps = distance / (unit * step);
    (unit * ((0.25 + 2.0 * steps).sqrt() - 0.5)).min(distance / step)
}
