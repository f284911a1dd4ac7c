//! riskaware hosts risky-choice studies and fits models of the people who answer, while they answer.
//!
//! Modules in reading order:
//!
//! * [`model`]: prospects, choice problems and the models that turn them into choice probabilities.
//! * [`inference`]: what choices say about a model's parameters: posterior, diagnostics, accuracy, curves.
//! * [`study`]: study files, the steps of a run, and the rules of time limits.
//! * [`planning`]: tables at which a person and a robot work at the same time; replays of simulated ones.
//! * [`store`]: the database, and the one writer through which answers enter it.
//! * [`export`]: a study's data as files: CSV, NDJSON, codebook, one archive of all.
//! * [`import`]: answers from elsewhere, read from files.
//! * [`jobs`]: refits, and the closing of questions whose time ran out.
//! * [`web`]: participant pages, results pages, JSON API.
//! * [`cli`]: the commands of the `riskaware` binary.
//! * [`clock`], [`chance`]: time and randomness, handed down from the binary.

pub mod chance;
pub mod cli;
pub mod clock;
pub mod export;
pub mod import;
pub mod inference;
pub mod jobs;
pub mod model;
pub mod planning;
pub mod store;
pub mod study;
pub mod web;
