//! From a study's link to the start of a run.

use std::{collections::BTreeMap, sync::Arc};

use axum::{
    extract::{Path, Query, State},
    http::{HeaderMap, StatusCode},
    response::{IntoResponse, Redirect, Response},
};

use super::{
    Looking, device, framed, language,
    pages::{Door, LandingPage, NotePage},
    recruiting, trouble,
};
use crate::{
    chance::Chance,
    jobs::Catalogue,
    store::{self, NewArrival, NewRun, Store, StudyState, Token, draw_run},
    study::{LinkParameter, NotAdmitted, Study, StudyId, TimeFactor, Words},
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
    let language = language::choose(served.languages(), asked_for(&query), &headers);
    let shown = in_language(&served, language.as_deref());
    let words = shown.words();
    let answer = match recruiting::read(&query, &served.recruiting().mturk) {
        Err(refused) => Ok(trouble::bad_link(&refused, words)),
        Ok(arrival) if recruiting::is_look(&arrival) => {
            let page = look(&store, &served, language.as_deref(), refusal).await;
            page.map(IntoResponse::into_response)
                .or_else(|error| not_now(error, words))
        }
        Ok(arrival) => {
            let arrival = NewArrival {
                refusal,
                language,
                ..arrival
            };
            let token = Token::random(&mut chance.fork());
            let noted = note(&store, &served, &token, arrival).await;
            noted
                .map(IntoResponse::into_response)
                .or_else(|error| not_now(error, words))
        }
    };
    Ok(framed(shown, answer))
}

/// Stores an arrival, and leads on.
async fn note(
    store: &Store,
    study: &Study,
    token: &Token,
    mut arrival: NewArrival,
) -> Result<Redirect, store::Error> {
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
    language: Option<&str>,
    refusal: Option<NotAdmitted>,
) -> Result<LandingPage, store::Error> {
    let studies = store.studies().await?;
    let state = studies.iter().find(|row| row.id == *study.id());
    if state.is_none_or(|row| row.state != StudyState::Open) {
        return Err(store::Error::Closed {
            study: study.id().to_string(),
            state: state.map_or(StudyState::Closed, |row| row.state),
        });
    }
    match refusal {
        Some(reason) => Err(store::Error::NotAdmitted(reason)),
        None => Ok(LandingPage::of(study, language, Door::AcceptFirst)),
    }
}

/// POST `/studies/STUDY/preview`: the study as a participant meets it, in any of its states, without counting.
pub(super) async fn preview(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    State(chance): State<Chance>,
    Path(study): Path<StudyId>,
    headers: HeaderMap,
) -> Result<Redirect, Error> {
    let (_, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let arrival = NewArrival {
        language: language::choose(served.languages(), None, &headers),
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
    Query(query): Query<BTreeMap<String, String>>,
    headers: HeaderMap,
) -> Result<Response, Error> {
    let (_, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let page = landed(&store, &served, &token, chosen(&served, &query)).await;
    let liked = language::choose(served.languages(), asked_for(&query), &headers);
    Ok(framed(in_language(&served, liked.as_deref()), page))
}

async fn landed(
    store: &Store,
    study: &Study,
    token: &str,
    language: Option<String>,
) -> Result<LandingPage, Error> {
    let token = read_token(token)?;
    let arrival = store.arrival(&token).await?;
    if arrival.study != *study.id() {
        return Err(Error::NotFound(trouble::LINK));
    }
    let language = language.filter(|language| Some(language) != arrival.language.as_ref());
    let shown = language.clone().or(arrival.language);
    let door = Door::Start {
        token,
        is_preview: arrival.is_preview,
        language,
    };
    Ok(LandingPage::of(study, shown.as_deref(), door))
}

/// POST `/s/STUDY/a/TOKEN`: starts the run, or leads back to the one that this person has.
pub(super) async fn start(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    State(chance): State<Chance>,
    State(settings): State<Arc<Settings>>,
    Path((study, token)): Path<(StudyId, String)>,
    Query(query): Query<BTreeMap<String, String>>,
    headers: HeaderMap,
) -> Result<Response, Error> {
    let (version, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let language = chosen(&served, &query);
    let liked = language::choose(served.languages(), asked_for(&query), &headers);
    let arrival = match read_token(&token) {
        Ok(arrival) => arrival,
        Err(error) => {
            let unread: Result<Response, Error> = Err(error);
            return Ok(framed(in_language(&served, liked.as_deref()), unread));
        }
    };
    let run = NewRun {
        study: study.clone(),
        version,
        candidates: draw_run(&served, &mut chance.fork())?,
        quota: served.recruiting().quota,
        time_limit_ms: served.recruiting().time_limit_ms,
        refusal: refusal(&store, &served, &headers),
        factor: TimeFactor::ONE,
        population: settings.population,
        language: language.clone(),
    };
    let led_on: Result<Response, Error> = match store.start(&arrival, run).await {
        Ok(started) => Ok(Redirect::to(&format!("/r/{}", started.link)).into_response()),
        Err(error) => {
            let arrival = store.arrival(&arrival).await.ok();
            let language = language
                .or(arrival.and_then(|arrival| arrival.language))
                .or(liked);
            let shown = in_language(&served, language.as_deref());
            return Ok(framed(shown, not_now(error, shown.words())));
        }
    };
    Ok(framed(&served, led_on))
}

/// The language that an address names.
fn asked_for(query: &BTreeMap<String, String>) -> Option<&str> {
    query.get("lang").map(String::as_str)
}

/// The same if the study has it, whatever the browser likes.
fn chosen(study: &Study, query: &BTreeMap<String, String>) -> Option<String> {
    let asked_for = asked_for(query)?;
    let languages = study.languages();
    let is_had = languages.len() > 1 && languages.iter().any(|language| language == asked_for);
    is_had.then(|| asked_for.to_owned())
}

/// The study in a language, or as its file words it.
pub(super) fn in_language<'a>(study: &'a Study, language: Option<&str>) -> &'a Study {
    language.map_or(study, |language| study.in_language(language))
}

/// What somebody is told who cannot begin now; anything else stays an error.
fn not_now(error: store::Error, words: &Words) -> Result<Response, Error> {
    let text_html = match &error {
        store::Error::Closed { state, .. } => Words::to_html(match state {
            StudyState::Draft => &words.study_draft,
            StudyState::Open | StudyState::Paused => &words.study_paused,
            StudyState::Closed => &words.study_closed,
        }),
        store::Error::NotAdmitted(reason) => words.not_admitted_html(reason),
        store::Error::NotFound(_)
        | store::Error::Conflict(_)
        | store::Error::Refused(_)
        | store::Error::Busy
        | store::Error::Unavailable(_)
        | store::Error::Database(_) => return Err(error.into()),
    };
    let page = NotePage {
        language: words.language.clone(),
        title: words.cannot_start.clone(),
        text_html,
    };
    Ok((StatusCode::GONE, page).into_response())
}

/// Why nobody new may start with this browser at this moment.
fn refusal(store: &Store, study: &Study, headers: &HeaderMap) -> Option<NotAdmitted> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let device = device::guess(text("sec-ch-ua-mobile"), text("user-agent"));
    study.recruiting().admit(store.clock().now(), device).err()
}

/// A text that is no token opens nothing, just as an unknown one.
pub(super) fn read_token(text: &str) -> Result<Token, Error> {
    text.parse().map_err(|_| Error::NotFound(trouble::LINK))
}
