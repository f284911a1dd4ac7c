//! Ids and states as they stand in the database.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

macro_rules! row_ids {
    ($($(#[$doc:meta])* $name:ident,)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, sqlx::Type)]
        #[serde(transparent)]
        #[sqlx(transparent)]
        pub struct $name(pub(super) i64);

        impl $name {
            /// The number, for links, exports and logs.
            pub fn get(self) -> i64 {
                self.0
            }
        }

        impl From<i64> for $name {
            fn from(number: i64) -> Self {
                Self(number)
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }
    )*};
}

row_ids! {
    /// One person's run through one study. An id that arrives from outside is looked up, and may find nothing.
    RunId,
    /// A version of a study file.
    VersionId,
    /// A version of a study file as people name it: counted within its study, from 1.
    VersionNumber,
    /// A problem as it was put before people.
    ProblemId,
    /// Something that happened to a run.
    EventId,
    /// A fit of one model to one part of a plan.
    FitId,
    /// Somebody who can log in.
    AccountId,
    /// A token of the API.
    ApiTokenId,
}

/// A stored name that this program does not know: the database was written by a later version.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown {kind} `{found}`; allowed: {allowed}")]
pub struct UnknownName {
    kind: &'static str,
    found: String,
    allowed: String,
}

macro_rules! stored_names {
    ($($(#[$doc:meta])* $name:ident, $kind:literal { $($(#[$variant_doc:meta])* $variant:ident = $text:literal,)* })*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub enum $name {
            $($(#[$variant_doc])* #[serde(rename = $text)] $variant,)*
        }

        impl $name {
            /// The name under which it is stored and exported.
            pub fn as_str(self) -> &'static str {
                match self {
                    $(Self::$variant => $text,)*
                }
            }
        }

        impl utoipa::ToSchema for $name {}

        impl utoipa::PartialSchema for $name {
            fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
                utoipa::openapi::ObjectBuilder::new()
                    .schema_type(utoipa::openapi::Type::String)
                    .enum_values(Some([$($text),*]))
                    .description(Some(concat!("The ", $kind, ".")))
                    .into()
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(self.as_str())
            }
        }

        impl FromStr for $name {
            type Err = UnknownName;

            fn from_str(text: &str) -> Result<Self, UnknownName> {
                match text {
                    $($text => Ok(Self::$variant),)*
                    _ => Err(UnknownName {
                        kind: $kind,
                        found: text.to_owned(),
                        allowed: [$($text),*].join(", "),
                    }),
                }
            }
        }

        impl TryFrom<String> for $name {
            type Error = UnknownName;

            fn try_from(text: String) -> Result<Self, UnknownName> {
                text.parse()
            }
        }
    )*};
}

stored_names! {
    /// Whether a study takes people in. People who are under way may finish in each of these states.
    StudyState, "study state" {
        /// It is being prepared and takes in nobody but previews.
        Draft = "draft",
        /// It takes people in.
        Open = "open",
        /// It does not for now.
        Paused = "paused",
        /// It does not any more.
        Closed = "closed",
    }
    /// How far a run is.
    RunState, "run state" {
        /// Under way.
        Active = "active",
        /// All steps are closed.
        Completed = "completed",
        /// The person did not consent.
        Declined = "declined",
        /// An answer showed that the study is not meant for the person.
        ScreenedOut = "screened_out",
        /// A comprehension or attention check was failed for good.
        FailedCheck = "failed_check",
        /// The run was not finished within its time, and its place was given back.
        TimedOut = "timed_out",
        /// The person withdrew, and their data are erased.
        Withdrawn = "withdrawn",
    }
    /// What became of a closed step.
    AnswerStatus, "answer status" {
        /// Answered, in time where there is a limit.
        Answered = "answered",
        /// Answered after limit and grace: kept, never a choice.
        Late = "late",
        /// The time ran out without an answer.
        TimedOut = "timed_out",
        /// Passed over on purpose; so far only data from elsewhere have it.
        Skipped = "skipped",
    }
    /// What the rules made of something that was sent.
    Verdict, "verdict" {
        /// It closed the step, as answered.
        Answered = "answered",
        /// It closed the step, as late.
        Late = "late",
        /// It closed the step, as timed out.
        TimedOut = "timed_out",
        /// It closed the step, as skipped; so far only data from elsewhere have it.
        Skipped = "skipped",
        /// A comprehension check was answered wrongly and may be tried again: the step goes on.
        Wrong = "wrong",
        /// The page said that the time had run out, but it had not: the question goes on.
        Early = "early",
        /// The step was closed already; the first answer stands.
        Duplicate = "duplicate",
        /// The same form once more: answered with the first receipt.
        Retry = "retry",
        /// The same form with other content: the first one stands.
        Conflict = "conflict",
    }
    /// What an event is about.
    EventKind, "event kind" {
        /// The run began.
        Started = "started",
        /// The current step was shown for the first time.
        Shown = "shown",
        /// A form was sent.
        Submitted = "submitted",
        /// The server closed a timed question that nobody answered.
        RanOut = "ran_out",
        /// The server ended the run before its last step.
        Ended = "ended",
        /// The person withdrew: everything else about the run is gone.
        Erased = "erased",
    }
    /// What became of a fit.
    FitState, "fit state" {
        /// Its chains agree: shown as a result.
        Converged = "converged",
        /// They do not yet: shown as a state only.
        Unconverged = "unconverged",
        /// It broke off with a message.
        Failed = "failed",
    }
    /// What an account may do.
    Role, "role" {
        /// Everything, accounts and the log included.
        Admin = "admin",
        /// Results, data, and changes of studies.
        Researcher = "researcher",
        /// Results.
        Viewer = "viewer",
    }
    /// What a token of the API may be used for.
    Scope, "scope" {
        /// To read results: counts, fits, curves.
        Results = "results",
        /// To read what each person answered.
        Data = "data",
        /// To change studies.
        Manage = "manage",
    }
    /// Whether somebody was let do what they tried.
    AuditOutcome, "outcome" {
        /// They did it.
        Done = "done",
        /// They were not let.
        Refused = "refused",
    }
}

/// Real people and simulated ones, which are never added up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Population {
    /// Real people.
    People,
    /// Simulated ones.
    Simulated,
}

impl Population {
    /// Whether its runs are marked as simulated.
    pub fn is_simulated(self) -> bool {
        match self {
            Self::People => false,
            Self::Simulated => true,
        }
    }

    pub(super) fn from_flag(is_simulated: bool) -> Self {
        if is_simulated {
            Self::Simulated
        } else {
            Self::People
        }
    }
}

/// Whose answers an analysis counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AnalysisSet {
    /// Each answer from the moment when it is given.
    All,
    /// The answers of completed runs.
    Completed,
}
