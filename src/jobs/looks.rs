//! How the evidence of a study grew: a look at the answers of the first people who finished, then of more of them.

use std::{collections::BTreeMap, ops::ControlFlow};

use serde::Serialize;
use tokio_util::sync::CancellationToken;

use super::{
    StudyCounts,
    fit_input::{FitInput, hash_of},
};
use crate::{
    inference::{
        FitError, FitSummary, fit,
        sequential::{Bound, Look, drawn, interval, ln_bayes_factor, looks, people_at},
    },
    model::ChoiceModel,
    store::{AnswerStatus, CellCount, Checkpoint, LookCount, ProblemId, Stopping},
    study::{ActionId, FitPlan, Sequential, StoppingRule, Study, Timestamp},
};

/// How many looks are shown, and the latest: as many as can be told apart.
const SHOWN: u64 = 40;

/// How the evidence of a study grew.
#[derive(Debug, Clone, PartialEq)]
pub struct SequentialEvidence {
    /// The looks that are shown, by the number of people.
    pub looks: Vec<Look>,
    /// That the study's rule was reached, and when.
    pub reached: Option<RuleReached>,
    /// A look that is due is still being made.
    pub is_behind: bool,
}

/// The first look that reached the study's rule for stopping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RuleReached {
    /// How many people had finished.
    pub n: u64,
    /// The Bayes factor or the width there.
    pub value: f64,
    /// When this was found.
    pub at: Timestamp,
}

/// A study's rule as it is stored and exported.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RuleText<'a> {
    /// The plan whose fits are followed.
    pub plan: &'a str,
    /// People between two looks.
    pub check_every: u64,
    /// People before the first look.
    pub minimum: u64,
    /// The bound on the Bayes factor, in favour of either of `models`.
    pub bayes_factor: Option<f64>,
    /// The two models, the first against the second.
    #[schema(value_type = Option<[String; 2]>)]
    pub models: Option<[&'a str; 2]>,
    /// The bound on the width of the 90 % interval of `quantity` in `model`.
    pub width_below: Option<f64>,
    /// The model.
    #[schema(value_type = Option<String>)]
    pub model: Option<&'a str>,
    /// The quantity.
    #[schema(value_type = Option<String>)]
    pub quantity: Option<&'a str>,
}

impl<'a> RuleText<'a> {
    /// The rule; none where the study has no rule.
    pub fn new(sequential: &'a Sequential) -> Option<Self> {
        let mut text = Self {
            plan: sequential.plan.as_str(),
            check_every: sequential.check_every,
            minimum: sequential.minimum,
            bayes_factor: None,
            models: None,
            width_below: None,
            model: None,
            quantity: None,
        };
        match sequential.rule? {
            StoppingRule::BayesFactor(bound) => {
                text.bayes_factor = Some(bound);
                text.models = sequential.models.map(|models| models.map(|model| model.id));
            }
            StoppingRule::Width(below) => {
                let interval = sequential.interval.as_ref();
                text.width_below = Some(below);
                text.model = interval.map(|interval| interval.model.id);
                text.quantity = interval.map(|interval| interval.quantity.as_str());
            }
        }
        Some(text)
    }

    /// Under what it is stored that the rule was reached in a study of this design.
    fn hash(&self, design: &str) -> String {
        let Self {
            plan,
            check_every,
            minimum,
            bayes_factor,
            models,
            width_below,
            model,
            quantity,
        } = self;
        let text = format!(
            "{plan} {check_every} {minimum} {bayes_factor:?} {models:?} {width_below:?} {model:?} {quantity:?}"
        );
        hash_of([text.as_str(), design].into_iter())
    }
}

/// The bound of a rule.
pub(super) fn bound(rule: StoppingRule) -> Bound {
    match rule {
        StoppingRule::BayesFactor(bound) => Bound::BayesFactor(bound),
        StoppingRule::Width(below) => Bound::Width(below),
    }
}

/// The looks of one study.
#[derive(Debug)]
pub(super) struct Looks<'a> {
    study: &'a Study,
    sequential: &'a Sequential,
    plan: &'a FitPlan,
    models: Vec<&'static ChoiceModel>,
    /// Of everything that looks depend on but the answers.
    settings_hash: String,
    /// The same without the program: a rule that was reached stays so when the program is replaced.
    design_hash: String,
}

/// A look that can be made.
#[derive(Debug)]
pub(super) struct LookInput {
    pub(super) n: u64,
    pub(super) hash: String,
    models: Option<[&'static ChoiceModel; 2]>,
    interval: Option<(&'static ChoiceModel, String)>,
    inputs: Vec<FitInput>,
}

impl<'a> Looks<'a> {
    /// None where nothing is followed.
    pub(super) fn new(study: &'a Study) -> Option<Self> {
        let sequential = study.sequential();
        let plan = study
            .plans()
            .iter()
            .find(|plan| plan.id == sequential.plan)?;
        let mut models: Vec<&'static ChoiceModel> =
            sequential.models.into_iter().flatten().collect();
        if let Some(interval) = &sequential.interval
            && !models.contains(&interval.model)
        {
            models.push(interval.model);
        }
        let nobody = FitInput::of_plan(study, plan, &models, &StudyCounts::new(study, &[]));
        let settings_hash = hash_of(nobody.iter().map(|input| input.hash.as_str()));
        let designs: Vec<String> = nobody
            .iter()
            .map(|input| input.design_hash(study.id()))
            .collect();
        (!models.is_empty()).then_some(Self {
            study,
            sequential,
            plan,
            models,
            settings_hash,
            design_hash: hash_of(designs.iter().map(String::as_str)),
        })
    }

    /// Under what it is stored that the study's rule was reached: other rules, problems or priors have to reach it
    /// anew. None where the study has no rule.
    pub(super) fn rule_hash(&self) -> Option<String> {
        Some(RuleText::new(self.sequential)?.hash(&self.design_hash))
    }

    /// How many looks there have been once so many people have finished.
    pub(super) fn count(&self, people: u64) -> u64 {
        looks(people, self.sequential.minimum, self.sequential.check_every)
    }

    /// The looks that are made: while a rule has not been reached all of them, else those that are shown.
    pub(super) fn wanted(&self, people: u64, is_reached: bool) -> Vec<u64> {
        let count = self.count(people);
        if self.sequential.rule.is_some() && !is_reached {
            (0..count).collect()
        } else {
            drawn(count, SHOWN)
        }
    }

    /// What the looks depend on, given what people chose in the order in which they finished.
    pub(super) fn inputs(&self, wanted: &[u64], chosen: &[LookCount]) -> Vec<LookInput> {
        let mut counts: BTreeMap<(ProblemId, &ActionId), CellCount> = BTreeMap::new();
        let mut chosen = chosen.iter().peekable();
        let mut inputs = Vec::with_capacity(wanted.len());
        for &look in wanted {
            while let Some(row) = chosen.next_if(|row| row.look <= look) {
                let count = counts
                    .entry((row.problem, &row.action))
                    .or_insert_with(|| CellCount {
                        problem: row.problem,
                        cell: row.cell.clone(),
                        hash: row.hash.clone(),
                        status: AnswerStatus::Answered,
                        action: Some(row.action.clone()),
                        n_before_exclusions: 0,
                        n_all: 0,
                        n_completed: 0,
                    });
                count.n_before_exclusions += row.n;
                count.n_all += row.n;
                count.n_completed += row.n;
            }
            let rows: Vec<CellCount> = counts.values().cloned().collect();
            let counts = StudyCounts::new(self.study, &rows);
            inputs.push(self.input(look, &counts));
        }
        inputs
    }

    fn input(&self, look: u64, counts: &StudyCounts) -> LookInput {
        let Sequential {
            check_every,
            minimum,
            ..
        } = *self.sequential;
        let inputs = FitInput::of_plan(self.study, self.plan, &self.models, counts);
        let answers = hash_of(inputs.iter().map(|input| input.hash.as_str()));
        LookInput {
            n: people_at(look, minimum, check_every),
            hash: format!("{}-{answers}", self.settings_hash),
            models: self.sequential.models,
            interval: self
                .sequential
                .interval
                .as_ref()
                .map(|interval| (interval.model, interval.quantity.clone())),
            inputs,
        }
    }

    /// What a page shows of the stored looks once so many people have finished.
    pub(super) fn evidence(
        &self,
        people: u64,
        stored: &[Checkpoint],
        reached: Option<Stopping>,
    ) -> SequentialEvidence {
        let mut shown: Vec<u64> = drawn(self.count(people), SHOWN)
            .into_iter()
            .map(|look| people_at(look, self.sequential.minimum, self.sequential.check_every))
            .collect();
        let latest = shown.last().copied();
        if let Some(reached) = &reached
            && let Err(place) = shown.binary_search(&reached.n)
        {
            shown.insert(place, reached.n);
        }
        let looks: Vec<Look> = stored
            .iter()
            .filter(|row| shown.contains(&row.n) && row.input_hash.starts_with(&self.settings_hash))
            .filter_map(|row| serde_json::from_str(&row.result).ok())
            .collect();
        SequentialEvidence {
            is_behind: latest.is_some_and(|n| looks.iter().all(|look| look.n != n)),
            looks,
            reached: reached.map(|reached| RuleReached {
                n: reached.n,
                value: reached.value,
                at: reached.reached_at,
            }),
        }
    }
}

impl LookInput {
    /// Makes the look from fits that start from nothing, so that it can be repeated.
    pub(super) fn look(&self, stop: &CancellationToken) -> Result<Look, FitError> {
        let mut fits: Vec<(&'static ChoiceModel, FitSummary)> = Vec::new();
        for input in &self.inputs {
            let mut watch = |_| {
                if stop.is_cancelled() {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            };
            let fit = fit(input.model, &input.data, &input.settings, &mut watch)?;
            fits.push((input.model, fit.summary));
        }
        let of = |model: &'static ChoiceModel| {
            let of_model = fits.iter().filter(move |(known, _)| *known == model);
            of_model.map(|(_, summary)| summary)
        };
        // Every model is fitted to the same answers: those of the first one tell how many there are.
        let first = self.inputs.first().map(|input| input.model);
        Ok(Look {
            n: self.n,
            answers: self
                .inputs
                .iter()
                .filter(|input| Some(input.model) == first)
                .map(|input| input.data.n())
                .sum(),
            ln_bayes_factor: self
                .models
                .and_then(|[first, second]| ln_bayes_factor(of(first), of(second))),
            interval: self
                .interval
                .as_ref()
                .and_then(|(model, quantity)| interval(of(model).next()?, quantity)),
        })
    }
}
