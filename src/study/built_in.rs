//! The studies that are compiled into the program.

/// The file name and text of each built-in study.
pub fn built_in() -> Vec<(&'static str, &'static str)> {
    vec![
        ("driving.toml", include_str!("../../studies/driving.toml")),
        ("cups.toml", include_str!("../../studies/cups.toml")),
    ]
}

/// A study file to start from: every kind of block once, with comments. Its id is `my-study`.
pub fn starter() -> &'static str {
    include_str!("../../studies/templates/starter.toml")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::Study;

    #[test]
    fn every_built_in_study_is_valid() {
        for (name, text) in built_in() {
            let study = Study::parse(name, text).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(format!("{}.toml", study.id()), name);
        }
    }
    #[test]
    fn the_file_to_start_from_is_valid_and_a_draft() {
        let study =
            Study::parse("starter.toml", starter()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(study.id().as_str(), "my-study");
        assert!(!starter().lines().any(|line| line.starts_with("open")));
    }
}
