//! Features at their boundary, one module each.

mod fit;
mod fit_command;
mod predict;
mod program;
