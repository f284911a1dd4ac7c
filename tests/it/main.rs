//! Features at their boundary, one module each.

mod api;
mod app;
mod crowd;
mod fit;
mod refit;
mod results;
mod study;
