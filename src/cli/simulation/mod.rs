//! Simulated people, who take a study through the same pages as everybody else.

mod page;
mod person;

pub use person::{Person, PersonError};
