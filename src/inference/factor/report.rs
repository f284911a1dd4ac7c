//! What the fits of a factor's levels say, ready for JSON.

use serde::Serialize;

use super::{Difference, FactorEvidence};
use crate::inference::accuracy::{CellAccuracy, LnKl, Shares, pooled};
use crate::inference::{Estimate, Fit, ParameterSummary, Quantity};
use crate::model::OrderedMap;

/// The models fitted to each level of a factor.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct FactorReport {
    /// The factor, such as `source`.
    pub factor: String,
    /// The levels that are compared, in order.
    pub levels: Vec<FactorLevel>,
    /// What each model says, by its id.
    #[schema(value_type = HashMap<String, FactorModelReport>)]
    pub models: OrderedMap<FactorModelReport>,
}

/// One level and how much there is of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct FactorLevel {
    /// Its name; null for those who have none.
    pub level: Option<String>,
    /// How many people; null where nobody knows who gave which answer.
    pub people: Option<u64>,
    /// How many choices are fitted.
    pub n: u64,
}

impl FactorLevel {
    /// The name on pages and in tables.
    pub fn label(&self) -> &str {
        name(self.level.as_deref())
    }
}

fn name(level: Option<&str>) -> &str {
    level.unwrap_or("(no label)")
}

/// What one model says on a factor.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct FactorModelReport {
    /// Whether the levels have parameters of their own; null where a fit has not converged.
    pub evidence: Option<FactorEvidence>,
    /// The parts in which the choices are fitted, in order.
    pub parts: Vec<FactorPartReport>,
}

/// One model's fits to one part of the choices.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct FactorPartReport {
    /// The part's id.
    pub part: String,
    /// Its text on pages.
    pub label: String,
    /// The fit to all levels together.
    pub shared: LevelFit,
    /// The fit to each level, in their order.
    pub levels: Vec<LevelFit>,
    /// The parameters of levels held against each other, where both fits converged.
    pub contrasts: Vec<Contrast>,
}

/// A fit to the choices of one level, or of several.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct LevelFit {
    /// How many choices were fitted.
    pub n: u64,
    /// Whether the chains agree; without it there are no results.
    pub converged: bool,
    /// The largest R̂; null where nothing moved.
    pub rhat_max: Option<f64>,
    /// The smallest effective sample size.
    pub ess_min: Option<f64>,
    /// Random seed.
    pub seed: u64,
    /// ln of the likelihood averaged over the prior.
    pub ln_evidence: Option<Estimate>,
    /// ln KL over the samples of all problems whose answers are not unanimous.
    pub ln_kl: Option<LnKl>,
    /// What the choices say about the parameters.
    #[schema(value_type = Option<HashMap<String, ParameterSummary>>)]
    pub parameters: Option<OrderedMap<ParameterSummary>>,
}

/// The parameters of one level held against those of another, or of all others.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct Contrast {
    /// The level; null for those who have none.
    pub level: Option<String>,
    /// What it is held against.
    #[serde(flatten)]
    pub against: Against,
    /// Each parameter's difference: that of the level less that of the other.
    #[schema(value_type = HashMap<String, Difference>)]
    pub differences: OrderedMap<Difference>,
}

/// What a level is held against.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[schema(as = ContrastAgainst)]
#[serde(tag = "against", rename_all = "snake_case")]
pub enum Against {
    /// The only other level.
    Level {
        /// Its name; null for those who have none.
        other: Option<String>,
    },
    /// One fit to all other levels.
    Rest,
}

impl LevelFit {
    pub(super) fn of(fit: &Fit) -> Self {
        let summary = fit.summary.shown();
        let cells: Vec<&CellAccuracy> = fit.accuracy.iter().collect();
        Self {
            n: summary.n,
            converged: summary.converged,
            rhat_max: summary.diagnostics.rhat_max(),
            ess_min: summary.diagnostics.ess_min(),
            seed: summary.seed,
            ln_evidence: summary.log_marginal_likelihood,
            ln_kl: summary.converged.then(|| pooled(&cells, Shares::Observed)),
            parameters: summary.parameters,
        }
    }
}

impl Contrast {
    /// Both with a name for tables.
    pub fn label(&self) -> String {
        let first = name(self.level.as_deref());
        match &self.against {
            Against::Level { other } => format!("{first} − {}", name(other.as_deref())),
            Against::Rest => format!("{first} − the rest"),
        }
    }

    /// Nothing unless both fits converged.
    pub(super) fn of(
        level: Option<String>,
        against: Against,
        first: &Fit,
        second: &Fit,
    ) -> Option<Self> {
        if !(first.summary.converged && second.summary.converged) {
            return None;
        }
        let informed = |fit: &Fit, quantity: Quantity| {
            let parameters = fit.summary.parameters.as_ref();
            parameters
                .and_then(|all| all.get(quantity.key()))
                .is_some_and(|found| found.informed)
        };
        let columns = first.draws.columns.iter();
        let differences = columns
            .filter_map(|(quantity, values)| {
                let other = second.draws.column(*quantity)?;
                let both = informed(first, *quantity) && informed(second, *quantity);
                let found = Difference::of(values, other, both)?;
                Some((quantity.key().to_owned(), found))
            })
            .collect();
        Some(Self {
            level,
            against,
            differences,
        })
    }
}
