//! The studies that are compiled into the program.

/// The file name and text of each built-in study.
pub fn built_in() -> Vec<(&'static str, &'static str)> {
    vec![("driving.toml", include_str!("../../studies/driving.toml"))]
}
