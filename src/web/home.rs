//! The first page: the open studies for whoever may want to take part, and the way in for researchers.

use std::{collections::BTreeMap, sync::Arc};

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension, Router,
    extract::{Query, State},
    http::HeaderMap,
    routing::get,
};

use super::{
    AppState, Error, Settings,
    access::{Caller, Need},
    accounts::{Bar, Who},
    assets,
    participant::language,
};
use crate::{
    jobs::Catalogue,
    store::{Store, StudyState},
    study::{Study, Words},
};

pub(super) fn router() -> Router<AppState> {
    Router::new().route("/", get(home))
}

#[derive(Template, WebTemplate)]
#[template(path = "home.html")]
struct HomePage {
    words: Words,
    /// The language that the address names, for the links to the studies.
    asked_for: Option<String>,
    open: Vec<OpenStudy>,
    /// The studies whose results whoever reads this may see.
    results: Vec<ResultsLink>,
    simulated: bool,
    access: &'static str,
    /// Whether the researchers' pages are open to whoever reads this.
    is_researcher: bool,
    leads_to_login: bool,
    bar: Bar,
}

/// A study that takes people in, in the language in which they would meet it.
struct OpenStudy {
    id: String,
    language: String,
    title: String,
    summary: String,
    minutes: String,
    take_part: String,
}

struct ResultsLink {
    id: String,
    title: String,
    is_open: bool,
}

impl OpenStudy {
    fn of(study: &Study) -> Self {
        let words = study.words();
        Self {
            id: study.id().to_string(),
            language: study.language().to_owned(),
            title: study.title().to_owned(),
            summary: study.summary().to_owned(),
            minutes: words.lasts_minutes(&study.minutes()),
            take_part: words.take_part.clone(),
        }
    }
}

async fn home(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    State(settings): State<Arc<Settings>>,
    Extension(caller): Extension<Caller>,
    Query(mut query): Query<BTreeMap<String, String>>,
    headers: HeaderMap,
) -> Result<HomePage, Error> {
    let asked_for = query.remove("lang");
    let is_researcher = caller.may(Need::Results);
    let states = store.studies().await?;
    let (mut open, mut results) = (Vec::new(), Vec::new());
    for study in catalogue.studies() {
        let state = states.iter().find(|row| row.id == *study.id());
        let state = state.map_or(StudyState::Draft, |row| row.state);
        let is_open = state == StudyState::Open;
        if is_open {
            let language = language::choose(study.languages(), asked_for.as_deref(), &headers);
            let shown = language.map_or(&*study, |language| study.in_language(&language));
            open.push(OpenStudy::of(shown));
        }
        let is_shown = is_researcher || store.is_public(study.id()).await?;
        if is_shown && state != StudyState::Draft {
            results.push(ResultsLink {
                id: study.id().to_string(),
                title: study.title().to_owned(),
                is_open,
            });
        }
    }
    let has_accounts = store.has_accounts().await?;
    let liked = language::liked(&headers);
    let liked = asked_for.iter().chain(&liked).map(String::as_str);
    Ok(HomePage {
        words: Words::of_languages(liked),
        asked_for,
        open,
        results,
        simulated: settings.population.is_simulated(),
        access: settings.access(has_accounts),
        is_researcher,
        leads_to_login: has_accounts && !is_researcher,
        bar: Bar::of(&store, &caller).await?,
    })
}
