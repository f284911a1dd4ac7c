//! Everything that is asked of a plan's models, by one call.

use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use super::bayes_factor::{BayesFactor, ln_evidence, sensitivity};
use super::leave_one_out::{LeaveOneOut, LeaveOneOutDifference, leave_one_out};
use super::plan::{PlanData, Unit};
use super::pointwise::PartFit;
use crate::inference::{Estimate, FitError, FitSettings, fit};
use crate::model::{ChoiceModel, OrderedMap};

/// A comparison of models over one plan of one study. In JSON numbers that do not exist are `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    pub models: OrderedMap<ModelScores>,
    /// Every two models, the later one of the order first.
    pub pairs: Vec<Pair>,
}

/// One model's scores.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelScores {
    /// The model's name for people.
    pub label: String,
    /// Whether the fits of all parts converged; if not, nothing else is given.
    pub converged: bool,
    /// How well it predicts a unit that was left out.
    pub leave_one_out: Option<LeaveOneOut>,
    /// ln marginal likelihood, the sum over parts.
    pub log_marginal_likelihood: Option<Estimate>,
}

/// What speaks for one model against another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// The model that positive figures speak for.
    pub first: String,
    /// The model that negative figures speak for.
    pub second: String,
    /// Difference in expected log score of units left out.
    pub leave_one_out: Option<LeaveOneOutDifference>,
    /// Ratio of marginal likelihoods.
    pub bayes_factor: Option<BayesFactor>,
}

/// What a comparison holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ComparisonSettings {
    /// Leave one unit out at a time.
    pub leave_one_out: bool,
    /// Repeat Bayes factors under other priors; each row fits every model again.
    pub sensitivity: bool,
}

impl ComparisonSettings {
    /// What can be had of existing fits at once: Bayes factors.
    pub const LIVE: Self = Self {
        leave_one_out: false,
        sensitivity: false,
    };

    /// What is cheap: Bayes factors and leave-one-out.
    pub const BRIEF: Self = Self {
        leave_one_out: true,
        sensitivity: false,
    };

    /// Everything.
    pub const FULL: Self = Self {
        leave_one_out: true,
        sensitivity: true,
    };
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
    let mut compared = Vec::with_capacity(models.len());
    for model in models {
        compared.push(Compared::of(plan, model, settings, known, wanted, watch)?);
    }
    let mut pairs = Vec::new();
    for (place, first) in compared.iter().enumerate() {
        for second in &compared[..place] {
            pairs.push(first.against(second));
        }
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
            .iter()
            .map(|model| (model.model.id.to_owned(), model.scores()))
            .collect(),
        pairs,
    })
}

/// A model with everything that pairs are made from.
struct Compared {
    model: &'static ChoiceModel,
    fits: Vec<PartFit>,
    converged: bool,
    left_out: Option<super::leave_one_out::Scored>,
    evidence_rows: Option<Vec<super::bayes_factor::EvidenceRow>>,
}

impl Compared {
    fn of(
        plan: &PlanData,
        model: &'static ChoiceModel,
        settings: &FitSettings,
        known: &[KnownFit],
        wanted: &ComparisonSettings,
        watch: &mut dyn FnMut(ComparisonProgress) -> ControlFlow<()>,
    ) -> Result<Self, FitError> {
        let fits = fits_of(plan, model, settings, known, watch)?;
        let converged = fits.iter().all(|fit| fit.summary.converged);
        let mut compared = Self {
            model,
            fits,
            converged,
            left_out: None,
            evidence_rows: None,
        };
        if !converged {
            return Ok(compared);
        }
        if wanted.leave_one_out {
            let scored = leave_one_out(plan, &compared.fits, &mut || {
                watch(ComparisonProgress::LeavingOut(model))
            })?;
            compared.left_out = Some(scored);
        }
        if wanted.sensitivity {
            let rows = sensitivity(plan, &compared.fits, &mut || {
                watch(ComparisonProgress::ChangingPriors(model))
            })?;
            compared.evidence_rows = Some(rows);
        }
        Ok(compared)
    }

    fn scores(&self) -> ModelScores {
        ModelScores {
            label: self.model.label.to_owned(),
            converged: self.converged,
            leave_one_out: self.left_out.as_ref().map(|scored| scored.report.clone()),
            log_marginal_likelihood: ln_evidence(&self.fits),
        }
    }

    fn against(&self, second: &Self) -> Pair {
        let bayes_factor = BayesFactor::of(&self.fits, &second.fits).map(|factor| {
            match (&self.evidence_rows, &second.evidence_rows) {
                (Some(first), Some(second)) => factor.with_sensitivity(first, second),
                (None, _) | (_, None) => factor,
            }
        });
        Pair {
            first: self.model.id.to_owned(),
            second: second.model.id.to_owned(),
            leave_one_out: self
                .left_out
                .as_ref()
                .zip(second.left_out.as_ref())
                .map(|(first, second)| first.minus(second)),
            bayes_factor,
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
