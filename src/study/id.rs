//! Names of things in a study, each kind of its own type.
//!
//! A study file's ids are checked when the file is parsed. The types themselves promise nothing about the text: an id
//! that arrives from a link or a database is looked up, and an unknown one finds nothing.

use std::borrow::Borrow;
use std::fmt;

use serde::{Deserialize, Serialize};

macro_rules! text_ids {
    ($($(#[$doc:meta])* $name:ident,)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(String);

        impl $name {
            /// The id as text.
            pub fn as_str(&self) -> &str {
                &self.0
            }
        }

        impl From<String> for $name {
            fn from(text: String) -> Self {
                Self(text)
            }
        }

        impl From<&str> for $name {
            fn from(text: &str) -> Self {
                Self(text.to_owned())
            }
        }

        impl From<$name> for String {
            fn from(id: $name) -> Self {
                id.0
            }
        }

        impl AsRef<str> for $name {
            fn as_ref(&self) -> &str {
                &self.0
            }
        }

        impl Borrow<str> for $name {
            fn borrow(&self) -> &str {
                &self.0
            }
        }

        impl PartialEq<str> for $name {
            fn eq(&self, other: &str) -> bool {
                self.0 == other
            }
        }

        impl PartialEq<&str> for $name {
            fn eq(&self, other: &&str) -> bool {
                self.0 == *other
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(&self.0)
            }
        }
    )*};
}

text_ids! {
    /// A study, such as `driving`.
    StudyId,
    /// A factor of a study's design, such as `risk`.
    FactorId,
    /// A level of a factor, such as `low`.
    LevelId,
    /// An action that a person can choose, such as `stop`.
    ActionId,
    /// A block of a study file, such as `timed`.
    BlockId,
    /// A question, unique in its block, such as `explicit-low`.
    QuestionId,
    /// A cell: level ids in factor order joined by `/`, such as `explicit/timed/low`.
    CellId,
    /// A replay of a replays block, such as `unstable-falls-7`.
    ReplayId,
    /// A fit plan, such as `risk`.
    PlanId,
    /// A part of a fit plan, such as `low` of the plan `risk`.
    PartId,
}
