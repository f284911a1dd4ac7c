//! What is stored of a fit, as JSON and as a blob of draws.

use serde::{Deserialize, Serialize};

use super::fit_input::FitInput;
use crate::{
    inference::{
        Draws, Fit, FitSummary, Quantity,
        accuracy::CellAccuracy,
        curves::{Curves, curves},
        predictive_check::{PredictiveCheck, checks_of_fit},
    },
    model::{ChoiceProblem, OrderedMap, model_named},
    store::{self, FitOutcome},
};

/// A fit as it is stored: what it was fitted to, and what it says. A fit that has not converged says nothing but its
/// diagnostics.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FitReport {
    /// The problems by cell.
    pub problems: OrderedMap<ChoiceProblem>,
    /// How often each action of each problem was chosen.
    pub counts: Vec<Vec<u64>>,
    /// Parameters, predictions and diagnostics.
    pub summary: FitSummary,
    /// ln KL in each cell with answers, with the samples that pooled tests need.
    pub accuracy: Vec<CellAccuracy>,
    /// Value and weighting.
    pub curves: Option<Curves>,
    /// What the columns of the stored draws are.
    pub quantities: Vec<Quantity>,
    /// Each cell's answers beside answers replicated from the fit; none in a fit stored before there were such checks.
    #[serde(default)]
    pub predictive_check: Vec<PredictiveCheck>,
}

impl FitReport {
    /// The report of a finished fit; `earlier` is that of a fit of the same problems under the same settings.
    pub(super) fn new(input: &FitInput, fit: &Fit, earlier: Option<&Self>) -> Self {
        let is_converged = fit.summary.converged;
        let earlier_curves = earlier.and_then(|earlier| earlier.curves.as_ref());
        Self {
            problems: input.problems(),
            counts: input.data.totals().to_vec(),
            summary: fit.summary.shown(),
            accuracy: if is_converged {
                fit.accuracy.clone()
            } else {
                Vec::new()
            },
            curves: if is_converged {
                curves(input.data.problems(), &[fit], earlier_curves)
            } else {
                None
            },
            quantities: fit
                .draws
                .columns
                .iter()
                .map(|(quantity, _)| *quantity)
                .collect(),
            predictive_check: if is_converged {
                checks_of_fit(fit, input.data.problems(), input.data.totals())
            } else {
                Vec::new()
            },
        }
    }

    /// The report of a stored fit; `None` for a failed one, and for one that another version of the program wrote in
    /// another form.
    pub fn read(fit: &store::Fit) -> Option<Self> {
        let text = match &fit.outcome {
            FitOutcome::Converged(text) | FitOutcome::Unconverged(text) => text,
            FitOutcome::Failed(_) => return None,
        };
        match serde_json::from_str(text) {
            Ok(report) => Some(report),
            Err(error) => {
                tracing::debug!(fit = fit.id.get(), %error, "a stored fit has another form");
                None
            }
        }
    }

    /// The stored draws of this fit; `None` if they are not of the announced size, or of a model unknown here.
    pub fn draws(&self, blob: &[u8]) -> Option<Draws> {
        let (chains, per_chain) = (self.summary.chains, self.summary.draws);
        let length = chains * per_chain;
        let (bytes, rest) = blob.as_chunks::<8>();
        if !rest.is_empty() || length == 0 || bytes.len() != length * self.quantities.len() {
            return None;
        }
        let values: Vec<f64> = bytes
            .iter()
            .map(|bytes| f64::from_le_bytes(*bytes))
            .collect();
        let columns = self
            .quantities
            .iter()
            .copied()
            .zip(values.chunks_exact(length).map(<[f64]>::to_vec))
            .collect();
        Some(Draws {
            model: model_named(&self.summary.model).ok()?,
            chains,
            per_chain,
            columns,
        })
    }

    /// The largest R̂ over parameters and predictions; `None` where nothing moved.
    pub fn rhat_max(&self) -> Option<f64> {
        self.summary.diagnostics.rhat_max()
    }

    /// The smallest effective sample size, bulk or tail, over parameters and predictions.
    pub fn ess_min(&self) -> Option<f64> {
        self.summary.diagnostics.ess_min()
    }
}

/// Draws as little-endian numbers, column after column.
pub(super) fn blob(draws: &Draws) -> Vec<u8> {
    draws
        .columns
        .iter()
        .flat_map(|(_, values)| values)
        .flat_map(|value| value.to_le_bytes())
        .collect()
}
