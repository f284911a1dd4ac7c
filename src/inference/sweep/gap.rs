//! One pattern of answers, every gap between expected rewards.

use std::fmt;
use std::str::FromStr;

use serde::Serialize;

use super::{
    Score, SimulatedCell, Simulation, SweepError, SweepHead, SweepScore, best_beside, counts_on,
    expected_rewards, is_unanimous, position,
};
use crate::inference::FittedProblem;
use crate::model::{ChoiceProblem, ChoiceProblemError, OrderedMap, Outcome, Prospect};

/// Steps of a gap sweep unless another number is asked for: the fine in steps of 28 from 26 to 474.
pub const DEFAULT_STEPS: usize = 17;

/// Share of the range that the default keeps from its ends: 1 of the 450 between the driving study's expected rewards.
const INSET: f64 = 1.0 / 450.0;

/// One number of a problem that varies.
///
/// As text `ACTION:REWARD=FROM..TO` or `ACTION:p(REWARD)=FROM..TO`: an outcome is named by its action and its reward, which no
/// other outcome of that action has.
#[derive(Debug, Clone, PartialEq)]
pub struct Variation {
    /// The action.
    pub action: String,
    /// Which of its numbers.
    pub number: VariedNumber,
    /// First value.
    pub from: f64,
    /// Last value.
    pub to: f64,
}

/// A number of an action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VariedNumber {
    /// The reward that is this one in the problem as it stands.
    Reward(f64),
    /// The probability of the outcome with this reward; the action's other probabilities keep their proportions.
    Probability(f64),
}

impl fmt::Display for Variation {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            action, from, to, ..
        } = self;
        match self.number {
            VariedNumber::Reward(reward) => write!(formatter, "{action}:{reward}={from}..{to}"),
            VariedNumber::Probability(reward) => {
                write!(formatter, "{action}:p({reward})={from}..{to}")
            }
        }
    }
}

impl FromStr for Variation {
    type Err = SweepError;

    fn from_str(text: &str) -> Result<Self, SweepError> {
        let read = || {
            let (place, range) = text.split_once('=')?;
            let (action, number) = place.rsplit_once(':')?;
            let (from, to) = range.split_once("..")?;
            let finite = |text: &str| {
                let value: f64 = text.trim().parse().ok()?;
                value.is_finite().then_some(value)
            };
            let number = number.trim();
            let inner = number
                .strip_prefix("p(")
                .and_then(|rest| rest.strip_suffix(')'));
            Some(Self {
                action: action.trim().to_owned(),
                number: match inner {
                    Some(reward) => VariedNumber::Probability(finite(reward)?),
                    None => VariedNumber::Reward(finite(number)?),
                },
                from: finite(from)?,
                to: finite(to)?,
            })
        };
        read().ok_or_else(|| SweepError::Variation {
            text: text.to_owned(),
        })
    }
}

impl Variation {
    /// What varies unless somebody says otherwise: the first action whose reward is sure and the same in all problems.
    ///
    /// It runs over the range in which the optimal action of each problem stays the same: between the lowest and the
    /// highest expected reward of the other actions, 1/450 of the range away from both ends (in the driving study the fine
    /// from 26 to 474). Where these are one and the same number, it runs between the extreme rewards of the others.
    ///
    /// # Errors
    /// When no action is of this kind.
    pub fn default_for(problems: &[FittedProblem]) -> Result<Self, SweepError> {
        let Some(first) = problems.first() else {
            return Err(SweepError::Nothing);
        };
        let sure = first.problem.actions().iter().find_map(|action| {
            let reward = sure_reward(&action.prospect)?;
            let everywhere = problems.iter().all(|problem| {
                problem
                    .problem
                    .position(&action.name)
                    .map(|at| &problem.problem.actions()[at].prospect)
                    .and_then(sure_reward)
                    == Some(reward)
            });
            everywhere.then_some((action.name.clone(), reward))
        });
        let (action, reward) = sure.ok_or(SweepError::NoDefaultVariation)?;
        let others = || {
            problems
                .iter()
                .flat_map(|problem| problem.problem.actions())
                .filter(|other| other.name != action)
                .map(|other| &other.prospect)
        };
        let expected: Vec<f64> = others().map(Prospect::expected_reward).collect();
        let (mut low, mut high) = extremes(&expected);
        if low == high {
            let rewards: Vec<f64> = others()
                .flat_map(Prospect::outcomes)
                .map(|outcome| outcome.reward)
                .collect();
            (low, high) = extremes(&rewards);
        }
        if low == high {
            return Err(SweepError::NoDefaultVariation);
        }
        let inset = (high - low) * INSET;
        let ends = (low + inset, high - inset);
        let (from, to) = if ends.0.abs() <= ends.1.abs() {
            ends
        } else {
            (ends.1, ends.0)
        };
        // The inset of 450 is 1 but for rounding.
        let tidy = |value: f64| (value * 1e6).round() / 1e6;
        Ok(Self {
            action,
            number: VariedNumber::Reward(reward),
            from: tidy(from),
            to: tidy(to),
        })
    }

    /// The values, evenly spaced, both ends included.
    fn values(&self, steps: usize) -> Vec<f64> {
        let width = (steps - 1) as f64;
        let value = |step| self.from + (self.to - self.from) * step as f64 / width;
        (0..steps).map(value).collect()
    }

    /// The problem with this value in place of the number.
    fn applied(&self, problem: &FittedProblem, value: f64) -> Result<FittedProblem, SweepError> {
        let varied = position(problem, &self.action)?;
        let (VariedNumber::Reward(reward) | VariedNumber::Probability(reward)) = self.number;
        let outcomes = problem.problem.actions()[varied].prospect.outcomes();
        let known = outcomes
            .iter()
            .find(|outcome| outcome.reward == reward)
            .ok_or_else(|| SweepError::UnknownOutcome {
                action: self.action.clone(),
                problem: problem.id.clone(),
                reward,
            })?;
        let rest = 1.0 - known.probability;
        let changed = |outcome: &Outcome| match self.number {
            VariedNumber::Reward(_) if outcome.reward == reward => Outcome {
                reward: value,
                ..*outcome
            },
            VariedNumber::Probability(_) if outcome.reward == reward => Outcome {
                probability: value,
                ..*outcome
            },
            VariedNumber::Reward(_) => *outcome,
            VariedNumber::Probability(_) => Outcome {
                probability: outcome.probability * (1.0 - value) / rest,
                ..*outcome
            },
        };
        if matches!(self.number, VariedNumber::Probability(_)) && rest <= 0.0 {
            return Err(SweepError::SureOutcome {
                action: self.action.clone(),
                reward,
            });
        }
        let prospect =
            Prospect::new(outcomes.iter().map(changed)).map_err(|source| SweepError::Value {
                value,
                source: ChoiceProblemError::Prospect {
                    action: self.action.clone(),
                    source,
                },
            })?;
        let actions = problem.problem.actions().iter().enumerate();
        let actions = actions.map(|(index, action)| {
            let prospect = if index == varied {
                prospect.clone()
            } else {
                action.prospect.clone()
            };
            (action.name.clone(), prospect)
        });
        let problem = FittedProblem {
            id: problem.id.clone(),
            problem: ChoiceProblem::new(actions)
                .map_err(|source| SweepError::Value { value, source })?,
        };
        Ok(problem)
    }
}

fn sure_reward(prospect: &Prospect) -> Option<f64> {
    let outcome = prospect
        .outcomes()
        .iter()
        .find(|outcome| outcome.probability > 0.0)?;
    prospect.is_sure().then_some(outcome.reward)
}

fn extremes(values: &[f64]) -> (f64, f64) {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (low, high)
}

/// The answers that every point of a gap sweep has.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// So many of n on one action, the rest on the best of the others.
    Held {
        /// The action; by default the safe one: the first whose rewards spread least.
        action: Option<String>,
        /// Answers on it.
        count: u64,
        /// All answers, at least 2.
        n: u64,
    },
    /// For each problem how often each action was chosen; problems nobody answered are left out.
    Observed(Vec<Vec<u64>>),
}

impl Default for Pattern {
    /// The paper's pattern: 25 of 30 on the safe action.
    fn default() -> Self {
        Self::Held {
            action: None,
            count: 25,
            n: 30,
        }
    }
}

/// One number of some problems varies while the answers stay.
#[derive(Debug, Clone, PartialEq)]
pub struct GapSweep {
    variation: Variation,
    series: Vec<Series>,
}

#[derive(Debug, Clone, PartialEq)]
struct Series {
    problem: String,
    held: usize,
    points: Vec<Point>,
}

#[derive(Debug, Clone, PartialEq)]
struct Point {
    value: f64,
    gap: f64,
    cell: SimulatedCell,
}

/// A finished gap sweep.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct GapSweepReport {
    /// What varied, as [`Variation`] writes it.
    pub vary: String,
    /// How it was made.
    #[serde(flatten)]
    pub head: SweepHead,
    /// One entry per problem.
    pub series: Vec<GapSeries>,
}

/// One problem of a gap sweep.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct GapSeries {
    /// The problem's id.
    pub problem: String,
    /// The action that most answers are on: gaps are its expected reward minus the best of the others.
    pub held: String,
    /// In the order of the values.
    pub points: Vec<GapPoint>,
}

/// One value of the number that varies.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct GapPoint {
    /// The value.
    pub value: f64,
    /// Expected reward of the held action minus the best expected reward of the others, in the study's reward unit: below 0
    /// most answers are suboptimal.
    pub gap: f64,
    /// How often each action was chosen.
    pub counts: Vec<u64>,
    /// Whether all answers are the same: scored against smoothed shares.
    pub unanimous: bool,
    /// By model.
    #[schema(value_type = HashMap<String, SweepScore>)]
    pub models: OrderedMap<SweepScore>,
    /// For each model but the first: how much closer to the choices it comes.
    #[schema(value_type = HashMap<String, Difference>)]
    pub difference: OrderedMap<Difference>,
}

/// ln KL of the first model minus that of another: above 0 the other comes closer to the choices.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = SweepDifference)]
pub struct Difference {
    /// Difference of the means.
    pub mean: Option<f64>,
    /// Standard deviation of the difference of two independent samples.
    pub sd: Option<f64>,
    /// Monte-Carlo standard error of the mean difference.
    pub standard_error: Option<f64>,
}

impl Difference {
    fn of(first: &SweepScore, other: &SweepScore) -> Self {
        let root = |left: Option<f64>, right: Option<f64>| Some(left?.hypot(right?));
        Self {
            mean: first
                .ln_kl
                .mean
                .zip(other.ln_kl.mean)
                .map(|(first, other)| first - other),
            sd: root(first.ln_kl.sd, other.ln_kl.sd),
            standard_error: root(first.standard_error, other.standard_error),
        }
    }
}

impl GapSweep {
    /// A sweep over `steps` values.
    ///
    /// # Errors
    /// When a problem has no such number, a value is not possible, or the pattern is not.
    pub fn new(
        problems: &[FittedProblem],
        variation: Variation,
        steps: usize,
        pattern: &Pattern,
    ) -> Result<Self, SweepError> {
        if steps < 2 {
            return Err(SweepError::TooFewSteps { steps });
        }
        let mut series = Vec::new();
        for (index, problem) in problems.iter().enumerate() {
            let observed = match pattern {
                Pattern::Held { .. } => None,
                Pattern::Observed(counts) => Some(counts.get(index).map_or(&[][..], Vec::as_slice)),
            };
            if observed.is_some_and(|counts| counts.iter().sum::<u64>() == 0) {
                continue;
            }
            let held = match (pattern, observed) {
                (Pattern::Observed(_), Some(counts)) => most_chosen(counts),
                (Pattern::Observed(_), None) => continue,
                (
                    Pattern::Held {
                        action: Some(name), ..
                    },
                    _,
                ) => position(problem, name)?,
                (Pattern::Held { action: None, .. }, _) => safest(problem),
            };
            let mut points = Vec::new();
            for value in variation.values(steps) {
                let changed = variation.applied(problem, value)?;
                let expected = expected_rewards(&changed);
                let best = best_beside(&expected, held);
                let counts = match pattern {
                    Pattern::Observed(_) => observed.unwrap_or_default().to_vec(),
                    Pattern::Held { n, .. } if *n < 2 => {
                        return Err(SweepError::TooFewAnswers { n: *n });
                    }
                    Pattern::Held { count, n, .. } if count > n => {
                        return Err(SweepError::TooManyOnAction {
                            count: *count,
                            n: *n,
                        });
                    }
                    Pattern::Held { count, n, .. } => {
                        counts_on(expected.len(), [(held, *count), (best, n - count)])
                    }
                };
                points.push(Point {
                    value,
                    gap: expected[held] - expected[best],
                    cell: SimulatedCell {
                        problem: changed,
                        counts,
                    },
                });
            }
            series.push(Series {
                problem: problem.id.clone(),
                held,
                points,
            });
        }
        if series.is_empty() {
            return Err(SweepError::Nothing);
        }
        Ok(Self { variation, series })
    }

    /// The cells to fit.
    pub fn cells(&self) -> Vec<SimulatedCell> {
        self.points().map(|point| point.cell.clone()).collect()
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.series.iter().flat_map(|series| &series.points)
    }

    /// The report of a simulation of [`cells`](Self::cells), from the scores of all its tasks in order.
    pub fn report(&self, simulation: &Simulation, scores: &[Score]) -> GapSweepReport {
        let mut by_cell = simulation.by_cell(scores).into_iter();
        let series = self.series.iter().map(|series| GapSeries {
            problem: series.problem.clone(),
            held: series.points[0].cell.problem.problem.actions()[series.held]
                .name
                .clone(),
            points: series
                .points
                .iter()
                .zip(by_cell.by_ref())
                .map(|(point, models)| gap_point(point, models))
                .collect(),
        });
        GapSweepReport {
            vary: self.variation.to_string(),
            head: simulation.head(),
            series: series.collect(),
        }
    }
}

fn gap_point(point: &Point, models: OrderedMap<SweepScore>) -> GapPoint {
    let difference = match models.0.split_first() {
        Some(((_, first), others)) => others
            .iter()
            .map(|(model, score)| (model.clone(), Difference::of(first, score)))
            .collect(),
        None => OrderedMap(Vec::new()),
    };
    GapPoint {
        value: point.value,
        gap: point.gap,
        counts: point.cell.counts.clone(),
        unanimous: is_unanimous(&point.cell.counts),
        models,
        difference,
    }
}

fn most_chosen(counts: &[u64]) -> usize {
    let mut most = 0;
    for (action, count) in counts.iter().enumerate() {
        if *count > counts[most] {
            most = action;
        }
    }
    most
}

/// The first action with the smallest standard deviation of its reward.
fn safest(problem: &FittedProblem) -> usize {
    let spread = |prospect: &Prospect| -> f64 {
        let mean = prospect.expected_reward();
        let outcomes = prospect.outcomes().iter();
        outcomes
            .map(|outcome| outcome.probability * (outcome.reward - mean).powi(2))
            .sum()
    };
    let actions = problem.problem.actions();
    let mut safest = 0;
    for (index, action) in actions.iter().enumerate() {
        if spread(&action.prospect) < spread(&actions[safest].prospect) {
            safest = index;
        }
    }
    safest
}

#[cfg(test)]
mod tests;
