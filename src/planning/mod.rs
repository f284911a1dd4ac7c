//! Tables at which a person and a robot work at the same time.
//!
//! * [`table`]: five cups, a hand, an arm and a tower; replays of simulated people.
//!
//! Source: Kwon, Biyik, Talati, Bhasin, Losey & Sadigh, *When Humans Aren't Optimal* (HRI 2020), section "Collaborative
//! cup stacking". Sizes, speeds and the way of falling are ours.

pub mod table;
