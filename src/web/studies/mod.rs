//! The researcher's pages of a study while it runs: state, progress, participants, links, previews.
//!
//! What people chose is not here but under `/results`.

mod data;
mod links;
mod list;
mod overview;
mod participants;
mod preview;
mod progress;
mod source_tables;
mod sources;
mod state;
mod words;

use std::sync::Arc;

use axum::{
    Router,
    extract::State,
    routing::{get, post},
};

use super::{
    AppState, Error, Settings,
    access::{Caller, Need},
    accounts::Bar,
};
use crate::{
    jobs::Catalogue,
    store::Store,
    study::{Study, StudyId},
};

pub(super) fn router() -> Router<AppState> {
    Router::new()
        .route("/studies", get(list::show))
        .route("/studies/{study}", get(overview::show))
        .route(
            "/studies/{study}/data/progress.html",
            get(overview::progress),
        )
        .route("/studies/{study}/state", post(state::set))
        .route("/studies/{study}/participants", get(participants::show))
        .route(
            "/studies/{study}/participants/{run}/erase",
            get(participants::ask_erase).post(participants::erase),
        )
        .route("/studies/{study}/links", get(links::show))
        .route("/studies/{study}/data", get(data::show))
        .route("/studies/{study}/sources", get(sources::show))
        .route("/studies/{study}/data/sources.html", get(sources::part))
        .route("/studies/{study}/preview", get(preview::show))
        .route("/studies/{study}/preview/start", post(preview::start))
}

type Parts = (State<Store>, State<Arc<Catalogue>>, State<Arc<Settings>>);

/// What stands on top of each page of a study.
struct Head {
    study: String,
    title: String,
    /// The page that is open, by the end of its address.
    page: &'static str,
    simulated: bool,
    may_data: bool,
    may_manage: bool,
    bar: Bar,
}

impl Head {
    async fn new(
        store: &Store,
        settings: &Settings,
        caller: &Caller,
        study: &Study,
        page: &'static str,
    ) -> Result<Self, Error> {
        Ok(Self {
            study: study.id().to_string(),
            title: study.title().to_owned(),
            page,
            simulated: settings.population.is_simulated(),
            may_data: caller.may(Need::Data),
            may_manage: caller.may(Need::Manage),
            bar: Bar::of(store, caller).await?,
        })
    }

    /// The pages that this reader may open: end of the address, name.
    fn pages(&self) -> Vec<(&'static str, &'static str)> {
        let mut pages = vec![("", "Overview"), ("/sources", "Sources")];
        if self.may_data {
            pages.extend([
                ("/participants", "Participants"),
                ("/links", "Links"),
                ("/data", "Data"),
            ]);
        }
        if self.may_manage {
            pages.push(("/preview", "Preview"));
        }
        pages
    }
}

/// The study as it is served now.
fn current(catalogue: &Catalogue, study: &StudyId) -> Result<Arc<Study>, Error> {
    let (_, study) = catalogue.current(study).ok_or(Error::NotFound("study"))?;
    Ok(study)
}
