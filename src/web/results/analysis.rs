//! `analysis.json`: everything that a paper cites, frozen. It rests on final fits alone, so the same data give the same bytes
//! on the same program and machine; what is not final yet is listed and left out.
//!
//! The file has three lines: the hash, the analysis, the end. So the hash is checked without a JSON library:
//! `sed -n 2p analysis.json | tr -d '\n' | sha256sum`.

use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::{Accuracy, Comparison, Curves, Sequential, Summary};
use crate::{
    inference::{FitSummary, accuracy::CellAccuracy, predictive_check::PredictiveCheck},
    jobs::{Catalogue, NotFinal, PartFit, Snapshot, fit_settings},
    model::{ChoiceProblem, OrderedMap},
    store::{Population, Store},
    study::{Include, Study, StudyId},
    web::Error,
};

/// What tells of when something happened to be made. The same data have other times after another way there.
const NOT_OF_THE_DATA: [&str; 2] = ["at", "fit_version"];

#[derive(Serialize)]
struct Analysis<'a> {
    /// Of this file's form.
    format: u32,
    study: StudyVersion<'a>,
    program_version: &'static str,
    /// The instructions that the fits were computed with decide their last digits.
    architecture: &'static str,
    simulated: bool,
    data_version: i64,
    /// Whether every part with answers, every comparison and every look that is due is here.
    is_complete: bool,
    /// What is left out because it is not final, and why.
    left_out: Vec<LeftOut<'a>>,
    /// Plans whose models are not compared yet on these fits.
    not_compared: Vec<&'a str>,
    settings: Settings<'a>,
    fits: Vec<FrozenFit<'a>>,
    figures: Figures<'a>,
}

#[derive(Serialize)]
struct StudyVersion<'a> {
    id: &'a str,
    title: &'a str,
    version: i64,
    /// SHA-256 of the study file.
    hash: &'a str,
}

#[derive(Serialize)]
struct LeftOut<'a> {
    plan: &'a str,
    part: &'a str,
    model: &'a str,
    reason: NotFinal,
}

#[derive(Serialize)]
struct Settings<'a> {
    reference_reward: f64,
    /// Independent posterior samples behind ln KL.
    samples: usize,
    include: &'static str,
    models: Vec<&'a str>,
    /// Chains, draws, options and priors; each fit names its own seed.
    fit: Value,
}

#[derive(Serialize)]
struct FrozenFit<'a> {
    plan: &'a str,
    part: &'a str,
    model: &'a str,
    seed: u64,
    input_hash: &'a str,
    data_version: i64,
    study_version: i64,
    program_version: &'a str,
    /// SHA-256 of the stored draws.
    draws_sha256: String,
    problems: &'a OrderedMap<ChoiceProblem>,
    counts: &'a [Vec<u64>],
    summary: &'a FitSummary,
    accuracy: &'a [CellAccuracy],
    predictive_check: &'a [PredictiveCheck],
}

/// The numbers behind the figures of the results page.
#[derive(Serialize)]
struct Figures<'a> {
    summary: Summary,
    accuracy: Accuracy,
    curves: Vec<Curves>,
    comparison: Vec<Comparison<'a>>,
    sequential: Sequential<'a>,
}

/// A study's analysis as a file.
///
/// # Errors
/// `NotFound` for a study that is not served, `Blind` for one that hides its results, and when the database fails.
pub async fn analysis_json(
    store: &Store,
    catalogue: &Catalogue,
    population: Population,
    study: &StudyId,
) -> Result<Vec<u8>, Error> {
    let snapshot = Snapshot::read(store, catalogue, population, study)
        .await?
        .ok_or(Error::NotFound("study"))?;
    if let Some(blind) = snapshot.blind() {
        return Err(Error::Blind(blind));
    }
    let (current, _) = catalogue.current(study).ok_or(Error::NotFound("study"))?;
    let version = store.study_version(current).await?;
    let (frozen, left_out) = snapshot.final_alone();
    let mut fits = Vec::new();
    for part in &frozen.fits {
        fits.extend(frozen_fit(store, part).await?);
    }
    let left_out: Vec<LeftOut<'_>> = left_out
        .iter()
        .map(|(part, reason)| LeftOut {
            plan: part.plan.as_str(),
            part: part.part.as_str(),
            model: part.model.id,
            reason: *reason,
        })
        .collect();
    let study = &frozen.study;
    let not_compared: Vec<&str> = study
        .plans()
        .iter()
        .filter(|plan| frozen.comparison(&plan.id).is_none())
        .map(|plan| plan.id.as_str())
        .collect();
    let sequential = Sequential::new(&frozen);
    let is_complete =
        left_out.is_empty() && not_compared.is_empty() && !sequential.is_behind && !fits.is_empty();
    let analysis = Analysis {
        format: 1,
        study: StudyVersion {
            id: study.id().as_str(),
            title: study.title(),
            version: version.number.get(),
            hash: study.hash(),
        },
        program_version: env!("CARGO_PKG_VERSION"),
        architecture: std::env::consts::ARCH,
        simulated: population.is_simulated(),
        data_version: frozen.version.data_version,
        is_complete,
        left_out,
        not_compared,
        settings: Settings {
            reference_reward: study.reference_reward(),
            samples: study.fit().samples,
            include: match study.include() {
                Include::Completed => "completed",
                Include::All => "all",
            },
            models: study.models().iter().map(|model| model.id).collect(),
            fit: settings_of(study).map_err(|error| Error::Internal(error.into()))?,
        },
        fits,
        figures: Figures {
            summary: Summary::new(&frozen),
            accuracy: Accuracy::new(&frozen, frozen.finest_plan()),
            curves: study
                .plans()
                .iter()
                .map(|plan| Curves::new(&frozen, Some(&plan.id), None))
                .collect(),
            comparison: study
                .plans()
                .iter()
                .map(|plan| Comparison::new(&frozen, plan))
                .collect(),
            sequential,
        },
    };
    file(&analysis).map_err(|error| Error::Internal(error.into()))
}

fn settings_of(study: &Study) -> Result<Value, serde_json::Error> {
    let mut settings = serde_json::to_value(fit_settings(study, 0))?;
    if let Some(members) = settings.as_object_mut() {
        members.remove("seed");
    }
    Ok(settings)
}

async fn frozen_fit<'a>(store: &Store, part: &'a PartFit) -> Result<Option<FrozenFit<'a>>, Error> {
    let (Some(fit), Some(report)) = (part.fit.as_deref(), part.converged()) else {
        return Ok(None);
    };
    let draws = store.fit_draws(fit.id).await?;
    Ok(Some(FrozenFit {
        plan: part.plan.as_str(),
        part: part.part.as_str(),
        model: part.model.id,
        seed: fit.seed,
        input_hash: &fit.input_hash,
        data_version: fit.data_version,
        study_version: fit.version_number.get(),
        program_version: &fit.program_version,
        draws_sha256: data_encoding::HEXLOWER.encode(&Sha256::digest(&draws)),
        problems: &report.problems,
        counts: &report.counts,
        summary: &report.summary,
        accuracy: &report.accuracy,
        predictive_check: &report.predictive_check,
    }))
}

/// The three lines. Keys are sorted, so that equal numbers are equal bytes.
fn file(analysis: &Analysis<'_>) -> Result<Vec<u8>, serde_json::Error> {
    let mut value = serde_json::to_value(analysis)?;
    let figures = &mut value["figures"];
    without_times(figures);
    // The state of each fit with its number in the database; `fits` and `left_out` say it of the data alone.
    if let Some(summary) = figures["summary"].as_object_mut() {
        summary.remove("fits");
    }
    let text = serde_json::to_string(&value)?;
    let hash = data_encoding::HEXLOWER.encode(&Sha256::digest(&text));
    Ok(format!("{{\"sha256\":\"{hash}\",\"analysis\":\n{text}\n}}\n").into_bytes())
}

fn without_times(value: &mut Value) {
    match value {
        Value::Object(members) => {
            members.retain(|name, value| {
                // The number of a stored fit counts all fits before it.
                let is_number_of_fit = name == "fit" && value.is_number();
                !is_number_of_fit && !NOT_OF_THE_DATA.contains(&name.as_str())
            });
            members.values_mut().for_each(without_times);
        }
        Value::Array(values) => values.iter_mut().for_each(without_times),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}
