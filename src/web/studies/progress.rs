//! How far people come: the part of the overview that renews itself.

use askama::Template;
use askama_web::WebTemplate;

use super::{
    super::{Error, results::count},
    words,
};
use crate::{
    store::{Population, RunState, StepProgress, Store, StudyState, Totals},
    study::{BlockId, OutlinedStep, QuestionId, Study},
};

#[derive(Template, WebTemplate)]
#[template(path = "studies/progress.html")]
pub(super) struct Progress {
    /// The study's state, by which the page sees that its buttons are old.
    state_id: &'static str,
    state: &'static str,
    /// What the state means for people now.
    admission: String,
    completed: String,
    /// Of how many, or how many are under way.
    completed_note: String,
    median: String,
    median_note: String,
    last_answer: String,
    last_answer_note: String,
    /// What became of everybody who started: text, number, share of them in percent.
    fates: Vec<(&'static str, String, u64)>,
    steps: Vec<StepLine>,
    sources: Vec<[String; 5]>,
    places: Vec<(String, String)>,
}

struct StepLine {
    label: String,
    detail: String,
    reached: String,
    /// Of everybody who started and did not withdraw, in percent.
    share: u64,
    answered: String,
    missed: String,
    here: String,
    left: String,
    /// Whether more people stop here than anywhere else.
    is_worst: bool,
    median: String,
}

impl Progress {
    pub(super) async fn read(
        store: &Store,
        population: Population,
        study: &Study,
    ) -> Result<Self, Error> {
        let id = study.id();
        let state = store.study(id).await?.state;
        let people = store.totals(id, population).await?;
        let steps = store.step_progress(id, population).await?;
        let median = store.median_duration_ms(id, population).await?;
        let last_answer = match people.started {
            0 => None,
            _ => store.last_answer(id, population).await?,
        };
        let places = if study.conditions().is_empty() {
            Vec::new()
        } else {
            let taken = store.places_taken(id, population).await?;
            let conditions = study.conditions().iter();
            conditions
                .map(|condition| {
                    let taken = taken.get(&Some(condition.id.clone())).copied();
                    (condition.id.to_string(), count(taken.unwrap_or(0)))
                })
                .collect()
        };
        let sources = store.runs_by_source(id, population).await?;
        let stayed = people.started.saturating_sub(people.withdrawn);
        let quota = study.recruiting().quota.map(u64::from);
        Ok(Self {
            state_id: state.as_str(),
            state: words::study_state(state),
            admission: admission(store, study, state, &people),
            completed: count(people.completed),
            completed_note: completed_note(quota, &people),
            median: words::duration_or_none(median),
            median_note: format!(
                "median of completed runs; the study says {} min",
                study.minutes()
            ),
            last_answer: last_answer.map_or_else(|| words::NONE.to_owned(), words::moment),
            last_answer_note: match last_answer {
                Some(at) => {
                    let ago = store.clock().now().0.saturating_sub(at.0);
                    format!(
                        "{} before this was counted",
                        words::duration(ago.unsigned_abs())
                    )
                }
                None => "nobody has answered yet".to_owned(),
            },
            fates: fates(&people, &steps),
            steps: lines(study, &steps, stayed),
            sources: by_source(&sources),
            places,
        })
    }
}

fn completed_note(quota: Option<u64>, people: &Totals) -> String {
    let of = quota.map_or_else(
        || "no quota".to_owned(),
        |quota| format!("of {}", count(quota)),
    );
    let excluded = match people.excluded_completed {
        0 => String::new(),
        n => format!("; {} left out of the analysis", count(n)),
    };
    format!("{of}; {} under way{excluded}", count(people.under_way()))
}

fn admission(store: &Store, study: &Study, state: StudyState, people: &Totals) -> String {
    match state {
        StudyState::Draft => "Only previews can start it.".to_owned(),
        StudyState::Paused => "Nobody new can start; people under way can finish.".to_owned(),
        StudyState::Closed => {
            "Nobody new can start any more; people under way can finish.".to_owned()
        }
        StudyState::Open => {
            let refusal = study.recruiting().admit(store.clock().now(), None).err();
            let taken = people.under_way() + people.completed;
            let quota = study.recruiting().quota.map(u64::from);
            match (refusal, quota) {
                (Some(refusal), _) => format!("Nobody can start now: {refusal}."),
                (None, Some(quota)) if taken >= quota => {
                    "All places are taken; one becomes free when somebody leaves.".to_owned()
                }
                (None, Some(quota)) => {
                    format!("People can start: {} left.", places(quota - taken))
                }
                (None, None) => "People can start.".to_owned(),
            }
        }
    }
}

fn places(n: u64) -> String {
    format!("{} {}", count(n), if n == 1 { "place" } else { "places" })
}

/// What became of everybody who started.
fn fates(people: &Totals, steps: &[StepProgress]) -> Vec<(&'static str, String, u64)> {
    let agreed: u64 = steps
        .iter()
        .filter(|step| step.kind == "consent")
        .map(|step| step.answered)
        .max()
        .map_or(0, |answered| answered.saturating_sub(people.declined));
    let asks_consent = steps.iter().any(|step| step.kind == "consent");
    let mut fates = vec![("Started", people.started)];
    if asks_consent {
        fates.push(("Consented", agreed));
    }
    fates.extend([
        ("Completed", people.completed),
        ("Under way or left", people.under_way()),
        ("Declined", people.declined),
        ("Screened out", people.screened_out),
        ("Failed a check", people.failed_check),
        ("Timed out", people.timed_out),
        ("Withdrawn", people.withdrawn),
    ]);
    fates
        .into_iter()
        .map(|(what, n)| (what, count(n), percent(n, people.started)))
        .collect()
}

fn lines(study: &Study, steps: &[StepProgress], stayed: u64) -> Vec<StepLine> {
    let outline = study.outline();
    let most = steps.iter().map(|step| step.left).max().unwrap_or(0);
    steps
        .iter()
        .map(|step| StepLine {
            label: label(&outline, step),
            detail: step.question.as_ref().map_or_else(
                || step.block.to_string(),
                |question| format!("{} · {question}", step.block),
            ),
            reached: count(step.reached),
            share: percent(step.reached, stayed),
            answered: count(step.answered),
            missed: count(step.late + step.timed_out),
            here: count(step.here),
            left: count(step.left),
            is_worst: most > 0 && step.left == most,
            median: words::duration_or_none(step.median_ms),
        })
        .collect()
}

/// The step's heading; that of an earlier version of the study is known by its block alone.
fn label(outline: &[OutlinedStep], step: &StepProgress) -> String {
    if step.kind == "thanks" {
        return "End".to_owned();
    }
    let is_same = |outlined: &&OutlinedStep| {
        let at: (&BlockId, Option<&QuestionId>) = (&outlined.block, outlined.question.as_ref());
        at == (&step.block, step.question.as_ref()) && outlined.kind.as_str() == step.kind
    };
    outline
        .iter()
        .find(is_same)
        .map_or_else(|| step.block.to_string(), |outlined| outlined.title.clone())
}

/// Source, started, completed, under way or left, ended otherwise.
fn by_source(runs: &[(Option<String>, RunState, u64)]) -> Vec<[String; 5]> {
    let mut sources: Vec<(Option<&str>, [u64; 4])> = Vec::new();
    for (source, state, n) in runs {
        let source = source.as_deref();
        let index = sources.iter().position(|(known, _)| *known == source);
        let index = index.unwrap_or_else(|| {
            sources.push((source, [0; 4]));
            sources.len() - 1
        });
        let numbers = &mut sources[index].1;
        numbers[0] += n;
        let column = match state {
            RunState::Completed => 1,
            RunState::Active => 2,
            RunState::Declined
            | RunState::ScreenedOut
            | RunState::FailedCheck
            | RunState::TimedOut
            | RunState::Withdrawn => 3,
        };
        numbers[column] += n;
    }
    sources
        .into_iter()
        .map(|(source, [started, completed, active, other])| {
            [
                source.unwrap_or("(no label)").to_owned(),
                count(started),
                count(completed),
                count(active),
                count(other),
            ]
        })
        .collect()
}

fn percent(n: u64, of: u64) -> u64 {
    (n * 100).checked_div(of).unwrap_or(0).min(100)
}
