//! From text to a checked study.
//!
//! `rules` for single values, `design` for factors and levels, `problem` for actions, `blocks` with `choices`,
//! `replays` and `forms`, `conditions` and `recruiting` for who meets them, `cells` for what the questions amount to, `fits` for what is made of the answers,
//! `sequential` for when there are enough of them.

mod blocks;
mod cells;
mod choices;
mod conditions;
mod design;
mod fits;
mod forms;
mod problem;
mod recruiting;
mod replays;
mod rules;
mod sequential;

use sha2::{Digest, Sha256};

use self::blocks::Asked;
use self::design::Design;
use super::definition::{Completion, CompletionCode, Include, RewardUnit, Study};
use super::document::{Document, Fault, KeyPath};
use super::file::{ActionOrder, RawCompletion, RawInclude, RawPriors, RawStudy};
use super::template::{Scalar, Scope, Values};
use super::{ParseError, Priors, StudyId};

/// The version of the file format that this program reads.
const FORMAT: i64 = 1;

/// The longest expected duration of a run, in minutes.
const LONGEST_MINUTES: u32 = 600;

/// Parses a study file.
pub(super) fn study(file_name: &str, text: &str) -> Result<Study, ParseError> {
    let document = Document::parse(file_name, text)?;
    check_format(&document)?;
    let raw: RawStudy = document.read()?;
    let refuse = |fault: Fault| document.refuse(&fault);

    let root = KeyPath::root();
    check_head(&raw).map_err(refuse)?;
    let general = general_values(&raw);
    let design = Design::read(&raw, &general).map_err(refuse)?;
    let scope = design.scope();
    let completion = completion(&raw.completion, &scope).map_err(refuse)?;

    let Asked {
        blocks,
        baseline,
        baseline_share,
        asked,
    } = blocks::read(&document, &raw, &design)?;
    let cells = cells::collect(asked).map_err(refuse)?;
    let reference_reward = fits::reference_reward(raw.reference_reward, &cells).map_err(refuse)?;
    let fit = fits::settings(&raw.fit).map_err(refuse)?;
    let plans = fits::plans(&raw.fit.plan, &design, &cells).map_err(refuse)?;
    let sequential =
        sequential::read(raw.stopping.as_ref(), &fit.models, &plans, &cells).map_err(refuse)?;
    let blind_until = fits::blind_until(raw.analysis.blind_until).map_err(refuse)?;
    let hypothesis = raw.analysis.hypothesis.as_ref();
    let hypothesis = hypothesis
        .map(|raw| fits::hypothesis(raw, &fit.models))
        .transpose()
        .map_err(refuse)?;
    let paper = fits::paper(&raw.paper, &design, &cells).map_err(refuse)?;

    let conditions = conditions::read(&design, &blocks).map_err(refuse)?;
    let recruiting =
        recruiting::read(&raw.recruiting, raw.minutes, !conditions.is_empty()).map_err(refuse)?;
    let factors = design.into_factors();

    Ok(Study {
        text: text.to_owned(),
        hash: data_encoding::HEXLOWER.encode(&Sha256::digest(text)),
        id: StudyId::from(rules::id(&raw.id, &root.key("id")).map_err(refuse)?),
        title: raw.title,
        summary: raw.summary,
        minutes: raw.minutes,
        contact: raw.contact,
        reward_unit: RewardUnit {
            name: raw.reward_unit.name,
            prefix: raw.reward_unit.prefix,
            suffix: raw.reward_unit.suffix,
        },
        reference_reward,
        factors,
        draws_action_order: raw.question.action_order == ActionOrder::PerRun,
        blocks,
        cells,
        baseline,
        baseline_share,
        completion,
        is_open_at_first: raw.open,
        conditions,
        recruiting,
        include: match raw.analysis.include {
            RawInclude::Completed => Include::Completed,
            RawInclude::All => Include::All,
        },
        blind_until,
        hypothesis,
        sequential,
        fit,
        plans,
        paper,
    })
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

fn check_head(raw: &RawStudy) -> Result<(), Fault> {
    let root = KeyPath::root();
    if raw.format != FORMAT {
        return Err(root.key("format").fault(raw.format, FORMAT));
    }
    rules::line(&raw.title, &root.key("title"))?;
    rules::line(&raw.summary, &root.key("summary"))?;
    rules::line(&raw.contact, &root.key("contact"))?;
    rules::line(&raw.reward_unit.name, &root.key("reward_unit").key("name"))?;
    if !(1..=LONGEST_MINUTES).contains(&raw.minutes) {
        return Err(root.key("minutes").fault(
            raw.minutes,
            format!("a whole number from 1 to {LONGEST_MINUTES}"),
        ));
    }
    Ok(())
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

fn completion(raw: &RawCompletion, scope: &Scope<'_>) -> Result<Completion, Fault> {
    let path = KeyPath::root().key("completion");
    let code = match &raw.code {
        Some(code) => CompletionCode::Fixed(rules::code(code, &path.key("code"))?),
        None => CompletionCode::PerRun,
    };
    if let Some(address) = &raw.redirect {
        rules::redirect(address, &path.key("redirect"))?;
    }
    Ok(Completion {
        title: rules::filled_line(&raw.title, scope, &path.key("title"))?,
        text_html: rules::filled_markdown(&raw.text, scope, &path.key("text"))?,
        code,
        redirect: raw.redirect.clone(),
    })
}
