//! What must hold for every replay.

use std::collections::HashSet;

use super::*;

fn replays(seeds: std::ops::Range<u64>) -> impl Iterator<Item = Replay> {
    seeds.flat_map(|seed| {
        [Tower::Stable, Tower::Unstable]
            .into_iter()
            .flat_map(move |tower| {
                [Outcome::Stands, Outcome::Falls].map(|outcome| Replay {
                    tower,
                    outcome,
                    seed,
                })
            })
    })
}

/// A cup's surface and inside, for the test of overlaps.
struct Solid {
    pose: Pose,
    sine: f64,
    cosine: f64,
}

impl Solid {
    fn new(pose: Pose) -> Self {
        let (sine, cosine) = pose.tilt.to_radians().sin_cos();
        Self { pose, sine, cosine }
    }

    /// Points of its surface: four rings and the middles of both ends.
    fn surface(&self) -> impl Iterator<Item = Point> {
        let rings = [-0.5, -0.2, 0.1, 0.5].into_iter().flat_map(|height| {
            let radius = radius(height * CUP_HEIGHT);
            (0..24).map(move |step| {
                let angle = f64::from(step) * std::f64::consts::TAU / 24.0;
                Point::new(
                    radius * angle.cos(),
                    radius * angle.sin(),
                    height * CUP_HEIGHT,
                )
            })
        });
        let ends = [-0.5, 0.5].map(|height| Point::new(0.0, 0.0, height * CUP_HEIGHT));
        rings.chain(ends).map(|own| {
            let turned = Point::new(
                own.x * self.cosine + own.z * self.sine,
                own.y,
                own.z * self.cosine - own.x * self.sine,
            );
            self.pose.position + turned
        })
    }

    /// A point lies inside it, deeper than `depth` metres.
    fn holds(&self, point: Point, depth: f64) -> bool {
        let way = point - self.pose.position;
        let x = way.x * self.cosine - way.z * self.sine;
        let z = way.x * self.sine + way.z * self.cosine;
        z.abs() < CUP_HEIGHT / 2.0 - depth && (x * x + way.y * way.y).sqrt() < radius(z) - depth
    }

    fn overlaps(&self, other: &Self, depth: f64) -> bool {
        self.pose.position.distance(other.pose.position) < 0.13
            && (self.surface().any(|point| other.holds(point, depth))
                || other.surface().any(|point| self.holds(point, depth)))
    }
}

/// A cup's radius at a height over its middle.
fn radius(height: f64) -> f64 {
    let share = height / CUP_HEIGHT + 0.5;
    MOUTH_RADIUS + (BOTTOM_RADIUS - MOUTH_RADIUS) * share
}

#[test]
fn cups_overlap_neither_each_other_nor_the_table() {
    for replay in replays(0..12) {
        let timeline = replay.timeline().unwrap();
        for (number, frame) in timeline.frames.iter().enumerate() {
            let at = number as u32 * FRAME_MS;
            let solids = frame.cups.map(Solid::new);
            for (index, one) in solids.iter().enumerate() {
                for other in &solids[index + 1..] {
                    assert!(!one.overlaps(other, 0.002), "{replay:?} at {at} ms");
                }
                let lowest = one.surface().map(|point| point.z).fold(f64::MAX, f64::min);
                assert!(lowest > -0.002, "{replay:?} at {at} ms: {lowest}");
            }
        }
    }
}

#[test]
fn cups_in_slots_and_at_their_starts_are_apart() {
    for tower in [Tower::Stable, Tower::Unstable] {
        let slots = SlotId::ALL.map(|slot| tower.pose(slot));
        let starts = CupId::ALL.map(CupId::start);
        let all: Vec<Solid> = slots.into_iter().chain(starts).map(Solid::new).collect();
        for (index, one) in all.iter().enumerate() {
            for other in &all[index + 1..] {
                assert!(!one.overlaps(other, 1e-9), "{tower:?}");
            }
        }
    }
}

/// Shortest distance of a point to the part of a line between `from` and `to`.
fn distance_to_segment(point: Point, from: Point, to: Point) -> f64 {
    let way = to - from;
    let off = point - from;
    let along = way.x * off.x + way.y * off.y + way.z * off.z;
    let share = (along / (way.length() * way.length())).clamp(0.0, 1.0);
    point.distance(from + way * share)
}

#[test]
fn the_arm_keeps_clear_of_the_tower_and_its_elbow_never_jumps() {
    for replay in replays(0..60).filter(|replay| replay.outcome == Outcome::Stands) {
        let timeline = replay.timeline().unwrap();
        for pair in timeline.frames.windows(2) {
            assert!(pair[0].elbow.distance(pair[1].elbow) < 0.1, "{replay:?}");
        }
        for frame in &timeline.frames {
            for cup in frame.cups {
                let at = cup.position;
                let in_tower = at.y == TOWER_Y && at.x.abs() < 0.1;
                if in_tower && at.distance(frame.gripper) > 0.09 {
                    let distance = distance_to_segment(at, frame.elbow, frame.gripper);
                    assert!(distance > MOUTH_RADIUS, "{replay:?}: {distance}");
                }
            }
        }
    }
}

/// Slots of the tower that hold a cup, by the picture alone. A cup counts within half the radius of its bottom and 10
/// degrees of upright, mouth down or, at every second level of the column, mouth up.
fn filled(tower: Tower, cups: [Pose; CUPS]) -> usize {
    // In millimetres: x, height of the middle, and whether the mouth is down.
    let slots = match tower {
        Tower::Stable => [
            (0.0, 50.0, true),
            (-86.0, 50.0, true),
            (86.0, 50.0, true),
            (-43.0, 150.0, true),
            (43.0, 150.0, true),
        ],
        Tower::Unstable => [
            (0.0, 50.0, true),
            (0.0, 150.0, false),
            (0.0, 250.0, true),
            (0.0, 350.0, false),
            (0.0, 450.0, true),
        ],
    };
    let holds = |(x, z, mouth_down): (f64, f64, bool), cup: &Pose| {
        let at = cup.position;
        let up = cup.tilt.to_radians().cos() * if mouth_down { 1.0 } else { -1.0 };
        let off = (at.x * 1000.0 - x).hypot(at.z * 1000.0 - z);
        at.y == 0.35 && off < 14.0 && up > 10.0_f64.to_radians().cos()
    };
    slots
        .into_iter()
        .filter(|slot| cups.iter().any(|cup| holds(*slot, cup)))
        .count()
}

#[test]
fn the_last_frame_shows_the_decided_outcome() {
    for replay in replays(0..250) {
        let timeline = replay.timeline().unwrap();
        let last = timeline.frames[timeline.frames.len() - 1];
        let in_slots = filled(replay.tower, last.cups);
        let last_event = timeline.events[timeline.events.len() - 1];
        match replay.outcome {
            Outcome::Stands => {
                assert_eq!(in_slots, 5, "{replay:?}");
                assert_eq!(timeline.tower, TowerState::Standing);
                assert_eq!(last_event.event, Event::TowerStands);
            }
            Outcome::Falls => {
                let most = match replay.tower {
                    Tower::Stable => 2,
                    Tower::Unstable => 1,
                };
                assert!(in_slots <= most, "{replay:?}: {in_slots}");
                assert_eq!(
                    timeline.tower,
                    TowerState::Fallen { in_slots },
                    "{replay:?}"
                );
                assert_eq!(last_event.event, Event::AtRest);
                let on_another = |pose: &Pose| pose.position.z > 0.1;
                assert!(!last.cups.iter().any(on_another), "{replay:?}");
                let on_table = |pose: &Pose| pose.position.x.abs() < 0.6;
                assert!(last.cups.iter().all(on_table), "{replay:?}");
            }
        }
        let duration = timeline.duration_ms();
        assert!(
            (6000..=10_000).contains(&duration),
            "{replay:?}: {duration} ms"
        );
        assert!(duration - last_event.at_ms >= 1000, "{replay:?}");
        assert_eq!(timeline.measures.interferences, 0);
        assert_eq!(timeline.measures.replans, 0);
    }
}

#[test]
fn the_first_cup_reveals_the_tower() {
    for replay in replays(0..40) {
        let timeline = replay.timeline().unwrap();
        let first = timeline.events[0];
        assert!(first.at_ms >= 600);
        let Event::ReachesFor { by: By::Hand, cup } = first.event else {
            panic!("the person reaches first in {replay:?}: {first:?}");
        };
        assert_eq!(cup == CupId::ORANGE, replay.tower == Tower::Stable);
    }
}

#[test]
fn every_cup_is_reached_grasped_and_placed_once() {
    for replay in replays(0..10) {
        let timeline = replay.timeline().unwrap();
        for cup in CupId::ALL {
            let own: Vec<Event> = timeline
                .events
                .iter()
                .map(|event| event.event)
                .filter(|event| match event {
                    Event::ReachesFor { cup: of, .. }
                    | Event::Grasps { cup: of, .. }
                    | Event::Placed { cup: of, .. } => *of == cup,
                    Event::PutBack { .. }
                    | Event::TowerStands
                    | Event::TowerFalls
                    | Event::AtRest => false,
                })
                .collect();
            assert!(
                matches!(
                    own[..],
                    [
                        Event::ReachesFor { by: first, .. },
                        Event::Grasps { by: second, .. },
                        Event::Placed { by: third, .. }
                    ] if first == second && second == third
                ),
                "{own:?}"
            );
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_frames_and_another_seed_others() {
    let bytes = |replay: Replay| {
        let timeline = replay.timeline().unwrap();
        serde_json::to_vec(&timeline.tracks()).unwrap()
    };
    let mut seen = HashSet::new();
    for replay in replays(0..15) {
        let frames = bytes(replay);
        assert_eq!(frames, bytes(replay), "{replay:?}");
        assert!(seen.insert(frames), "{replay:?} was there before");
    }
}

#[test]
fn tracks_hold_one_number_per_frame() {
    let replay = Replay {
        tower: Tower::Unstable,
        outcome: Outcome::Falls,
        seed: 17,
    };
    let timeline = replay.timeline().unwrap();
    let tracks = serde_json::to_value(timeline.tracks()).unwrap();
    let frames = timeline.duration_ms() / FRAME_MS + 1;
    let lists = [
        "/hand/x",
        "/gripper/z",
        "/gripper/opening",
        "/elbow/y",
        "/cups/4/tilt",
    ];
    for list in lists {
        let numbers = tracks.pointer(list).unwrap().as_array().unwrap();
        assert_eq!(numbers.len() as u32, frames, "{list}");
    }
    let first = timeline.frames[0].cups[1].position;
    assert_eq!(
        tracks.pointer("/cups/1/x/0").unwrap().as_f64().unwrap(),
        (first.x * 1000.0).round()
    );
}
