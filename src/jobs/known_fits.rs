//! Stored fits with their reports, carried over from one snapshot to the next, so that each is read once.

use std::sync::Arc;

use super::{FitReport, live_fits::LiveFit};
use crate::{
    inference::Draws,
    store::{Fit, FitId},
};

/// The newest stored fit of each part and model.
#[derive(Debug, Clone, Default)]
pub(super) struct KnownFits(Vec<KnownFit>);

/// A stored fit and what it says.
#[derive(Debug, Clone)]
pub(super) struct KnownFit {
    pub(super) fit: Arc<Fit>,
    /// None where it failed, or was written in another form.
    pub(super) report: Option<Arc<FitReport>>,
    /// Where this server made it.
    pub(super) draws: Option<Arc<Draws>>,
}

impl KnownFits {
    pub(super) fn ids(&self) -> Vec<FitId> {
        self.0.iter().map(|known| known.fit.id).collect()
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &KnownFit> {
        self.0.iter()
    }

    /// Those with the given ids, of which `new` were not known yet. What this server made need not be read from its
    /// text.
    pub(super) fn renewed(self, ids: &[FitId], new: Vec<(Fit, Option<Arc<LiveFit>>)>) -> Self {
        let kept = self
            .0
            .into_iter()
            .filter(|known| ids.contains(&known.fit.id));
        let new = new.into_iter().map(|(fit, live)| match live {
            Some(live) => KnownFit {
                fit: Arc::new(fit),
                report: Some(live.report.clone()),
                draws: Some(live.draws.clone()),
            },
            None => KnownFit {
                report: FitReport::read(&fit).map(Arc::new),
                fit: Arc::new(fit),
                draws: None,
            },
        });
        Self(kept.chain(new).collect())
    }
}
