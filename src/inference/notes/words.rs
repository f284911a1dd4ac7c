//! Notes in words, for tables and pages alike.

use std::fmt;

use super::{ChainPosition, End, Note};
use crate::inference::{PAPER_RANGE_FLOOR, Quantity};

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LossesOnly {
                not_learned,
                product_only,
                gamma_through_normalisation,
            } => {
                f.write_str("All rewards here are losses or nothing.")?;
                if !not_learned.is_empty() {
                    write!(f, " So {}", not_learned_at_all(not_learned))?;
                }
                if *product_only {
                    f.write_str(
                        " λ (loss aversion) and θ (sensitivity) are learned only as their product λ·θ: a person who minds losses twice as much and one who chooses twice as sharply look the same.",
                    )?;
                }
                if *gamma_through_normalisation {
                    f.write_str(
                        " γ (weighting of gains) acts on the weight of getting nothing, and on choices only through the normalisation of decision weights.",
                    )?;
                }
                Ok(())
            }
            Self::GainsOnly { not_learned } => write!(
                f,
                "All rewards here are gains or nothing. So {}",
                not_learned_at_all(not_learned)
            ),
            Self::NoChoiceDepends { quantities } => write!(
                f,
                "No choice here depends on {}: what stands there is the prior, not a finding.",
                list(quantities.iter().map(|quantity| named(*quantity)))
            ),
            Self::NotInformed { quantities } => write!(
                f,
                "These choices say next to nothing about {}: they took less than a tenth of the prior’s variance away.",
                list(quantities.iter().map(|quantity| named(*quantity)))
            ),
            Self::BoundActive {
                quantity,
                end,
                bound,
                share,
            } => {
                let end = match end {
                    End::Low => "lower",
                    End::High => "upper",
                };
                write!(
                    f,
                    "{} of the draws of {} lie within 1 % of the {end} end of its prior, {bound}: there the prior, not the choices, ends the posterior.",
                    percent(*share),
                    quantity.symbol()
                )
            }
            Self::NotMonotone {
                quantity,
                below,
                prior_low,
                share,
                prior_share,
            } => {
                write!(
                    f,
                    "{} of the posterior of {} ({} of its prior) lies under {below}, where the weighting function is not monotone: a likelier outcome can get less weight, and the curves turn back.",
                    percent(*share),
                    quantity.symbol(),
                    percent(*prior_share),
                )?;
                if *prior_low == PAPER_RANGE_FLOOR {
                    write!(
                        f,
                        " This is the paper’s wide range, here Uniform({prior_low}, 1); the default prior begins at {below}."
                    )
                } else {
                    write!(
                        f,
                        " The prior begins at {prior_low}. The paper’s wide range is {PAPER_RANGE_FLOOR} to 1, the default prior begins at {below}."
                    )
                }
            }
            Self::LossAversionVaries {
                small,
                at_small,
                large,
                at_large,
            } => write!(
                f,
                "Gains and losses bend differently here (α ≠ β), so λ alone depends on the unit of rewards. Read loss aversion at an amount: −v(−x)/v(x) is {at_small:.2} at {small} and {at_large:.2} at {large} (medians)."
            ),
            Self::StuckChains { chains, of } => write!(
                f,
                "{} {} of {of} hardly moved: nothing that these draws say can be used.",
                if chains.len() == 1 { "Chain" } else { "Chains" },
                list(chains.iter().map(usize::to_string))
            ),
            Self::DisagreeingChains {
                quantity,
                rhat,
                apart,
            } => {
                let rhat =
                    rhat.map_or_else(|| "R̂ unknown".to_owned(), |rhat| format!("R̂ {rhat:.3}"));
                write!(
                    f,
                    "The chains disagree about {} ({rhat}): ",
                    quantity.symbol()
                )?;
                if apart.is_empty() {
                    f.write_str("none stands apart, all of them wander slowly.")
                } else {
                    let places = apart.iter().map(place);
                    write!(f, "{}.", places.collect::<Vec<_>>().join("; "))
                }
            }
        }
    }
}

fn place(at: &ChainPosition) -> String {
    let (side, distance) = if at.rank > 0.5 {
        ("above", at.rank)
    } else {
        ("below", 1.0 - at.rank)
    };
    let by_place = distance - 0.5;
    let by_spread = (at.spread_rank - 0.5).abs();
    if by_place >= by_spread {
        format!(
            "a draw of chain {} lies {side} {} of all draws on average",
            at.chain,
            percent(distance)
        )
    } else if at.spread_rank < 0.5 {
        format!("chain {} is narrower than the others", at.chain)
    } else {
        format!("chain {} is wider than the others", at.chain)
    }
}

fn not_learned_at_all(quantities: &[Quantity]) -> String {
    format!(
        "{} cannot be learned at all: what stands there is the prior, not a finding.",
        list(quantities.iter().map(|quantity| named(*quantity)))
    )
}

fn named(quantity: Quantity) -> String {
    quantity.meaning().map_or_else(
        || quantity.symbol().to_owned(),
        |meaning| format!("{} ({meaning})", quantity.symbol()),
    )
}

/// `a`, `a and b`, `a, b and c`.
fn list(items: impl Iterator<Item = String>) -> String {
    let mut items: Vec<String> = items.collect();
    match items.pop() {
        None => String::new(),
        Some(only) if items.is_empty() => only,
        Some(last) => format!("{} and {last}", items.join(", ")),
    }
}

fn percent(share: f64) -> String {
    // The bound of 5 % itself must not seem to be reached by rounding.
    let digits = usize::from(share < 0.1 && share > 0.0);
    format!("{:.digits$} %", share * 100.0)
}
