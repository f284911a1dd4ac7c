//! The arm: two links from a fixed shoulder to the gripper.

use super::geometry::Point;

/// The arm's shoulder, beyond the table's far edge.
pub const SHOULDER: Point = Point::new(0.05, 0.76, 0.20);

/// Length of the upper and of the lower arm in metres.
const LINK: f64 = 0.38;

/// The elbow for a gripper position: above the line from shoulder to gripper, in the vertical plane that holds both.
///
/// With links of equal length L and the gripper at distance d, the elbow stands √(L² − d²/4) over the middle of the line,
/// at a right angle to it. A gripper farther away than 2 L stretches the arm; the elbow is then the middle of the line.
/// Straight above or below the shoulder there is no such plane, and the result is NaN; a gripper's [`workspace`] ends
/// before.
///
/// [`workspace`]: super::workspace
pub fn elbow(gripper: Point) -> Point {
    let way = gripper - SHOULDER;
    let middle = SHOULDER + way * 0.5;
    let square = way.length() * way.length();
    let flat_square = way.x * way.x + way.y * way.y;
    let height = (LINK * LINK - square / 4.0).max(0.0).sqrt();
    // The upward direction made perpendicular to the line; its length is the line's share in the plane of the table.
    let up = Point::new(0.0, 0.0, 1.0) - way * (way.z / square);
    middle + up * (height / (flat_square / square).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::geometry::{CupId, workspace};
    use super::*;

    #[test]
    fn both_links_keep_their_length_within_reach() {
        for x in -5..=5 {
            for y in 2..=5 {
                for z in 1..=4 {
                    let gripper =
                        Point::new(f64::from(x) * 0.06, f64::from(y) * 0.1, f64::from(z) * 0.12);
                    let elbow = elbow(gripper);
                    assert!((elbow.distance(SHOULDER) - LINK).abs() < 1e-12);
                    assert!((elbow.distance(gripper) - LINK).abs() < 1e-12);
                    assert!(elbow.z > (SHOULDER.z + gripper.z) / 2.0);
                }
            }
        }
    }

    #[test]
    fn no_gripper_gets_above_or_below_the_shoulder() {
        assert!(workspace(SHOULDER).y < SHOULDER.y);
    }

    #[test]
    fn all_cups_are_within_reach() {
        for cup in CupId::ALL {
            assert!(cup.start().position.distance(SHOULDER) < 2.0 * LINK);
        }
    }
}
