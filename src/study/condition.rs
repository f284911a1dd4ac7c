//! Conditions: the combinations of levels of factors that differ between people.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::{FactorId, LevelId};

/// The level ids of a condition, in factor order, joined by `/`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ConditionId(String);

impl ConditionId {
    /// The id as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl From<&str> for ConditionId {
    fn from(text: &str) -> Self {
        Self(text.to_owned())
    }
}

impl fmt::Display for ConditionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

/// What one group of people meets: a level of every factor that differs between people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Condition {
    /// Its id.
    pub id: ConditionId,
    /// Its levels, in factor order.
    pub levels: Vec<(FactorId, LevelId)>,
}

impl Condition {
    pub(super) fn new(levels: Vec<(FactorId, LevelId)>) -> Self {
        let ids: Vec<&str> = levels.iter().map(|(_, level)| level.as_str()).collect();
        Self {
            id: ConditionId(ids.join("/")),
            levels,
        }
    }

    /// Whether something with these levels belongs here: none of them is another level of a factor of the condition.
    pub(super) fn takes(&self, levels: &[(FactorId, LevelId)]) -> bool {
        self.levels.iter().all(|(factor, level)| {
            levels
                .iter()
                .all(|(other, found)| other != factor || found == level)
        })
    }
}
