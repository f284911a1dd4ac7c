//! Everything that is asked of a plan's models, by one call.

use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use super::bayes_factor::{BayesFactor, EvidenceRow, ln_evidence, sensitivity};
use super::bootstrap::{Bootstrap, BootstrapSettings, participant_bootstrap};
use super::held_out::{Exam, HeldOut, HeldOutSettings};
use super::ladder::{LadderStep, Rung, ladder};
use super::leave_one_out::{LeaveOneOut, LeaveOneOutDifference, Scored, leave_one_out};
use super::plan::{PlanData, Unit};
use super::pointwise::PartFit;
use super::score::ScoreDifference;
use crate::inference::{Estimate, FitError, FitSettings, fit};
use crate::model::{ChoiceModel, OrderedMap};

/// A comparison of models over one plan of one study. In JSON numbers that do not exist are `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = ModelComparison)]
pub struct Comparison {
    /// What was left out and resampled as one.
    pub unit: Unit,
    /// How many units there are.
    pub units: u64,
    /// How many answers.
    pub n: u64,
    /// The parts that were fitted apart.
    pub parts: Vec<String>,
    /// Each model by itself, in the order given: from the simplest to the richest.
    #[schema(value_type = HashMap<String, ModelScores>)]
    pub models: OrderedMap<ModelScores>,
    /// Every two models, the later one of the order first.
    pub pairs: Vec<Pair>,
    /// Predictions of problems from other problems; missing if not asked for, or no part has two problems with answers.
    pub held_out: Option<HeldOut>,
    /// Chance, then each model, with what each gains; empty if nothing was left out.
    pub ladder: Vec<LadderStep>,
}

impl Comparison {
    /// Two models' figures, and 1 if positive ones speak for `better`, −1 if negative ones do.
    pub fn pair(&self, better: &str, than: &str) -> Option<(&Pair, f64)> {
        self.pairs.iter().find_map(|pair| {
            if (pair.first.as_str(), pair.second.as_str()) == (better, than) {
                Some((pair, 1.0))
            } else if (pair.first.as_str(), pair.second.as_str()) == (than, better) {
                Some((pair, -1.0))
            } else {
                None
            }
        })
    }
}

/// One model's scores.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ModelScores {
    /// The model's name for people.
    pub label: String,
    /// Whether the fits of all parts converged; if not, nothing else is given.
    pub converged: bool,
    /// How well it predicts a unit that was left out.
    pub leave_one_out: Option<LeaveOneOut>,
    /// ln marginal likelihood, the sum over parts.
    pub log_marginal_likelihood: Option<Estimate>,
    /// Intervals over resampled people, by part; missing if not asked for.
    #[schema(value_type = Option<HashMap<String, Bootstrap>>)]
    pub bootstrap: Option<OrderedMap<Bootstrap>>,
}

/// What speaks for one model against another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = ModelPair)]
pub struct Pair {
    /// The model that positive figures speak for.
    pub first: String,
    /// The model that negative figures speak for.
    pub second: String,
    /// Difference in expected log score of units left out.
    pub leave_one_out: Option<LeaveOneOutDifference>,
    /// Ratio of marginal likelihoods.
    pub bayes_factor: Option<BayesFactor>,
    /// Difference in expected log score of problems held out.
    pub held_out: Option<ScoreDifference>,
}

/// What a comparison holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ComparisonSettings {
    /// Leave one unit out at a time.
    pub leave_one_out: bool,
    /// Repeat Bayes factors under other priors; each row fits every model again.
    pub sensitivity: bool,
    /// Predict problems from others; each fold fits every model again.
    pub held_out: Option<HeldOutSettings>,
    /// Intervals over resampled people; most resamples are a fit.
    pub bootstrap: Option<BootstrapSettings>,
}

impl ComparisonSettings {
    /// What can be had of existing fits at once: Bayes factors.
    pub const LIVE: Self = Self {
        leave_one_out: false,
        sensitivity: false,
        held_out: None,
        bootstrap: None,
    };

    /// What is cheap: Bayes factors and leave-one-out.
    pub const BRIEF: Self = Self {
        leave_one_out: true,
        ..Self::LIVE
    };

    /// Everything that a verdict needs: also problems held out, with the folds of `seed`, and other priors.
    pub fn full(seed: u64) -> Self {
        let held_out = HeldOutSettings {
            seed,
            ..HeldOutSettings::default()
        };
        Self {
            sensitivity: true,
            held_out: Some(held_out),
            ..Self::BRIEF
        }
    }
}

/// A fit that exists already and need not be made again: of the answers of that part, under the settings given.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownFit {
    /// Which part of the plan.
    pub part: usize,
    /// The fit.
    pub fit: PartFit,
}

/// What a comparison is busy with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ComparisonProgress {
    /// Fits that were not given are made.
    Fitting(&'static ChoiceModel),
    /// Units are left out.
    LeavingOut(&'static ChoiceModel),
    /// Priors are changed.
    ChangingPriors(&'static ChoiceModel),
    /// Problems are held out.
    HoldingOut(&'static ChoiceModel),
    /// People are resampled.
    Resampling(&'static ChoiceModel),
}

/// Compares models over a plan.
///
/// * `models`: from the simplest to the richest; each once.
/// * `settings`: of fits that are made here; the reference reward should be given, so that all parts share it.
/// * `known`: fits to use rather than to make.
/// * `watch`: hears of progress many times a second, and stops the work by answering `Break`.
///
/// A model with a part that has not converged is listed without scores.
///
/// # Errors
/// As [`fit`](crate::inference::fit()).
pub fn compare_models(
    plan: &PlanData,
    models: &[&'static ChoiceModel],
    settings: &FitSettings,
    known: &[KnownFit],
    wanted: &ComparisonSettings,
    watch: &mut dyn FnMut(ComparisonProgress) -> ControlFlow<()>,
) -> Result<Comparison, FitError> {
    let mut exam = wanted
        .held_out
        .as_ref()
        .and_then(|settings| Exam::new(plan, settings));
    let mut compared = Vec::with_capacity(models.len());
    for model in models {
        let fits = fits_of(plan, model, settings, known, watch)?;
        let one = Compared::of(plan, fits, model, wanted, watch)?;
        if let Some(exam) = exam.as_mut().filter(|_| one.converged) {
            let mut inner = || watch(ComparisonProgress::HoldingOut(model));
            exam.examine(plan, &one.fits, &mut inner)?;
        }
        compared.push(one);
    }
    let mut pairs = Vec::new();
    for (place, first) in compared.iter().enumerate() {
        for second in &compared[..place] {
            pairs.push(first.against(second, exam.as_ref()));
        }
    }
    let mut steps = Vec::new();
    if wanted.leave_one_out || exam.is_some() {
        let mut rungs = vec![Rung::random(plan)];
        rungs.extend(compared.iter().map(Compared::rung));
        steps = ladder(&rungs, exam.as_ref(), plan.data().n());
    }
    Ok(Comparison {
        unit: plan.unit(),
        units: plan.units(),
        n: plan.data().n(),
        parts: plan
            .parts()
            .iter()
            .map(|part| part.id().to_owned())
            .collect(),
        models: compared
            .into_iter()
            .map(|model| (model.model.id.to_owned(), model.scores()))
            .collect(),
        pairs,
        held_out: exam.map(Exam::report),
        ladder: steps,
    })
}

/// A model with everything that pairs are made from.
struct Compared {
    model: &'static ChoiceModel,
    fits: Vec<PartFit>,
    converged: bool,
    left_out: Option<Scored>,
    evidence_rows: Option<Vec<EvidenceRow>>,
    bootstrap: Option<OrderedMap<Bootstrap>>,
}

impl Compared {
    fn of(
        plan: &PlanData,
        fits: Vec<PartFit>,
        model: &'static ChoiceModel,
        wanted: &ComparisonSettings,
        watch: &mut dyn FnMut(ComparisonProgress) -> ControlFlow<()>,
    ) -> Result<Self, FitError> {
        let mut compared = Self {
            model,
            converged: fits.iter().all(|fit| fit.summary.converged),
            fits,
            left_out: None,
            evidence_rows: None,
            bootstrap: None,
        };
        if !compared.converged {
            return Ok(compared);
        }
        if wanted.leave_one_out {
            let mut inner = || watch(ComparisonProgress::LeavingOut(model));
            compared.left_out = Some(leave_one_out(plan, &compared.fits, &mut inner)?);
        }
        if wanted.sensitivity {
            let mut inner = || watch(ComparisonProgress::ChangingPriors(model));
            compared.evidence_rows = Some(sensitivity(plan, &compared.fits, &mut inner)?);
        }
        if let Some(settings) = &wanted.bootstrap {
            let mut inner = || watch(ComparisonProgress::Resampling(model));
            let mut parts = Vec::with_capacity(compared.fits.len());
            for (place, fit) in compared.fits.iter().enumerate() {
                let found = participant_bootstrap(plan, place, fit, settings, &mut inner)?;
                parts.push((plan.parts()[place].id().to_owned(), found));
            }
            compared.bootstrap = Some(OrderedMap(parts));
        }
        Ok(compared)
    }

    fn scores(self) -> ModelScores {
        ModelScores {
            label: self.model.label.to_owned(),
            converged: self.converged,
            log_marginal_likelihood: ln_evidence(&self.fits),
            leave_one_out: self.left_out.map(|scored| scored.report),
            bootstrap: self.bootstrap,
        }
    }

    fn rung(&self) -> Rung {
        Rung {
            id: self.model.id.to_owned(),
            label: self.model.label.to_owned(),
            units: self.left_out.as_ref().map(|scored| scored.units.clone()),
        }
    }

    fn against(&self, second: &Self, exam: Option<&Exam>) -> Pair {
        let plain = BayesFactor::of(&self.fits, &second.fits);
        let rows = self
            .evidence_rows
            .as_ref()
            .zip(second.evidence_rows.as_ref());
        let bayes_factor = match rows {
            Some((first, other)) => plain.map(|factor| factor.with_sensitivity(first, other)),
            None => plain,
        };
        let left_out = self.left_out.as_ref().zip(second.left_out.as_ref());
        Pair {
            first: self.model.id.to_owned(),
            second: second.model.id.to_owned(),
            leave_one_out: left_out.map(|(first, other)| first.minus(other)),
            bayes_factor,
            held_out: exam.and_then(|exam| exam.difference(self.model.id, second.model.id)),
        }
    }
}

/// A model's fits of all parts, made where they are not known.
fn fits_of(
    plan: &PlanData,
    model: &'static ChoiceModel,
    settings: &FitSettings,
    known: &[KnownFit],
    watch: &mut dyn FnMut(ComparisonProgress) -> ControlFlow<()>,
) -> Result<Vec<PartFit>, FitError> {
    let mut fits = Vec::with_capacity(plan.parts().len());
    for (place, part) in plan.parts().iter().enumerate() {
        let found = known
            .iter()
            .find(|known| known.part == place && known.fit.model == model);
        fits.push(match found {
            Some(known) => known.fit.clone(),
            None => fit(model, part.data(), settings, &mut |_| {
                watch(ComparisonProgress::Fitting(model))
            })?
            .into(),
        });
    }
    Ok(fits)
}
