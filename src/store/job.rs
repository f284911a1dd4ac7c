//! What the writer is asked to do, and the ticket on which each answer goes back.

use tokio::sync::oneshot;

use super::accounts::{AccountChange, AuditEntry};
use super::checkpoints::NewCheckpoints;
use super::comparisons::NewComparison;
use super::exclusions::ExclusionChange;
use super::fits::NewFit;
use super::import::Import;
use super::token::TokenHash;
use super::{
    Error, Population, RunId, Started, StudyState, Submission, Submitted, Token, VersionId,
};
use crate::study::{ConditionId, NotAdmitted, StepPlan, StudyId, TimeFactor, Timestamp};

/// Waits for a commit: the result is held until the transaction is on disk, and dropped if it is rolled back.
#[derive(Debug)]
pub(super) struct Ticket<T> {
    waiter: oneshot::Sender<Result<T, Error>>,
    held: Option<Result<T, Error>>,
}

impl<T> Ticket<T> {
    pub(super) fn new() -> (Self, oneshot::Receiver<Result<T, Error>>) {
        let (waiter, receiver) = oneshot::channel();
        (Self { waiter, held: None }, receiver)
    }

    /// Whether the job was carried out, and not refused.
    fn is_done(&self) -> bool {
        matches!(self.held, Some(Ok(_)))
    }

    pub(super) fn hold(&mut self, result: Result<T, Error>) {
        self.held = Some(result);
    }

    /// Tells the waiter, after the commit. A waiter that has gone away (a closed tab) is no error.
    fn deliver(self) {
        let result = self
            .held
            .unwrap_or(Err(Error::Unavailable("the job was not carried out")));
        drop(self.waiter.send(result));
    }

    fn fail(self, err: &Error) {
        drop(self.waiter.send(Err(err.clone())));
    }
}

/// A job for the writer.
#[derive(Debug)]
pub(super) enum Job {
    /// One of many: written together with its neighbours.
    Hot(Hot),
    /// A rare one: written by statements of its own, in the same transaction.
    Rare(Rare),
}

#[derive(Debug)]
pub(super) enum Hot {
    Arrive(Arrive, Ticket<()>),
    Start(Box<Start>, Ticket<Started>),
    Submit(Submit, Ticket<Submitted>),
    Show(Show, Ticket<()>),
    CloseOverdue(Timestamp, Ticket<usize>),
}

#[derive(Debug)]
pub(super) enum Rare {
    Publish(Publish, Ticket<VersionId>),
    SetState(StudyId, StudyState, Ticket<()>),
    SetEnds(StudyId, Timestamp, Ticket<u64>),
    Withdraw(RunId, Timestamp, Ticket<()>),
    Exclude(Box<ExclusionChange>, Timestamp, Ticket<()>),
    SaveFits(Vec<NewFit>, Timestamp, Ticket<Vec<super::FitId>>),
    SaveComparison(Box<NewComparison>, Timestamp, Ticket<()>),
    SaveCheckpoints(Box<NewCheckpoints>, Timestamp, Ticket<bool>),
    ForgetArrivals(Timestamp, Ticket<u64>),
    ForgetPeople(StudyId, Vec<VersionId>, Timestamp, Ticket<u64>),
    Account(Box<AccountChange>, Timestamp, Ticket<i64>),
    Import(Box<Import>, Ticket<u64>),
    /// Another job with what the log says of it once it is done.
    Recorded(Box<Rare>, AuditEntry, Timestamp),
}

#[derive(Debug)]
pub(super) struct Arrive {
    pub(super) token: TokenHash,
    pub(super) study: StudyId,
    pub(super) platform: Option<String>,
    pub(super) platform_key: Option<String>,
    pub(super) recruiting: Option<String>,
    pub(super) source: Option<String>,
    pub(super) language: Option<String>,
    pub(super) is_preview: bool,
    pub(super) refusal: Option<NotAdmitted>,
    pub(super) at: Timestamp,
}

#[derive(Debug)]
pub(super) struct Start {
    pub(super) arrival: TokenHash,
    /// The study whose button was pressed.
    pub(super) study: StudyId,
    pub(super) link: Token,
    pub(super) version: VersionId,
    pub(super) candidates: Vec<CandidateRun>,
    pub(super) quota: Option<u32>,
    pub(super) time_limit_ms: Option<i64>,
    pub(super) refusal: Option<NotAdmitted>,
    pub(super) factor: TimeFactor,
    pub(super) population: Population,
    pub(super) language: Option<String>,
    pub(super) at: Timestamp,
}

impl Start {
    /// Whether it matters who else is under way.
    pub(super) fn counts_places(&self) -> bool {
        self.quota.is_some() || self.candidates.len() > 1
    }
}

/// What a run would be in one condition.
#[derive(Debug, Clone)]
pub struct CandidateRun {
    /// The condition; none in a study without conditions.
    pub condition: Option<ConditionId>,
    /// The steps.
    pub steps: Vec<DrawnStep>,
}

/// A step as a run begins with it.
#[derive(Debug, Clone)]
pub struct DrawnStep {
    /// What was drawn.
    pub plan: StepPlan,
    /// What a choice puts before the person; none for practice questions and all other kinds of steps.
    pub asked: Option<AskedProblem>,
    /// Whether its answer enters the fits.
    pub is_fitted: bool,
    /// Whether it is stored and never counted.
    pub is_practice: bool,
}

/// A problem by its content.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
pub struct AskedProblem {
    /// The cell's id, or `block:question` outside the design.
    pub cell: String,
    /// The hash of the prospects, with the time limit where there is one.
    pub hash: String,
    /// Each action's outcomes as JSON; none where the question withholds them.
    pub prospects: Option<String>,
}

#[derive(Debug)]
pub(super) struct Submit {
    pub(super) run: RunId,
    /// The link on which it was sent, if it was on one.
    pub(super) link: Option<TokenHash>,
    pub(super) submission: Submission,
    /// The reply and what was measured, as JSON.
    pub(super) body: String,
    /// The body's SHA-256 in hexadecimal.
    pub(super) body_hash: String,
    pub(super) at: Timestamp,
}

#[derive(Debug)]
pub(super) struct Show {
    pub(super) run: RunId,
    pub(super) position: u32,
    pub(super) at: Timestamp,
}

#[derive(Debug)]
pub(super) struct Publish {
    pub(super) study: StudyId,
    pub(super) hash: String,
    pub(super) text: String,
    /// Whom it leaves out of the analysis, as JSON.
    pub(super) exclusion: Option<String>,
    pub(super) state_if_new: StudyState,
    pub(super) is_built_in: bool,
    pub(super) at: Timestamp,
}

impl Arrive {
    /// Who it is, if a recruiting platform said so.
    pub(super) fn person(&self) -> Option<(StudyId, String, String)> {
        let (platform, key) = self.platform.clone().zip(self.platform_key.clone())?;
        Some((self.study.clone(), platform, key))
    }
}

impl Job {
    pub(super) fn is_hot(&self) -> bool {
        match self {
            Self::Hot(_) => true,
            Self::Rare(_) => false,
        }
    }

    /// Tells the waiter what was held for it, after the commit.
    pub(super) fn deliver(self) {
        match self {
            Self::Hot(Hot::Arrive(_, ticket) | Hot::Show(_, ticket)) => ticket.deliver(),
            Self::Hot(Hot::Start(_, ticket)) => ticket.deliver(),
            Self::Hot(Hot::Submit(_, ticket)) => ticket.deliver(),
            Self::Hot(Hot::CloseOverdue(_, ticket)) => ticket.deliver(),
            Self::Rare(Rare::Publish(_, ticket)) => ticket.deliver(),
            Self::Rare(
                Rare::SetState(_, _, ticket)
                | Rare::Withdraw(_, _, ticket)
                | Rare::Exclude(_, _, ticket)
                | Rare::SaveComparison(_, _, ticket),
            ) => ticket.deliver(),
            Self::Rare(Rare::SaveFits(_, _, ticket)) => ticket.deliver(),
            Self::Rare(Rare::SaveCheckpoints(_, _, ticket)) => ticket.deliver(),
            Self::Rare(
                Rare::ForgetArrivals(_, ticket)
                | Rare::ForgetPeople(_, _, _, ticket)
                | Rare::SetEnds(_, _, ticket)
                | Rare::Import(_, ticket),
            ) => ticket.deliver(),
            Self::Rare(Rare::Account(_, _, ticket)) => ticket.deliver(),
            Self::Rare(Rare::Recorded(rare, ..)) => Self::Rare(*rare).deliver(),
        }
    }

    /// Tells the waiter that nothing was stored.
    pub(super) fn fail(self, err: &Error) {
        match self {
            Self::Hot(Hot::Arrive(_, ticket) | Hot::Show(_, ticket)) => ticket.fail(err),
            Self::Hot(Hot::Start(_, ticket)) => ticket.fail(err),
            Self::Hot(Hot::Submit(_, ticket)) => ticket.fail(err),
            Self::Hot(Hot::CloseOverdue(_, ticket)) => ticket.fail(err),
            Self::Rare(Rare::Publish(_, ticket)) => ticket.fail(err),
            Self::Rare(
                Rare::SetState(_, _, ticket)
                | Rare::Withdraw(_, _, ticket)
                | Rare::Exclude(_, _, ticket)
                | Rare::SaveComparison(_, _, ticket),
            ) => ticket.fail(err),
            Self::Rare(Rare::SaveFits(_, _, ticket)) => ticket.fail(err),
            Self::Rare(Rare::SaveCheckpoints(_, _, ticket)) => ticket.fail(err),
            Self::Rare(
                Rare::ForgetArrivals(_, ticket)
                | Rare::ForgetPeople(_, _, _, ticket)
                | Rare::SetEnds(_, _, ticket)
                | Rare::Import(_, ticket),
            ) => ticket.fail(err),
            Self::Rare(Rare::Account(_, _, ticket)) => ticket.fail(err),
            Self::Rare(Rare::Recorded(rare, ..)) => Self::Rare(*rare).fail(err),
        }
    }
}

impl Rare {
    /// Whether it was carried out, and not refused.
    pub(super) fn is_done(&self) -> bool {
        match self {
            Self::Publish(_, ticket) => ticket.is_done(),
            Self::SetState(_, _, ticket)
            | Self::Withdraw(_, _, ticket)
            | Self::Exclude(_, _, ticket)
            | Self::SaveComparison(_, _, ticket) => ticket.is_done(),
            Self::SaveFits(_, _, ticket) => ticket.is_done(),
            Self::SaveCheckpoints(_, _, ticket) => ticket.is_done(),
            Self::ForgetArrivals(_, ticket)
            | Self::ForgetPeople(_, _, _, ticket)
            | Self::SetEnds(_, _, ticket)
            | Self::Import(_, ticket) => ticket.is_done(),
            Self::Account(_, _, ticket) => ticket.is_done(),
            Self::Recorded(rare, ..) => rare.is_done(),
        }
    }

    /// Whether it erases what people told, which then has to leave the write-ahead log too.
    pub(super) fn erases(&self) -> bool {
        match self {
            Self::Withdraw(..) | Self::ForgetPeople(..) | Self::ForgetArrivals(..) => true,
            Self::Recorded(rare, ..) => rare.erases(),
            Self::Publish(..)
            | Self::SetState(..)
            | Self::SaveFits(..)
            | Self::SaveComparison(..)
            | Self::SaveCheckpoints(..)
            | Self::SetEnds(..)
            | Self::Exclude(..)
            | Self::Account(..)
            | Self::Import(..) => false,
        }
    }
}
