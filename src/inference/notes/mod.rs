//! What a reader must know before quoting a fit: each note is a kind with its numbers, [`Display`](std::fmt::Display)
//! puts it into words.

mod bounds;
mod chains;
mod loss_aversion;
mod rewards;
#[cfg(test)]
mod tests;
mod words;

use serde::{Deserialize, Serialize};

use self::loss_aversion::loss_aversion;
pub use self::{
    bounds::End, chains::ChainPosition, loss_aversion::LossAversion, rewards::design_note,
};
use super::{ChoiceData, Fit, ParameterSummary, Quantity, Source};
use crate::model::{ChoiceProblem, Parameter};

/// Something that limits what may be read off a fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Note {
    /// Every reward is a loss or nothing.
    LossesOnly {
        /// Parameters of which the choices say nothing.
        #[schema(value_type = Vec<String>)]
        not_learned: Vec<Quantity>,
        /// λ and θ are learned as their product only.
        product_only: bool,
        /// γ acts on nothing but the weight of the outcome 0, through the normalisation of decision weights.
        gamma_through_normalisation: bool,
    },
    /// Every reward is a gain or nothing.
    GainsOnly {
        /// Parameters of which the choices say nothing.
        #[schema(value_type = Vec<String>)]
        not_learned: Vec<Quantity>,
    },
    /// No choice depends on these, for other reasons than the signs of rewards.
    NoChoiceDepends {
        /// Which ones.
        #[schema(value_type = Vec<String>)]
        quantities: Vec<Quantity>,
    },
    /// Choices depend on these, but took less than a tenth of the prior's variance away.
    NotInformed {
        /// Which ones.
        #[schema(value_type = Vec<String>)]
        quantities: Vec<Quantity>,
    },
    /// More than 5 % of the draws lie within 1 % of the prior's range of one of its ends.
    BoundActive {
        /// Whose prior.
        #[schema(value_type = String)]
        quantity: Quantity,
        /// Which end of it.
        end: End,
        /// Where that end is.
        bound: f64,
        /// Share of draws near it.
        share: f64,
    },
    /// Draws lie where the weighting function is not monotone.
    NotMonotone {
        /// γ or δ.
        #[schema(value_type = String)]
        quantity: Quantity,
        /// Under this value it is not monotone.
        below: f64,
        /// Where the prior begins.
        prior_low: f64,
        /// Share of the posterior there.
        share: f64,
        /// Share of the prior there.
        prior_share: f64,
    },
    /// Gains and losses bend differently, so that λ depends on the unit of rewards.
    LossAversionVaries {
        /// The smallest reward other than 0, without its sign.
        small: f64,
        /// Median loss aversion there.
        at_small: f64,
        /// The largest reward, without its sign.
        large: f64,
        /// Median loss aversion there.
        at_large: f64,
    },
    /// Some chains hardly moved.
    StuckChains {
        /// Which ones, counted from 1.
        chains: Vec<usize>,
        /// Of how many.
        of: usize,
    },
    /// The chains do not agree about a quantity: R̂ is 1.01 or more.
    DisagreeingChains {
        /// About what.
        #[schema(value_type = String)]
        quantity: Quantity,
        /// Its R̂; null if it cannot be computed.
        rhat: Option<f64>,
        /// The chains that stand apart from the others; empty where all of them wander.
        apart: Vec<ChainPosition>,
    },
}

impl Note {
    /// The parameters that have no posterior of their own in such a design, only a prior.
    fn tied(&self) -> Vec<Quantity> {
        match self {
            Self::LossesOnly {
                not_learned,
                product_only,
                ..
            } => {
                let mut tied = not_learned.clone();
                if *product_only {
                    tied.extend([Parameter::Lambda, Parameter::Theta].map(Quantity::Parameter));
                }
                tied
            }
            Self::GainsOnly { not_learned } => not_learned.clone(),
            Self::NoChoiceDepends { .. }
            | Self::NotInformed { .. }
            | Self::BoundActive { .. }
            | Self::NotMonotone { .. }
            | Self::LossAversionVaries { .. }
            | Self::StuckChains { .. }
            | Self::DisagreeingChains { .. } => Vec::new(),
        }
    }

    /// Whether the note speaks of the chains and not of what they found, so that it stands beside a fit that has not
    /// converged.
    pub fn is_diagnostic(&self) -> bool {
        match self {
            Self::StuckChains { .. } | Self::DisagreeingChains { .. } => true,
            Self::LossesOnly { .. }
            | Self::GainsOnly { .. }
            | Self::NoChoiceDepends { .. }
            | Self::NotInformed { .. }
            | Self::BoundActive { .. }
            | Self::NotMonotone { .. }
            | Self::LossAversionVaries { .. } => false,
        }
    }

    /// Whether the note follows from the problems alone, whatever was chosen.
    pub fn is_of_design(&self) -> bool {
        match self {
            Self::LossesOnly { .. } | Self::GainsOnly { .. } => true,
            Self::NoChoiceDepends { .. }
            | Self::NotInformed { .. }
            | Self::BoundActive { .. }
            | Self::NotMonotone { .. }
            | Self::LossAversionVaries { .. }
            | Self::StuckChains { .. }
            | Self::DisagreeingChains { .. } => false,
        }
    }
}

/// Writes into a fit's summary what limits its reading, and loss aversion at three amounts.
pub(super) fn annotate(fit: &mut Fit, data: &ChoiceData) {
    let answered: Vec<&ChoiceProblem> = data
        .problems()
        .iter()
        .zip(data.totals())
        .filter(|(_, counts)| counts.iter().any(|n| *n > 0))
        .map(|(problem, _)| &problem.problem)
        .collect();
    let of_design = design_note(fit.model, answered.iter().copied(), fit.settings.options);
    let tied = of_design.as_ref().map(Note::tied).unwrap_or_default();
    for (name, parameter) in fit.summary.parameters.iter_mut().flat_map(|all| &mut all.0) {
        // However its posterior moved: it did so together with what the choices do tell about.
        if tied.iter().any(|quantity| quantity.key() == name) {
            parameter.informed = false;
        }
    }
    fit.summary.loss_aversion = loss_aversion(fit, answered.iter().copied());
    fit.summary.notes = notes(fit, of_design, &tied);
}

fn notes(fit: &Fit, of_design: Option<Note>, tied: &[Quantity]) -> Vec<Note> {
    let Some(parameters) = &fit.summary.parameters else {
        return Vec::new();
    };
    let which = |wanted: fn(&ParameterSummary) -> bool| -> Vec<Quantity> {
        let columns = fit.draws.columns.iter().map(|(quantity, _)| *quantity);
        columns
            .filter(|quantity| !tied.contains(quantity))
            .filter(|quantity| parameters.get(quantity.key()).is_some_and(wanted))
            .collect()
    };
    let no_choice_depends = which(|found| found.source == Source::Prior);
    let not_informed = which(|found| found.source == Source::Choices && !found.informed);
    let from_choices = which(|found| found.source == Source::Choices);
    let mut notes: Vec<Note> = of_design.into_iter().collect();
    if !no_choice_depends.is_empty() {
        notes.push(Note::NoChoiceDepends {
            quantities: no_choice_depends,
        });
    }
    if !not_informed.is_empty() {
        notes.push(Note::NotInformed {
            quantities: not_informed,
        });
    }
    for quantity in from_choices {
        notes.extend(bounds::active_bounds(fit, quantity));
        notes.extend(bounds::not_monotone(fit, quantity));
    }
    if let Some([small, .., large]) = fit.summary.loss_aversion.as_deref() {
        notes.push(Note::LossAversionVaries {
            small: small.amount,
            at_small: small.q50,
            large: large.amount,
            at_large: large.q50,
        });
    }
    notes.extend(chains::notes(&fit.draws, parameters));
    notes
}
