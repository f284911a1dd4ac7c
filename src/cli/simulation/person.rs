//! One simulated person: reads a page, decides, sends the form.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use rand::{Rng, RngExt};
use reqwest::{Client, Response, StatusCode, header};

use super::{choice::choice, form::fill_in, page::Page};
use crate::{
    model::{ChoiceError, Parameters},
    study::{BlockId, QuestionId, Step, StepData, StepError, StepKind, StepPlan, Study},
};

/// No run has more pages; a person who meets more goes round in circles.
const MOST_PAGES: usize = 500;
/// How often a busy server is asked again before the person gives up.
const MOST_RETRIES: u32 = 20;

/// A person with a way to choose.
pub struct Person<R> {
    /// The study being taken, for the prospects behind its questions.
    pub study: Arc<Study>,
    /// How this person chooses.
    pub parameters: Parameters,
    /// The mean time spent on a page; zero for a load generator.
    pub thinking: Duration,
    /// This person's chance.
    pub rng: R,
}

/// Why a simulated person could not finish.
#[derive(Debug, thiserror::Error)]
pub enum PersonError {
    /// The connection failed.
    #[error("request: {0}")]
    Request(#[from] reqwest::Error),
    /// The server did not show the page that was asked for.
    #[error("{method} {path} was answered with {status}")]
    Status {
        /// `GET` or `POST`.
        method: &'static str,
        /// What was asked for, without its token.
        path: &'static str,
        /// The answer's status.
        status: StatusCode,
    },
    /// A page that a person could not go on from.
    #[error("the page after {0} answers asks nothing and is not the last one")]
    DeadEnd(usize),
    /// The page asks what the study does not.
    #[error("question: {0}")]
    Step(#[from] StepError),
    /// The model cannot say what the person would do.
    #[error("choice: {0}")]
    Choice(#[from] ChoiceError),
}

impl<R: Rng> Person<R> {
    /// Takes the study from its link to the last page; returns how long each page turn took, from sending a form until
    /// the next page was there.
    ///
    /// # Errors
    /// When the server does not answer as it should.
    pub async fn takes_part(
        &mut self,
        client: &Client,
        server: &str,
    ) -> Result<Vec<Duration>, PersonError> {
        let landing = format!("{server}/s/{}", self.study.id());
        let mut html = text("GET", "/s/STUDY", client.get(landing).send().await?).await?;
        let mut turns = Vec::new();
        while turns.len() < MOST_PAGES {
            let page = Page::read(&html);
            if page.is_finished {
                return Ok(turns);
            }
            let action = page
                .action
                .clone()
                .ok_or(PersonError::DeadEnd(turns.len()))?;
            self.thinks().await;
            let fields = self.fills_in(page)?;
            let sent = Instant::now();
            html = send(client, &format!("{server}{action}"), &fields).await?;
            turns.push(sent.elapsed());
        }
        Err(PersonError::DeadEnd(MOST_PAGES))
    }

    /// Exponential times: mostly short, sometimes long, so that some timed questions run out.
    async fn thinks(&mut self) {
        if !self.thinking.is_zero() {
            let share: f64 = self.rng.random();
            tokio::time::sleep(self.thinking.mul_f64(-(1.0 - share).ln())).await;
        }
    }

    fn fills_in(&mut self, page: Page) -> Result<Vec<(String, String)>, PersonError> {
        let mut fields = page.hidden;
        match page.question {
            Some((block, question)) => {
                let names: Vec<String> = page.buttons.into_iter().map(|(_, value)| value).collect();
                let action = self.chooses(block.into(), question.into(), &names)?;
                fields.push(("action".to_owned(), action));
            }
            // The first button is the one that goes on.
            None => fields.extend(page.buttons.into_iter().next()),
        }
        fields.extend(page.clauses);
        if let Some(block) = page.form {
            let asked = plan(StepKind::Form, block.into(), None);
            if let Step::Form(form) = self.study.step(&asked)? {
                fields.extend(fill_in(form.fields, &mut self.rng));
            }
        }
        Ok(fields)
    }

    fn chooses(
        &mut self,
        block: BlockId,
        question: QuestionId,
        names: &[String],
    ) -> Result<String, PersonError> {
        let asked = plan(StepKind::Choice, block, Some(question));
        let step = self.study.step(&asked)?;
        let problem = match &step {
            Step::Choice(choice) => choice.problem,
            Step::Consent(_)
            | Step::Info(_)
            | Step::Replays(_)
            | Step::Form(_)
            | Step::Thanks(_) => None,
        };
        let options = self.study.fit().options;
        Ok(choice(
            problem,
            names,
            &self.parameters,
            options,
            &mut self.rng,
        )?)
    }
}

/// A step as a page names it.
fn plan(kind: StepKind, block: BlockId, question: Option<QuestionId>) -> StepPlan {
    StepPlan {
        kind,
        block,
        question,
        limit_ms: None,
        data: StepData::default(),
    }
}

/// Sends a form until the server has taken it, as a page does that keeps its pending form.
async fn send(
    client: &Client,
    url: &str,
    fields: &[(String, String)],
) -> Result<String, PersonError> {
    let mut tries = 0;
    loop {
        let response = client.post(url).form(fields).send().await?;
        if response.status() != StatusCode::SERVICE_UNAVAILABLE || tries == MOST_RETRIES {
            return text("POST", "a form", response).await;
        }
        tries += 1;
        let seconds = response
            .headers()
            .get(header::RETRY_AFTER)
            .and_then(|value| value.to_str().ok()?.parse().ok());
        tokio::time::sleep(Duration::from_secs(seconds.unwrap_or(1))).await;
    }
}

async fn text(
    method: &'static str,
    path: &'static str,
    response: Response,
) -> Result<String, PersonError> {
    match response.status() {
        StatusCode::OK => Ok(response.text().await?),
        status => Err(PersonError::Status {
            method,
            path,
            status,
        }),
    }
}
