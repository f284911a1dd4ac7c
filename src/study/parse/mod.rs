//! From text to a checked study.
//!
//! `rules` for single values, `design` for factors and levels, `problem` for actions, `blocks` with `choices`,
//! `replays`, `forms` and their `fields`, `conditions` and `recruiting` for who meets them, `endings`, `cells` for what
//! the questions amount to, `languages` for what stands in place of the file's texts, `fits` for what is made of the answers,
//! `sequential` for when there are enough of them.

mod blocks;
mod cells;
mod choices;
mod conditions;
mod design;
mod endings;
mod fields;
mod fits;
mod forms;
mod languages;
mod problem;
mod recruiting;
mod replays;
mod rules;
mod sequential;

use sha2::{Digest, Sha256};

use self::blocks::Asked;
use self::design::Design;
use self::languages::Language;
use super::definition::{Endings, Include, RewardUnit, Study};
use super::document::{Document, Fault, KeyPath};
use super::file::{ActionOrder, RawInclude, RawPriors, RawStudy};
use super::template::{Scalar, Values};
use super::words::Words;
use super::{Bonus, FitSettings, ParseError, Priors, StudyId};

/// The version of the file format that this program reads.
const FORMAT: i64 = 1;

/// The longest expected duration of a run, in minutes.
const LONGEST_MINUTES: u32 = 600;

/// Where a text comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// Somebody wrote it, and can still change it.
    File,
    /// It is stored with answers, and stays as it is.
    Database,
}

/// Parses a study file.
///
/// # Errors
/// One error or more. What is wrong with one part (the head, an ending, a block, the analysis) hides nothing of the
/// others; of each part the first error is named. Where a key that every study needs cannot be read, only what is wrong
/// with other keys and values is told.
pub(super) fn study(file_name: &str, text: &str, origin: Origin) -> Result<Study, Vec<ParseError>> {
    let one = |error: ParseError| vec![error];
    let document = Document::parse(file_name, text).map_err(one)?;
    check_format(&document).map_err(one)?;
    let languages = languages::read(&document).map_err(|faults| {
        let faults = faults.iter().map(|fault| document.refuse(fault));
        faults.collect::<Vec<ParseError>>()
    });
    let (own, others) = match &languages {
        Ok(languages) => (languages.first(), languages.get(1..).unwrap_or_default()),
        Err(_) => (None, [].as_slice()),
    };
    let study = in_language(&document, text, origin, own.unwrap_or(&Language::default()));
    let mut study = match (study, &languages) {
        (Ok(study), Ok(_)) => study,
        (study, languages) => {
            let errors = [
                study.err().unwrap_or_default(),
                languages.as_ref().err().cloned().unwrap_or_default(),
            ];
            return Err(errors.concat());
        }
    };
    for language in others {
        let document = document.translated(&language.tag, language.texts.clone());
        let translation = in_language(&document, text, origin, language)?;
        if translation.structure() != study.structure() {
            let at = KeyPath::root().key("text").key(&language.tag);
            let fault = at.fault(
                "values that make other questions of the study",
                "texts that leave ids, steps and problems as they are",
            );
            return Err(vec![document.refuse(&fault)]);
        }
        study.languages.push(language.tag.clone());
        study.translations.push(translation);
    }
    Ok(study)
}

/// The study with the texts of one language, alone.
fn in_language(
    document: &Document<'_>,
    text: &str,
    origin: Origin,
    language: &Language,
) -> Result<Study, Vec<ParseError>> {
    let one = |error: ParseError| vec![error];
    let words = Words::new(&language.tag, &language.words);
    let (raw, mut errors) = document.read_in_part::<RawStudy>();
    let Some(raw) = raw else {
        errors.extend(blocks::unreadable(document));
        return Err(errors);
    };
    errors.extend(head_faults(&raw).iter().map(|fault| document.refuse(fault)));
    let general = general_values(&raw);
    let design = match Design::read(&raw, &general, origin) {
        Ok(design) => design,
        Err(fault) => {
            errors.push(document.refuse(&fault));
            errors.extend(blocks::unreadable(document));
            return Err(errors);
        }
    };
    let scope = design.scope();
    let endings = keep(
        endings::read(
            &raw.completion,
            recruiting::ids(&raw.recruiting),
            &scope,
            &words,
        ),
        document,
        &mut errors,
    );
    let bonus = raw.bonus.as_ref().map(endings::bonus).transpose();
    let bonus = keep(bonus, document, &mut errors);
    let asked = blocks::read(document, &raw, &design, &words);
    let asked = asked.map_err(|faulty| errors.extend(faulty)).ok();
    let fit = keep(fits::settings(&raw.fit), document, &mut errors);
    let parts = (endings, bonus, asked, fit);
    let (Some(endings), Some(bonus), Some(asked), Some(fit)) = parts else {
        return Err(errors);
    };
    if !errors.is_empty() {
        return Err(errors);
    }
    let parts = Parts {
        endings,
        bonus,
        asked,
        fit,
    };
    let study = whole(text, &raw, design, parts).map_err(|fault| one(document.refuse(&fault)))?;
    Ok(Study {
        languages: vec![language.tag.clone()],
        untranslated: language.missing.clone(),
        words,
        ..study
    })
}

/// What was read part by part.
struct Parts {
    endings: Endings,
    bonus: Option<Bonus>,
    asked: Asked,
    fit: FitSettings,
}

/// What the parts amount to.
fn whole(text: &str, raw: &RawStudy, design: Design<'_>, parts: Parts) -> Result<Study, Fault> {
    let Parts {
        endings,
        bonus,
        asked:
            Asked {
                blocks,
                baseline,
                baseline_share,
                asked,
            },
        fit,
    } = parts;
    let cells = cells::collect(asked)?;
    let reference_reward = fits::reference_reward(raw.reference_reward, &cells)?;
    let plans = fits::plans(&raw.fit.plan, &design, &cells)?;
    let sequential = sequential::read(raw.stopping.as_ref(), &fit.models, &plans, &cells)?;
    let exclude = fits::exclude(&raw.analysis.exclude)?;
    let blind_until = fits::blind_until(raw.analysis.blind_until)?;
    let hypothesis = raw.analysis.hypothesis.as_ref();
    let hypothesis = hypothesis
        .map(|raw| fits::hypothesis(raw, &fit.models))
        .transpose()?;
    let paper = fits::paper(&raw.paper, &design, &cells)?;
    let conditions = conditions::read(&design, &blocks)?;
    let recruiting = recruiting::read(&raw.recruiting, raw.minutes, !conditions.is_empty())?;
    let factors = design.into_factors();

    Ok(Study {
        languages: Vec::new(),
        translations: Vec::new(),
        untranslated: Vec::new(),
        words: Words::english(),
        text: text.to_owned(),
        hash: data_encoding::HEXLOWER.encode(&Sha256::digest(text)),
        id: StudyId::from(raw.id.as_str()),
        title: raw.title.clone(),
        summary: raw.summary.clone(),
        minutes: raw.minutes,
        contact: raw.contact.clone(),
        reward_unit: RewardUnit {
            name: raw.reward_unit.name.clone(),
            prefix: raw.reward_unit.prefix.clone(),
            suffix: raw.reward_unit.suffix.clone(),
        },
        reference_reward,
        factors,
        draws_action_order: raw.question.action_order == ActionOrder::PerRun,
        blocks,
        cells,
        baseline,
        baseline_share,
        endings,
        bonus,
        is_open_at_first: raw.open,
        conditions,
        recruiting,
        include: match raw.analysis.include {
            RawInclude::Completed => Include::Completed,
            RawInclude::All => Include::All,
        },
        exclude,
        blind_until,
        hypothesis,
        sequential,
        fit,
        plans,
        paper,
    })
}

/// The value, or its fault among the errors.
fn keep<T>(
    read: Result<T, Fault>,
    document: &Document<'_>,
    errors: &mut Vec<ParseError>,
) -> Option<T> {
    read.map_err(|fault| errors.push(document.refuse(&fault)))
        .ok()
}

/// Parses a file of priors alone.
pub(super) fn priors(file_name: &str, text: &str) -> Result<Priors, ParseError> {
    let document = Document::parse(file_name, text)?;
    let raw: RawPriors = document.read()?;
    fits::priors(&raw, &KeyPath::root()).map_err(|fault| document.refuse(&fault))
}

/// The format comes first: a file of another format would only give misleading errors about its keys.
fn check_format(document: &Document<'_>) -> Result<(), ParseError> {
    let path = KeyPath::root().key("format");
    match document.integer_at(&path) {
        Some(FORMAT) | None => Ok(()),
        Some(other) => Err(document.refuse(&path.fault(other, FORMAT))),
    }
}

/// Everything that is wrong with the keys at the top.
fn head_faults(raw: &RawStudy) -> Vec<Fault> {
    let root = KeyPath::root();
    let whole = |is_fine: bool, fault: Fault| if is_fine { Ok(()) } else { Err(fault) };
    let checks = [
        whole(
            raw.format == FORMAT,
            root.key("format").fault(raw.format, FORMAT),
        ),
        rules::id(&raw.id, &root.key("id")).map(drop),
        rules::line(&raw.title, &root.key("title")),
        rules::line(&raw.summary, &root.key("summary")),
        rules::line(&raw.contact, &root.key("contact")),
        rules::line(&raw.reward_unit.name, &root.key("reward_unit").key("name")),
        whole(
            (1..=LONGEST_MINUTES).contains(&raw.minutes),
            root.key("minutes").fault(
                raw.minutes,
                format!("a whole number from 1 to {LONGEST_MINUTES}"),
            ),
        ),
    ];
    checks.into_iter().filter_map(Result::err).collect()
}

/// What every text can name without defining it.
fn general_values(raw: &RawStudy) -> Values {
    Values::from([
        (
            "title".to_owned(),
            Scalar::Text(raw.title.replace('{', "{{").replace('}', "}}")),
        ),
        (
            "contact".to_owned(),
            Scalar::Text(raw.contact.replace('{', "{{").replace('}', "}}")),
        ),
        ("minutes".to_owned(), Scalar::Number(f64::from(raw.minutes))),
    ])
}
