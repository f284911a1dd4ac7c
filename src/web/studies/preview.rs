//! Taking a study as a participant does, without being counted.

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Form, Path, State},
    response::{IntoResponse, Redirect, Response},
};
use serde::Deserialize;

use super::{
    super::{
        Error,
        access::{Caller, Recorded},
        accounts::Who,
        assets,
    },
    Head, Parts, current,
};
use crate::{
    chance::Chance,
    store::{NewArrival, NewRun, Token, draw_run},
    study::{StudyId, TimeFactor},
};

#[derive(Template, WebTemplate)]
#[template(path = "studies/preview.html")]
pub(super) struct PreviewPage {
    head: Head,
    /// Ids of the conditions that can be chosen.
    conditions: Vec<String>,
}

/// GET `/studies/STUDY/preview`.
pub(super) async fn show(
    (State(store), State(catalogue), State(settings)): Parts,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
) -> Result<PreviewPage, Error> {
    let served = current(&catalogue, &study)?;
    Ok(PreviewPage {
        head: Head::new(&store, &settings, &caller, &served, "/preview").await?,
        conditions: served
            .conditions()
            .iter()
            .map(|condition| condition.id.to_string())
            .collect(),
    })
}

#[derive(Deserialize)]
pub(super) struct StartForm {
    condition: String,
}

/// POST `/studies/STUDY/preview/start`: a preview in a chosen condition, from its first step on.
pub(super) async fn start(
    (State(store), State(catalogue), State(settings)): Parts,
    State(chance): State<Chance>,
    Path(study): Path<StudyId>,
    Form(form): Form<StartForm>,
) -> Result<Response, Error> {
    let (version, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let candidates = draw_run(&served, &mut chance.fork())?;
    let is_chosen = |id: &str| id == form.condition;
    let candidate = candidates.into_iter().find(|candidate| {
        let condition = candidate.condition.as_ref();
        condition.is_some_and(|condition| is_chosen(condition.as_str()))
    });
    let candidate = candidate.ok_or_else(|| {
        let allowed: Vec<&str> = served
            .conditions()
            .iter()
            .map(|condition| condition.id.as_str())
            .collect();
        Error::Unprocessable(format!(
            "condition `{}` does not exist; allowed: {}",
            form.condition,
            if allowed.is_empty() {
                "none, as everybody meets the same".to_owned()
            } else {
                allowed.join(", ")
            }
        ))
    })?;
    let arrival = NewArrival {
        is_preview: true,
        ..NewArrival::default()
    };
    let token = Token::random(&mut chance.fork());
    store.arrive(&token, &study, arrival).await?;
    let run = NewRun {
        study: study.clone(),
        version,
        candidates: vec![candidate],
        quota: None,
        time_limit_ms: None,
        refusal: None,
        factor: TimeFactor::ONE,
        population: settings.population,
        language: None,
    };
    let started = store.start(&token, run).await?;
    let recorded = Recorded {
        action: None,
        detail: Some(form.condition),
    };
    let there = Redirect::to(&format!("/r/{}", started.link));
    Ok((Extension(recorded), there).into_response())
}
