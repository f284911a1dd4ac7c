//! The first page: the studies, and who may see their results.

use std::sync::Arc;

use askama::Template;
use askama_web::WebTemplate;
use axum::{Extension, Router, extract::State, routing::get};

use super::{
    AppState, Error, Settings,
    access::{Caller, Need},
    accounts::{Bar, Who},
    assets,
};
use crate::{
    jobs::Catalogue,
    store::{Store, StudyState},
    study::StudyId,
};

pub(super) fn router() -> Router<AppState> {
    Router::new().route("/", get(home))
}

#[derive(Template, WebTemplate)]
#[template(path = "home.html")]
struct HomePage {
    studies: Vec<Entry>,
    simulated: bool,
    access: &'static str,
    /// Whether the researchers' pages may be open to whoever reads this.
    leads_to_studies: bool,
    bar: Bar,
}

struct Entry {
    id: String,
    title: String,
    summary: String,
    minutes: u32,
    is_open: bool,
}

async fn home(
    State(store): State<Store>,
    State(catalogue): State<Arc<Catalogue>>,
    State(settings): State<Arc<Settings>>,
    Extension(caller): Extension<Caller>,
) -> Result<HomePage, Error> {
    let states = store.studies().await?;
    let is = |id: &StudyId, state| states.iter().any(|row| row.id == *id && row.state == state);
    let studies = catalogue
        .studies()
        .into_iter()
        .filter(|study| !is(study.id(), StudyState::Draft))
        .map(|study| Entry {
            id: study.id().to_string(),
            title: study.title().to_owned(),
            summary: study.summary().to_owned(),
            minutes: study.minutes(),
            is_open: is(study.id(), StudyState::Open),
        })
        .collect();
    let has_accounts = store.has_accounts().await?;
    Ok(HomePage {
        studies,
        simulated: settings.population.is_simulated(),
        access: settings.access(has_accounts),
        leads_to_studies: !has_accounts || caller.may(Need::Results),
        bar: Bar::of(&store, &caller).await?,
    })
}
