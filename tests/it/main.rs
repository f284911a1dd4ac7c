//! The integration tests, one module per feature.

mod api;
mod app;
mod architecture;
mod crash;
mod crowd;
mod fit;
mod predict;
mod refit;
mod results;
mod store;
mod study;
mod survey;
