//! The steps of a run: showing the current one, taking an answer.

use std::sync::Arc;

use axum::{
    Json,
    extract::{Form, Path, State, rejection::FormRejection},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Redirect, Response},
};
use data_encoding::HEXLOWER;
use serde::Serialize;

use super::{
    Looking,
    arrival::read_token,
    pages::{NotePage, Outcome, PageClock, Rejected, RunLink, ThanksPage, step_page},
    withdrawal::withdrawn,
};
use crate::{
    chance::Chance,
    clock::Clock,
    jobs::Catalogue,
    store::{RunState, RunView, Store, Submission, Token, Verdict},
    study::{
        CompletionCode, Step, Study,
        step::{ClientTiming, FieldError, Fields},
    },
    web::Error,
};

/// GET `/r/TOKEN`: the page that this person is at.
pub(super) async fn current(
    _: Looking,
    State(pages): State<RunPages>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = pages.store.run(&token).await?;
    pages.page(&token, &run, Rejected::default()).await
}

/// POST `/r/TOKEN`: an answer to one step. It is on disk before this is answered.
pub(super) async fn answer(
    State(pages): State<RunPages>,
    Path(token): Path<String>,
    headers: HeaderMap,
    form: Result<Form<Fields>, FormRejection>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let Form(fields) = form.map_err(|rejection| Error::BadRequest(format!("the form could not be read: {rejection}")))?;
    let run = pages.store.run(&token).await?;
    let position = field(&fields, "step")?
        .parse()
        .map_err(|_| Error::BadRequest("field step must be the number of a step".to_owned()))?;
    let key = field(&fields, "key")?.to_owned();
    let submission = match pages.submission(&run, position, key, &fields).await? {
        Ok(submission) => submission,
        // What is wrong with a step that is closed matters to nobody.
        Err(_) if position < run.position => return Ok(receipt(&headers, &token, StatusCode::CONFLICT)),
        Err(errors) => {
            let page = pages.page(&token, &run, Rejected { fields, errors }).await?;
            return Ok((StatusCode::UNPROCESSABLE_ENTITY, page).into_response());
        }
    };
    let status = match pages.store.submit(run.run, submission).await?.verdict {
        Verdict::Conflict | Verdict::Duplicate => StatusCode::CONFLICT,
        Verdict::Answered
        | Verdict::Late
        | Verdict::TimedOut
        | Verdict::Skipped
        | Verdict::Early
        | Verdict::Retry => StatusCode::OK,
    };
    Ok(receipt(&headers, &token, status))
}

/// Where a form leads. A page's script is told the status; a plain form is always sent on, since the first answer
/// stands either way and its sender wants the next page.
fn receipt(headers: &HeaderMap, token: &Token, status: StatusCode) -> Response {
    #[derive(Serialize)]
    struct Receipt {
        next: String,
    }
    let next = format!("/r/{token}");
    let accepts = headers.get(header::ACCEPT).and_then(|accept| accept.to_str().ok());
    if accepts.is_some_and(|accept| accept.starts_with("application/json")) {
        (status, Json(Receipt { next })).into_response()
    } else {
        Redirect::to(&next).into_response()
    }
}

fn field<'a>(fields: &'a Fields, name: &str) -> Result<&'a str, Error> {
    let value = fields.get(name).filter(|value| !value.is_empty() && value.len() <= 64);
    value.map(String::as_str).ok_or_else(|| Error::BadRequest(format!("field {name} must hold 1 to 64 characters")))
}

/// What it takes to make the page of a run.
#[derive(Clone, axum::extract::FromRef)]
pub(super) struct RunPages {
    store: Store,
    catalogue: Arc<Catalogue>,
    chance: Chance,
    clock: Clock,
}

impl RunPages {
    /// What a form says, or why the step that it answers does not take it.
    async fn submission(
        &self,
        run: &RunView,
        position: u32,
        key: String,
        fields: &Fields,
    ) -> Result<Result<Submission, Vec<FieldError>>, Error> {
        let plan = self.store.step(run.run, position).await?;
        let study = self.study(run)?;
        let step = study.step(&plan).map_err(Error::internal)?;
        let consent_version = match &step {
            Step::Consent(consent) => Some(consent.version.to_owned()),
            Step::Info(_) | Step::Choice(_) | Step::Form(_) | Step::Thanks(_) => None,
        };
        Ok(step.read(fields).map(|reply| Submission {
            position,
            key,
            reply,
            timing: ClientTiming::read(fields),
            consent_version,
        }))
    }

    fn study(&self, run: &RunView) -> Result<Arc<Study>, Error> {
        self.catalogue
            .version(run.version)
            .ok_or_else(|| Error::Internal(anyhow::anyhow!("study version {} is not readable", run.version)))
    }

    /// The page of the step that is open now, with messages where its form was sent back.
    async fn page(&self, token: &Token, run: &RunView, rejected: Rejected) -> Result<Response, Error> {
        let study = self.study(run)?;
        match run.state {
            RunState::Active => self.step(token, run, &study, rejected).await,
            RunState::Completed => self.thanks(token, run, &study).await,
            RunState::Declined => Ok(declined(&study)),
            RunState::Withdrawn => Ok(withdrawn().into_response()),
        }
    }

    async fn step(&self, token: &Token, run: &RunView, study: &Study, rejected: Rejected) -> Result<Response, Error> {
        let shown = self.store.look(run).await?;
        let step = study.step(&shown.plan).map_err(Error::internal)?;
        let clock = shown.clock.map(|clock| PageClock::at(clock, self.store.clock().now()));
        let link = RunLink {
            token,
            is_owner: run.is_owner,
            position: shown.position,
            key: HEXLOWER.encode(&self.chance.bytes()[..16]),
            plan: &shown.plan,
        };
        Ok(step_page(link, step, clock, rejected))
    }

    /// The code is shown only after the stored answers were counted, and only to the link that started the run.
    async fn thanks(&self, token: &Token, run: &RunView, study: &Study) -> Result<Response, Error> {
        let completion = study.completion();
        let outcome = if run.is_owner {
            let stored = self.store.stored_count(run.run).await?;
            let code = match &completion.code {
                CompletionCode::Fixed(code) => code.clone(),
                CompletionCode::PerRun => self.store.completion_code(run.run),
            };
            Outcome::Finished { redirect: completion.redirect_url(&code), code, stored }
        } else {
            Outcome::AlreadyTaken
        };
        Ok(ThanksPage { token, completion, outcome }.into_response())
    }
}
