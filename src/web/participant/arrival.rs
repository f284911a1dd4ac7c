//! From a study's link to the start of a run.

use std::{collections::BTreeMap, sync::Arc};

use axum::{
    extract::{Path, Query, State},
    http::HeaderMap,
    response::Redirect,
};

use super::{Looking, device, pages::LandingPage, recruiting};
use crate::{
    chance::Chance,
    jobs::Catalogue,
    store::{NewArrival, NewRun, Store, Token, draw_run},
    study::{NotAdmitted, RecruitingIds, Study, StudyId, TimeFactor},
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
) -> Result<Redirect, Error> {
    let mut arrival = recruiting::read(&query)?;
    let (_, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    arrival.refusal = refusal(&store, &served, &headers);
    match served.recruiting().ids {
        RecruitingIds::Plain => {}
        RecruitingIds::Hashed => {
            for (parameter, value) in &mut arrival.recruiting {
                *value = store.recruiting_id(&study, parameter, value);
            }
        }
    }
    let token = Token::random(&mut chance.fork());
    store.arrive(&token, &study, arrival).await?;
    Ok(Redirect::to(&format!("/s/{study}/a/{token}")))
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
) -> Result<LandingPage, Error> {
    let token = read_token(&token)?;
    let (_, served) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let arrival = store.arrival(&token).await?;
    if arrival.study != study {
        return Err(Error::NotFound("link"));
    }
    Ok(LandingPage {
        title: served.title().to_owned(),
        summary: served.summary().to_owned(),
        minutes: served.minutes(),
        study: study.to_string(),
        token,
        is_preview: arrival.is_preview,
    })
}

/// POST `/s/STUDY/a/TOKEN`: starts the run, or leads back to the one that this person has.
pub(super) async fn start(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    State(chance): State<Chance>,
    State(settings): State<Arc<Settings>>,
    Path((study, token)): Path<(StudyId, String)>,
    headers: HeaderMap,
) -> Result<Redirect, Error> {
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
    let started = store.start(&arrival, run).await?;
    Ok(Redirect::to(&format!("/r/{}", started.link)))
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
