//! The integration tests, one module per feature.

mod api;
mod app;
mod architecture;
mod catalogue;
mod comparison;
mod crash;
mod crowd;
mod fit;
mod fit_command;
mod predict;
mod program;
mod refit;
mod results;
mod simulation;
mod store;
mod study;
mod survey;
