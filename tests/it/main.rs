//! The integration tests, one module per feature.

mod store;
mod study;
