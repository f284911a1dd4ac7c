//! Actions with their outcomes: from names and numbers to a choice problem.

use super::design::Design;
use super::rules;
use crate::model::{ChoiceProblem, Outcome, Prospect};
use crate::study::ActionId;
use crate::study::document::{Fault, KeyPath, did_you_mean, list};
use crate::study::file::{RawAction, RawOutcome};
use crate::study::step::ActionView;
use crate::study::template::{Scalar, Scope};

/// The actions of one question: what the page offers and, unless something is withheld, what each leads to.
pub(super) struct Offer {
    pub(super) actions: Vec<ActionView>,
    pub(super) problem: Option<ChoiceProblem>,
}

/// A probability or reward as far as this question tells it.
enum Known {
    Number(f64),
    /// Other questions give the name a value, this one does not.
    Withheld,
}

/// Reads the actions of a question. `question` names it in messages about actions that several questions share.
pub(super) fn offer(
    design: &Design<'_>,
    raw: &[RawAction],
    scope: &Scope<'_>,
    question: &str,
    at: &KeyPath,
) -> Result<Offer, Fault> {
    read_offer(design, raw, scope, at).map_err(|fault| Fault {
        found: format!("{} (in question {question})", fault.found),
        ..fault
    })
}

fn read_offer(
    design: &Design<'_>,
    raw: &[RawAction],
    scope: &Scope<'_>,
    at: &KeyPath,
) -> Result<Offer, Fault> {
    rules::distinct_ids(raw.iter().map(|action| action.id.as_str()), at, "action")?;
    if raw.len() < 2 {
        return Err(at.fault(format!("{} actions", raw.len()), "two actions or more"));
    }
    let mut actions = Vec::with_capacity(raw.len());
    let mut prospects = Vec::with_capacity(raw.len());
    for (index, action) in raw.iter().enumerate() {
        let at = at.index(index);
        actions.push(ActionView {
            id: ActionId::from(action.id.as_str()),
            label: rules::filled_line(&action.label, scope, &at.key("label"))?,
            detail: rules::filled(&action.detail, scope, &at.key("detail"))?,
        });
        let prospect = prospect(design, &action.outcomes, scope, &at.key("outcomes"))?;
        prospects.push(prospect.map(|prospect| (action.id.clone(), prospect)));
    }
    let problem = match prospects.into_iter().collect::<Option<Vec<_>>>() {
        Some(prospects) => Some(
            ChoiceProblem::new(prospects)
                .map_err(|error| at.fault(error, "actions that differ in their ids"))?,
        ),
        None => None,
    };
    Ok(Offer { actions, problem })
}

fn prospect(
    design: &Design<'_>,
    raw: &[RawOutcome],
    scope: &Scope<'_>,
    at: &KeyPath,
) -> Result<Option<Prospect>, Fault> {
    let mut told = 0.0;
    let mut rest = None;
    let mut is_withheld = false;
    let mut outcomes = Vec::with_capacity(raw.len());
    for (index, outcome) in raw.iter().enumerate() {
        let at = at.index(index);
        let reward = match &outcome.reward {
            Scalar::Number(reward) => Known::Number(*reward),
            Scalar::Text(name) => match name.strip_prefix('-') {
                Some(name) => number(design, name, scope, &at.key("reward"))?.negated(),
                None => number(design, name, scope, &at.key("reward"))?,
            },
        };
        let at = at.key("p");
        let probability = match &outcome.p {
            Scalar::Number(probability) => Known::Number(*probability),
            Scalar::Text(name) if name == "rest" => {
                if rest.replace(index).is_some() {
                    return Err(at.fault("`rest` for the second time", "one `rest` per action"));
                }
                Known::Number(0.0)
            }
            Scalar::Text(name) => number(design, name, scope, &at)?,
        };
        match (probability, reward) {
            (Known::Number(probability), Known::Number(reward)) => {
                if !(0.0..=1.0).contains(&probability) {
                    return Err(at.fault(probability, "a probability from 0 to 1"));
                }
                told += probability;
                outcomes.push(Outcome {
                    probability,
                    reward,
                });
            }
            (Known::Withheld, Known::Number(_) | Known::Withheld)
            | (Known::Number(_), Known::Withheld) => {
                is_withheld = true;
            }
        }
    }
    if is_withheld {
        return Ok(None);
    }
    if let Some(rest) = rest {
        outcomes[rest].probability = remainder(told).ok_or_else(|| {
            at.index(rest).key("p").fault(
                format!("`rest` where the others sum to {told}"),
                "a sum of at most 1",
            )
        })?;
    }
    Prospect::new(outcomes)
        .map(Some)
        .map_err(|error| at.fault(error, "probabilities from 0 to 1 that sum to 1"))
}

/// What is missing to 1, free of the rounding that 1 − 0.95 would leave; `None` if there is too much already.
fn remainder(told: f64) -> Option<f64> {
    let rest = ((1.0 - told) * 1e12).round() / 1e12;
    (rest >= 0.0).then_some(rest)
}

fn number(
    design: &Design<'_>,
    name: &str,
    scope: &Scope<'_>,
    at: &KeyPath,
) -> Result<Known, Fault> {
    match scope.get(name) {
        Some(Scalar::Number(number)) => Ok(Known::Number(*number)),
        Some(Scalar::Text(_)) => Err(at.fault(
            format!("{}, which is a text", rules::shown(name)),
            "the name of a number",
        )),
        None if design.defines(name) => Ok(Known::Withheld),
        None => Err(at.fault(
            format!(
                "unknown name {}{}",
                rules::shown(name),
                did_you_mean(name, design.defined_names())
            ),
            format!(
                "a number, or the name of a value: {}",
                list(design.defined_names())
            ),
        )),
    }
}

impl Known {
    fn negated(self) -> Self {
        match self {
            Self::Number(number) => Self::Number(-number),
            Self::Withheld => Self::Withheld,
        }
    }
}
