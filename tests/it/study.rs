//! Study files: what they say, what is refused, and the runs drawn from them.

mod cups;
mod driving;
mod lab;
pub mod languages;
mod refused;
mod sequential;
