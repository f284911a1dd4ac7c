//! The authoritative state of the table, in fixed time steps.

use super::collapse::Collapse;
use super::geometry::{CUPS, CupId, Point, Pose};
use super::measures::Measures;
use super::motion::{GRIPPER, HAND, Limits, Motion, Mover, Turner};
use super::tower::{SlotId, Tower};

/// Length of a time step in milliseconds.
pub const TICK_MS: u32 = 5;
/// The same in seconds.
pub(super) const TICK: f64 = TICK_MS as f64 / 1000.0;
/// Hand and gripper that are closer than this, in metres, are in each other's way.
pub const INTERFERENCE_DISTANCE: f64 = 0.12;
/// A reach for another cup is noted no sooner than this after the one before, in milliseconds: whoever changes their mind at
/// every tick adds five events a second.
const REACH_MS: u32 = 200;
/// The opening of resting fingers, in metres.
const OPEN: f64 = 0.11;
/// The opening of fingers around the middle of a cup, in metres.
const CLOSED: f64 = 0.07;
/// A cup is grasped or let go only where it is meant to be, within this in metres.
const PLACE_TOLERANCE: f64 = 5e-4;
/// Likewise its tilt, in degrees.
const TILT_TOLERANCE: f64 = 0.5;

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
    /// Opening around the cup that was just put into a slot.
    Opening(CupId, SlotId),
}

/// The hand or the gripper.
#[derive(Debug, Clone)]
pub struct Effector {
    mover: Mover,
    turner: Turner,
    opening: f64,
    grip: Grip,
    towards: Option<CupId>,
    /// The last reach that was noted since it was last empty, and when in milliseconds.
    noted: Option<(CupId, u32)>,
    limits: Limits,
}

impl Effector {
    fn new(by: By, limits: Limits) -> Self {
        Self {
            mover: Mover {
                position: by.rest(),
                velocity: Point::new(0.0, 0.0, 0.0),
            },
            turner: Turner {
                tilt: 0.0,
                rate: 0.0,
            },
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
    fn advance(&mut self, drive: &Drive) -> f64 {
        let before = self.mover.position;
        let motion = match self.grip {
            Grip::Closing(_) | Grip::Opening(..) => Motion::Stay,
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
    /// To slow down and stay.
    pub const STAY: Self = Self {
        motion: Motion::Stay,
        pace: 1.0,
        tilt: 0.0,
        towards: None,
    };

    /// Itself, or to stay where a number is not finite.
    fn or_stay(self) -> Self {
        let target = self.motion.target().unwrap_or(Point::new(0.0, 0.0, 0.0));
        let numbers = [self.pace, self.tilt, target.x, target.y, target.z];
        if numbers.into_iter().all(f64::is_finite) {
            self
        } else {
            Self::STAY
        }
    }
}

/// Where a cup is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Start,
    Held(By),
    Slot(SlotId),
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
    /// The cup is carried, or stands in the tower.
    #[error("cup {} cannot be taken: it does not stand at its start", .0.index())]
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
/// use riskaware::planning::table::{By, CupId, Drive, Motion, Table, Tower};
///
/// let mut table = Table::new(Tower::Stable);
/// let cup = CupId::ORANGE;
/// let reach = Drive { motion: Motion::To(cup.start().position), towards: Some(cup), ..Drive::STAY };
/// assert!(table.grasp(By::Hand, cup).is_err(), "the hand is not there yet");
/// while !table.effector(By::Hand).rests_at(cup.start().position, 0.0) {
///     table.advance(reach, Drive::STAY);
/// }
/// table.grasp(By::Hand, cup)?;
/// # Ok::<(), riskaware::planning::table::Refusal>(())
/// ```
#[derive(Debug, Clone)]
pub struct Table {
    tower: Tower,
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

impl Table {
    /// A table with all cups at their starts, on which `tower` is to be built.
    pub fn new(tower: Tower) -> Self {
        Self {
            tower,
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
        if self.cups[cup.index()] != Place::Start {
            return Err(Refusal::Taken(cup));
        }
        if self.effector(by.other()).grip == Grip::Closing(cup) {
            return Err(Refusal::Taken(cup));
        }
        if !effector.is_at_rest() {
            return Err(Refusal::Moving(by));
        }
        let metres = effector.position().distance(cup.start().position);
        if metres > PLACE_TOLERANCE {
            return Err(Refusal::NotInPlace {
                by,
                metres,
                degrees: 0.0,
            });
        }
        self.effector_mut(by).grip = Grip::Closing(cup);
        Ok(())
    }

    /// Puts the held cup into a slot and begins to open the fingers. They stand still until they are open.
    pub fn release(&mut self, by: By, slot: SlotId) -> Result<(), Refusal> {
        let effector = self.effector(by);
        let Grip::Holding(cup) = effector.grip else {
            return Err(Refusal::NothingHeld(by));
        };
        if self.in_slot(slot).is_some() {
            return Err(Refusal::Filled(slot));
        }
        let supports = self.tower.supports(slot);
        if let Some(&missing) = supports.iter().find(|slot| self.in_slot(**slot).is_none()) {
            return Err(Refusal::Unsupported { slot, missing });
        }
        if !effector.is_at_rest() {
            return Err(Refusal::Moving(by));
        }
        let pose = self.tower.pose(slot);
        let metres = effector.position().distance(pose.position);
        let degrees = (effector.tilt() - pose.tilt).abs();
        if metres > PLACE_TOLERANCE || degrees > TILT_TOLERANCE {
            return Err(Refusal::NotInPlace {
                by,
                metres,
                degrees,
            });
        }
        self.cups[cup.index()] = Place::Slot(slot);
        let effector = self.effector_mut(by);
        effector.grip = Grip::Opening(cup, slot);
        effector.turner = Turner {
            tilt: 0.0,
            rate: 0.0,
        };
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
            Place::Slot(slot) => self.tower.pose(slot),
        });
        if let Fate::Falls(fall) = &self.fate {
            for (cup, pose) in fall.cups.into_iter().zip(fall.collapse.poses(fall.step)) {
                poses[cup.index()] = pose;
            }
        }
        poses
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
            Place::Slot(slot) => slot.index(),
            Place::Start | Place::Held(_) => CUPS,
        });
        Ok(cups)
    }

    fn in_slot(&self, slot: SlotId) -> Option<CupId> {
        CupId::ALL
            .into_iter()
            .find(|cup| self.cups[cup.index()] == Place::Slot(slot))
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
        effector.noted = Some((cup, now));
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
            Grip::Opening(cup, slot) => {
                effector.opening = (effector.opening + way).min(OPEN);
                if effector.opening == OPEN {
                    effector.grip = Grip::Empty;
                    self.placed += 1;
                    self.note(Event::Placed { by, cup, slot });
                    if self.placed == CUPS {
                        self.measures.completion_seconds = Some(f64::from(self.time_ms()) / 1000.0);
                    }
                }
            }
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
