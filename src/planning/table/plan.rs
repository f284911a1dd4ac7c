//! Who takes which cup, where and how fast: the plan of a replay, drawn from its seed.

use rand::{Rng, RngExt, seq::SliceRandom};

use super::effector::By;
use super::geometry::{CUP_HEIGHT, CUPS, CupId, Point};
use super::motion::Motion;
use super::tower::{SlotId, TOWER_Y, Tower};

/// Nobody moves before, in milliseconds: time to look at the table.
const LEAD_MS: u32 = 600;
/// A carried cup stays this far above what it passes, in metres.
const CLEARANCE: f64 = 0.02;

/// One thing to do, by hand or gripper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Task {
    /// Stay where it is for some milliseconds.
    Pause(u32),
    /// Move; a carried cup is turned to `tilt` on the way.
    Move {
        /// Where to. A stop is done once it rests there, a point on the way once it is closer than `within`.
        motion: Motion,
        /// Metres.
        within: f64,
        /// Degrees.
        tilt: f64,
        /// The cup that is reached for.
        towards: Option<CupId>,
    },
    /// Grasp a cup.
    Grasp(CupId),
    /// Go to a place and wait there until so many cups are placed and the tower is free; if it is, pass by there.
    AwaitTurn {
        /// Where to wait.
        at: Point,
        /// Cups that have to stand before.
        placed: usize,
        /// Where to go then: the other has to be away from there.
        then: Point,
        /// Degrees.
        tilt: f64,
    },
    /// Put the carried cup into a slot.
    Release(SlotId),
}

/// What one of the two does, in order, and how fast.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Duties {
    pub by: By,
    pub pace: f64,
    pub tasks: Vec<Task>,
}

/// A cup's way into the tower.
#[derive(Debug, Clone, Copy)]
struct Item {
    by: By,
    cup: CupId,
    slot: SlotId,
}

/// Draws the duties of hand and gripper.
///
/// The hand places three cups, the gripper two of those that stand at the sides. The person's first cup is the orange one
/// in the stable tower and another one in the unstable tower. Slots, cups, turns, paces and pauses are random.
pub(super) fn draw(tower: Tower, rng: &mut impl Rng) -> [Duties; 2] {
    let items = items(tower, rng);
    let mut hand = Duties {
        by: By::Hand,
        pace: rng.random_range(0.86..1.0),
        tasks: vec![Task::Pause(LEAD_MS)],
    };
    // Where the hand places two cups first, the arm sets out later instead of waiting with a cup.
    let delay_ms = match items[1].by {
        By::Hand => rng.random_range(800..1200),
        By::Gripper => rng.random_range(50..400),
    };
    let mut gripper = Duties {
        by: By::Gripper,
        pace: rng.random_range(0.88..1.0),
        tasks: vec![Task::Pause(LEAD_MS + delay_ms)],
    };
    for (placed, item) in items.iter().enumerate() {
        let filled = items[..placed].iter().map(|item| item.slot);
        let tower_top = filled
            .map(|slot| tower.pose(slot).position.z + CUP_HEIGHT / 2.0)
            .fold(CUP_HEIGHT, f64::max);
        let duties = match item.by {
            By::Hand => &mut hand,
            By::Gripper => &mut gripper,
        };
        add_item(&mut duties.tasks, tower, *item, placed, tower_top);
        duties.tasks.push(Task::Pause(rng.random_range(0..120)));
    }
    for duties in [&mut hand, &mut gripper] {
        duties.tasks.push(stop(duties.by.rest(), 0.0, None));
    }
    [hand, gripper]
}

fn items(tower: Tower, rng: &mut impl Rng) -> [Item; CUPS] {
    let turns = [
        [By::Hand, By::Gripper, By::Hand, By::Gripper, By::Hand],
        [By::Hand, By::Hand, By::Gripper, By::Hand, By::Gripper],
        [By::Hand, By::Gripper, By::Hand, By::Hand, By::Gripper],
    ];
    let turns = turns[rng.random_range(0..turns.len())];
    let mut sides = CupId::ALL[1..].to_vec();
    sides.shuffle(rng);
    let mut for_hand = vec![sides[2], sides[3]];
    let orange = match tower {
        Tower::Stable => 0,
        Tower::Unstable => rng.random_range(1..=2),
    };
    for_hand.insert(orange, CupId::ORANGE);
    let mut for_hand = for_hand.into_iter();
    let mut for_gripper = sides.into_iter();
    let slots = slots(tower, rng);
    let mut place = 0;
    turns.map(|by| {
        let cups = match by {
            By::Hand => &mut for_hand,
            By::Gripper => &mut for_gripper,
        };
        let cup = cups
            .next()
            .expect("three cups for the hand, more than two for the gripper");
        let slot = slots[place];
        place += 1;
        Item { by, cup, slot }
    })
}

/// An order of the slots in which each has its supports, the middle of the pyramid first.
fn slots(tower: Tower, rng: &mut impl Rng) -> Vec<SlotId> {
    let mut order = vec![SlotId::ALL[0]];
    while order.len() < CUPS {
        let is_open = |slot: &SlotId| {
            !order.contains(slot)
                && tower
                    .supports(*slot)
                    .iter()
                    .all(|needed| order.contains(needed))
        };
        let open: Vec<SlotId> = SlotId::ALL.into_iter().filter(is_open).collect();
        order.push(open[rng.random_range(0..open.len())]);
    }
    order
}

/// Fetches a cup, carries it over everything that stands, and puts it into its slot.
fn add_item(tasks: &mut Vec<Task>, tower: Tower, item: Item, placed: usize, tower_top: f64) {
    let Item { by, cup, slot } = item;
    let start = cup.start().position;
    let end = tower.pose(slot);
    let side = if start.x < 0.0 { -1.0 } else { 1.0 };
    let tilt = end.tilt;
    let carry = (tower_top + CUP_HEIGHT / 2.0 + CLEARANCE).max(end.position.z + 0.03);
    let above = |point: Point, z: f64| Point::new(point.x, point.y, z);
    let hover = above(end.position, carry);
    match by {
        By::Hand => {
            let before = Point::new(start.x * 0.95, start.y - 0.05, 0.12);
            tasks.push(way(before, 0.07, 0.0, Some(cup)));
            tasks.push(stop(start, 0.0, Some(cup)));
            tasks.push(Task::Grasp(cup));
            tasks.push(way(above(start, carry.min(0.2)), 0.05, 0.0, None));
            tasks.push(Task::AwaitTurn {
                at: Point::new(
                    end.position.x + 0.45 * (start.x - end.position.x),
                    0.10,
                    carry,
                ),
                placed,
                then: hover,
                tilt,
            });
        }
        By::Gripper => {
            tasks.push(way(above(start, 0.17), 0.03, 0.0, Some(cup)));
            tasks.push(stop(start, 0.0, Some(cup)));
            tasks.push(Task::Grasp(cup));
            tasks.push(way(above(start, carry.min(0.25)), 0.03, 0.0, None));
            tasks.push(Task::AwaitTurn {
                at: Point::new(end.position.x + side * 0.22, TOWER_Y + 0.12, carry),
                placed,
                then: hover,
                tilt,
            });
        }
    }
    tasks.push(stop(hover, tilt, None));
    tasks.push(stop(end.position, tilt, None));
    tasks.push(Task::Release(slot));
    match by {
        By::Hand => {
            let away = Point::new(end.position.x + side * 0.05, 0.16, end.position.z + 0.02);
            tasks.push(way(away, 0.06, 0.0, None));
        }
        By::Gripper => {
            tasks.push(way(
                above(end.position, end.position.z + 0.09),
                0.02,
                0.0,
                None,
            ));
            let away = Point::new(
                end.position.x + side * 0.08,
                TOWER_Y + 0.17,
                end.position.z + 0.08,
            );
            tasks.push(way(away, 0.06, 0.0, None));
        }
    }
}

fn stop(target: Point, tilt: f64, towards: Option<CupId>) -> Task {
    Task::Move {
        motion: Motion::To(target),
        within: 0.0,
        tilt,
        towards,
    }
}

fn way(target: Point, within: f64, tilt: f64, towards: Option<CupId>) -> Task {
    Task::Move {
        motion: Motion::Through(target),
        within,
        tilt,
        towards,
    }
}
