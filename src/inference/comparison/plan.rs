//! What is compared: one plan's answers, and in which parts they are fitted.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::inference::{ChoiceData, FittedProblem};

/// What is left out as one when predictions are scored, and drawn as one when answers are resampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = ResampledUnit)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// All answers of a person.
    Participant,
    /// One answer, because nobody knows who gave which.
    Answer,
}

/// Answers that several units gave alike.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    /// How many units.
    pub weight: u64,
    /// What each of them answered: by problem and action, at least one.
    pub answers: Vec<Answers>,
}

/// How often one action was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Answers {
    /// Position of the problem.
    pub problem: usize,
    /// Position of the action.
    pub action: usize,
    /// How often, at least once.
    pub count: u64,
}

/// The answers of one plan, with the parts in which its problems are fitted.
///
/// Patterns are whole, all answers of a person in the plan, so that a person can be followed through fits of different
/// parts. They stand in an order of their own, each once.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanData {
    data: ChoiceData,
    unit: Unit,
    patterns: Vec<Pattern>,
    parts: Vec<Part>,
}

/// Problems of a plan that are fitted together.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    id: String,
    data: ChoiceData,
    problems: Vec<usize>,
    patterns: Vec<Pattern>,
    /// The pattern of the part that each pattern of the plan belongs to; nothing for people without an answer here.
    membership: Vec<Option<usize>>,
}

impl PlanData {
    /// A plan of several parts.
    ///
    /// * `data`: all problems of the plan; its groups hold the whole pattern of each person.
    /// * `unit`: [`Unit::Answer`] takes the patterns apart into single answers.
    /// * `parts`: id and the positions of the problems, each problem in exactly one part.
    ///
    /// # Errors
    /// When a problem is in no part, in two, or does not exist.
    pub fn new(
        data: &ChoiceData,
        unit: Unit,
        parts: Vec<(String, Vec<usize>)>,
    ) -> Result<Self, PlanError> {
        let problems = data.problems();
        let mut owners = vec![0_usize; problems.len()];
        for (part, positions) in &parts {
            if positions.is_empty() {
                return Err(PlanError::EmptyPart { part: part.clone() });
            }
            for position in positions {
                match owners.get_mut(*position) {
                    Some(owner) => *owner += 1,
                    None => {
                        return Err(PlanError::NoSuchProblem {
                            part: part.clone(),
                            position: *position,
                            problems: problems.len(),
                        });
                    }
                }
            }
        }
        if let Some(position) = owners.iter().position(|owners| *owners != 1) {
            return Err(PlanError::Parts {
                problem: problems[position].id.clone(),
                parts: owners[position],
            });
        }
        Ok(Self::of(data, unit, parts))
    }

    /// A plan that fits all its problems together.
    pub fn whole(data: &ChoiceData, unit: Unit) -> Self {
        let all = (0..data.problems().len()).collect();
        Self::of(data, unit, vec![("all".to_owned(), all)])
    }

    fn of(data: &ChoiceData, unit: Unit, parts: Vec<(String, Vec<usize>)>) -> Self {
        let patterns = patterns(data, unit);
        let data = ChoiceData::from_counts(data.problems().to_vec(), data.totals().to_vec())
            .expect("the sums of valid data are valid");
        let parts = parts
            .into_iter()
            .map(|(id, problems)| Part::new(id, problems, &data, &patterns))
            .collect();
        Self {
            data,
            unit,
            patterns,
            parts,
        }
    }

    /// All problems and the sums of all answers.
    pub fn data(&self) -> &ChoiceData {
        &self.data
    }

    /// What is left out and drawn as one.
    pub fn unit(&self) -> Unit {
        self.unit
    }

    /// The distinct patterns of answers.
    pub fn patterns(&self) -> &[Pattern] {
        &self.patterns
    }

    /// The parts in order.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// How many units there are: people, or answers.
    pub fn units(&self) -> u64 {
        self.patterns.iter().map(|pattern| pattern.weight).sum()
    }
}

impl Part {
    fn new(id: String, problems: Vec<usize>, plan: &ChoiceData, whole: &[Pattern]) -> Self {
        let mut places = vec![None; plan.problems().len()];
        for (place, problem) in problems.iter().enumerate() {
            places[*problem] = Some(place);
        }
        let restricted = |pattern: &Pattern| -> Vec<Answers> {
            let answers = pattern.answers.iter();
            let mut own: Vec<Answers> = answers
                .filter_map(|answers| {
                    places[answers.problem].map(|problem| Answers {
                        problem,
                        ..*answers
                    })
                })
                .collect();
            own.sort_unstable();
            own
        };
        let mut weights: BTreeMap<Vec<Answers>, u64> = BTreeMap::new();
        for pattern in whole {
            let answers = restricted(pattern);
            if !answers.is_empty() {
                *weights.entry(answers).or_default() += pattern.weight;
            }
        }
        let patterns = merged(weights);
        let membership = whole
            .iter()
            .map(|pattern| {
                let answers = restricted(pattern);
                patterns
                    .binary_search_by(|known| known.answers.cmp(&answers))
                    .ok()
            })
            .collect();
        let own = |problem: &usize| {
            (
                plan.problems()[*problem].clone(),
                plan.totals()[*problem].clone(),
            )
        };
        let (own, totals): (Vec<FittedProblem>, Vec<Vec<u64>>) = problems.iter().map(own).unzip();
        Self {
            data: ChoiceData::from_counts(own, totals).expect("a part of valid data is valid"),
            id,
            problems,
            patterns,
            membership,
        }
    }

    /// The part's id, such as `high`.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// The part's problems and the sums of their answers: what is fitted.
    pub fn data(&self) -> &ChoiceData {
        &self.data
    }

    /// Which problem of the plan each problem of the part is.
    pub fn problems(&self) -> &[usize] {
        &self.problems
    }

    /// The distinct patterns of answers in the part; positions of problems are the part's.
    pub fn patterns(&self) -> &[Pattern] {
        &self.patterns
    }

    /// The pattern of the part that each pattern of the plan belongs to.
    pub(super) fn membership(&self) -> &[Option<usize>] {
        &self.membership
    }
}

/// Distinct patterns and their weights; people without an answer are left out.
fn patterns(data: &ChoiceData, unit: Unit) -> Vec<Pattern> {
    let mut weights: BTreeMap<Vec<Answers>, u64> = BTreeMap::new();
    match unit {
        Unit::Participant => {
            for group in data.groups() {
                let answers = answers(&group.counts);
                if group.weight > 0 && !answers.is_empty() {
                    *weights.entry(answers).or_default() += group.weight;
                }
            }
        }
        Unit::Answer => {
            for all in answers(data.totals()) {
                weights.insert(vec![Answers { count: 1, ..all }], all.count);
            }
        }
    }
    merged(weights)
}

fn merged(weights: BTreeMap<Vec<Answers>, u64>) -> Vec<Pattern> {
    weights
        .into_iter()
        .map(|(answers, weight)| Pattern { weight, answers })
        .collect()
}

/// Counts above 0 with their places, in order.
fn answers(counts: &[Vec<u64>]) -> Vec<Answers> {
    let mut found = Vec::new();
    for (problem, row) in counts.iter().enumerate() {
        for (action, count) in row.iter().enumerate().filter(|(_, count)| **count > 0) {
            found.push(Answers {
                problem,
                action,
                count: *count,
            });
        }
    }
    found
}

/// Why problems and parts make no plan.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PlanError {
    /// A part has no problem.
    #[error("part `{part}` has no problem")]
    EmptyPart {
        /// The part.
        part: String,
    },
    /// A part names a problem that is not there.
    #[error("part `{part}` names problem {position} of {problems}, counted from 0")]
    NoSuchProblem {
        /// The part.
        part: String,
        /// The position.
        position: usize,
        /// How many problems there are.
        problems: usize,
    },
    /// A problem is not in exactly one part.
    #[error("problem `{problem}` is in {parts} parts, allowed is exactly one")]
    Parts {
        /// The problem.
        problem: String,
        /// In how many parts it is.
        parts: usize,
    },
}
