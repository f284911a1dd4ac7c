//! Choices as counts: all that a fit needs to know of them.

use crate::model::ChoiceProblem;

/// A choice problem with the name under which results are reported, such as a cell's id.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedProblem {
    /// The name, such as `explicit/timed/low`.
    pub id: String,
    /// The actions and their prospects.
    pub problem: ChoiceProblem,
}

/// People with one and the same pattern of answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    /// How many people.
    pub weight: u64,
    /// How often each of them chose each action: `counts[problem][action]`.
    pub counts: Vec<Vec<u64>>,
}

/// Problems and what people chose in them.
///
/// The counts are sufficient: a likelihood costs the same for ten people and for ten million.
#[derive(Debug, Clone, PartialEq)]
pub struct ChoiceData {
    problems: Vec<FittedProblem>,
    groups: Vec<Group>,
    totals: Vec<Vec<u64>>,
}

impl ChoiceData {
    /// Data from problems and groups of participants.
    ///
    /// # Errors
    /// When there is no problem, an id comes twice, a group's counts have another shape than the problems, or the
    /// counts are too many to add up.
    pub fn new(problems: Vec<FittedProblem>, groups: Vec<Group>) -> Result<Self, ChoiceDataError> {
        if problems.is_empty() {
            return Err(ChoiceDataError::NoProblem);
        }
        for (index, problem) in problems.iter().enumerate() {
            if problems[..index]
                .iter()
                .any(|earlier| earlier.id == problem.id)
            {
                return Err(ChoiceDataError::RepeatedId {
                    id: problem.id.clone(),
                });
            }
        }
        let shape = |problem: &FittedProblem| problem.problem.actions().len();
        let mut totals: Vec<Vec<u64>> = problems
            .iter()
            .map(|problem| vec![0; shape(problem)])
            .collect();
        let mut sum = 0_u64;
        for (index, group) in groups.iter().enumerate() {
            let fits = group.counts.len() == problems.len()
                && group
                    .counts
                    .iter()
                    .zip(&totals)
                    .all(|(row, total)| row.len() == total.len());
            if !fits {
                return Err(ChoiceDataError::Shape { group: index + 1 });
            }
            for (row, total_row) in group.counts.iter().zip(&mut totals) {
                for (count, total) in row.iter().zip(total_row) {
                    let added = group
                        .weight
                        .checked_mul(*count)
                        .ok_or(ChoiceDataError::TooMany)?;
                    sum = sum.checked_add(added).ok_or(ChoiceDataError::TooMany)?;
                    *total += added;
                }
            }
        }
        Ok(Self {
            problems,
            groups,
            totals,
        })
    }

    /// Data where only the sums are known: `counts[problem][action]`.
    ///
    /// # Errors
    /// As [`ChoiceData::new`].
    pub fn from_counts(
        problems: Vec<FittedProblem>,
        counts: Vec<Vec<u64>>,
    ) -> Result<Self, ChoiceDataError> {
        Self::new(problems, vec![Group { weight: 1, counts }])
    }

    /// The problems in the order in which they are reported.
    pub fn problems(&self) -> &[FittedProblem] {
        &self.problems
    }

    /// The distinct answer patterns.
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// How often each action was chosen by everybody: `totals()[problem][action]`.
    pub fn totals(&self) -> &[Vec<u64>] {
        &self.totals
    }

    /// How many choices there are.
    pub fn n(&self) -> u64 {
        self.totals.iter().flatten().sum()
    }
}

/// Why problems and counts make no data.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChoiceDataError {
    /// There is nothing to fit.
    #[error("a fit needs at least one problem")]
    NoProblem,
    /// Two problems share an id.
    #[error("problem `{id}` comes twice")]
    RepeatedId {
        /// The id.
        id: String,
    },
    /// Counts do not belong to the problems.
    #[error("the counts of group {group} have another shape than the problems and their actions")]
    Shape {
        /// Which group, counted from 1.
        group: usize,
    },
    /// The sum of all counts is out of range.
    #[error("there are more choices than can be counted")]
    TooMany,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// `(id, actions, counts)`, for tests.
    pub(crate) type Cell<'a> = (&'a str, &'a [(&'a str, &'a [(f64, f64)])], &'a [u64]);

    /// Data from cells, for tests.
    pub(crate) fn data(cells: &[Cell<'_>]) -> ChoiceData {
        let problem = |(id, actions, _): &Cell<'_>| FittedProblem {
            id: (*id).to_owned(),
            problem: ChoiceProblem::from_outcomes(actions.iter().copied()).unwrap(),
        };
        let counts = cells.iter().map(|(_, _, counts)| counts.to_vec()).collect();
        ChoiceData::from_counts(cells.iter().map(problem).collect(), counts).unwrap()
    }

    fn cups() -> FittedProblem {
        let actions = [
            ("stable", vec![(1.0, 20.0)]),
            ("unstable", vec![(0.2, 105.0), (0.8, 0.0)]),
        ];
        FittedProblem {
            id: "cups".to_owned(),
            problem: ChoiceProblem::from_outcomes(actions).unwrap(),
        }
    }

    #[test]
    fn groups_add_up() {
        let groups = vec![
            Group {
                weight: 3,
                counts: vec![vec![1, 0]],
            },
            Group {
                weight: 2,
                counts: vec![vec![1, 4]],
            },
        ];
        let data = ChoiceData::new(vec![cups()], groups).unwrap();
        assert_eq!(data.totals(), [[5, 8]]);
        assert_eq!(data.n(), 13);
    }

    #[test]
    fn nonsense_is_refused() {
        assert_eq!(
            ChoiceData::new(vec![], vec![]),
            Err(ChoiceDataError::NoProblem)
        );
        let twice = ChoiceData::from_counts(vec![cups(), cups()], vec![vec![1, 1]; 2]);
        assert_eq!(
            twice,
            Err(ChoiceDataError::RepeatedId {
                id: "cups".to_owned()
            })
        );
        let shape = ChoiceData::from_counts(vec![cups()], vec![vec![1, 1, 1]]);
        assert_eq!(shape, Err(ChoiceDataError::Shape { group: 1 }));
        let many = ChoiceData::from_counts(vec![cups()], vec![vec![u64::MAX, 1]]);
        assert_eq!(many, Err(ChoiceDataError::TooMany));
    }
}
