//! Frames as whole numbers, track by track: what a browser draws from.

use serde::Serialize;

use super::geometry::{CUPS, Point, Pose, millimetres};
use super::timeline::Timeline;

/// Where a point was, frame by frame, in millimetres.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct PointTrack {
    /// To the right.
    pub x: Vec<i32>,
    /// Away from the person.
    pub y: Vec<i32>,
    /// Up.
    pub z: Vec<i32>,
}

/// The gripper, frame by frame, in millimetres.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct GripperTrack {
    /// Where it grips.
    #[serde(flatten)]
    pub place: PointTrack,
    /// The distance between its fingers.
    pub opening: Vec<i32>,
}

/// A cup, frame by frame.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct CupTrack {
    /// The middle of its axis in millimetres.
    #[serde(flatten)]
    pub place: PointTrack,
    /// Tenths of a degree about the y axis: 0 is mouth down, 1800 mouth up, positive clockwise as the person sees it.
    pub tilt: Vec<i32>,
}

/// All that moves, in whole numbers; every list has one number per frame.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Tracks {
    /// The person's hand: where it grips.
    pub hand: PointTrack,
    /// The arm's gripper.
    pub gripper: GripperTrack,
    /// The arm's elbow.
    pub elbow: PointTrack,
    /// The cups, the orange one first.
    pub cups: [CupTrack; CUPS],
}

impl Timeline {
    /// The frames in whole numbers.
    pub fn tracks(&self) -> Tracks {
        let mut tracks = Tracks::default();
        for frame in &self.frames {
            tracks.hand.push(frame.hand);
            tracks.gripper.place.push(frame.gripper);
            tracks.gripper.opening.push(millimetres(frame.opening));
            tracks.elbow.push(frame.elbow);
            for (track, pose) in tracks.cups.iter_mut().zip(frame.cups) {
                track.push(pose);
            }
        }
        tracks
    }
}

impl PointTrack {
    fn push(&mut self, point: Point) {
        let [x, y, z] = point.millimetres();
        self.x.push(x);
        self.y.push(y);
        self.z.push(z);
    }
}

impl CupTrack {
    fn push(&mut self, pose: Pose) {
        self.place.push(pose.position);
        self.tilt.push((pose.tilt * 10.0).round() as i32);
    }
}
