//! A little trial, worked out by hand: the arm takes the orange cup, and the person wants the other tower.

use super::*;

fn to(target: Point, tilt: f64, towards: Option<CupId>) -> Drive {
    Drive {
        motion: Motion::To(target),
        tilt,
        towards,
        ..Drive::STAY
    }
}

/// Lets `by` follow `own` until it has arrived, while the other one follows `others`.
fn go(table: &mut Table, by: By, own: Drive, others: Drive) {
    let Motion::To(target) = own.motion else {
        panic!("{own:?} arrives nowhere");
    };
    while !table.effector(by).rests_at(target, own.tilt) {
        match by {
            By::Hand => table.advance(own, others),
            By::Gripper => table.advance(others, own),
        }
    }
}

fn wait_for_fingers(table: &mut Table, by: By) {
    while !matches!(table.effector(by).grip(), Grip::Empty | Grip::Holding(_)) {
        table.advance(Drive::STAY, Drive::STAY);
    }
}

fn take(table: &mut Table, by: By, cup: CupId, others: Drive) {
    go(table, by, to(cup.start().position, 0.0, Some(cup)), others);
    table.grasp(by, cup).unwrap();
    wait_for_fingers(table, by);
}

#[test]
fn an_arm_with_the_wrong_guess_turns_back() {
    let mut table = Table::default();
    let orange = CupId::ORANGE;
    let lifted = orange.start().position + Point::new(0.0, 0.0, 0.15);
    take(&mut table, By::Gripper, orange, Drive::STAY);
    go(&mut table, By::Gripper, to(lifted, 0.0, None), Drive::STAY);

    // The person takes another cup: the unstable tower. The arm puts its cup back and withdraws.
    let [_, left, right, far_left, far_right] = CupId::ALL;
    let hold = to(lifted, 0.0, None);
    take(&mut table, By::Hand, right, hold);
    assert!(matches!(
        table.put_back(By::Gripper),
        Err(Refusal::NotInPlace { .. })
    ));
    go(
        &mut table,
        By::Gripper,
        to(orange.start().position, 0.0, None),
        Drive::STAY,
    );
    table.put_back(By::Gripper).unwrap();
    assert_eq!(
        table.put_back(By::Gripper),
        Err(Refusal::NothingHeld(By::Gripper))
    );
    wait_for_fingers(&mut table, By::Gripper);
    assert_eq!(table.poses()[orange.index()], orange.start());
    assert_eq!(table.measures().replans, 1);
    go(
        &mut table,
        By::Gripper,
        to(By::Gripper.rest(), 0.0, None),
        Drive::STAY,
    );
    assert_eq!(table.measures().interferences, 0);

    // The person builds the column. The arm sets out for the cup that the person goes for, then for another one.
    assert_eq!(table.tower(), None);
    let arm = |cup| Drive {
        towards: Some(cup),
        ..Drive::STAY
    };
    let order = [
        (right, Drive::STAY),
        (left, arm(left)),
        (far_left, arm(far_right)),
        (orange, Drive::STAY),
        (far_right, Drive::STAY),
    ];
    for (slot, (cup, arms)) in SlotId::ALL.into_iter().zip(order) {
        if cup != right {
            take(&mut table, By::Hand, cup, arms);
        }
        let pose = Tower::Unstable.pose(slot);
        let drive = to(pose.position, pose.tilt, None);
        go(&mut table, By::Hand, drive, Drive::STAY);
        table.release(By::Hand, slot).unwrap();
        assert_eq!(table.tower(), Some(Tower::Unstable));
        wait_for_fingers(&mut table, By::Hand);
    }
    table.stand().unwrap();

    let measures = table.measures();
    assert_eq!(measures.replans, 2);
    // The same cup once; and the last way, from the far right to the top, leads past the resting gripper at 11 cm. The way
    // to that cup, from the slot below the top, passes it at 12.07 cm.
    assert_eq!(measures.interferences, 2);
    // From rest to the orange cup (0.28, 0.38, 0.15), up, down, and to rest.
    let gripper = 0.2453_f64.sqrt() + 0.15 + 0.15 + 0.2453_f64.sqrt();
    assert!((measures.gripper_path_metres - gripper).abs() < 1e-4);
    // Squares of the ways from rest to the first cup, to its slot, to the next cup, and so on.
    let squares: [f64; 10] = [
        0.0690, 0.1213, 0.1213, 0.1313, 0.1548, 0.1848, 0.1076, 0.1576, 0.2348, 0.3048,
    ];
    let hand: f64 = squares.map(f64::sqrt).iter().sum();
    assert!((measures.hand_path_metres - hand).abs() < 1e-4);
    assert_eq!(
        measures.completion_seconds,
        Some(f64::from(table.time_ms()) / 1000.0)
    );
    let arms: Vec<Event> = table
        .events()
        .iter()
        .map(|event| event.event)
        .filter(|event| match event {
            Event::ReachesFor { by, .. }
            | Event::Grasps { by, .. }
            | Event::Placed { by, .. }
            | Event::PutBack { by, .. } => *by == By::Gripper,
            Event::TowerStands | Event::TowerFalls | Event::AtRest => false,
        })
        .collect();
    let by = By::Gripper;
    assert_eq!(
        arms,
        [
            Event::ReachesFor { by, cup: orange },
            Event::Grasps { by, cup: orange },
            Event::PutBack { by, cup: orange },
            Event::ReachesFor { by, cup: left },
            Event::ReachesFor { by, cup: far_right },
        ]
    );
}
