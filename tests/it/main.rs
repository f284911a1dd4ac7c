//! Features at their boundary, one module each.

mod fit;
