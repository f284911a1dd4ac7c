//! Evidence as it grows: looks at the answers of the first people, and a preset rule for when there is enough.
//!
//! Whoever looks after every answer and stops when it suits finds what he wants more often than he should. So a rule is
//! judged at looks that were fixed beforehand, in their order, and the first look that reaches it stands.

use serde::{Deserialize, Serialize};

use super::{Estimate, FitSummary};

/// What the answers of the first people say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Look {
    /// How many people.
    pub n: u64,
    /// How many answers of theirs were fitted.
    pub answers: u64,
    /// ln of the Bayes factor of the first model against the second, summed over the parts of the plan. Missing where
    /// one model alone is fitted, or a fit has not converged.
    pub ln_bayes_factor: Option<Estimate>,
    /// The 90 % interval that is followed. Missing where none is, or its fit has not converged.
    pub interval: Option<[f64; 2]>,
}

/// When there is enough evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bound {
    /// The Bayes factor is at least this, above 1, in favour of either model, even if its logarithm is two Monte-Carlo
    /// errors nearer to 0 than estimated:
    ///
    /// ```text
    /// |ln BF| − 2 se ≥ ln bound
    /// ```
    BayesFactor(f64),
    /// The interval is narrower than this, above 0.
    Width(f64),
}

impl Look {
    /// The width of the interval that is followed.
    pub fn width(&self) -> Option<f64> {
        self.interval.map(|[low, high]| high - low)
    }
}

impl Bound {
    /// What a look has to say on this bound: the Bayes factor of the first model against the second (at most the
    /// largest number there is), or the width.
    pub fn value(self, look: &Look) -> Option<f64> {
        match self {
            Self::BayesFactor(_) => look.ln_bayes_factor.map(|ln| ln.value.exp().min(f64::MAX)),
            Self::Width(_) => look.width(),
        }
    }

    /// Whether a look reaches the bound. One with a fit that has not converged does not, nor one whose Bayes factor may
    /// have crossed it by the noise of its estimate alone: the first look that reaches the bound stands, so noise would
    /// be taken at its luckiest.
    pub fn is_reached(self, look: &Look) -> bool {
        match self {
            Self::BayesFactor(bound) => look
                .ln_bayes_factor
                .is_some_and(|ln| ln.value.abs() - 2.0 * ln.se >= bound.ln()),
            Self::Width(bound) => look.width().is_some_and(|width| width < bound),
        }
    }
}

/// The sum of independent estimates; none if one of them is missing or there is none at all.
///
/// ```text
/// value = Σ valueᵢ,   se = √Σ seᵢ²
/// ```
pub fn sum(estimates: impl IntoIterator<Item = Option<Estimate>>) -> Option<Estimate> {
    let mut sum: Option<Estimate> = None;
    for estimate in estimates {
        let estimate = estimate?;
        let before = sum.unwrap_or(Estimate {
            value: 0.0,
            se: 0.0,
        });
        sum = Some(Estimate {
            value: before.value + estimate.value,
            se: before.se.hypot(estimate.se),
        });
    }
    sum
}

/// ln of the Bayes factor of one model against another, each fitted to the parts of a plan.
///
/// ```text
/// ln BF = Σ_parts ln Z(first, part) − Σ_parts ln Z(second, part)
/// ```
///
/// None if a fit has not converged. Source: models.md, section 7.
pub fn ln_bayes_factor<'a>(
    first: impl IntoIterator<Item = &'a FitSummary>,
    second: impl IntoIterator<Item = &'a FitSummary>,
) -> Option<Estimate> {
    let evidence = |fit: &FitSummary| fit.log_marginal_likelihood.filter(|_| fit.converged);
    let first = sum(first.into_iter().map(evidence))?;
    let second = sum(second.into_iter().map(evidence))?;
    Some(Estimate {
        value: first.value - second.value,
        se: first.se.hypot(second.se),
    })
}

/// The 90 % interval of a quantity, such as `gamma`, in a converged fit.
pub fn interval(fit: &FitSummary, quantity: &str) -> Option<[f64; 2]> {
    let parameters = fit.parameters.as_ref().filter(|_| fit.converged)?;
    let quantity = parameters.get(quantity)?;
    Some([quantity.q5, quantity.q95])
}

/// How many looks there have been once so many people have finished: the first at `minimum` people, the next ones
/// after each further `every`.
pub fn looks(people: u64, minimum: u64, every: u64) -> u64 {
    match people.checked_sub(minimum) {
        Some(further) => 1 + further / every.max(1),
        None => 0,
    }
}

/// How many people a look is about; looks count from 0.
pub fn people_at(look: u64, minimum: u64, every: u64) -> u64 {
    minimum.saturating_add(look.saturating_mul(every))
}

/// Which of so many looks are drawn: at most `most` and one, evenly, the first and the latest among them. What was drawn
/// once is drawn, or left out for good, as looks are added.
pub fn drawn(looks: u64, most: u64) -> Vec<u64> {
    let mut step = 1;
    while looks.div_ceil(step) > most.max(1) {
        step *= 2;
    }
    let mut drawn: Vec<u64> = (0..looks)
        .step_by(usize::try_from(step).unwrap_or(1))
        .collect();
    if let Some(latest) = looks.checked_sub(1)
        && drawn.last() != Some(&latest)
    {
        drawn.push(latest);
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(ln: Option<f64>, interval: Option<[f64; 2]>) -> Look {
        Look {
            n: 10,
            answers: 80,
            ln_bayes_factor: ln.map(|value| Estimate { value, se: 0.1 }),
            interval,
        }
    }

    #[test]
    fn looks_come_at_the_moments_that_were_set() {
        assert_eq!(looks(0, 1, 1), 0);
        assert_eq!(looks(19, 20, 10), 0);
        assert_eq!(looks(20, 20, 10), 1);
        assert_eq!(looks(29, 20, 10), 1);
        assert_eq!(looks(30, 20, 10), 2);
        for people in 1..200 {
            let count = looks(people, 7, 3);
            if let Some(latest) = count.checked_sub(1) {
                assert!(people_at(latest, 7, 3) <= people);
            }
            assert!(
                people_at(count, 7, 3) > people,
                "the next one is still to come"
            );
        }
    }

    #[test]
    fn a_bayes_factor_is_enough_in_either_direction() {
        let bound = Bound::BayesFactor(10.0);
        for (ln, reached) in [
            (2.2, false),
            (10_f64.ln() + 0.21, true),
            (-2.6, true),
            (-2.2, false),
            // Beyond the bound, but by less than two errors of 0.1.
            (10_f64.ln() + 0.19, false),
            (-2.4, false),
        ] {
            assert_eq!(bound.is_reached(&look(Some(ln), None)), reached, "{ln}");
        }
        assert!(!bound.is_reached(&look(None, Some([0.1, 0.2]))));
        assert_eq!(
            bound.value(&look(Some(-700.0), None)),
            Some((-700_f64).exp())
        );
        assert_eq!(bound.value(&look(Some(1e6), None)), Some(f64::MAX));
    }

    #[test]
    fn a_width_is_enough_below_its_bound() {
        let bound = Bound::Width(0.25);
        assert!(bound.is_reached(&look(None, Some([0.5, 0.625]))));
        assert!(!bound.is_reached(&look(None, Some([0.5, 0.75]))));
        assert!(!bound.is_reached(&look(Some(50.0), None)));
        assert_eq!(bound.value(&look(None, Some([0.5, 0.75]))), Some(0.25));
    }

    #[test]
    fn errors_add_up_in_squares_and_a_missing_part_leaves_no_sum() {
        let of = |value, se| Some(Estimate { value, se });
        assert_eq!(sum([of(1.0, 0.3), of(2.5, 0.4)]), of(3.5, 0.5));
        assert_eq!(sum([of(1.0, 0.3), None]), None);
        assert_eq!(sum([]), None);
    }

    #[test]
    fn at_most_forty_looks_and_the_latest_are_drawn() {
        assert_eq!(drawn(0, 40), [0; 0]);
        assert_eq!(drawn(3, 40), [0, 1, 2]);
        let mut before: Vec<u64> = Vec::new();
        for count in 1..1_000 {
            let now = drawn(count, 40);
            assert!(now.len() <= 41, "{count}");
            assert_eq!((now[0], *now.last().unwrap()), (0, count - 1));
            assert!(now.is_sorted());
            // Nothing but the latest look is new.
            let new: Vec<_> = now.iter().filter(|look| !before.contains(look)).collect();
            assert!(new.len() <= 1, "{count}: {new:?}");
            before = now;
        }
    }
}
