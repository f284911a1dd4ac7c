//! What is wrong with a study file, and where.

use std::fmt;

/// A study file that is refused: which file, which line and key, what was found, and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParseError {
    pub(super) file: String,
    pub(super) line: Option<usize>,
    pub(super) key: String,
    pub(super) found: String,
    pub(super) allowed: String,
}

impl ParseError {
    /// The file's name, as it was given.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// The line, counted from 1, where the text allows to name one.
    pub fn line(&self) -> Option<usize> {
        self.line
    }

    /// The path of the key, such as `block[timed].limit_s`; empty for the file as a whole.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// What was found there.
    pub fn found(&self) -> &str {
        &self.found
    }

    /// What is allowed there.
    pub fn allowed(&self) -> &str {
        &self.allowed
    }
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        if let Some(line) = self.line {
            write!(f, ", line {line}")?;
        }
        if !self.key.is_empty() {
            write!(f, ", {}", self.key)?;
        }
        write!(f, ": found {}; allowed: {}", self.found, self.allowed)
    }
}

impl std::error::Error for ParseError {}
