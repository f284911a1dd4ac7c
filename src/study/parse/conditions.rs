//! The conditions that the factors between people make.

use super::design::Design;
use crate::study::Condition;
use crate::study::definition::{Assign, Block, BlockBody};
use crate::study::document::{Fault, KeyPath};

/// Each condition needs people of its own, and its steps are drawn for every start.
const MOST_CONDITIONS: usize = 64;

/// Every combination of the levels of factors that differ between people, the first one changing slowest.
pub(super) fn read(design: &Design<'_>, blocks: &[Block]) -> Result<Vec<Condition>, Fault> {
    let between: Vec<_> = design
        .factors()
        .iter()
        .filter(|factor| factor.assign == Assign::Between)
        .collect();
    if between.is_empty() {
        return Ok(Vec::new());
    }
    let path = KeyPath::root().key("factor");
    let count = between.iter().try_fold(1_usize, |product, factor| {
        product.checked_mul(factor.levels.len())
    });
    if count.is_none_or(|count| count > MOST_CONDITIONS) {
        let allowed = format!("at most {MOST_CONDITIONS} conditions");
        return Err(path.fault("a product of too many levels between people", allowed));
    }
    let mut combinations = vec![Vec::new()];
    for factor in between {
        combinations = combinations
            .iter()
            .flat_map(|combination| {
                factor.levels.iter().map(|level| {
                    let mut longer = combination.clone();
                    longer.push((factor.id.clone(), level.id.clone()));
                    longer
                })
            })
            .collect();
    }
    let conditions: Vec<Condition> = combinations.into_iter().map(Condition::new).collect();
    for condition in &conditions {
        if !asks_something(condition, blocks) {
            let found = format!("condition `{}` without a question", condition.id);
            return Err(path.fault(found, "one question or more in every condition"));
        }
    }
    Ok(conditions)
}

fn asks_something(condition: &Condition, blocks: &[Block]) -> bool {
    blocks.iter().any(|block| match &block.body {
        BlockBody::Choice(choices) => choices
            .questions
            .iter()
            .any(|question| condition.takes(&question.levels)),
        BlockBody::Consent(_) | BlockBody::Info(_) | BlockBody::Replays(_) | BlockBody::Form(_) => {
            false
        }
    })
}
