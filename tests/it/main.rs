//! The integration tests, one module per feature.

mod api;
mod app;
mod architecture;
mod building_blocks;
mod calibrate;
mod catalogue;
mod comparison;
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
mod study_command;
mod survey;
mod sweep;
