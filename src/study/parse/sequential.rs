//! How evidence is followed, and the rule for stopping.

use super::rules;
use crate::model::{ChoiceModel, NOISY_RATIONAL, Parameter, RISK_AWARE};
use crate::study::document::{Fault, KeyPath, did_you_mean, list};
use crate::study::file::{RawStopping, RawWidth};
use crate::study::{Cell, FitPlan, KeyInterval, Sequential, StoppingRule};

/// People between two looks where the study file says nothing.
const CHECK_EVERY: u64 = 5;

/// The name of the sensitivity without a unit.
const TAU: &str = "tau";

/// What is followed: as the file says, else the paper's two models and the parameter of most interest, on the coarsest
/// plan.
pub(super) fn read(
    raw: Option<&RawStopping>,
    models: &[&'static ChoiceModel],
    plans: &[FitPlan],
    cells: &[Cell],
) -> Result<Sequential, Fault> {
    let at = KeyPath::root().key("stopping");
    let plan = plan(raw.and_then(|raw| raw.plan.as_deref()), plans, &at)?;
    let check_every = whole(
        raw.and_then(|raw| raw.check_every),
        CHECK_EVERY,
        &at.key("check_every"),
    )?;
    let minimum = whole(
        raw.and_then(|raw| raw.minimum),
        check_every,
        &at.key("minimum"),
    )?;
    let is_one_part = plan.parts.len() == 1;
    let mut sequential = Sequential {
        plan: plan.id.clone(),
        check_every,
        minimum,
        models: compared(models),
        interval: is_one_part.then(|| key_interval(models, cells)),
        rule: None,
    };
    let Some(raw) = raw else {
        return Ok(sequential);
    };
    match (raw.bayes_factor, &raw.width) {
        (Some(bound), None) => {
            if !(1.0 < bound && bound.is_finite()) {
                return Err(at
                    .key("bayes_factor")
                    .fault(bound, "a finite number above 1"));
            }
            if let Some(names) = &raw.models {
                sequential.models = Some(two(names, models, &at.key("models"))?);
            }
            if sequential.models.is_none() {
                return Err(at.key("bayes_factor").fault(
                    "a study that fits one model",
                    "a study with two models or more in `fit.models`",
                ));
            }
            sequential.rule = Some(StoppingRule::BayesFactor(bound));
        }
        (None, Some(width)) => {
            if raw.models.is_some() {
                return Err(at.key("models").fault(
                    "models beside `width`",
                    "`models` only beside `bayes_factor`",
                ));
            }
            let at = at.key("width");
            if !is_one_part {
                return Err(at.fault(
                    format!("plan `{}` with {} parts", plan.id, plan.parts.len()),
                    "a plan with one part, named by `plan`",
                ));
            }
            sequential.interval = Some(interval(width, models, &at)?);
            if !(0.0 < width.below && width.below.is_finite()) {
                return Err(at
                    .key("below")
                    .fault(width.below, "a finite number above 0"));
            }
            sequential.rule = Some(StoppingRule::Width(width.below));
        }
        (Some(_), Some(_)) => {
            return Err(at.fault("two bounds", "`bayes_factor` or `width`, not both"));
        }
        (None, None) => {
            return Err(at.fault("no bound", "one of `bayes_factor` and `width`"));
        }
    }
    Ok(sequential)
}

/// The plan with this id, or the coarsest one.
fn plan<'a>(id: Option<&str>, plans: &'a [FitPlan], at: &KeyPath) -> Result<&'a FitPlan, Fault> {
    let Some(id) = id else {
        let coarsest = plans.iter().min_by_key(|plan| plan.parts.len());
        return coarsest.ok_or_else(|| at.key("plan").fault("no plan", "at least one plan"));
    };
    plans.iter().find(|plan| plan.id == *id).ok_or_else(|| {
        let known = || plans.iter().map(|plan| plan.id.as_str());
        at.key("plan").fault(
            format!("{}{}", rules::shown(id), did_you_mean(id, known())),
            list(known()),
        )
    })
}

fn whole(raw: Option<u64>, default: u64, at: &KeyPath) -> Result<u64, Fault> {
    match raw {
        Some(0) => Err(at.fault(0, "a whole number, 1 or more")),
        Some(people) => Ok(people),
        None => Ok(default),
    }
}

/// The paper's two where both are fitted, else the richest against the plainest.
fn compared(models: &[&'static ChoiceModel]) -> Option<[&'static ChoiceModel; 2]> {
    let (first, last) = (*models.first()?, *models.last()?);
    if models.contains(&&NOISY_RATIONAL) && models.contains(&&RISK_AWARE) {
        Some([&RISK_AWARE, &NOISY_RATIONAL])
    } else {
        (models.len() > 1).then_some([last, first])
    }
}

fn two(
    names: &[String],
    models: &[&'static ChoiceModel],
    at: &KeyPath,
) -> Result<[&'static ChoiceModel; 2], Fault> {
    let [first, second] = names else {
        return Err(at.fault(format!("{} models", names.len()), "two models"));
    };
    let pair = [
        fitted(first, models, &at.index(0))?,
        fitted(second, models, &at.index(1))?,
    ];
    if pair[0] == pair[1] {
        return Err(at.index(1).fault(
            format!("{} for the second time", rules::shown(second)),
            "another model",
        ));
    }
    Ok(pair)
}

fn fitted(
    name: &str,
    models: &[&'static ChoiceModel],
    at: &KeyPath,
) -> Result<&'static ChoiceModel, Fault> {
    let known = || models.iter().map(|model| model.id);
    models
        .iter()
        .copied()
        .find(|model| model.id == name)
        .ok_or_else(|| {
            at.fault(
                format!("{}{}", rules::shown(name), did_you_mean(name, known())),
                format!("a model that the study fits: {}", list(known())),
            )
        })
}

fn interval(
    raw: &RawWidth,
    models: &[&'static ChoiceModel],
    at: &KeyPath,
) -> Result<KeyInterval, Fault> {
    let model = fitted(&raw.model, models, &at.key("model"))?;
    let known = || {
        let parameters = model.parameters.iter().map(|parameter| parameter.key());
        parameters.chain([TAU])
    };
    if !known().any(|name| name == raw.quantity) {
        return Err(at.key("quantity").fault(
            format!(
                "{}{}",
                rules::shown(&raw.quantity),
                did_you_mean(&raw.quantity, known())
            ),
            list(known()),
        ));
    }
    Ok(KeyInterval {
        model,
        quantity: raw.quantity.clone(),
    })
}

/// How probabilities of losses are weighted where only losses are fitted, else those of gains; the sensitivity where no
/// model weighs probabilities.
fn key_interval(models: &[&'static ChoiceModel], cells: &[Cell]) -> KeyInterval {
    let has_gains = cells
        .iter()
        .filter(|cell| cell.fitted)
        .filter_map(|cell| cell.problem.as_ref())
        .flat_map(|problem| problem.actions())
        .flat_map(|action| action.prospect.outcomes())
        .any(|outcome| outcome.reward > 0.0);
    let weighting = if has_gains {
        Parameter::Gamma
    } else {
        Parameter::Delta
    };
    // The paper's model if it is fitted, else the richest that weighs.
    let weighs = |model: &&&'static ChoiceModel| model.is_free(weighting);
    let model = models
        .iter()
        .filter(weighs)
        .find(|model| ***model == RISK_AWARE)
        .or_else(|| models.iter().rfind(weighs));
    match model {
        Some(model) => KeyInterval {
            model,
            quantity: weighting.key().to_owned(),
        },
        None => KeyInterval {
            model: models.last().copied().unwrap_or(&NOISY_RATIONAL),
            quantity: TAU.to_owned(),
        },
    }
}
