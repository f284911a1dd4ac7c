//! What a fit depends on: the answers, the problems, the settings, a seed. Equal inputs make equal fits.

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::StudyCounts;
use crate::{
    inference::{
        ChoiceData, FitSettings, FittedProblem, PAPER_RANGE_FLOOR, Prior, Priors, WEIGHTING_FLOOR,
    },
    model::{ChoiceModel, ChoiceProblem, OrderedMap},
    store::{Fit, FitKey},
    study::{self, CellId, FitPlan, PartId, PlanId, PriorChange, Study, StudyId},
};

/// Where all seeds come from: fixed, so that the same answers give the same draws on every server.
const SEED_SPACE: &str = "riskaware live fit";
const COMPARISON_SEED_SPACE: &str = "riskaware comparison";

/// The version of this program: another one may draw other numbers from the same input.
pub(super) const PROGRAM_VERSION: &str = env!("CARGO_PKG_VERSION");

/// One model's fit to one part of a plan, ready to be run.
#[derive(Debug, Clone)]
pub(super) struct FitInput {
    pub(super) plan: PlanId,
    pub(super) part: PartId,
    /// The part's text on pages.
    pub(super) label: String,
    pub(super) cells: Vec<CellId>,
    /// The time limits of the cells, in their order: under another one people answer another question.
    pub(super) limits: Vec<Option<u64>>,
    pub(super) model: &'static ChoiceModel,
    pub(super) data: ChoiceData,
    pub(super) settings: FitSettings,
    /// Of everything above and of the program's version.
    pub(super) hash: String,
}

#[derive(Serialize)]
struct Canonical<'a> {
    program: &'a str,
    study: &'a StudyId,
    plan: &'a PlanId,
    part: &'a PartId,
    model: &'a str,
    problems: OrderedMap<ChoiceProblem>,
    #[serde(skip_serializing_if = "is_without_limits")]
    limits: &'a [Option<u64>],
    counts: &'a [Vec<u64>],
    settings: &'a FitSettings,
}

fn is_without_limits(limits: &&[Option<u64>]) -> bool {
    limits.iter().all(Option::is_none)
}

impl FitInput {
    /// Every model of the study with every part of every plan, in file order.
    pub(super) fn all(study: &Study, counts: &StudyCounts) -> Vec<Self> {
        let plans = study.plans().iter();
        plans
            .flat_map(|plan| Self::of_plan(study, plan, study.models(), counts))
            .collect()
    }

    /// These models with every part of a plan, in file order.
    pub(super) fn of_plan(
        study: &Study,
        plan: &FitPlan,
        models: &[&'static ChoiceModel],
        counts: &StudyCounts,
    ) -> Vec<Self> {
        let mut inputs = Vec::new();
        for part in &plan.parts {
            for model in models {
                inputs.extend(Self::new(study, &plan.id, part, model, counts));
            }
        }
        inputs
    }

    fn new(
        study: &Study,
        plan: &PlanId,
        part: &study::PlanPart,
        model: &'static ChoiceModel,
        counts: &StudyCounts,
    ) -> Option<Self> {
        let cells = part
            .cells
            .iter()
            .map(|&index| (&study.cells()[index], &counts.cells[index]));
        let ((problems, limits), counts): ((Vec<_>, Vec<_>), Vec<_>) = cells
            .filter_map(|(cell, counts)| {
                let problem = FittedProblem {
                    id: cell.id.to_string(),
                    problem: cell.problem.clone()?,
                };
                Some(((problem, cell.limit_ms), counts.actions.clone()))
            })
            .unzip();
        let cells = problems
            .iter()
            .map(|problem| CellId::from(problem.id.as_str()))
            .collect();
        let data = ChoiceData::from_counts(problems, counts).ok()?;
        let mut input = Self {
            plan: plan.clone(),
            part: part.id.clone(),
            label: part.label.clone(),
            cells,
            limits,
            model,
            data,
            settings: fit_settings(study, seed(study.id(), plan, &part.id, model)),
            hash: String::new(),
        };
        input.hash = input.hash_of(study.id());
        Some(input)
    }

    /// The problems with their names, in order.
    pub(super) fn problems(&self) -> OrderedMap<ChoiceProblem> {
        self.data
            .problems()
            .iter()
            .map(|problem| (problem.id.clone(), problem.problem.clone()))
            .collect()
    }

    /// Under what it is stored.
    pub(super) fn key(&self) -> FitKey {
        FitKey {
            plan: self.plan.clone(),
            part: self.part.clone(),
            model: self.model.id.to_owned(),
        }
    }

    /// Whether a stored fit is one of this part and model, of whatever answers.
    pub(super) fn is_of(&self, fit: &Fit) -> bool {
        fit.key == self.key()
    }

    fn hash_of(&self, study: &StudyId) -> String {
        self.hash_with(study, PROGRAM_VERSION, self.data.totals(), &self.settings)
    }

    /// The hash of what the study asks, and of the priors and options under which it is judged: neither the answers, nor
    /// the program, nor how long its chains are.
    pub(super) fn design_hash(&self, study: &StudyId) -> String {
        let judged_by = FitSettings {
            chains: 0,
            draws: 0,
            samples: 0,
            seed: 0,
            ..self.settings.clone()
        };
        self.hash_with(study, "", &[], &judged_by)
    }

    fn hash_with(
        &self,
        study: &StudyId,
        program: &str,
        counts: &[Vec<u64>],
        settings: &FitSettings,
    ) -> String {
        let canonical = Canonical {
            program,
            study,
            plan: &self.plan,
            part: &self.part,
            model: self.model.id,
            problems: self.problems(),
            limits: &self.limits,
            counts,
            settings,
        };
        let text = serde_json::to_vec(&canonical)
            .expect("plain data with text keys always turns into JSON");
        data_encoding::HEXLOWER.encode(&Sha256::digest(text))
    }
}

/// The first 53 bits of SHA-256 over the names: a seed that every reader of JSON shows exactly.
fn seed(study: &StudyId, plan: &PlanId, part: &PartId, model: &ChoiceModel) -> u64 {
    seed_of(&[
        SEED_SPACE,
        study.as_str(),
        plan.as_str(),
        part.as_str(),
        model.id,
    ])
}

/// The seed of a plan's comparison.
pub(super) fn comparison_seed(study: &StudyId, plan: &PlanId) -> u64 {
    seed_of(&[COMPARISON_SEED_SPACE, study.as_str(), plan.as_str()])
}

/// One hash over several.
pub(super) fn hash_of<'a>(hashes: impl Iterator<Item = &'a str>) -> String {
    let mut all = Sha256::new();
    for hash in hashes {
        all.update(hash);
        all.update([0]);
    }
    data_encoding::HEXLOWER.encode(&all.finalize())
}

fn seed_of(names: &[&str]) -> u64 {
    let hash = Sha256::digest(names.join("\0"));
    let first = hash
        .iter()
        .take(8)
        .fold(0_u64, |number, &byte| number << 8 | u64::from(byte));
    first >> 11
}

/// The settings with which the models are fitted to a study's choices.
pub fn fit_settings(study: &Study, seed: u64) -> FitSettings {
    let wanted = study.fit();
    let priors = Priors::with_weighting_floor(match wanted.weighting {
        study::Weighting::Monotone => WEIGHTING_FLOOR,
        study::Weighting::PaperRange => PAPER_RANGE_FLOOR,
    });
    FitSettings {
        priors: changed_priors(priors, &wanted.priors),
        options: wanted.options,
        reference_reward: Some(study.reference_reward()),
        samples: wanted.samples,
        seed,
        ..FitSettings::default()
    }
}

/// Priors with those replaced that a file names.
pub fn changed_priors(mut priors: Priors, changes: &study::Priors) -> Priors {
    for (prior, change) in [
        (&mut priors.alpha, changes.alpha),
        (&mut priors.beta, changes.beta),
        (&mut priors.gamma, changes.gamma),
        (&mut priors.delta, changes.delta),
        (&mut priors.lambda, changes.lambda),
        (&mut priors.tau, changes.tau),
        (&mut priors.eta_gain, changes.eta_gain),
        (&mut priors.eta_loss, changes.eta_loss),
    ] {
        match change {
            None => {}
            Some(PriorChange::Uniform { low, high }) => *prior = Prior::Uniform { low, high },
            Some(PriorChange::LogNormal { median, log_sd }) => {
                *prior = Prior::LogNormal { median, log_sd }
            }
        }
    }
    priors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{jobs::QuestionCounts, study::built_in};

    fn driving() -> Study {
        let (name, text) = built_in()[0];
        Study::parse(name, text).unwrap()
    }

    fn counts(study: &Study, of_cell: impl Fn(usize) -> u64) -> StudyCounts {
        let cells = study.cells().iter().enumerate().map(|(index, cell)| {
            let actions = (0..cell.actions.len())
                .map(|action| of_cell(index) * action as u64)
                .collect();
            QuestionCounts {
                actions,
                ..QuestionCounts::default()
            }
        });
        StudyCounts {
            cells: cells.collect(),
            baseline: Vec::new(),
        }
    }

    #[test]
    fn the_hash_follows_the_answers_of_the_part_alone() {
        let study = driving();
        let before = FitInput::all(&study, &counts(&study, |_| 5));
        let changed = study.cells().iter().position(|cell| cell.fitted).unwrap();
        let after = FitInput::all(
            &study,
            &counts(&study, |index| if index == changed { 6 } else { 5 }),
        );
        let mut moved = 0;
        for (before, after) in before.iter().zip(&after) {
            let has_cell = before.cells.contains(&study.cells()[changed].id);
            assert_eq!(
                before.hash != after.hash,
                has_cell,
                "{} {}",
                before.plan,
                before.part
            );
            assert_eq!(before.settings.seed, after.settings.seed);
            moved += usize::from(has_cell);
        }
        assert_eq!(moved, study.plans().len() * study.models().len());
    }

    #[test]
    fn each_fit_has_a_seed_of_its_own() {
        let study = driving();
        let inputs = FitInput::all(&study, &counts(&study, |_| 1));
        let seeds: std::collections::BTreeSet<u64> =
            inputs.iter().map(|input| input.settings.seed).collect();
        assert_eq!(seeds.len(), inputs.len());
        assert!(seeds.iter().all(|&seed| seed < 1 << 53));
    }
}
