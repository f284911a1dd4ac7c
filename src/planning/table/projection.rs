//! The one picture of the table.

use serde::Serialize;

use super::geometry::Point;

/// An oblique projection into a picture of 640 by 480 units, y down.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Projection {
    /// Where the world's origin is drawn.
    pub origin: [f64; 2],
    /// Picture units per metre to the right.
    pub x: [f64; 2],
    /// Picture units per metre away from the person.
    pub y: [f64; 2],
    /// Picture units per metre up.
    pub z: [f64; 2],
}

/// The projection of every picture of the table.
pub const PROJECTION: Projection = Projection {
    origin: [285.0, 430.0],
    x: [400.0, 0.0],
    y: [110.0, -200.0],
    z: [0.0, -400.0],
};

impl Projection {
    /// Where a point is drawn.
    pub fn picture(&self, point: Point) -> [f64; 2] {
        [0, 1].map(|axis| {
            self.origin[axis]
                + self.x[axis] * point.x
                + self.y[axis] * point.y
                + self.z[axis] * point.z
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_lies_in_the_picture() {
        for (x, y, z) in [(-0.6, 0.0, 0.0), (0.6, 0.7, 0.0), (0.0, 0.35, 0.6)] {
            let [right, down] = PROJECTION.picture(Point::new(x, y, z));
            assert!((0.0..=640.0).contains(&right) && (0.0..=480.0).contains(&down));
        }
    }
}
