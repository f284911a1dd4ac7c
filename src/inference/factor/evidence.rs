//! Whether the levels of a factor have parameters of their own.

use serde::Serialize;

use crate::inference::{Estimate, FitSummary, sequential};

/// One fit shared by all levels against one fit for each.
///
/// ```text
/// ln BF = Σ_parts (Σ_levels ln Z(level, part) − ln Z(all levels, part)),   Z = ∫ L · prior
/// ```
///
/// Above 0 the choices are likelier if each level has parameters of its own, each drawn from the prior independently of
/// the others; below 0 if one set of parameters made them all. Separate parameters are not free: each has to be paid
/// for by a likelihood that is higher than the prior's spread made it unlikely. So it depends on the priors, and should
/// not be shown without saying so. The likelihoods leave out binomial coefficients, which are the same on both sides as
/// long as both count the same choices one by one.
///
/// Source: Kass & Raftery (1995), *JASA* 90, section 3; Jeffreys (1961), chapter V, for the test whether two samples share a
/// parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, utoipa::ToSchema)]
pub struct FactorEvidence {
    /// ln BF of separate to shared parameters with its Monte-Carlo error, in nats.
    pub ln_bayes_factor: Estimate,
    /// Σ over parts and levels of ln Z.
    pub separate: Estimate,
    /// Σ over parts of ln Z of one fit to all levels.
    pub shared: Estimate,
    /// What it amounts to.
    pub verdict: FactorVerdict,
}

/// Whether the levels differ, by the Bayes factor alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FactorVerdict {
    /// The choices are at least three times as likely with separate parameters.
    Differ,
    /// They are at least three times as likely with shared ones.
    Alike,
    /// Neither, two Monte-Carlo errors taken off.
    Undecided,
}

impl FactorEvidence {
    /// The evidence of fits to each level and of fits to all of them; nothing where one has not converged or there is none.
    ///
    /// * `separate`: every level's fit to every part.
    /// * `shared`: the fit to every part.
    pub fn of<'a>(
        separate: impl IntoIterator<Item = &'a FitSummary>,
        shared: impl IntoIterator<Item = &'a FitSummary>,
    ) -> Option<Self> {
        let evidence = |fit: &FitSummary| fit.log_marginal_likelihood.filter(|_| fit.converged);
        let separate = sequential::sum(separate.into_iter().map(evidence))?;
        let shared = sequential::sum(shared.into_iter().map(evidence))?;
        let ln_bayes_factor = Estimate {
            value: separate.value - shared.value,
            se: separate.se.hypot(shared.se),
        };
        Some(Self {
            ln_bayes_factor,
            separate,
            shared,
            verdict: FactorVerdict::of(ln_bayes_factor),
        })
    }
}

impl FactorVerdict {
    /// The least Bayes factor that decides. Source: Lee & Wagenmakers (2013), table 7.1: what is below 3 is anecdotal.
    pub const LEAST: f64 = 3.0;

    /// The verdict of ln BF:
    ///
    /// ```text
    /// |ln BF| − 2 se ≥ ln 3
    /// ```
    pub fn of(ln_bayes_factor: Estimate) -> Self {
        if ln_bayes_factor.value.abs() - 2.0 * ln_bayes_factor.se < Self::LEAST.ln() {
            Self::Undecided
        } else if ln_bayes_factor.value > 0.0 {
            Self::Differ
        } else {
            Self::Alike
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_noise_alone_may_have_made_decides_nothing() {
        for (value, se, verdict) in [
            (1.2, 0.01, FactorVerdict::Differ),
            (1.2, 0.06, FactorVerdict::Undecided),
            (1.0, 0.0, FactorVerdict::Undecided),
            (-1.2, 0.01, FactorVerdict::Alike),
            (-40.0, 0.2, FactorVerdict::Alike),
            (-1.0, 0.0, FactorVerdict::Undecided),
        ] {
            let found = FactorVerdict::of(Estimate { value, se });
            assert_eq!(found, verdict, "{value} {se}");
        }
    }
}
