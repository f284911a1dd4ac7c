//! What a trial at the table is measured by.

/// Measures of one trial. The paper compares robots in its lab study by completion time and by the gripper's path
/// (section "Collaborative cup stacking"); the others are ours.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measures {
    /// Time from the start until the last cup stood, in seconds. None while the tower is not complete.
    pub completion_seconds: Option<f64>,
    /// Length of the gripper's path in metres: the sum of the distances between its places at successive ticks.
    pub gripper_path_metres: f64,
    /// Length of the hand's path in metres, likewise.
    pub hand_path_metres: f64,
    /// How many times hand and gripper came into each other's way: were on the way to the same cup, or closer than
    /// [`INTERFERENCE_DISTANCE`](super::INTERFERENCE_DISTANCE). What lasts counts once.
    pub interferences: u32,
    /// How many times the gripper turned back: put a cup back to its start, or set out for another cup than the one that it
    /// was reaching for.
    pub replans: u32,
}
