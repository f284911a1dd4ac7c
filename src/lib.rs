//! riskaware

pub mod model;
pub mod study;
