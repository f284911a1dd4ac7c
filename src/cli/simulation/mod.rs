//! Simulated people, who take a study through the same pages as everybody else.

mod form;
mod page;
mod person;

pub use person::{Person, PersonError};
