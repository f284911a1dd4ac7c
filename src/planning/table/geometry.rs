//! Points, cups and the table, in metres and degrees.
//!
//! x runs to the right as the person sees it, y away from the person, z up; the table's top is z = 0.

use std::ops::{Add, Mul, Sub};

/// Height of a cup in metres.
pub const CUP_HEIGHT: f64 = 0.10;
/// Radius of a cup at its open, wide end, in metres.
pub const MOUTH_RADIUS: f64 = 0.04;
/// Radius of a cup at its closed, narrow end, in metres.
pub const BOTTOM_RADIUS: f64 = 0.028;
/// How many cups there are.
pub const CUPS: usize = 5;
/// The table ends at x = ± this, in metres.
pub const TABLE_END: f64 = 0.6;

/// A place or a vector, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// To the right.
    pub x: f64,
    /// Away from the person.
    pub y: f64,
    /// Up.
    pub z: f64,
}

impl Point {
    /// A point from its coordinates in metres.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { x, y, z }
    }

    /// Its coordinates in whole millimetres.
    pub fn millimetres(self) -> [i32; 3] {
        [self.x, self.y, self.z].map(millimetres)
    }

    /// Distance from the origin in metres.
    pub fn length(self) -> f64 {
        (self.x * self.x + self.y * self.y + self.z * self.z).sqrt()
    }

    /// Distance to another point in metres.
    pub fn distance(self, other: Self) -> f64 {
        (self - other).length()
    }
}

/// Metres as whole millimetres.
pub(super) fn millimetres(metres: f64) -> i32 {
    (metres * 1000.0).round() as i32
}

impl Add for Point {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl Sub for Point {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl Mul<f64> for Point {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
}

/// Where a cup is and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// The middle of its axis.
    pub position: Point,
    /// Its rotation about the y axis in degrees: 0 is mouth down, 180 mouth up, positive clockwise as the person sees it.
    pub tilt: f64,
}

/// One of the five cups.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CupId(usize);

impl CupId {
    /// The cup with which the stable tower begins.
    pub const ORANGE: Self = Self(0);

    /// All cups, the orange one first.
    pub const ALL: [Self; CUPS] = [Self(0), Self(1), Self(2), Self(3), Self(4)];

    /// Its place in [`Self::ALL`].
    pub fn index(self) -> usize {
        self.0
    }

    /// Where it stands at the start, mouth down: in an arc between the person and the tower, the orange one in front.
    pub fn start(self) -> Pose {
        let (x, y) = [
            (0.0, 0.09),
            (-0.27, 0.13),
            (0.27, 0.13),
            (-0.38, 0.37),
            (0.38, 0.37),
        ][self.0];
        Pose {
            position: Point::new(x, y, CUP_HEIGHT / 2.0),
            tilt: 0.0,
        }
    }
}

/// The nearest point to `wish` that hand or gripper may take: above the table by half a cup, and not far beyond its edges.
pub fn workspace(wish: Point) -> Point {
    Point::new(
        wish.x.clamp(-TABLE_END, TABLE_END),
        wish.y.clamp(-0.15, 0.7),
        wish.z.clamp(CUP_HEIGHT / 2.0, 0.7),
    )
}
