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
    arrival::{in_language, read_token},
    framed,
    pages::{
        ChoicePage, ConsentPage, FormPage, InfoPage, NotePage, PageClock, Rejected, ReplayView,
        ReplaysPage, RunLink, scene,
    },
    withdrawal::withdrawn,
};
use crate::{
    chance::Chance,
    jobs::Catalogue,
    store::{Population, Receipt, RunState, RunView, StepView, Store, Submission, Token, Verdict},
    study::{
        Ending, Step, Study, Words,
        step::{ClientTiming, FieldError, Fields, ReplaysStep},
    },
    web::{AppState, Error, Replays, Settings, replays},
};

/// GET `/r/TOKEN`: the page that this person is at.
pub(super) async fn current(
    _: Looking,
    State(pages): State<RunPages>,
    Path(token): Path<String>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = pages.store.visit(&token).await?;
    let study = pages.study(&run)?;
    let study = in_language(&study, run.language.as_deref());
    let page = pages.page(&token, &run, study, Rejected::default()).await;
    Ok(framed(study, page))
}

/// POST `/r/TOKEN`: an answer to one step. It is on disk before this is answered.
pub(super) async fn answer(
    State(pages): State<RunPages>,
    Path(token): Path<String>,
    headers: HeaderMap,
    form: Result<Form<Fields>, FormRejection>,
) -> Result<Response, Error> {
    let token = read_token(&token)?;
    let run = pages.store.run(&token).await?;
    if matches!(run.state, RunState::Withdrawn | RunState::TimedOut) {
        return Ok(led_on(&headers, &token, StatusCode::CONFLICT, None));
    }
    let study = pages.study(&run)?;
    let study = in_language(&study, run.language.as_deref());
    let answer = match form {
        Ok(Form(fields)) => pages.take(&token, &run, study, &headers, fields).await,
        Err(rejection) => Err(unreadable(rejection)),
    };
    Ok(framed(study, answer))
}

/// What a page's script is told about the form that it sent.
#[derive(Serialize)]
struct Delivery {
    next: String,
    /// Of the first form with this key.
    #[serde(skip_serializing_if = "Option::is_none")]
    receipt: Option<StoredForm>,
}

#[derive(Serialize)]
struct StoredForm {
    event: i64,
    step: u32,
    verdict: &'static str,
    at_ms: i64,
}

/// Where a form leads. A page's script is told the status; a plain form is always sent on, since the first answer
/// stands either way and its sender wants the next page.
fn led_on(
    headers: &HeaderMap,
    token: &Token,
    status: StatusCode,
    receipt: Option<Receipt>,
) -> Response {
    let next = format!("/r/{token}");
    let accepts = headers
        .get(header::ACCEPT)
        .and_then(|accept| accept.to_str().ok());
    if accepts.is_some_and(|accept| accept.starts_with("application/json")) {
        let receipt = receipt.map(|receipt| StoredForm {
            event: receipt.event.get(),
            step: receipt.position,
            verdict: receipt.verdict.as_str(),
            at_ms: receipt.at.0,
        });
        (status, Json(Delivery { next, receipt })).into_response()
    } else {
        Redirect::to(&next).into_response()
    }
}

fn unreadable(rejection: FormRejection) -> Error {
    if rejection.status() == StatusCode::PAYLOAD_TOO_LARGE {
        return Error::TooLarge {
            allowed: super::FORM_LIMIT,
        };
    }
    Error::BadRequest(format!("the form could not be read: {rejection}"))
}

fn field<'a>(fields: &'a Fields, name: &str) -> Result<&'a str, Error> {
    let value = fields
        .get(name)
        .filter(|value| !value.is_empty() && value.len() <= 64);
    value
        .map(String::as_str)
        .ok_or_else(|| Error::BadRequest(format!("field {name} must hold 1 to 64 characters")))
}

/// What it takes to make the page of a run.
#[derive(Clone)]
pub(super) struct RunPages {
    pub(super) store: Store,
    catalogue: Arc<Catalogue>,
    chance: Chance,
    replays: Arc<Replays>,
    pub(super) settings: Arc<Settings>,
}

impl axum::extract::FromRef<AppState> for RunPages {
    fn from_ref(state: &AppState) -> Self {
        Self {
            store: state.store.clone(),
            catalogue: state.catalogue.clone(),
            chance: state.chance.clone(),
            replays: state.replays.clone(),
            settings: state.settings.clone(),
        }
    }
}

impl RunPages {
    /// Stores an answer to one step, or sends its form back.
    async fn take(
        &self,
        token: &Token,
        run: &RunView,
        study: &Study,
        headers: &HeaderMap,
        fields: Fields,
    ) -> Result<Response, Error> {
        let position = field(&fields, "step")?
            .parse()
            .map_err(|_| Error::BadRequest("field step must be the number of a step".to_owned()))?;
        let key = field(&fields, "key")?.to_owned();
        let submission = match self.submission(run, study, position, key, &fields).await? {
            Ok(submission) => submission,
            // What is wrong with a step that is closed matters to nobody.
            Err(_)
                if run
                    .step
                    .as_ref()
                    .is_none_or(|current| position < current.position) =>
            {
                return Ok(led_on(headers, token, StatusCode::CONFLICT, None));
            }
            Err(errors) => {
                // The page that carries the messages is looked at like any other: a timed question's clock starts.
                let run = self.store.visit(token).await?;
                let page = self
                    .page(token, &run, study, Rejected { fields, errors })
                    .await?;
                return Ok((StatusCode::UNPROCESSABLE_ENTITY, page).into_response());
            }
        };
        let submitted = self.store.submit_on(token, run.run, submission).await?;
        let status = match submitted.verdict {
            Verdict::Conflict | Verdict::Duplicate => StatusCode::CONFLICT,
            Verdict::Answered
            | Verdict::Late
            | Verdict::TimedOut
            | Verdict::Skipped
            | Verdict::Wrong
            | Verdict::Early
            | Verdict::Retry => StatusCode::OK,
        };
        Ok(led_on(headers, token, status, Some(submitted.receipt)))
    }

    /// What a form says, or why the step that it answers does not take it.
    async fn submission(
        &self,
        run: &RunView,
        study: &Study,
        position: u32,
        key: String,
        fields: &Fields,
    ) -> Result<Result<Submission, Vec<FieldError>>, Error> {
        let plan = self.store.step(run.run, position).await?;
        let step = study.step(&plan)?;
        let consent_version = match &step {
            Step::Consent(consent) => Some(consent.version.to_owned()),
            Step::Info(_)
            | Step::Replays(_)
            | Step::Choice(_)
            | Step::Form(_)
            | Step::Thanks(_) => None,
        };
        if let Step::Replays(shown) = &step
            && let Some(error) = self.too_early(run, position, shown, study.words()).await?
        {
            return Ok(Err(vec![error]));
        }
        Ok(step.read(fields, study.words()).map(|reply| Submission {
            position,
            key,
            assessment: step.assess(&reply),
            reply,
            timing: ClientTiming::read(fields),
            consent_version,
        }))
    }

    /// Nobody has seen all replays before as much time has passed as they last. What a page says of it is not enough;
    /// simulated people, who watch nothing, need no time.
    async fn too_early(
        &self,
        run: &RunView,
        position: u32,
        shown: &ReplaysStep<'_>,
        words: &Words,
    ) -> Result<Option<FieldError>, Error> {
        let current = run.step.as_ref().filter(|step| step.position == position);
        let Some(step) = current.filter(|_| run.population == Population::People) else {
            return Ok(None);
        };
        let lasts_ms = self.lasts_ms(shown).await?;
        let passed_ms = step.shown_at.map_or(0, |shown_at| {
            self.store.clock().now().millis_since(shown_at)
        });
        let missing_s = lasts_ms.saturating_sub(passed_ms).div_ceil(1000);
        Ok((missing_s > 0).then(|| FieldError {
            field: "viewings".to_owned(),
            message: words.viewings_early(lasts_ms.div_ceil(1000), missing_s),
        }))
    }

    /// How long the replays of a step last together, in milliseconds.
    async fn lasts_ms(&self, step: &ReplaysStep<'_>) -> Result<u64, Error> {
        let mut lasts_ms = 0;
        for named in &step.replays {
            lasts_ms += self.replays.played(&named.id).await?.duration_ms;
        }
        Ok(lasts_ms)
    }

    async fn replay_views(
        &self,
        step: &ReplaysStep<'_>,
        words: &Words,
    ) -> Result<Vec<ReplayView>, Error> {
        let mut views = Vec::with_capacity(step.replays.len());
        for named in &step.replays {
            let played = self.replays.played(&named.id).await?;
            views.push(ReplayView {
                id: named.id.clone(),
                url: replays::url(&named.id),
                description: played.description(words),
                captions: played.captions(words),
            });
        }
        Ok(views)
    }

    fn study(&self, run: &RunView) -> Result<Arc<Study>, Error> {
        self.catalogue.version(run.version).ok_or_else(|| {
            Error::Internal(anyhow::anyhow!(
                "study version {} cannot be read",
                run.version
            ))
        })
    }

    /// The page that a run is at, with messages where its form was sent back.
    async fn page(
        &self,
        token: &Token,
        run: &RunView,
        study: &Study,
        rejected: Rejected,
    ) -> Result<Response, Error> {
        let words = study.words();
        let Some(shown) = &run.step else {
            return Ok(withdrawn(words).into_response());
        };
        let step = study.step(&shown.plan)?;
        match (run.state, step) {
            (RunState::Withdrawn, _) => Ok(withdrawn(words).into_response()),
            (RunState::Declined, _) => declined(study),
            (RunState::ScreenedOut, _) => self.ended(token, run, study, Ending::ScreenedOut).await,
            (RunState::FailedCheck, _) => self.ended(token, run, study, Ending::FailedCheck).await,
            (RunState::TimedOut, _) => self.ended(token, run, study, Ending::TimedOut).await,
            (RunState::Completed, _) | (RunState::Active, Step::Thanks(_)) => {
                self.ended(token, run, study, Ending::Completed).await
            }
            (RunState::Active, Step::Consent(text)) => Ok(ConsentPage {
                run: self.link(token, run, shown, words),
                text,
                rejected,
            }
            .into_response()),
            (RunState::Active, Step::Info(text)) => Ok(InfoPage {
                run: self.link(token, run, shown, words),
                scene: scene(text.scene, words),
                text,
            }
            .into_response()),
            (RunState::Active, Step::Replays(text)) => Ok(ReplaysPage {
                run: self.link(token, run, shown, words),
                scene: scene(Some("table"), words),
                replays: self.replay_views(&text, words).await?,
                seconds: self.lasts_ms(&text).await?.div_ceil(1000),
                text,
                errors: rejected.errors,
            }
            .into_response()),
            (RunState::Active, Step::Choice(question)) => Ok(ChoicePage {
                run: self.link(token, run, shown, words),
                scene: scene(question.scene, words),
                clock: PageClock::of(shown, self.store.clock().now()),
                question,
                errors: rejected.errors,
            }
            .into_response()),
            (RunState::Active, Step::Form(text)) => {
                let link = self.link(token, run, shown, words);
                let rejected = self.answered_before(run, shown, rejected).await?;
                Ok(FormPage::new(link, text, shown.attempts, &rejected).into_response())
            }
        }
    }

    /// A form that was not sent back just now holds what a wrong attempt answered, so that nobody has to begin anew. Which
    /// answer was wrong is not told: it could be guessed by trying then.
    async fn answered_before(
        &self,
        run: &RunView,
        shown: &StepView,
        rejected: Rejected,
    ) -> Result<Rejected, Error> {
        if shown.attempts == 0 || !rejected.errors.is_empty() {
            return Ok(rejected);
        }
        let reply = self.store.last_wrong(run.run, shown.position).await?;
        Ok(Rejected {
            fields: reply.map(|reply| reply.fields()).unwrap_or_default(),
            ..rejected
        })
    }

    /// What a form needs to know of its run, with a new idempotency key.
    fn link<'a>(
        &self,
        token: &'a Token,
        run: &RunView,
        shown: &'a StepView,
        words: &'a Words,
    ) -> RunLink<'a> {
        RunLink {
            words,
            token,
            is_owner: run.is_owner,
            is_preview: run.is_preview,
            position: shown.position,
            key: HEXLOWER.encode(&self.chance.bytes()[..16]),
            plan: &shown.plan,
        }
    }
}

/// What somebody who declined is shown, then and whenever they come back: the text of the study's consent step.
fn declined(study: &Study) -> Result<Response, Error> {
    let page = study.declined_page().ok_or(Error::NotFound("run"))?;
    Ok(NotePage {
        language: study.language().to_owned(),
        title: page.title.to_owned(),
        text_html: page.text_html.to_owned(),
    }
    .into_response())
}
