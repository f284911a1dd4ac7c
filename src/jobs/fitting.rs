//! One fit, from its input to what is stored of it.

use std::ops::ControlFlow;

use tokio_util::sync::CancellationToken;

use super::{FitReport, fit_input::FitInput, live_fits::LiveFit};
use crate::{
    inference::{Fit, FitError, Progress, fit, refit},
    store::FitOutcome,
};

/// A fit that came to an end.
#[derive(Debug)]
pub(super) struct Fitted {
    pub(super) report: FitReport,
    /// The report as it is stored.
    pub(super) outcome: FitOutcome,
    pub(super) fit: Fit,
}

/// Why there is no fit.
#[derive(Debug, thiserror::Error)]
pub(super) enum FitFailure {
    /// The server is ending, or newer answers made the fit needless.
    #[error("the fit was stopped")]
    Stopped,
    #[error(transparent)]
    Fit(FitError),
    #[error("the result could not be written as JSON: {0}")]
    Report(#[from] serde_json::Error),
}

/// Fits, from an earlier fit on or anew.
pub(super) fn run(
    input: &FitInput,
    previous: Option<&LiveFit>,
    stop: &CancellationToken,
) -> Result<Fitted, FitFailure> {
    let mut watch = |_: Progress| {
        if stop.is_cancelled() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let FitInput {
        model,
        data,
        settings,
        ..
    } = input;
    let fitted = match previous {
        Some(previous) => refit(&previous.warm_start, model, data, settings, &mut watch),
        None => fit(model, data, settings, &mut watch),
    };
    let fit = fitted.map_err(|error| match error {
        FitError::Stopped => FitFailure::Stopped,
        FitError::Setting { .. } | FitError::Prior(_) | FitError::ReferenceReward(_) => {
            FitFailure::Fit(error)
        }
    })?;
    // A warm fit is of the same problems and settings as the one before.
    let earlier = previous.filter(|_| fit.summary.provisional);
    let report = FitReport::new(input, &fit, earlier.map(|earlier| &*earlier.report));
    let text = serde_json::to_string(&report)?;
    let outcome = if fit.summary.converged {
        FitOutcome::Converged(text)
    } else {
        FitOutcome::Unconverged(text)
    };
    Ok(Fitted {
        report,
        outcome,
        fit,
    })
}
