//! How a pushed tower falls: rigid bodies in the tower's vertical plane.
//!
//! The only file that knows the physics engine (rapier, built for the same results on every machine). A collapse is
//! computed at once, before it is shown.

use rapier2d::prelude::*;

use super::effector::TICK_MS;
use super::geometry::{BOTTOM_RADIUS, CUP_HEIGHT, CUPS, MOUTH_RADIUS, Point, Pose, TABLE_END};
use super::tower::{SlotId, TOWER_Y, Tower};

/// A collapse that has not come to rest by then is not used, in milliseconds.
pub const LONGEST_MS: u32 = 2500;
/// A cup has left its slot when it is farther away than this, in metres: half the radius of a cup's bottom.
const STILL_THERE: f64 = BOTTOM_RADIUS / 2.0;
/// Cups slower than this, at every point, are at rest, in m/s: a third of a millimetre between two frames.
const REST_SPEED: f32 = 0.01;
/// For so many steps.
const REST_STEPS: usize = 20;
/// Steps of the physics in one step of the engine: fewer let cups sink visibly into what they hit.
const SUBSTEPS: usize = 4;
/// Farthest point of a cup from its middle, in metres.
const EXTENT: f32 = 0.064;
/// Mass of a cup per area of its outline, in kg/m². Chosen: 27 g a cup. As all cups weigh the same, it cancels out of how
/// they move.
const DENSITY: f32 = 4.0;
/// Coefficient of friction between cups, and of cups on the table. Chosen, not measured: with it cups slide off each other,
/// and come to rest on the table soon enough for a replay.
const FRICTION: f32 = 0.35;
/// Share of the speed that a bounce keeps. Chosen, not measured: hits are seen as such, and bouncing ends soon.
const RESTITUTION: f32 = 0.15;

/// The first push that a tower gets: velocities to the right, for one cup and, layer by layer, for those above and below.
///
/// ```text
/// v(n) = speed · (1 + slope · n)    ω(n) = speed · slope / h
/// slope = above where n > 0, −below else
/// ```
///
/// n: layers above the pushed cup, negative below it; v: velocity of a cup's middle to the right in m/s; ω: its turning in
/// rad/s, clockwise as the person sees it; h: [`CUP_HEIGHT`]. So each part turns as one body. Other cups in the layer of the
/// pushed one get no push.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Push {
    /// The slot whose cup is pushed.
    pub slot: SlotId,
    /// Velocity of that cup in m/s.
    pub speed: f64,
    /// What each layer above adds to the velocity, as a share of `speed`; negative where the upper cups lag behind.
    pub above: f64,
    /// What each layer below adds, likewise; cups below −1 move the other way, and the tower buckles.
    pub below: f64,
}

impl Push {
    /// The same push, so many times as strong.
    pub fn times(self, factor: f64) -> Self {
        Self {
            speed: self.speed * factor,
            ..self
        }
    }

    /// Velocity in m/s and turning, clockwise, in rad/s of a cup this many layers above the pushed one.
    fn given_to(self, layers: f64) -> (f64, f64) {
        let slope = if layers > 0.0 {
            self.above
        } else {
            -self.below
        };
        let velocity = self.speed * (1.0 + slope * layers);
        (velocity, self.speed * slope / CUP_HEIGHT)
    }
}

/// A fall, step by step.
#[derive(Debug, Clone)]
pub struct Collapse {
    steps: Vec<[Pose; CUPS]>,
    standing: usize,
}

impl Collapse {
    /// The cups that stood in slots 0 to 4, after `step` time steps of the engine. The last step holds for ever.
    pub fn poses(&self, step: usize) -> [Pose; CUPS] {
        self.steps[step.min(self.steps.len() - 1)]
    }

    /// How many steps it has, the first being the standing tower.
    pub fn steps(&self) -> usize {
        self.steps.len()
    }

    /// How many slots hold a cup at the end, be it another one.
    pub fn standing(&self) -> usize {
        self.standing
    }
}

/// The fall of a tower after a push, or nothing if it does not fall or is not at rest within [`LONGEST_MS`].
///
/// It has fallen when no cup is left on top of another, that is with its middle higher than one cup, and when at most one
/// slot of a column and two of a pyramid still hold a cup.
pub fn collapse(tower: Tower, push: Push) -> Option<Collapse> {
    let mut world = world();
    let handles = SlotId::ALL.map(|slot| world.insert(body(tower, slot, push), cup()).0);
    let mut steps = vec![SlotId::ALL.map(|slot| tower.pose(slot))];
    let mut quiet = 0;
    while quiet < REST_STEPS {
        if steps.len() > (LONGEST_MS / TICK_MS) as usize {
            return None;
        }
        for _ in 0..SUBSTEPS {
            world.step();
        }
        let before = steps[steps.len() - 1];
        let bodies = handles.map(|handle| &world.bodies[handle]);
        let mut slot = 0;
        steps.push(bodies.map(|body| {
            let pose = pose(body, before[slot].tilt);
            slot += 1;
            pose
        }));
        let is_slow =
            |body: &RigidBody| body.linvel().length() + body.angvel().abs() * EXTENT < REST_SPEED;
        quiet = if bodies.into_iter().all(is_slow) {
            quiet + 1
        } else {
            0
        };
    }
    let last = steps[steps.len() - 1];
    let is_filled = |slot: &SlotId| last.iter().any(|pose| is_in_slot(tower, *slot, *pose));
    let standing = SlotId::ALL.iter().filter(|slot| is_filled(slot)).count();
    let may_stand = match tower {
        Tower::Unstable => 1,
        Tower::Stable => 2,
    };
    let is_down = last.iter().all(|pose| pose.position.z < CUP_HEIGHT);
    let has_fallen = is_down && standing <= may_stand;
    has_fallen.then_some(Collapse { steps, standing })
}

/// A cup with this pose fills the slot: it stands there, the right way up, however often it has turned over.
fn is_in_slot(tower: Tower, slot: SlotId, pose: Pose) -> bool {
    let meant = tower.pose(slot);
    let turned = (pose.tilt - meant.tilt).rem_euclid(360.0);
    pose.position.distance(meant.position) < STILL_THERE && turned.min(360.0 - turned) < 10.0
}

/// The table top between two walls that nobody sees, at cup scale: contacts are as exact as a tenth of a millimetre.
fn world() -> PhysicsWorld {
    let mut world = PhysicsWorld::default();
    world.integration_parameters.dt = TICK_MS as f32 / 1000.0 / SUBSTEPS as f32;
    world.integration_parameters.length_unit = 0.1;
    world.integration_parameters.num_solver_iterations = 4;
    // Stiffer than the default, which lets cups of this size sink visibly into each other when they hit.
    let stiff = SpringCoefficients::new(120.0, 2.0);
    world.integration_parameters.contact_softness = stiff;
    world.integration_parameters.static_contact_softness = stiff;
    world
        .integration_parameters
        .normalized_max_corrective_velocity = 10.0;
    let end = TABLE_END as f32;
    let wall = 0.1;
    for (x, y, half_width, half_height) in [
        (0.0, -wall, end + wall, wall),
        (-end - wall, 1.0, wall, 1.0),
        (end + wall, 1.0, wall, 1.0),
    ] {
        world.insert(
            RigidBodyBuilder::fixed().translation(Vector::new(x, y)),
            ColliderBuilder::cuboid(half_width, half_height).friction(FRICTION),
        );
    }
    world
}

fn body(tower: Tower, slot: SlotId, push: Push) -> RigidBodyBuilder {
    let pose = tower.pose(slot);
    let pushed = tower.pose(push.slot);
    let layers = (pose.position.z - pushed.position.z) / CUP_HEIGHT;
    let beside = layers.abs() < 0.5 && slot != push.slot;
    let (velocity, turning) = if beside {
        (0.0, 0.0)
    } else {
        push.given_to(layers)
    };
    RigidBodyBuilder::dynamic()
        .translation(Vector::new(pose.position.x as f32, pose.position.z as f32))
        .rotation(-(pose.tilt as f32).to_radians())
        .linvel(Vector::new(velocity as f32, 0.0))
        .angvel(-turning as f32)
        .can_sleep(false)
        .ccd_enabled(true)
}

fn cup() -> ColliderBuilder {
    let half = CUP_HEIGHT as f32 / 2.0;
    let (mouth, bottom) = (MOUTH_RADIUS as f32, BOTTOM_RADIUS as f32);
    ColliderBuilder::convex_hull(&[
        Vector::new(-mouth, -half),
        Vector::new(mouth, -half),
        Vector::new(bottom, half),
        Vector::new(-bottom, half),
    ])
    .expect("four corners of a trapezoid have a hull")
    .density(DENSITY)
    .friction(FRICTION)
    .restitution(RESTITUTION)
}

/// The pose of a body, its tilt counted on from the step before.
fn pose(body: &RigidBody, before: f64) -> Pose {
    let place = body.translation();
    let angle = -f64::from(body.rotation().angle().to_degrees());
    let turns = ((before - angle) / 360.0).round();
    Pose {
        position: Point::new(f64::from(place.x), TOWER_Y, f64::from(place.y)),
        tilt: angle + 360.0 * turns,
    }
}
