//! Simulated people, who take a study through the same pages as everybody else.

//!
//! [`SimulatedGroup`] are people who only choose, without pages and without a server.

mod answers;
mod choice;
mod form;
mod page;
mod person;

pub use answers::{SimulatedAnswersError, SimulatedGroup};
pub use person::{Person, PersonError};
