//! The integration tests, one module per feature.

mod app;
mod architecture;
mod crash;
mod fit;
mod store;
mod study;
mod survey;
