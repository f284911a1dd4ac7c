//! What is wrong with a file.

use std::fmt;

/// So many faults are told; of the others only how many there are. (decision)
const MOST_TOLD: usize = 100;

/// A cell that cannot be taken.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: found `{value}`; allowed: {allowed}")]
pub struct Fault {
    /// The line in the file, from 1.
    pub line: u64,
    /// The column as the file calls it.
    pub column: String,
    /// What stands there.
    pub value: String,
    /// What could.
    pub allowed: String,
}

/// The faults of a file: all are counted, the first ones are told.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Faults {
    told: Vec<Fault>,
    untold: u64,
}

impl Faults {
    /// The first ones, in the order of the file.
    pub fn told(&self) -> &[Fault] {
        &self.told
    }

    /// How many there are.
    pub fn count(&self) -> u64 {
        self.told.len() as u64 + self.untold
    }

    pub(super) fn is_empty(&self) -> bool {
        self.told.is_empty()
    }

    pub(super) fn extend(&mut self, faults: impl IntoIterator<Item = Fault>) {
        for fault in faults {
            if self.told.len() < MOST_TOLD {
                self.told.push(fault);
            } else {
                self.untold += 1;
            }
        }
    }
}

impl From<Fault> for Faults {
    fn from(fault: Fault) -> Self {
        Self {
            told: vec![fault],
            untold: 0,
        }
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for fault in &self.told {
            write!(f, "\n  {fault}")?;
        }
        if self.untold > 0 {
            write!(f, "\n  and {} more", self.untold)?;
        }
        Ok(())
    }
}
