//! The two towers: where each cup stands, and which cups must stand before it.

use serde::{Deserialize, Serialize};

use super::geometry::{CUP_HEIGHT, CUPS, CupId, Point, Pose};

/// Towers stand in the vertical plane at this y, in metres.
pub const TOWER_Y: f64 = 0.35;

/// Distance between neighbours in a layer of the pyramid, in metres: mouths of 8 cm and 6 mm of air.
const SPACING: f64 = 0.086;

/// What is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tower {
    /// A pyramid: three cups mouth down on the table, two mouth down across the gaps.
    Stable,
    /// A column of five cups, alternately mouth down and mouth up, so that narrow stands on narrow and wide on wide.
    Unstable,
}

/// A place for a cup in a tower.
///
/// Stable: 0 in the middle, 1 to its left, 2 to its right, 3 over 0 and 1, 4 over 0 and 2. Unstable: from the table up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SlotId(usize);

impl SlotId {
    /// The slots of either tower.
    pub const ALL: [Self; CUPS] = [Self(0), Self(1), Self(2), Self(3), Self(4)];

    /// Its place in [`Self::ALL`].
    pub fn index(self) -> usize {
        self.0
    }
}

impl Tower {
    /// The tower that begins with this cup: the orange one begins the stable tower, any other one the unstable tower.
    pub fn begun_with(cup: CupId) -> Self {
        if cup == CupId::ORANGE {
            Self::Stable
        } else {
            Self::Unstable
        }
    }

    /// The name used in study files and addresses.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Stable => "stable",
            Self::Unstable => "unstable",
        }
    }

    /// How the cup in `slot` stands.
    pub fn pose(self, slot: SlotId) -> Pose {
        let ground = CUP_HEIGHT / 2.0;
        let (x, z, tilt) = match self {
            Self::Stable => {
                let (x, layer) =
                    [(0.0, 0.0), (-1.0, 0.0), (1.0, 0.0), (-0.5, 1.0), (0.5, 1.0)][slot.0];
                (x * SPACING, ground + layer * CUP_HEIGHT, 0.0)
            }
            Self::Unstable => {
                let height = [0.0, 1.0, 2.0, 3.0, 4.0][slot.0] * CUP_HEIGHT;
                let tilt = if slot.0.is_multiple_of(2) { 0.0 } else { 180.0 };
                (0.0, ground + height, tilt)
            }
        };
        Pose {
            position: Point::new(x, TOWER_Y, z),
            tilt,
        }
    }

    /// The slots that must be filled before `slot`.
    pub fn supports(self, slot: SlotId) -> &'static [SlotId] {
        match self {
            Self::Stable => [
                [].as_slice(),
                &[],
                &[],
                &[SlotId(0), SlotId(1)],
                &[SlotId(0), SlotId(2)],
            ][slot.0],
            Self::Unstable => [
                [].as_slice(),
                &[SlotId(0)],
                &[SlotId(1)],
                &[SlotId(2)],
                &[SlotId(3)],
            ][slot.0],
        }
    }
}
