//! Choice problems: the actions a person can choose from.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error as _};
use serde::ser::{Serialize, SerializeMap, Serializer};
use utoipa::openapi::{ArrayBuilder, ObjectBuilder};

use super::{OrderedMap, Outcome, Prospect, ProspectError};

/// One action of a choice problem.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionProspect {
    /// The action's name, such as `stop`.
    pub name: String,
    /// What may follow from it.
    pub prospect: Prospect,
}

/// Two or more named actions with their prospects, in the order of their file.
///
/// In JSON `{"ACTION":[[probability, reward],...],...}`.
#[derive(Debug, Clone, PartialEq)]
pub struct ChoiceProblem {
    actions: Vec<ActionProspect>,
}

impl ChoiceProblem {
    /// A choice problem from actions in the order in which they are shown.
    ///
    /// # Errors
    /// When there are fewer than two actions, or a name is empty or comes twice.
    pub fn new(
        actions: impl IntoIterator<Item = (String, Prospect)>,
    ) -> Result<Self, ChoiceProblemError> {
        let actions: Vec<ActionProspect> = actions
            .into_iter()
            .map(|(name, prospect)| ActionProspect { name, prospect })
            .collect();
        if actions.len() < 2 {
            return Err(ChoiceProblemError::TooFewActions {
                actions: actions.len(),
            });
        }
        for (index, action) in actions.iter().enumerate() {
            if action.name.trim().is_empty() {
                return Err(ChoiceProblemError::EmptyName {
                    position: index + 1,
                });
            }
            if actions[..index]
                .iter()
                .any(|earlier| earlier.name == action.name)
            {
                return Err(ChoiceProblemError::RepeatedName {
                    name: action.name.clone(),
                });
            }
        }
        Ok(Self { actions })
    }

    /// A choice problem from plain numbers: `[("stop", &[(1.0, -50.0)]), ...]`.
    ///
    /// # Errors
    /// When a prospect or the set of names is not valid; the error names the action.
    pub fn from_outcomes<N: Into<String>>(
        actions: impl IntoIterator<Item = (N, impl AsRef<[(f64, f64)]>)>,
    ) -> Result<Self, ChoiceProblemError> {
        let mut named = Vec::new();
        for (name, outcomes) in actions {
            let name = name.into();
            let outcomes = outcomes.as_ref().iter().copied().map(Outcome::from);
            match Prospect::new(outcomes) {
                Ok(prospect) => named.push((name, prospect)),
                Err(source) => {
                    return Err(ChoiceProblemError::Prospect {
                        action: name,
                        source,
                    });
                }
            }
        }
        Self::new(named)
    }

    /// The actions in order.
    pub fn actions(&self) -> &[ActionProspect] {
        &self.actions
    }

    /// Where the action with this name stands.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.actions.iter().position(|action| action.name == name)
    }

    /// The action names in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.actions.iter().map(|action| action.name.as_str())
    }
}

impl fmt::Display for ChoiceProblem {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, action) in self.actions.iter().enumerate() {
            let separator = if index == 0 { "" } else { "; " };
            write!(formatter, "{separator}{}:", action.name)?;
            for outcome in action.prospect.outcomes() {
                write!(formatter, " ({}, {})", outcome.probability, outcome.reward)?;
            }
        }
        Ok(())
    }
}

impl utoipa::ToSchema for ChoiceProblem {}

impl utoipa::PartialSchema for ChoiceProblem {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
        let outcome = ArrayBuilder::new()
            .description(Some("[probability, reward]"))
            .items(f64::schema())
            .min_items(Some(2))
            .max_items(Some(2));
        let prospect = ArrayBuilder::new().items(outcome).min_items(Some(1));
        ObjectBuilder::new()
            .description(Some(
                "Two or more named actions, each with its outcomes; the probabilities of an action sum to 1",
            ))
            .additional_properties(Some(prospect))
            .min_properties(Some(2))
            .into()
    }
}

impl Serialize for ChoiceProblem {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.actions.len()))?;
        for action in &self.actions {
            map.serialize_entry(&action.name, &action.prospect)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for ChoiceProblem {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Outcomes are read as plain numbers first, so that a bad prospect's error can name its action.
        let actions = OrderedMap::<Vec<(f64, f64)>>::deserialize(deserializer)?;
        Self::from_outcomes(actions.0).map_err(D::Error::custom)
    }
}

/// Why actions make no choice problem.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChoiceProblemError {
    /// There is nothing to choose.
    #[error("a choice problem needs 2 or more actions, found {actions}")]
    TooFewActions {
        /// How many there are.
        actions: usize,
    },
    /// An action has no name.
    #[error("action {position} has an empty name")]
    EmptyName {
        /// Which action, counted from 1.
        position: usize,
    },
    /// Two actions share a name.
    #[error("action `{name}` comes twice")]
    RepeatedName {
        /// The name.
        name: String,
    },
    /// An action's outcomes make no prospect.
    #[error("action `{action}`: {source}")]
    Prospect {
        /// The action's name.
        action: String,
        /// What is wrong with it.
        source: ProspectError,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_error(text: &str, expected: &str) {
        let error = serde_json::from_str::<ChoiceProblem>(text)
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }

    #[test]
    fn json_keeps_the_order_of_actions() {
        let text = r#"{"unstable":[[0.2,105.0],[0.8,0.0]],"stable":[[1.0,20.0]]}"#;
        let problem: ChoiceProblem = serde_json::from_str(text).unwrap();
        assert_eq!(problem.names().collect::<Vec<_>>(), ["unstable", "stable"]);
        assert_eq!(problem.position("stable"), Some(1));
        assert_eq!(serde_json::to_string(&problem).unwrap(), text);
    }

    #[test]
    fn errors_name_the_action_and_the_value() {
        check_error(r#"{"stop":[[1,0]]}"#, "2 or more actions, found 1");
        check_error(r#"{"stop":[[1,0]],"stop":[[1,1]]}"#, "`stop` comes twice");
        check_error(
            r#"{"stop":[[1,0]],"":[[1,1]]}"#,
            "action 2 has an empty name",
        );
        check_error(
            r#"{"stop":[[1,0]],"go":[[0.5,1]]}"#,
            "action `go`: probabilities sum to 0.5, not 1",
        );
        check_error(
            r#"{"stop":[[1,0]],"go":[]}"#,
            "action `go`: a prospect needs at least one outcome",
        );
        check_error(
            r#"{"stop":[[1,0]],"go":[[1.5,1]]}"#,
            "action `go`: probability 1.5 of outcome 1",
        );
    }
}
