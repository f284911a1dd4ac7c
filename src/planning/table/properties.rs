//! What must hold for the engine whatever is asked of it.

use proptest::prelude::*;

use super::effector::TICK;
use super::*;

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
fn a_cup_between_moving_fingers_cannot_be_taken() {
    let mut table = Table::default();
    let cup = CupId::ORANGE;
    let [hand, gripper] = [By::Hand, By::Gripper];
    move_to(&mut table, hand, cup.start().position, None);
    move_to(&mut table, gripper, cup.start().position, None);
    table.grasp(hand, cup).unwrap();
    assert_eq!(table.grasp(gripper, cup), Err(Refusal::Taken(cup)));
    while table.effector(hand).grip() != Grip::Holding(cup) {
        table.advance(Drive::STAY, Drive::STAY);
    }
    table.put_back(hand).unwrap();
    assert_eq!(table.grasp(gripper, cup), Err(Refusal::Taken(cup)));
    while table.effector(hand).grip() != Grip::Empty {
        table.advance(Drive::STAY, Drive::STAY);
    }
    table.grasp(gripper, cup).unwrap();
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
