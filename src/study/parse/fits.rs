//! What is made of the answers: reference reward, fit settings, fit plans, and the paper's figures.

use std::collections::BTreeMap;

use super::design::Design;
use super::rules;
use crate::model::{ChoiceModel, MODELS, RiskAwareOptions, model_named};
use crate::study::document::{Fault, KeyPath, did_you_mean, list};
use crate::study::file::{
    RawFit, RawHypothesis, RawMeanSd, RawPaper, RawPlan, RawPrior, RawPriors, RawWeighting,
};
use crate::study::{
    ActionLabel, Cell, FitPlan, FitSettings, Flag, LevelId, MeanSd, PaperFigure, PartId, PlanId,
    PlanPart, PriorChange, Priors, StatedHypothesis, Weighting,
};

/// The id of the only part of a plan that splits by nothing.
const ALL: &str = "all";

/// The numbers of posterior samples that a study may ask for.
const SAMPLES: std::ops::RangeInclusive<usize> = 2..=1_000;

/// The reference reward (models.md, section 4): the file's, or the reward of largest magnitude over all fitted cells,
/// the gain if a gain and a loss tie.
pub(super) fn reference_reward(given: Option<f64>, cells: &[Cell]) -> Result<f64, Fault> {
    let at = KeyPath::root().key("reference_reward");
    if let Some(reward) = given {
        return if reward != 0.0 && reward.is_finite() {
            Ok(reward)
        } else {
            Err(at.fault(reward, "a finite number other than 0"))
        };
    }
    let problems = || {
        cells
            .iter()
            .filter(|cell| cell.fitted)
            .filter_map(|cell| cell.problem.as_ref())
    };
    if problems().next().is_none() {
        let allowed = "at least one question that is fitted";
        return Err(KeyPath::root()
            .key("block")
            .fault("no question that is fitted", allowed));
    }
    problems()
        .flat_map(|problem| problem.actions())
        .flat_map(|action| action.prospect.outcomes())
        .map(|outcome| outcome.reward)
        .max_by(|left, right| {
            left.abs()
                .total_cmp(&right.abs())
                .then(left.total_cmp(right))
        })
        .filter(|reward| *reward != 0.0)
        .ok_or_else(|| {
            at.fault(
                "rewards that are all 0",
                "a reward other than 0 in some fitted question",
            )
        })
}

/// How the models are fitted.
pub(super) fn settings(raw: &RawFit) -> Result<FitSettings, Fault> {
    let at = KeyPath::root().key("fit");
    let defaults = FitSettings::default();
    let samples = raw.samples.unwrap_or(defaults.samples);
    if !SAMPLES.contains(&samples) {
        let allowed = format!(
            "a whole number from {} to {}",
            SAMPLES.start(),
            SAMPLES.end()
        );
        return Err(at.key("samples").fault(samples, allowed));
    }
    let models = match &raw.models {
        Some(names) => models(names, &at.key("models"))?,
        None => defaults.models,
    };
    Ok(FitSettings {
        models,
        samples,
        weighting: match raw.weighting {
            RawWeighting::Monotone => Weighting::Monotone,
            RawWeighting::PaperRange => Weighting::PaperRange,
        },
        options: RiskAwareOptions {
            normalise: raw.normalise.unwrap_or(defaults.options.normalise),
            zero: raw.zero,
            weighting_function: defaults.options.weighting_function,
        },
        priors: priors(&raw.priors, &at.key("priors"))?,
    })
}

/// The priors of the table at `at`.
pub(super) fn priors(raw: &RawPriors, at: &KeyPath) -> Result<Priors, Fault> {
    let share = |name: &str, raw: Option<RawPrior>| prior(raw, true, &at.key(name));
    let scale = |name: &str, raw: Option<RawPrior>| prior(raw, false, &at.key(name));
    Ok(Priors {
        alpha: share("alpha", raw.alpha)?,
        beta: share("beta", raw.beta)?,
        gamma: share("gamma", raw.gamma)?,
        delta: share("delta", raw.delta)?,
        lambda: scale("lambda", raw.lambda)?,
        tau: scale("tau", raw.tau)?,
        eta_gain: scale("eta_gain", raw.eta_gain)?,
        eta_loss: scale("eta_loss", raw.eta_loss)?,
    })
}

/// The models with these ids, each once.
fn models(names: &[String], at: &KeyPath) -> Result<Vec<&'static ChoiceModel>, Fault> {
    if names.is_empty() {
        return Err(at.fault("no model", format!("at least one of {}", known_models())));
    }
    let mut models: Vec<&'static ChoiceModel> = Vec::with_capacity(names.len());
    for (index, name) in names.iter().enumerate() {
        let at = at.index(index);
        let model = model_named(name).map_err(|_| {
            let meant = did_you_mean(name, MODELS.iter().map(|model| model.id));
            at.fault(format!("{}{meant}", rules::shown(name)), known_models())
        })?;
        if models.contains(&model) {
            return Err(at.fault(
                format!("{} for the second time", rules::shown(name)),
                "each model once",
            ));
        }
        models.push(model);
    }
    Ok(models)
}

fn known_models() -> String {
    list(MODELS.iter().map(|model| model.id))
}

/// Whom the analysis leaves out, by the names of flags.
pub(super) fn exclude(raw: &[String]) -> Result<Vec<Flag>, Fault> {
    let at = KeyPath::root().key("analysis").key("exclude");
    let mut flags = Vec::new();
    for (index, name) in raw.iter().enumerate() {
        let found = Flag::named(name).filter(|flag| flag.can_exclude());
        let flag = found.ok_or_else(|| {
            let allowed = Flag::ALL.into_iter().filter(|flag| flag.can_exclude());
            at.index(index).fault(
                rules::shown(name),
                format!("one of {}", list(allowed.map(Flag::as_str))),
            )
        })?;
        if flags.contains(&flag) {
            let fault = at.index(index).fault(rules::shown(name), "each flag once");
            return Err(fault);
        }
        flags.push(flag);
    }
    Ok(flags)
}

/// How many people must have finished before results are shown.
pub(super) fn blind_until(raw: Option<u64>) -> Result<Option<u64>, Fault> {
    match raw {
        Some(0) => Err(KeyPath::root().key("analysis").key("blind_until").fault(
            0,
            "a whole number, 1 or more; leave it out to show results from the start",
        )),
        Some(_) | None => Ok(raw),
    }
}

/// The study's hypothesis, about two of the models that it fits.
pub(super) fn hypothesis(
    raw: &RawHypothesis,
    models: &[&'static ChoiceModel],
) -> Result<StatedHypothesis, Fault> {
    let at = KeyPath::root().key("analysis").key("hypothesis");
    rules::line(&raw.id, &at.key("id"))?;
    rules::line(&raw.statement, &at.key("statement"))?;
    let fitted = |name: &str, at: KeyPath| {
        let found = models.iter().copied().find(|model| model.id == name);
        found.ok_or_else(|| {
            let ids = list(models.iter().map(|model| model.id));
            at.fault(
                rules::shown(name),
                format!("one of the fitted models: {ids}"),
            )
        })
    };
    let better = fitted(&raw.better, at.key("better"))?;
    let than = fitted(&raw.than, at.key("than"))?;
    if better == than {
        return Err(at
            .key("than")
            .fault(rules::shown(&raw.than), "another model than `better`"));
    }
    Ok(StatedHypothesis {
        id: raw.id.clone(),
        statement: raw.statement.clone(),
        better,
        than,
    })
}

/// The prior of a parameter, which lies in [0, 1] if it `is_share`, else at 0 or above.
fn prior(
    raw: Option<RawPrior>,
    is_share: bool,
    at: &KeyPath,
) -> Result<Option<PriorChange>, Fault> {
    let Some(raw) = raw else { return Ok(None) };
    match raw {
        RawPrior::Uniform([low, high]) => {
            let highest = if is_share { 1.0 } else { f64::MAX };
            if 0.0 <= low && low < high && high <= highest {
                return Ok(Some(PriorChange::Uniform { low, high }));
            }
            let allowed = if is_share {
                "two numbers from 0 to 1, the smaller first"
            } else {
                "two numbers, 0 or more, the smaller first"
            };
            Err(at.key("uniform").fault(format!("[{low}, {high}]"), allowed))
        }
        RawPrior::LogNormal(_) if is_share => Err(at.fault(
            "`log_normal` for a parameter that lies between 0 and 1",
            "`uniform = [a, b]`",
        )),
        RawPrior::LogNormal(raw) => {
            let at = at.key("log_normal");
            for (name, number) in [("median", raw.median), ("log_sd", raw.log_sd)] {
                if !(0.0 < number && number.is_finite()) {
                    return Err(at.key(name).fault(number, "a finite number above 0"));
                }
            }
            Ok(Some(PriorChange::LogNormal {
                median: raw.median,
                log_sd: raw.log_sd,
            }))
        }
    }
}

/// The fit plans; without any in the file, one that fits all cells together.
pub(super) fn plans(
    raw: &[RawPlan],
    design: &Design<'_>,
    cells: &[Cell],
) -> Result<Vec<FitPlan>, Fault> {
    if raw.is_empty() {
        return Ok(vec![FitPlan {
            id: PlanId::from(ALL),
            label: "All cells together".to_owned(),
            parts: parts(&[], design, cells),
        }]);
    }
    let list = KeyPath::root().key("fit").key("plan");
    rules::distinct_ids(raw.iter().map(|plan| plan.id.as_str()), &list, "plan")?;
    let mut plans = Vec::with_capacity(raw.len());
    for (index, plan) in raw.iter().enumerate() {
        let at = list.index(index);
        rules::line(&plan.label, &at.key("label"))?;
        let mut by = Vec::with_capacity(plan.by.len());
        for (index, factor) in plan.by.iter().enumerate() {
            let at = at.key("by").index(index);
            let position = design.factor(factor, &at)?;
            if by.contains(&position) {
                return Err(at.fault(
                    format!("{} for the second time", rules::shown(factor)),
                    "each factor once",
                ));
            }
            by.push(position);
        }
        by.sort_unstable();
        plans.push(FitPlan {
            id: PlanId::from(plan.id.as_str()),
            label: plan.label.clone(),
            parts: parts(&by, design, cells),
        });
    }
    Ok(plans)
}

/// The fitted cells split by the factors at the positions `by`.
fn parts(by: &[usize], design: &Design<'_>, cells: &[Cell]) -> Vec<PlanPart> {
    let mut parts: Vec<PlanPart> = Vec::new();
    for (index, cell) in cells.iter().enumerate().filter(|(_, cell)| cell.fitted) {
        // A cell's levels stand in factor order, one per factor.
        let shared: Vec<(usize, &LevelId)> = by
            .iter()
            .map(|factor| (*factor, &cell.levels[*factor].1))
            .collect();
        let id = if by.is_empty() {
            PartId::from(ALL)
        } else {
            PartId::from(
                shared
                    .iter()
                    .map(|(_, level)| level.as_str())
                    .collect::<Vec<_>>()
                    .join("/"),
            )
        };
        match parts.iter_mut().find(|part| part.id == id) {
            Some(part) => part.cells.push(index),
            None => parts.push(PlanPart {
                id,
                label: part_label(&shared, design),
                cells: vec![index],
            }),
        }
    }
    parts
}

fn part_label(shared: &[(usize, &LevelId)], design: &Design<'_>) -> String {
    if shared.is_empty() {
        return "All cells".to_owned();
    }
    let labels: Vec<&str> = shared
        .iter()
        .flat_map(|(factor, id)| {
            design.factors()[*factor]
                .levels
                .iter()
                .filter(move |level| level.id == **id)
        })
        .map(|level| level.label.as_str())
        .collect();
    labels.join(" · ")
}

/// The source paper's figures.
pub(super) fn paper(
    raw: &[RawPaper],
    design: &Design<'_>,
    cells: &[Cell],
) -> Result<Vec<PaperFigure>, Fault> {
    let list = KeyPath::root().key("paper");
    raw.iter()
        .enumerate()
        .map(|(index, figure)| {
            let at = list.index(index);
            rules::line(&figure.label, &at.key("label"))?;
            Ok(PaperFigure {
                label: figure.label.clone(),
                levels: design.named(&design.levels(&figure.levels, &at.key("levels"))?),
                risk_aware: mean_sd(figure.risk_aware, &at.key("risk_aware"))?,
                noisy_rational: mean_sd(figure.noisy_rational, &at.key("noisy_rational"))?,
                t: figure.t,
                df: figure.df,
                p: figure.p.clone(),
                n: figure.n,
                choices: published_choices(&figure.choices, cells, &at.key("choices"))?,
                source: figure.source.clone(),
            })
        })
        .collect()
}

/// How often each action was taken in the source study, in the order of the study's actions.
fn published_choices(
    raw: &BTreeMap<String, u32>,
    cells: &[Cell],
    at: &KeyPath,
) -> Result<Vec<(ActionLabel, u32)>, Fault> {
    let mut actions: Vec<&ActionLabel> = Vec::new();
    for action in cells.iter().flat_map(|cell| &cell.actions) {
        if !actions.contains(&action) {
            actions.push(action);
        }
    }
    let names = || actions.iter().map(|action| action.id.as_str());
    for id in raw.keys() {
        if !names().any(|name| name == id) {
            let found = format!(
                "unknown action {}{}",
                rules::shown(id),
                did_you_mean(id, names())
            );
            return Err(at.key(id).fault(found, format!("one of {}", list(names()))));
        }
    }
    if !raw.is_empty() && raw.values().all(|count| *count == 0) {
        return Err(at.fault("no choice at all", "at least one, or no `choices`"));
    }
    Ok(actions
        .iter()
        .filter_map(|action| Some(((*action).clone(), *raw.get(action.id.as_str())?)))
        .collect())
}

fn mean_sd(raw: Option<RawMeanSd>, at: &KeyPath) -> Result<Option<MeanSd>, Fault> {
    let Some(RawMeanSd { mean, sd }) = raw else {
        return Ok(None);
    };
    if !mean.is_finite() {
        return Err(at.key("mean").fault(mean, "a finite number"));
    }
    if !(0.0 <= sd && sd.is_finite()) {
        return Err(at.key("sd").fault(sd, "a finite number, 0 or more"));
    }
    Ok(Some(MeanSd { mean, sd }))
}
