//! The integration tests, one module per feature.

mod api;
mod app;
mod architecture;
mod calibrate;
mod catalogue;
mod comparison;
mod crash;
mod crowd;
mod cups;
mod evidence;
mod exports;
mod fit;
mod fit_command;
mod fit_files;
mod import;
mod predict;
mod program;
mod recover;
mod refit;
mod results;
mod results_reading;
mod simulation;
mod store;
mod study;
mod survey;
mod sweep;
