//! From a study's link to the start of a run.

use std::{collections::BTreeMap, sync::Arc};

use axum::{
    extract::{Path, Query, State},
    http::HeaderMap,
    response::{IntoResponse, Redirect, Response},
};

use super::{
    Looking, device, framed,
    pages::{Door, LandingPage},
    recruiting,
};
use crate::{
    chance::Chance,
    jobs::Catalogue,
    store::{NewArrival, NewRun, Store, StudyState, Token, draw_run},
    study::{LinkParameter, NotAdmitted, Study, StudyId, TimeFactor},
    web::{Error, Settings},
};

/// GET `/s/STUDY?…`: notes the arrival and leads to an address without the recruiting ids.
///
/// Nothing is drawn and no place is taken yet, so that whatever only previews links uses nothing up.
pub(super) async fn arrive(
    _: Looking,
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    State(chance): State<Chance>,
    Path(study): Path<StudyId>,
    headers: HeaderMap,
    Query(query): Query<BTreeMap<String, String>>,
) -> Result<Response, Error> {
    let (_, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let refusal = refusal(&store, &served, &headers);
    let answer = match recruiting::read(&query, &served.recruiting().mturk) {
        Err(refused) => Err(refused),
        Ok(arrival) if recruiting::is_look(&arrival) => {
            let page = look(&store, &served, refusal).await;
            page.map(IntoResponse::into_response)
        }
        Ok(arrival) => {
            let arrival = NewArrival { refusal, ..arrival };
            let token = Token::random(&mut chance.fork());
            let noted = note(&store, &served, &token, arrival).await;
            noted.map(IntoResponse::into_response)
        }
    };
    Ok(framed(&served, answer))
}

/// Stores an arrival, and leads on.
async fn note(
    store: &Store,
    study: &Study,
    token: &Token,
    mut arrival: NewArrival,
) -> Result<Redirect, Error> {
    let (id, ids) = (study.id(), study.recruiting().ids);
    for parameter in LinkParameter::ALL {
        let value = arrival.recruiting.get_mut(parameter.name());
        if let Some(value) = value.filter(|_| !parameter.is_plain(ids)) {
            *value = store.recruiting_id(id, parameter.name(), value);
        }
    }
    store.arrive(token, id, arrival).await?;
    Ok(Redirect::to(&format!("/s/{id}/a/{token}")))
}

/// What somebody is shown who looks at the task on MTurk and has not accepted it. Nothing is stored of it.
async fn look(
    store: &Store,
    study: &Study,
    refusal: Option<NotAdmitted>,
) -> Result<LandingPage, Error> {
    let studies = store.studies().await?;
    let state = studies.iter().find(|row| row.id == *study.id());
    if state.is_none_or(|row| row.state != StudyState::Open) {
        return Err(Error::Closed(format!(
            "study {} takes nobody in at the moment",
            study.id()
        )));
    }
    if let Some(reason) = refusal {
        return Err(Error::Closed(reason.to_string()));
    }
    Ok(LandingPage::of(study, Door::AcceptFirst))
}

/// POST `/studies/STUDY/preview`: the study as a participant meets it, in any of its states, without counting.
pub(super) async fn preview(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    State(chance): State<Chance>,
    Path(study): Path<StudyId>,
) -> Result<Redirect, Error> {
    catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let arrival = NewArrival {
        is_preview: true,
        ..NewArrival::default()
    };
    let token = Token::random(&mut chance.fork());
    store.arrive(&token, &study, arrival).await?;
    Ok(Redirect::to(&format!("/s/{study}/a/{token}")))
}

/// GET `/s/STUDY/a/TOKEN`: what the study is, and the button that starts it.
pub(super) async fn landing(
    _: Looking,
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    Path((study, token)): Path<(StudyId, String)>,
) -> Result<Response, Error> {
    let (_, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let page = landed(&store, &served, &token).await;
    Ok(framed(&served, page))
}

async fn landed(store: &Store, study: &Study, token: &str) -> Result<LandingPage, Error> {
    let token = read_token(token)?;
    let arrival = store.arrival(&token).await?;
    if arrival.study != *study.id() {
        return Err(Error::NotFound("link"));
    }
    let door = Door::Start {
        token,
        is_preview: arrival.is_preview,
    };
    Ok(LandingPage::of(study, door))
}

/// POST `/s/STUDY/a/TOKEN`: starts the run, or leads back to the one that this person has.
pub(super) async fn start(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    State(chance): State<Chance>,
    State(settings): State<Arc<Settings>>,
    Path((study, token)): Path<(StudyId, String)>,
    headers: HeaderMap,
) -> Result<Response, Error> {
    let arrival = read_token(&token)?;
    let (version, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let run = NewRun {
        study: study.clone(),
        version,
        candidates: draw_run(&served, &mut chance.fork())?,
        quota: served.recruiting().quota,
        time_limit_ms: served.recruiting().time_limit_ms,
        refusal: refusal(&store, &served, &headers),
        factor: TimeFactor::ONE,
        population: settings.population,
        is_preview: false,
    };
    let started = store.start(&arrival, run).await;
    let led_on = started
        .map(|started| Redirect::to(&format!("/r/{}", started.link)))
        .map_err(Error::from);
    Ok(framed(&served, led_on))
}

/// Why nobody new may start with this browser at this moment.
fn refusal(store: &Store, study: &Study, headers: &HeaderMap) -> Option<NotAdmitted> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let device = device::guess(text("sec-ch-ua-mobile"), text("user-agent"));
    study.recruiting().admit(store.clock().now(), device).err()
}

/// A text that is no token opens nothing, just as an unknown one.
pub(super) fn read_token(text: &str) -> Result<Token, Error> {
    text.parse().map_err(|_| Error::NotFound("link"))
}
