//! The simulated person and arm: they carry out their duties tick by tick, as clients of the engine.

use super::effector::{By, Drive, Grip, TICK_MS};
use super::engine::{Refusal, Table};
use super::geometry::Point;
use super::motion::Motion;
use super::plan::{Duties, Task};

/// Whoever waits for the tower sets out when the other is this far from the slot, in metres, and on its way out.
const TOWER_FREE: f64 = 0.18;

/// Nobody turns towards the tower farther away than this from the place to wait, in metres: beside it a cup is still too low.
const GATE: f64 = 0.06;

/// One of the two at work.
#[derive(Debug)]
pub(super) struct Conductor {
    by: By,
    pace: f64,
    tasks: std::vec::IntoIter<Task>,
    current: Option<Task>,
    ticks_on_task: u32,
}

impl Conductor {
    pub fn new(duties: Duties) -> Self {
        let mut tasks = duties.tasks.into_iter();
        let current = tasks.next();
        Self {
            by: duties.by,
            pace: duties.pace,
            tasks,
            current,
            ticks_on_task: 0,
        }
    }

    /// What to do in the next tick. Grasping and letting go happen here.
    pub fn drive(&mut self, table: &mut Table) -> Result<Drive, Refusal> {
        while let Some(task) = self.current {
            if !self.is_done(task, table) {
                let drive = self.work_on(task, table)?;
                self.ticks_on_task += 1;
                return Ok(drive);
            }
            self.current = self.tasks.next();
            self.ticks_on_task = 0;
        }
        Ok(Drive::STAY)
    }

    /// Drops everything and goes to `place` at full pace.
    pub fn draw_back(&mut self, place: Point) {
        self.pace = 1.0;
        self.tasks = Vec::new().into_iter();
        self.current = Some(Task::Move {
            motion: Motion::To(place),
            within: 0.0,
            tilt: 0.0,
            towards: None,
        });
        self.ticks_on_task = 0;
    }

    fn is_done(&self, task: Task, table: &Table) -> bool {
        let own = table.effector(self.by);
        match task {
            Task::Pause(ms) => self.ticks_on_task * TICK_MS >= ms,
            Task::Move {
                motion,
                within,
                tilt,
                ..
            } => match motion {
                Motion::Stay => true,
                Motion::To(target) => own.rests_at(target, tilt),
                Motion::Through(target) => own.position().distance(target) < within,
            },
            Task::Grasp(cup) => own.grip() == Grip::Holding(cup),
            Task::AwaitTurn {
                at, placed, then, ..
            } => {
                let other = table.effector(self.by.other());
                own.position().distance(at) < GATE
                    && table.placed() >= placed
                    && (placed == 0 || other.position().distance(then) > TOWER_FREE)
            }
            Task::Release(_) => self.ticks_on_task > 0 && own.grip() == Grip::Empty,
        }
    }

    fn work_on(&self, task: Task, table: &mut Table) -> Result<Drive, Refusal> {
        let begins = self.ticks_on_task == 0;
        let drive = Drive {
            pace: self.pace,
            ..Drive::STAY
        };
        Ok(match task {
            Task::Pause(_) => drive,
            Task::Move {
                motion,
                tilt,
                towards,
                ..
            } => Drive {
                motion,
                tilt,
                towards,
                ..drive
            },
            Task::Grasp(cup) => {
                if begins {
                    table.grasp(self.by, cup)?;
                }
                drive
            }
            Task::AwaitTurn { at, tilt, .. } => Drive {
                motion: Motion::To(at),
                tilt,
                ..drive
            },
            Task::Release(slot) => {
                if begins {
                    table.release(self.by, slot)?;
                }
                drive
            }
        })
    }
}
