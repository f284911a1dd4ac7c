//! Work behind the pages: the studies that are served, refits, and the closing of questions whose time ran out.
//!
//! In reading order:
//!
//! * [`Catalogue`]: every stored version of every study, parsed once;
//! * [`StudyCounts`]: what was chosen, in the study's own order;
//! * `fit_input`: what a fit depends on, its hash and its seed;
//! * [`FitReport`]: what is stored of a fit;
//! * [`refit`], [`closing`]: the two background tasks;
//! * [`Snapshot`]: all that a results page says about a study, at one moment.
//!
//! Every fit is cold: a pure function of counts, problems, settings, seed and program. So what is behind is known from
//! the hashes alone, also after a restart.

mod catalogue;
pub mod closing;
mod counts;
mod fit_input;
mod fit_report;
pub mod refit;
mod snapshot;

pub use catalogue::{Catalogue, CatalogueError};
pub use counts::{QuestionCounts, StudyCounts};
pub use fit_report::{Diagnostics, Findings, FitReport, LnKlSamples, Series};
pub use snapshot::{PartFit, PartState, Snapshot};
