//! What a study makes of a reply: whether the run goes on.

use serde::{Deserialize, Serialize};

use super::{Reply, Step};

/// What the study makes of a checked reply. It is stored with the reply, so that the rules of a run need no study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum Assessment {
    /// The run goes on.
    #[default]
    Passes,
    /// A comprehension check was answered wrongly.
    Wrong {
        /// The attempt after which there is none left, counted from 1.
        last_attempt: u32,
        /// What follows then.
        then: AfterFailure,
    },
    /// The person is not whom the study looks for: the run ends here.
    ScreensOut,
}

/// What follows the last wrong attempt at a comprehension check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AfterFailure {
    /// The run ends.
    End,
    /// The run goes on, and that the check failed is stored with the answer.
    GoOn,
}

impl Assessment {
    /// Whether nothing hinders the run from going on.
    pub fn passes(&self) -> bool {
        *self == Self::Passes
    }
}

impl Step<'_> {
    /// What the study makes of a reply to this step.
    pub fn assess(&self, reply: &Reply) -> Assessment {
        match (self, reply) {
            (Self::Form(form), Reply::Filled { values }) => form.assess(values),
            (
                Self::Consent(_)
                | Self::Info(_)
                | Self::Replays(_)
                | Self::Choice(_)
                | Self::Form(_)
                | Self::Thanks(_),
                _,
            ) => Assessment::Passes,
        }
    }
}
