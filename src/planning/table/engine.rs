//! The authoritative state of the table, in fixed time steps.

use super::collapse::Collapse;
use super::effector::{By, CLOSED, Drive, Effector, Grip, OPEN, TICK, TICK_MS};
use super::geometry::{CUPS, CupId, Pose};
use super::measures::Measures;
use super::motion::{GRIPPER, HAND, Turner};
use super::tower::{SlotId, Tower};

/// Hand and gripper that are closer than this, in metres, are in each other's way.
pub const INTERFERENCE_DISTANCE: f64 = 0.12;
/// A reach for another cup is noted no sooner than this after the one before, in milliseconds: whoever changes their mind at
/// every tick adds five events a second, so that a trial's events are bounded by how long it lasts.
const REACH_MS: u32 = 200;
/// A cup is grasped or let go only where it is meant to be, within this in metres.
const PLACE_TOLERANCE: f64 = 5e-4;
/// Likewise its tilt, in degrees.
const TILT_TOLERANCE: f64 = 0.5;

/// Where a cup is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Start,
    Held(By),
    Slot(Tower, SlotId),
}

/// Something that happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// Hand or gripper set out for a cup, or, on the way, for another one.
    ReachesFor {
        /// Which of them.
        by: By,
        /// The cup.
        cup: CupId,
    },
    /// Hand or gripper has a cup.
    Grasps {
        /// Which of them.
        by: By,
        /// The cup.
        cup: CupId,
    },
    /// A cup stands in the tower and was let go.
    Placed {
        /// By whom.
        by: By,
        /// The cup.
        cup: CupId,
        /// Where it stands.
        slot: SlotId,
    },
    /// A cup stands at its start again and was let go.
    PutBack {
        /// By whom.
        by: By,
        /// The cup.
        cup: CupId,
    },
    /// The tower is complete and will not fall.
    TowerStands,
    /// The complete tower begins to fall.
    TowerFalls,
    /// All cups of the fallen tower lie or stand still.
    AtRest,
}

/// Something that happened, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimedEvent {
    /// Milliseconds since the start.
    pub at_ms: u32,
    /// What happened.
    pub event: Event,
}

/// Why a command was not carried out. The state is as before.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Its fingers are busy or around another cup.
    #[error("{0:?} cannot grasp: its fingers are not empty")]
    NotEmpty(By),
    /// It carries nothing.
    #[error("{0:?} cannot let go: it holds no cup")]
    NothingHeld(By),
    /// It has to come to rest before.
    #[error("{0:?} can neither grasp nor let go: it moves")]
    Moving(By),
    /// The cup is between somebody's fingers, or stands in the tower.
    #[error("cup {} cannot be taken: it does not stand free at its start", .0.index())]
    Taken(CupId),
    /// Too far from the place where the command could be carried out.
    #[error(
        "{by:?} is {metres:.4} m and {degrees:.1} degrees from where it would have to be, at most {PLACE_TOLERANCE} and {TILT_TOLERANCE} are allowed"
    )]
    NotInPlace {
        /// Who was asked.
        by: By,
        /// Distance in metres.
        metres: f64,
        /// Difference of the tilt in degrees.
        degrees: f64,
    },
    /// Another cup stands there.
    #[error("slot {} is filled", .0.index())]
    Filled(SlotId),
    /// A cup under this slot is missing.
    #[error("slot {} needs a cup in slot {} first", .slot.index(), .missing.index())]
    Unsupported {
        /// The slot asked for.
        slot: SlotId,
        /// The slot that is empty.
        missing: SlotId,
    },
    /// Only a complete tower that has not fallen can stand or fall.
    #[error("the tower is not complete, or has been judged before")]
    NotComplete,
}

/// A falling tower, and how far its fall has gone.
#[derive(Debug, Clone)]
struct Fall {
    collapse: Collapse,
    /// The cup that stood in each slot.
    cups: [CupId; CUPS],
    step: usize,
}

/// What became of the tower.
#[derive(Debug, Clone)]
enum Fate {
    Open,
    Stands,
    Falls(Fall),
}

/// The cup table: hand, gripper, five cups and a tower. The only authority on where they are.
///
/// ```
/// use riskaware::planning::table::{By, CupId, Drive, Motion, Table};
///
/// let mut table = Table::default();
/// let cup = CupId::ORANGE;
/// let reach = Drive { motion: Motion::To(cup.start().position), towards: Some(cup), ..Drive::STAY };
/// assert!(table.grasp(By::Hand, cup).is_err(), "the hand is not there yet");
/// while !table.effector(By::Hand).rests_at(cup.start().position, 0.0) {
///     table.advance(reach, Drive::STAY);
/// }
/// table.grasp(By::Hand, cup)?;
/// # Ok::<(), riskaware::planning::table::Refusal>(())
/// ```
///
/// Which tower is built is open until its first cup is let go: [`Tower::begun_with`].
#[derive(Debug, Clone)]
pub struct Table {
    ticks: u32,
    hand: Effector,
    gripper: Effector,
    cups: [Place; CUPS],
    placed: usize,
    fate: Fate,
    interferes: bool,
    events: Vec<TimedEvent>,
    measures: Measures,
}

impl Default for Table {
    /// All cups at their starts, hand and gripper at rest.
    fn default() -> Self {
        Self {
            ticks: 0,
            hand: Effector::new(By::Hand, HAND),
            gripper: Effector::new(By::Gripper, GRIPPER),
            cups: [Place::Start; CUPS],
            placed: 0,
            fate: Fate::Open,
            interferes: false,
            events: Vec::new(),
            measures: Measures::default(),
        }
    }
}

impl Table {
    /// Lets one tick pass.
    pub fn advance(&mut self, hand: Drive, gripper: Drive) {
        let [hand, gripper] = [hand, gripper].map(Drive::or_stay);
        self.note_reach(By::Hand, hand.towards);
        self.note_reach(By::Gripper, gripper.towards);
        self.ticks += 1;
        self.measures.hand_path_metres += self.hand.advance(&hand);
        self.measures.gripper_path_metres += self.gripper.advance(&gripper);
        self.move_fingers(By::Hand);
        self.move_fingers(By::Gripper);
        self.count_interference();
        self.fall();
    }

    /// Begins to close the fingers around a cup. They stand still until it is held.
    pub fn grasp(&mut self, by: By, cup: CupId) -> Result<(), Refusal> {
        let effector = self.effector(by);
        if effector.grip != Grip::Empty {
            return Err(Refusal::NotEmpty(by));
        }
        let others = self.effector(by.other()).grip.cup();
        if self.cups[cup.index()] != Place::Start || others == Some(cup) {
            return Err(Refusal::Taken(cup));
        }
        self.in_place(by, cup.start())?;
        self.effector_mut(by).grip = Grip::Closing(cup);
        Ok(())
    }

    /// Puts the held cup into a slot and begins to open the fingers. They stand still until they are open.
    pub fn release(&mut self, by: By, slot: SlotId) -> Result<(), Refusal> {
        let cup = self.held(by)?;
        let tower = self.tower().unwrap_or(Tower::begun_with(cup));
        if self.in_slot(slot).is_some() {
            return Err(Refusal::Filled(slot));
        }
        let supports = tower.supports(slot);
        if let Some(&missing) = supports.iter().find(|slot| self.in_slot(**slot).is_none()) {
            return Err(Refusal::Unsupported { slot, missing });
        }
        self.in_place(by, tower.pose(slot))?;
        self.put_down(by, cup, Place::Slot(tower, slot));
        Ok(())
    }

    /// Puts the held cup back to where it stood at the start, as [`Self::release`] puts one into a slot.
    pub fn put_back(&mut self, by: By) -> Result<(), Refusal> {
        let cup = self.held(by)?;
        self.in_place(by, cup.start())?;
        self.put_down(by, cup, Place::Start);
        Ok(())
    }

    /// Notes that the complete tower stands.
    pub fn stand(&mut self) -> Result<(), Refusal> {
        self.complete()?;
        self.fate = Fate::Stands;
        self.note(Event::TowerStands);
        Ok(())
    }

    /// Lets the complete tower fall: from the next tick on its cups follow `collapse`.
    pub fn topple(&mut self, collapse: Collapse) -> Result<(), Refusal> {
        let cups = self.complete()?;
        self.fate = Fate::Falls(Fall {
            collapse,
            cups,
            step: 0,
        });
        self.note(Event::TowerFalls);
        Ok(())
    }

    /// The hand or the gripper.
    pub fn effector(&self, by: By) -> &Effector {
        match by {
            By::Hand => &self.hand,
            By::Gripper => &self.gripper,
        }
    }

    /// How every cup stands, lies or is carried.
    pub fn poses(&self) -> [Pose; CUPS] {
        let mut poses = CupId::ALL.map(|cup| match self.cups[cup.index()] {
            Place::Start => cup.start(),
            Place::Held(by) => Pose {
                position: self.effector(by).position(),
                tilt: self.effector(by).tilt(),
            },
            Place::Slot(tower, slot) => tower.pose(slot),
        });
        if let Fate::Falls(fall) = &self.fate {
            for (cup, pose) in fall.cups.into_iter().zip(fall.collapse.poses(fall.step)) {
                poses[cup.index()] = pose;
            }
        }
        poses
    }

    /// The tower that was begun.
    pub fn tower(&self) -> Option<Tower> {
        self.cups.iter().find_map(|place| match place {
            Place::Start | Place::Held(_) => None,
            Place::Slot(tower, _) => Some(*tower),
        })
    }

    /// How many cups stand in the tower, let go.
    pub fn placed(&self) -> usize {
        self.placed
    }

    /// Milliseconds since the start.
    pub fn time_ms(&self) -> u32 {
        self.ticks * TICK_MS
    }

    /// What happened so far, in order.
    pub fn events(&self) -> &[TimedEvent] {
        &self.events
    }

    /// The measures so far.
    pub fn measures(&self) -> Measures {
        self.measures
    }

    /// The cup in each slot of a complete tower of which nothing was decided yet.
    fn complete(&self) -> Result<[CupId; CUPS], Refusal> {
        let Fate::Open = self.fate else {
            return Err(Refusal::NotComplete);
        };
        if self.placed() < CUPS {
            return Err(Refusal::NotComplete);
        }
        let mut cups = CupId::ALL;
        cups.sort_by_key(|cup| match self.cups[cup.index()] {
            Place::Slot(_, slot) => slot.index(),
            Place::Start | Place::Held(_) => CUPS,
        });
        Ok(cups)
    }

    fn in_slot(&self, slot: SlotId) -> Option<CupId> {
        CupId::ALL
            .into_iter()
            .find(|cup| matches!(self.cups[cup.index()], Place::Slot(_, filled) if filled == slot))
    }

    fn held(&self, by: By) -> Result<CupId, Refusal> {
        match self.effector(by).grip {
            Grip::Holding(cup) => Ok(cup),
            Grip::Empty | Grip::Closing(_) | Grip::Opening(_) => Err(Refusal::NothingHeld(by)),
        }
    }

    /// It rests where a cup between its fingers stands like this.
    fn in_place(&self, by: By, pose: Pose) -> Result<(), Refusal> {
        let effector = self.effector(by);
        if !effector.is_at_rest() {
            return Err(Refusal::Moving(by));
        }
        let metres = effector.position().distance(pose.position);
        let degrees = (effector.tilt() - pose.tilt).abs();
        if metres > PLACE_TOLERANCE || degrees > TILT_TOLERANCE {
            return Err(Refusal::NotInPlace {
                by,
                metres,
                degrees,
            });
        }
        Ok(())
    }

    fn put_down(&mut self, by: By, cup: CupId, place: Place) {
        self.cups[cup.index()] = place;
        let effector = self.effector_mut(by);
        effector.grip = Grip::Opening(cup);
        effector.turner = Turner::default();
    }

    fn effector_mut(&mut self, by: By) -> &mut Effector {
        match by {
            By::Hand => &mut self.hand,
            By::Gripper => &mut self.gripper,
        }
    }

    fn note(&mut self, event: Event) {
        self.events.push(TimedEvent {
            at_ms: self.time_ms(),
            event,
        });
    }

    fn note_reach(&mut self, by: By, towards: Option<CupId>) {
        let now = self.time_ms();
        let effector = self.effector_mut(by);
        effector.towards = towards.filter(|_| effector.grip == Grip::Empty);
        let Some(cup) = effector.towards else {
            return;
        };
        if let Some((last, at_ms)) = effector.noted
            && (cup == last || now < at_ms + REACH_MS)
        {
            return;
        }
        let former = effector.noted.replace((cup, now));
        self.measures.replans += u32::from(former.is_some() && by == By::Gripper);
        self.note(Event::ReachesFor { by, cup });
    }

    fn move_fingers(&mut self, by: By) {
        let effector = self.effector_mut(by);
        let way = effector.limits.finger_speed * TICK;
        match effector.grip {
            Grip::Empty | Grip::Holding(_) => {}
            Grip::Closing(cup) => {
                effector.opening = (effector.opening - way).max(CLOSED);
                if effector.opening == CLOSED {
                    effector.noted = None;
                    effector.grip = Grip::Holding(cup);
                    self.cups[cup.index()] = Place::Held(by);
                    self.note(Event::Grasps { by, cup });
                }
            }
            Grip::Opening(cup) => {
                effector.opening = (effector.opening + way).min(OPEN);
                if effector.opening == OPEN {
                    effector.grip = Grip::Empty;
                    self.note_put_down(by, cup);
                }
            }
        }
    }

    fn note_put_down(&mut self, by: By, cup: CupId) {
        let Place::Slot(_, slot) = self.cups[cup.index()] else {
            self.measures.replans += u32::from(by == By::Gripper);
            self.note(Event::PutBack { by, cup });
            return;
        };
        self.placed += 1;
        self.note(Event::Placed { by, cup, slot });
        if self.placed == CUPS {
            self.measures.completion_seconds = Some(f64::from(self.time_ms()) / 1000.0);
        }
    }

    fn count_interference(&mut self) {
        let distance = self.hand.position().distance(self.gripper.position());
        let same_cup = self.hand.towards.is_some() && self.hand.towards == self.gripper.towards;
        let interferes = same_cup || distance < INTERFERENCE_DISTANCE;
        if interferes && !self.interferes {
            self.measures.interferences += 1;
        }
        self.interferes = interferes;
    }

    fn fall(&mut self) {
        let Fate::Falls(fall) = &mut self.fate else {
            return;
        };
        let last = fall.collapse.steps() - 1;
        if fall.step == last {
            return;
        }
        fall.step += 1;
        if fall.step == last {
            self.note(Event::AtRest);
        }
    }
}
