//! Do groups of people choose differently? A factor splits the choices by its levels, such as the sources that people
//! came from or the conditions of a study; each model is fitted to each level alone and to all of them together.
//!
//! * [`compare_levels`]: the fits of a [`FactorDesign`], and what they say on the factor;
//! * [`FactorEvidence`]: whether levels have parameters of their own, by a Bayes factor;
//! * [`Difference`]: how far a parameter of one level is above that of another.

mod difference;
mod evidence;
mod fits;
mod report;

pub use difference::Difference;
pub use evidence::{FactorEvidence, FactorVerdict};
pub use fits::{FactorDesign, FactorPart, compare_levels};
pub use report::{
    Against, Contrast, FactorLevel, FactorModelReport, FactorPartReport, FactorReport, LevelFit,
};
