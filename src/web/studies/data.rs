//! The data of a study: what there is, every form of export, and the paragraph that says who took part.

use askama::Template;
use askama_web::WebTemplate;
use axum::{Extension, extract::Path};

use super::{
    super::{Error, access::Caller, accounts::Who, assets, results::count},
    Head, Parts, current, words,
};
use crate::{
    jobs::Blind,
    store::{AnalysisSet, Population, RunState, Store, Totals},
    study::{
        Asks, BlockId, ParticipantFacts, RecruitingIds, Study, StudyId,
        step::{Field, FieldKind},
    },
};

#[derive(Template, WebTemplate)]
#[template(path = "studies/data.html")]
pub(super) struct DataPage {
    head: Head,
    /// What there is: what, how many.
    counts: Vec<(&'static str, String)>,
    forms: Vec<ExportForm>,
    /// Whether plain ids of recruiting platforms are stored.
    has_plain_ids: bool,
    paragraph: String,
    retention: Option<String>,
}

/// A form of export.
struct ExportForm {
    file: &'static str,
    name: &'static str,
    what: &'static str,
    /// Whether ids of recruiting platforms can be asked for.
    takes_ids: bool,
    /// Why it cannot be had now.
    refusal: Option<&'static str>,
}

/// GET `/studies/STUDY/data`.
pub(super) async fn show(
    (axum::extract::State(store), catalogue, settings): Parts,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
) -> Result<DataPage, Error> {
    let served = current(&catalogue, &study)?;
    let population = settings.population;
    let people = store.totals(&study, population).await?;
    let is_blind = Blind::of(&served, &people).is_some();
    let recruiting = served.recruiting();
    Ok(DataPage {
        head: Head::new(&store, &settings, &caller, &served, "/data").await?,
        counts: vec![
            ("Started", count(people.started)),
            ("Completed", count(people.completed)),
            (
                "Completed, and left out of the analysis",
                count(people.excluded_completed),
            ),
            ("Withdrawn and erased", count(people.withdrawn)),
        ],
        forms: forms(&served, is_blind),
        has_plain_ids: recruiting.ids == RecruitingIds::Plain,
        paragraph: facts(&store, population, &served, &people)
            .await?
            .paragraph(),
        retention: recruiting.retention.map(words::moment),
    })
}

fn forms(study: &Study, is_blind: bool) -> Vec<ExportForm> {
    let form = |file, name, what, takes_ids| ExportForm {
        file,
        name,
        what,
        takes_ids,
        refusal: None,
    };
    let mut forms = vec![
        form(
            "answers.csv",
            "Long table",
            "CSV, one row per question shown.",
            false,
        ),
        form(
            "wide.csv",
            "Wide table",
            "CSV, one row per participant.",
            true,
        ),
        form(
            "answers.ndjson",
            "Lines of JSON",
            "The long table, one object per line.",
            false,
        ),
        form(
            "psych-ds.zip",
            "Archive",
            "Everything with codebook and study files, in the form of the Psych-DS standard.",
            true,
        ),
        form(
            "codebook.csv",
            "Codebook, CSV",
            "Every column: label, unit, levels, missing codes.",
            false,
        ),
        form(
            "codebook.json",
            "Codebook, JSON",
            "The same for programs.",
            false,
        ),
    ];
    if study.bonus().is_some() {
        forms.push(form(
            "bonus.csv",
            "Bonuses",
            "What each person is paid beside the fee.",
            true,
        ));
    }
    forms.push(ExportForm {
        refusal: is_blind.then_some("Hidden until enough people have finished."),
        ..form(
            "analysis.json",
            "Frozen analysis",
            "Final fits and the numbers behind every figure, to be cited.",
            false,
        )
    });
    forms
}

/// Reads what the paragraph about the participants is made of.
async fn facts(
    store: &Store,
    population: Population,
    study: &Study,
    people: &Totals,
) -> Result<ParticipantFacts, Error> {
    let id = study.id();
    let completed_by_source = store
        .runs_by_source(id, population)
        .await?
        .into_iter()
        .filter(|(_, state, _)| *state == RunState::Completed)
        .map(|(source, _, n)| (source.unwrap_or_default(), n))
        .collect();
    let set = AnalysisSet::Completed;
    let genders = match field(study, "gender") {
        Some((block, field)) => store
            .form_answers(id, population, set, block, &field.id, false)
            .await?
            .into_iter()
            .map(|answer| (answer.value.map(|value| text_of(field, value)), answer.n))
            .collect(),
        None => Vec::new(),
    };
    let ages = match field(study, "age") {
        Some((block, field)) => store
            .form_answers(id, population, set, block, &field.id, false)
            .await?
            .into_iter()
            .filter_map(|answer| Some((answer.value?.parse().ok()?, answer.n)))
            .collect(),
        None => Vec::new(),
    };
    Ok(ParticipantFacts {
        completed_by_source,
        started: people.started,
        declined: people.declined,
        screened_out: people.screened_out,
        failed_check: people.failed_check,
        timed_out: people.timed_out,
        withdrawn: people.withdrawn,
        unfinished: people.under_way(),
        excluded: store.exclusions(id, population, set).await?,
        genders,
        ages,
        median_ms: store.median_duration_ms(id, population).await?,
        filters: study.recruiting().filters.clone(),
        is_simulated: population.is_simulated(),
    })
}

/// The form field with this id, which names what it asks for.
fn field<'a>(study: &'a Study, id: &str) -> Option<(&'a BlockId, &'a Field)> {
    study.contents().find_map(|contents| match contents.asks {
        Asks::Fields(fields) => fields
            .iter()
            .find(|field| field.id == id)
            .map(|field| (contents.block, field)),
        Asks::Nothing | Asks::Replays(_) | Asks::Consent(_) | Asks::Choices { .. } => None,
    })
}

/// What the option of an answer says on the page.
fn text_of(field: &Field, value: String) -> String {
    match &field.kind {
        FieldKind::Choice { options, .. } => options
            .iter()
            .find(|option| option.id == value)
            .map_or(value, |option| option.label.clone()),
        FieldKind::Integer { .. }
        | FieldKind::Number { .. }
        | FieldKind::Text { .. }
        | FieldKind::LongText { .. }
        | FieldKind::Choices { .. }
        | FieldKind::Likert { .. } => value,
    }
}
