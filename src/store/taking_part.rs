//! How somebody takes part: arriving, starting, sending in forms. Each call returns once its commit is on disk.

use std::collections::BTreeMap;

use sha2::{Digest, Sha256};

use super::job::{Arrive, CandidateRun, Hot, Job, Show, Start, Submit, Ticket};
use super::rules::{self, Submission};
use super::{
    Error, EventId, Population, RunId, RunState, Store, Token, TokenHash, Verdict, VersionId, json,
};
use crate::study::{NotAdmitted, StudyId, TimeFactor, Timestamp};

/// Somebody who followed a link to a study.
#[derive(Debug, Clone, Default)]
pub struct NewArrival {
    /// The recruiting platform and the person's id there, if the link gave them.
    pub person: Option<(String, String)>,
    /// All recruiting parameters as they are to be stored; see [`Store::recruiting_id`] for hashed ones.
    pub recruiting: BTreeMap<String, String>,
    /// Where the person comes from, for tables by source.
    pub source: Option<String>,
    /// The language of the texts, where the study has several.
    pub language: Option<String>,
    /// A look at the study that is never counted, which is possible in each of its states.
    pub is_preview: bool,
    /// Why nobody new may start; who is under way may come back all the same.
    pub refusal: Option<NotAdmitted>,
}

/// How a run begins.
#[derive(Debug, Clone)]
pub struct NewRun {
    /// The study whose button was pressed; the arrival must be one of it.
    pub study: StudyId,
    /// The study version that its texts come from.
    pub version: VersionId,
    /// What it would be in each condition, see [`draw_run`](super::draw_run): it becomes the first of those whose condition has the
    /// fewest people under way or finished.
    pub candidates: Vec<CandidateRun>,
    /// How many people may be under way or finished.
    pub quota: Option<u32>,
    /// After so many milliseconds it gives its place back if it is not finished.
    pub time_limit_ms: Option<i64>,
    /// Why nobody new may start; who is under way may come back all the same.
    pub refusal: Option<NotAdmitted>,
    /// Extra time, asked for before the start.
    pub factor: TimeFactor,
    /// Real or simulated.
    pub population: Population,
    /// A language other than that of the arrival.
    pub language: Option<String>,
}

/// Where pressing the start button led.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Started {
    /// The run's link.
    pub link: Token,
    /// The run.
    pub run: RunId,
    /// How far it is: a person who has finished gets no second run.
    pub state: RunState,
    /// Whether the link may withdraw.
    pub is_owner: bool,
    /// Whether the run was there before.
    pub is_resumed: bool,
}

/// The same for the same form, however often it is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Receipt {
    /// The event that keeps the form.
    pub event: EventId,
    /// The step.
    pub position: u32,
    /// What the rules made of it.
    pub verdict: Verdict,
    /// When it was judged.
    pub at: Timestamp,
}

/// A form that is on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Submitted {
    /// The receipt of the first form with this key.
    pub receipt: Receipt,
    /// `Retry` or `Conflict` where the key was used before, else as in the receipt.
    pub verdict: Verdict,
    /// The run's state now.
    pub state: RunState,
    /// The run's current step now.
    pub position: u32,
}

impl Store {
    /// Stores that somebody followed a link to a study, under a token from the caller's generator.
    ///
    /// # Errors
    /// `NotFound` for an unknown study, `Closed` for one that takes nobody in and `NotAdmitted` where the arrival says
    /// so, except for a preview and for a person of a recruiting platform who has a run there.
    pub async fn arrive(
        &self,
        token: &Token,
        study: &StudyId,
        arrival: NewArrival,
    ) -> Result<(), Error> {
        let (platform, platform_key) = match &arrival.person {
            Some((platform, person)) => {
                let key = self.shared.secret.platform_key(study, platform, person);
                (Some(platform.clone()), Some(key))
            }
            None => (None, None),
        };
        let recruiting = (!arrival.recruiting.is_empty()).then(|| json(&arrival.recruiting));
        let arrive = Arrive {
            token: token.hash(),
            study: study.clone(),
            platform,
            platform_key,
            recruiting,
            source: arrival.source,
            language: arrival.language,
            is_preview: arrival.is_preview,
            refusal: arrival.refusal,
            at: self.now(),
        };
        self.wait_for(|ticket| Job::Hot(Hot::Arrive(arrive, ticket)))
            .await
    }

    /// Starts the run of an arrival, or finds the one that it or the same person of a recruiting platform has.
    ///
    /// # Errors
    /// `NotFound` for an unknown or expired arrival or one of another study, `Closed` where a new run would be needed and the study takes
    /// nobody in, `NotAdmitted` where `run` says so or no place is left (a preview starts in any case).
    pub async fn start(&self, arrival: &Token, run: NewRun) -> Result<Started, Error> {
        let start = Box::new(Start {
            arrival: arrival.hash(),
            study: run.study,
            link: self.shared.secret.run_token(arrival),
            version: run.version,
            candidates: run.candidates,
            quota: run.quota,
            time_limit_ms: run.time_limit_ms,
            refusal: run.refusal,
            factor: run.factor,
            population: run.population,
            language: run.language,
            at: self.now(),
        });
        self.wait_for(|ticket| Job::Hot(Hot::Start(start, ticket)))
            .await
    }

    /// Judges and stores a form. It is on disk when this returns.
    ///
    /// # Errors
    /// `NotFound` for an unknown run, `Refused` where the run's rules say no.
    pub async fn submit(&self, run: RunId, submission: Submission) -> Result<Submitted, Error> {
        self.submit_form(run, None, submission).await
    }

    /// The same for a form that was sent on a link: the one that completes the run shows the completion code.
    ///
    /// # Errors
    /// As [`Store::submit`].
    pub async fn submit_on(
        &self,
        link: &Token,
        run: RunId,
        submission: Submission,
    ) -> Result<Submitted, Error> {
        self.submit_form(run, Some(link.hash()), submission).await
    }

    async fn submit_form(
        &self,
        run: RunId,
        link: Option<TokenHash>,
        submission: Submission,
    ) -> Result<Submitted, Error> {
        if !(1..=64).contains(&submission.key.len()) {
            return Err(Error::Refused(format!(
                "the form's key has {} bytes; 1 to 64 are allowed",
                submission.key.len()
            )));
        }
        let body = json(&rules::Body::of(&submission));
        let body_hash = data_encoding::HEXLOWER.encode(&Sha256::digest(&body));
        let submit = Submit {
            run,
            link,
            submission,
            body,
            body_hash,
            at: self.now(),
        };
        self.wait_for(|ticket| Job::Hot(Hot::Submit(submit, ticket)))
            .await
    }

    /// Closes the timed questions whose time ran out with nobody there, and ends the runs that were not finished in
    /// their time, which frees their places. Returns how many. For a task that calls it every second; nothing is written where nothing is overdue.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn close_overdue(&self) -> Result<usize, Error> {
        let now = self.now();
        if !self.is_anything_overdue(now).await? {
            return Ok(0);
        }
        self.wait_for(|ticket| Job::Hot(Hot::CloseOverdue(now, ticket)))
            .await
    }

    /// Marks the current step as shown, once that is on disk.
    pub(super) async fn show(&self, run: RunId, position: u32) -> Result<(), Error> {
        let show = Show {
            run,
            position,
            at: self.now(),
        };
        self.wait_for(|ticket| Job::Hot(Hot::Show(show, ticket)))
            .await
    }

    /// Marks the current step as shown with some later commit. Where the queue is full the page goes out unmarked:
    /// of an untimed question only the server's own response time is then unknown.
    pub(super) fn show_later(&self, run: RunId, position: u32) {
        let (ticket, _) = Ticket::new();
        let show = Show {
            run,
            position,
            at: self.now(),
        };
        if let Err(err) = self.enqueue(Job::Hot(Hot::Show(show, ticket))) {
            tracing::debug!(run = run.get(), error = %err, "a page view was not stored");
        }
    }
}
