//! Placeholder until the model branch is merged.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// A choice problem.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ChoiceProblem(BTreeMap<String, Vec<(f64, f64)>>);
