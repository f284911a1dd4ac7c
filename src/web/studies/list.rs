//! All studies with how they are going.

use askama::Template;
use askama_web::WebTemplate;
use axum::{Extension, extract::State};

use super::{
    super::{
        Error,
        access::Caller,
        accounts::{Bar, Who},
        assets,
        results::count,
    },
    Parts, words,
};

#[derive(Template, WebTemplate)]
#[template(path = "studies/list.html")]
pub(super) struct ListPage {
    bar: Bar,
    simulated: bool,
    studies: Vec<Line>,
    /// Files of the studies folder that cannot be read, with the reason.
    file_errors: Vec<(String, String)>,
}

struct Line {
    id: String,
    title: String,
    state_id: &'static str,
    state: &'static str,
    completed: String,
    started: String,
    median: String,
    last_answer: String,
}

/// GET `/studies`.
pub(super) async fn show(
    (State(store), State(catalogue), State(settings)): Parts,
    Extension(caller): Extension<Caller>,
) -> Result<ListPage, Error> {
    let population = settings.population;
    let rows = store.studies().await?;
    let mut studies = Vec::new();
    for study in catalogue.studies() {
        let id = study.id();
        let Some(row) = rows.iter().find(|row| row.id == *id) else {
            continue;
        };
        let people = store.totals(id, population).await?;
        let median = store.median_duration_ms(id, population).await?;
        let last_answer = match people.started {
            0 => None,
            _ => store.last_answer(id, population).await?,
        };
        studies.push(Line {
            id: id.to_string(),
            title: study.title().to_owned(),
            state_id: row.state.as_str(),
            state: words::study_state(row.state),
            completed: match study.recruiting().quota {
                Some(quota) => format!("{} of {}", count(people.completed), count(quota.into())),
                None => count(people.completed),
            },
            started: count(people.started),
            median: words::duration_or_none(median),
            last_answer: last_answer.map_or_else(|| words::NONE.to_owned(), words::moment),
        });
    }
    Ok(ListPage {
        bar: Bar::of(&store, &caller).await?,
        simulated: population.is_simulated(),
        studies,
        file_errors: catalogue
            .file_errors()
            .into_iter()
            .map(|(file, error)| {
                // Most errors begin with the file's name, which stands above them already.
                let error = error.strip_prefix(&file).unwrap_or(&error);
                let error = error.trim_start_matches([',', ':', ' ']).to_owned();
                (file, error)
            })
            .collect(),
    })
}
