//! One study while it runs.

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Path, State},
};

use super::{
    super::{
        Error,
        access::{Caller, Need},
        accounts::Who,
        assets,
    },
    Head, Parts, current,
    progress::Progress,
    state::{Button, buttons},
    words,
};
use crate::{
    jobs::Blind,
    store::{AuditRow, Store, Totals},
    study::{Study, StudyId},
};

/// How many looks at a blind study are listed.
const LOOKS: u32 = 10;

#[derive(Template, WebTemplate)]
#[template(path = "studies/overview.html")]
pub(super) struct OverviewPage {
    head: Head,
    state_id: &'static str,
    buttons: Vec<Button>,
    /// What the study file says about recruiting: what, value.
    terms: Vec<(&'static str, String)>,
    /// Whether everybody may see the results; none where this reader may not change it.
    is_public: Option<bool>,
    blind: Option<BlindState>,
    progress: Progress,
}

/// A study that hides its results for now, or did.
struct BlindState {
    until: String,
    /// How many are missing, in words; empty once results are shown.
    missing: String,
    /// Who looked: when, who, what.
    looks: Vec<[String; 3]>,
}

/// GET `/studies/STUDY`.
pub(super) async fn show(
    (State(store), State(catalogue), State(settings)): Parts,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
) -> Result<OverviewPage, Error> {
    let served = current(&catalogue, &study)?;
    let state = store.study(&study).await?.state;
    let head = Head::new(&store, &settings, &caller, &served, "").await?;
    let is_public = match &caller {
        Caller::Account(_) if caller.may(Need::Manage) => Some(store.is_public(&study).await?),
        Caller::Account(_) | Caller::Local | Caller::Nobody | Caller::Token(_) => None,
    };
    let people = store.totals(&study, settings.population).await?;
    let mut terms = terms(&served);
    let longer = store
        .runs_with_more_time(&study, settings.population)
        .await?;
    for (times, n) in longer {
        let persons = words::people(n);
        terms.push((
            "More time",
            format!("{persons} with {times} times as long; their timed answers are stored and not counted"),
        ));
    }
    Ok(OverviewPage {
        state_id: state.as_str(),
        buttons: if head.may_manage {
            buttons(state)
        } else {
            Vec::new()
        },
        terms,
        is_public,
        blind: blind(&store, &served, &people, head.may_data).await?,
        progress: Progress::read(&store, settings.population, &served).await?,
        head,
    })
}

/// GET `/studies/STUDY/data/progress.html`: what the open page fetches when something has changed.
pub(super) async fn progress(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
) -> Result<Progress, Error> {
    let served = current(&catalogue, &study)?;
    Progress::read(&store, settings.population, &served).await
}

fn terms(study: &Study) -> Vec<(&'static str, String)> {
    let recruiting = study.recruiting();
    let mut terms = Vec::new();
    if let Some(quota) = recruiting.quota {
        terms.push(("Quota", words::people(quota.into())));
    }
    if let Some(opens) = recruiting.opens {
        terms.push(("From", words::moment(opens)));
    }
    if let Some(closes) = recruiting.closes {
        terms.push(("Until before", words::moment(closes)));
    }
    if !recruiting.devices.is_empty() {
        let devices: Vec<&str> = recruiting
            .devices
            .iter()
            .map(|device| device.as_str())
            .collect();
        terms.push(("Devices", devices.join(", ")));
    }
    if let Some(limit_ms) = recruiting.time_limit_ms {
        let limit = words::duration(limit_ms.unsigned_abs());
        terms.push(("A place is kept for", limit));
    }
    if let Some(retention) = recruiting.retention {
        terms.push(("Can be withdrawn until", words::moment(retention)));
    }
    terms
}

async fn blind(
    store: &Store,
    study: &Study,
    people: &Totals,
    may_see_looks: bool,
) -> Result<Option<BlindState>, Error> {
    let Some(until) = study.blind_until() else {
        return Ok(None);
    };
    let looks = if may_see_looks {
        let rows = store.looks_at(study.id(), LOOKS).await?;
        rows.into_iter().map(look).collect()
    } else {
        Vec::new()
    };
    Ok(Some(BlindState {
        until: words::people(until),
        missing: match Blind::of(study, people).map(|blind| blind.until - blind.completed) {
            None => String::new(),
            Some(1) => "1 person is missing".to_owned(),
            Some(missing) => format!("{} are missing", words::people(missing)),
        },
        looks,
    }))
}

fn look(row: AuditRow) -> [String; 3] {
    [words::moment(row.at), row.entry.actor, row.entry.action]
}
