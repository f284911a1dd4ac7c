//! The database: what is stored of a run, what is counted, and what survives.

mod checks;
mod commit;
mod copies;
mod evidence;
mod exclusions;
mod fits;
mod lab;
mod opening;
mod reading;
mod runs;
mod upgrade;
mod withdrawal;
