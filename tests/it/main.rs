//! The integration tests, one module per feature.

mod accounts;
mod api;
mod app;
mod architecture;
mod calibrate;
mod catalogue;
mod comparison;
mod conditions;
mod crash;
mod crowd;
mod cups;
mod evidence;
mod fit;
mod fit_command;
mod fit_files;
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
