//! Which problems of a study a sweep can run over.

use crate::{
    inference::FittedProblem,
    study::{CellId, FactorId, LevelId, Study},
};

/// A problem of the fitted cells, each distinct one once.
#[derive(Debug, Clone, PartialEq)]
pub struct SweptProblem {
    /// The problem under the id of the first cell that asks it.
    pub problem: FittedProblem,
    /// All fitted cells that ask it, in file order.
    pub cells: Vec<CellId>,
    /// What sets it apart, for people: the levels that its cells share, such as `Risk: high`.
    pub label: String,
}

/// The distinct problems of the fitted cells, in file order.
pub fn swept_problems(study: &Study) -> Vec<SweptProblem> {
    let mut found: Vec<SweptProblem> = Vec::new();
    for cell in study.cells().iter().filter(|cell| cell.fitted) {
        let Some(problem) = &cell.problem else {
            continue;
        };
        match found
            .iter_mut()
            .find(|known| known.problem.problem == *problem)
        {
            Some(known) => known.cells.push(cell.id.clone()),
            None => found.push(SweptProblem {
                problem: FittedProblem {
                    id: cell.id.to_string(),
                    problem: problem.clone(),
                },
                cells: vec![cell.id.clone()],
                label: String::new(),
            }),
        }
    }
    let many = found.len() > 1;
    for swept in &mut found {
        swept.label = label(study, &swept.cells, many);
    }
    found
}

/// The levels that all of these cells have, without those that every fitted cell has.
fn label(study: &Study, cells: &[CellId], many: bool) -> String {
    let fitted = || study.cells().iter().filter(|cell| cell.fitted);
    let of = |level: &(FactorId, LevelId), ids: &[CellId]| {
        fitted()
            .filter(|cell| ids.contains(&cell.id))
            .all(|cell| cell.levels.contains(level))
    };
    let all: Vec<CellId> = fitted().map(|cell| cell.id.clone()).collect();
    let mut words = Vec::new();
    for factor in study.factors() {
        for level in &factor.levels {
            let pair = (factor.id.clone(), level.id.clone());
            if of(&pair, cells) && !(many && of(&pair, &all)) {
                words.push(format!("{}: {}", factor.label, level.label.to_lowercase()));
            }
        }
    }
    match (words.is_empty(), cells) {
        (false, _) => words.join(", "),
        (true, [cell]) => study
            .cell(cell.as_str())
            .map_or_else(|| cell.to_string(), |cell| cell.label.clone()),
        (true, _) => "All cells".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::built_in;

    #[test]
    fn the_driving_study_has_two_problems_told_apart_by_risk() {
        let (name, text) = built_in()[0];
        let study = Study::parse(name, text).unwrap();
        let found = swept_problems(&study);
        let labels: Vec<&str> = found.iter().map(|swept| swept.label.as_str()).collect();
        assert_eq!(labels, ["Risk: high", "Risk: low"]);
        assert!(found.iter().all(|swept| swept.cells.len() == 4));
    }
}
