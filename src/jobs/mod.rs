//! Work behind the pages: the studies that are served, refits, and the closing of questions whose time ran out.
//!
//! In reading order:
//!
//! * [`Catalogue`]: every stored version of every study, parsed once;
//! * [`StudyFolder`]: the study files of a lab, read again when they change;
//! * [`StudyCounts`]: what was chosen, in the study's own order;
//! * `fit_input`: what a fit depends on, its hash and its seed;
//! * [`FitReport`]: what is stored of a fit;
//! * `due`: which fits are due; `fitting`: one fit, from its input to its report; `lane`: the threads on which fits run; `live_fits`: what is
//!   remembered of them; `quiet`: when a study is idle;
//! * [`PlanComparison`], [`SequentialEvidence`]: what belongs beside the fits;
//! * [`refit`], [`evidence`], [`closing`]: the background tasks;
//! * [`OnDemand`]: work that is done when somebody asks for it: [`Sweeps`], simulated sweeps, with the problems that they
//!   run over ([`swept_problems`]); [`SourceFits`], the models fitted to people from each source;
//! * [`Snapshot`]: all that a results page says about a study, at one moment; `snapshot_cache` keeps the latest,
//!   `known_fits` the fits that were read for it; [`Released`] is what strangers see of it.
//!
//! A final fit is cold: a pure function of counts, problems, settings, seed and program. So what is behind is known from
//! the hashes alone, also after a restart. A provisional fit shows what it will say while answers keep coming.

mod catalogue;
pub mod closing;
mod counts;
mod due;
pub mod evidence;
mod fit_input;
mod fit_report;
mod fitting;
mod known_fits;
mod lane;
mod live_fits;
mod looks;
mod on_demand;
mod plan_comparison;
mod quiet;
pub mod refit;
mod released;
mod snapshot;
mod snapshot_cache;
mod source_fits;
mod study_folder;
mod sweep_problems;
mod sweeps;

pub use catalogue::{Catalogue, CatalogueError};
pub use counts::{QuestionCounts, StudyCounts};
pub use fit_input::{changed_priors, fit_settings};
pub use fit_report::FitReport;
pub use looks::{RuleReached, RuleText, SequentialEvidence};
pub use on_demand::{Asker, OnDemand, Work, WorkState};
pub use plan_comparison::PlanComparison;
pub use released::Released;
pub use snapshot::{Blind, NotFinal, PartFit, PartState, Snapshot, Version};
pub use source_fits::{LeftOutReason, SourceComparison, SourceFitInput, SourceFits, StudySource};
pub use study_folder::{FolderError, Prepare, StudyFolder};
pub use sweep_problems::{SweptProblem, swept_problems};
pub use sweeps::{SweepInput, SweepResult, SweepState, Sweeps};

use std::sync::Arc;

use tokio_util::sync::CancellationToken;

use crate::store::{Population, Store};

/// Starts the background work; the future completes once all of it has ended after `stop`.
pub fn start(
    store: &Store,
    catalogue: &Arc<Catalogue>,
    population: Population,
    stop: &CancellationToken,
) -> impl Future<Output = ()> + use<> {
    let refits = tokio::spawn(refit::run(
        store.clone(),
        catalogue.clone(),
        population,
        stop.clone(),
    ));
    let evidence = tokio::spawn(evidence::run(
        store.clone(),
        catalogue.clone(),
        population,
        stop.clone(),
    ));
    let closing = tokio::spawn(closing::run(store.clone(), stop.clone()));
    async move {
        for (task, ended) in [
            ("refits", refits.await),
            ("evidence", evidence.await),
            ("closing", closing.await),
        ] {
            if let Err(error) = ended {
                tracing::error!(task, %error, "a background task ended badly");
            }
        }
    }
}
