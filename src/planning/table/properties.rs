//! What must hold for the engine whatever is asked of it, and for every replay.

use std::collections::HashSet;

use proptest::prelude::*;

use super::collapse::is_in_slot;
use super::effector::TICK;
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

/// Numbers as a client may send them, most of them usual ones.
fn number(usual: std::ops::Range<f64>) -> impl Strategy<Value = f64> {
    let odd = vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, -0.0];
    prop_oneof![20 => usual, 1 => prop::sample::select(odd)]
}

fn point() -> impl Strategy<Value = Point> {
    let axis = || number(-2.0..2.0);
    (axis(), axis(), axis()).prop_map(|(x, y, z)| Point::new(x, y, z))
}

fn drive() -> impl Strategy<Value = Drive> {
    let motion = prop_oneof![
        Just(Motion::Stay),
        point().prop_map(Motion::To),
        point().prop_map(Motion::Through)
    ];
    let cup = prop::option::of(prop::sample::select(&CupId::ALL[..]));
    (motion, number(-1.0..3.0), number(-1000.0..1000.0), cup).prop_map(
        |(motion, pace, tilt, towards)| Drive {
            motion,
            pace,
            tilt,
            towards,
        },
    )
}

/// A point on the table that hand or gripper may take without the workspace changing it.
fn place() -> impl Strategy<Value = Point> {
    (-0.5..0.5, 0.0..0.6, 0.05..0.5).prop_map(|(x, y, z)| Point::new(x, y, z))
}

fn move_to(table: &mut Table, by: By, target: Point, towards: Option<CupId>) {
    let drive = Drive {
        motion: Motion::To(target),
        towards,
        ..Drive::STAY
    };
    let mut ticks = 0;
    while !table
        .effector(by)
        .rests_at(target, table.effector(by).tilt())
    {
        match by {
            By::Hand => table.advance(drive, Drive::STAY),
            By::Gripper => table.advance(Drive::STAY, drive),
        }
        ticks += 1;
        assert!(ticks < 2000, "{by:?} does not arrive at {target:?}");
    }
}

/// Takes a cup and brings it over its slot, then down, without turning it.
fn fetch(table: &mut Table, by: By, cup: CupId, slot: Pose) {
    move_to(table, by, cup.start().position, Some(cup));
    table.grasp(by, cup).unwrap();
    while table.effector(by).grip() != Grip::Holding(cup) {
        table.advance(Drive::STAY, Drive::STAY);
    }
    move_to(table, by, slot.position, None);
}

proptest! {
    #[test]
    fn speed_acceleration_and_place_stay_in_bounds_whatever_is_asked(
        drives in prop::collection::vec((drive(), drive(), 1_usize..120), 1..12)
    ) {
        let mut table = Table::default();
        for (hand, gripper, ticks) in drives {
            for _ in 0..ticks {
                let before = table.clone();
                table.advance(hand, gripper);
                for (by, limits) in [(By::Hand, HAND), (By::Gripper, GRIPPER)] {
                    let (old, new) = (before.effector(by), table.effector(by));
                    let way = new.position().distance(old.position());
                    prop_assert!(way <= limits.speed * TICK * (1.0 + 1e-9));
                    let change = new.velocity().distance(old.velocity());
                    prop_assert!(change <= limits.acceleration * TICK * (1.0 + 1e-9));
                    prop_assert_eq!(new.position(), workspace(new.position()));
                    prop_assert!(new.tilt().is_finite());
                }
            }
        }
        move_to(&mut table, By::Hand, workspace(Point::new(1.0, -1.0, -1.0)), None);
    }

    #[test]
    fn path_length_is_the_sum_of_the_moves(targets in prop::collection::vec(place(), 1..6)) {
        let mut table = Table::default();
        let mut at = By::Gripper.rest();
        let mut sum = 0.0;
        for target in targets {
            sum += at.distance(target);
            at = target;
            move_to(&mut table, By::Gripper, target, None);
        }
        prop_assert!((table.measures().gripper_path_metres - sum).abs() < 1e-4);
        prop_assert_eq!(table.measures().hand_path_metres, 0.0);
    }

    #[test]
    fn a_straight_move_lasts_as_long_as_a_trapezoid_of_speed(target in place()) {
        let mut table = Table::default();
        let way = target.distance(By::Gripper.rest());
        move_to(&mut table, By::Gripper, target, None);
        // Full acceleration, cruise, and braking with four fifths of it.
        let rise = 1.0 / GRIPPER.acceleration + 1.0 / (0.8 * GRIPPER.acceleration);
        let top = (2.0 * way / rise).sqrt().min(GRIPPER.speed);
        let seconds = way / top + top * rise / 2.0;
        let lasted = f64::from(table.time_ms()) / 1000.0;
        prop_assert!((lasted - seconds).abs() <= 4.0 * TICK, "{} s instead of {}", lasted, seconds);
    }
}

#[test]
fn fingers_close_only_at_rest() {
    let mut table = Table::default();
    let cup = CupId::ORANGE;
    let start = cup.start().position;
    move_to(
        &mut table,
        By::Hand,
        start + Point::new(-0.03, 0.0, 0.0),
        None,
    );
    let pass = Drive {
        motion: Motion::To(start + Point::new(0.03, 0.0, 0.0)),
        pace: 0.05,
        ..Drive::STAY
    };
    let mut refusals = Vec::new();
    while table.effector(By::Hand).position().x < 0.02 {
        table.advance(pass, Drive::STAY);
        refusals.push(table.grasp(By::Hand, cup).unwrap_err());
    }
    assert!(refusals.contains(&Refusal::Moving(By::Hand)));
    move_to(&mut table, By::Hand, start, None);
    table.grasp(By::Hand, cup).unwrap();
}

#[test]
fn a_change_of_mind_at_every_tick_is_not_an_event_at_every_tick() {
    let mut table = Table::default();
    let reach = |cup: usize| Drive {
        towards: Some(CupId::ALL[cup]),
        ..Drive::STAY
    };
    for tick in 0..2000 {
        table.advance(reach(tick % 2), Drive::STAY);
    }
    assert_eq!(table.time_ms(), 10_000);
    assert!((2..=50).contains(&table.events().len()));
    let stays = table.events().len();
    for _ in 0..2000 {
        table.advance(Drive::STAY, Drive::STAY);
        table.advance(reach(1), Drive::STAY);
    }
    assert!(table.events().len() <= stays + 1);
}

#[test]
fn a_slot_needs_its_supports() {
    let mut table = Table::default();
    let upper = SlotId::ALL[3];
    fetch(
        &mut table,
        By::Hand,
        CupId::ORANGE,
        Tower::Stable.pose(upper),
    );
    let refusal = table.release(By::Hand, upper).unwrap_err();
    assert_eq!(
        refusal,
        Refusal::Unsupported {
            slot: upper,
            missing: SlotId::ALL[0]
        }
    );
    assert!(table.stand().is_err(), "an incomplete tower is not judged");
}

#[test]
fn a_cup_is_let_go_only_in_its_slot() {
    let mut table = Table::default();
    let [middle, left, ..] = SlotId::ALL;
    assert_eq!(
        table.release(By::Hand, middle),
        Err(Refusal::NothingHeld(By::Hand))
    );
    fetch(
        &mut table,
        By::Hand,
        CupId::ORANGE,
        Tower::Stable.pose(left),
    );
    assert!(matches!(
        table.release(By::Hand, middle),
        Err(Refusal::NotInPlace { .. })
    ));
    table.release(By::Hand, left).unwrap();
}

#[test]
fn a_cup_mouth_down_does_not_go_where_one_belongs_mouth_up() {
    let mut table = Table::default();
    let [bottom, second, ..] = SlotId::ALL;
    fetch(
        &mut table,
        By::Hand,
        CupId::ALL[1],
        Tower::Unstable.pose(bottom),
    );
    table.release(By::Hand, bottom).unwrap();
    while table.effector(By::Hand).grip() != Grip::Empty {
        table.advance(Drive::STAY, Drive::STAY);
    }
    fetch(
        &mut table,
        By::Hand,
        CupId::ALL[2],
        Tower::Unstable.pose(second),
    );
    assert!(matches!(
        table.release(By::Hand, second),
        Err(Refusal::NotInPlace { .. })
    ));
}

#[test]
fn a_held_cup_cannot_be_taken() {
    let mut table = Table::default();
    let cup = CupId::ALL[2];
    let aside = Pose {
        position: Point::new(0.4, 0.0, 0.2),
        tilt: 0.0,
    };
    fetch(&mut table, By::Hand, cup, aside);
    let held = table.poses()[cup.index()].position;
    assert!(held.distance(aside.position) < 1e-9);
    move_to(&mut table, By::Gripper, cup.start().position, None);
    assert_eq!(table.grasp(By::Gripper, cup), Err(Refusal::Taken(cup)));
    assert_eq!(
        table.grasp(By::Hand, CupId::ALL[1]),
        Err(Refusal::NotEmpty(By::Hand))
    );
}

#[test]
fn the_same_target_is_one_interference_as_long_as_it_lasts() {
    let mut table = Table::default();
    let reach = |cup: usize| Drive {
        towards: Some(CupId::ALL[cup]),
        ..Drive::STAY
    };
    for _ in 0..10 {
        table.advance(reach(1), reach(1));
    }
    assert_eq!(table.measures().interferences, 1);
    table.advance(reach(1), reach(2));
    table.advance(reach(2), reach(2));
    assert_eq!(table.measures().interferences, 2);
}

#[test]
fn coming_too_close_is_an_interference() {
    let mut table = Table::default();
    let meeting = Point::new(0.0, 0.3, 0.2);
    let beside = Point::new(INTERFERENCE_DISTANCE + 0.001, 0.3, 0.2);
    move_to(&mut table, By::Hand, meeting, None);
    move_to(&mut table, By::Gripper, beside, None);
    assert_eq!(table.measures().interferences, 0);
    move_to(
        &mut table,
        By::Gripper,
        beside + Point::new(-0.002, 0.0, 0.0),
        None,
    );
    move_to(
        &mut table,
        By::Gripper,
        beside + Point::new(0.1, 0.0, 0.0),
        None,
    );
    move_to(&mut table, By::Gripper, meeting, None);
    assert_eq!(table.measures().interferences, 2);
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

#[test]
fn the_last_frame_shows_the_decided_outcome() {
    for replay in replays(0..250) {
        let timeline = replay.timeline().unwrap();
        let last = timeline.frames[timeline.frames.len() - 1];
        let still_there = |slot: &SlotId| {
            let mut cups = last.cups.iter();
            cups.any(|pose| is_in_slot(replay.tower, *slot, *pose))
        };
        let standing = SlotId::ALL.iter().filter(|slot| still_there(slot)).count();
        let last_event = timeline.events[timeline.events.len() - 1];
        match replay.outcome {
            Outcome::Stands => {
                assert_eq!(standing, CUPS, "{replay:?}");
                assert_eq!(timeline.tower, TowerState::Standing);
                assert_eq!(last_event.event, Event::TowerStands);
            }
            Outcome::Falls => {
                assert!(standing <= 2, "{replay:?}");
                assert!(matches!(timeline.tower, TowerState::Fallen { .. }));
                assert_eq!(last_event.event, Event::AtRest);
                let on_another = |pose: &Pose| pose.position.z > CUP_HEIGHT;
                assert!(!last.cups.iter().any(on_another), "{replay:?}");
                let on_table = |pose: &Pose| pose.position.x.abs() < TABLE_END;
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
