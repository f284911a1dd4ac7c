//! How well a model predicts a problem from the answers to other problems.

use std::collections::{BTreeMap, HashMap};
use std::ops::ControlFlow;

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::plan::{Part, PlanData};
use super::pointwise::PartFit;
use super::score::{ScoreDifference, Weighted, sum_and_se};
use crate::inference::accuracy::{ln_divergence, smoothed_shares};
use crate::inference::likelihood::key;
use crate::inference::sampler::{random_stream, streams};
use crate::inference::summary::null_as_nan;
use crate::inference::{ChoiceData, FitError, FittedProblem, fit};
use crate::model::{ChoiceProblem, OrderedMap};

/// The name under which chance is scored.
pub const RANDOM: &str = "random";

/// The name under which the observed share of the other problems is scored.
pub const OBSERVED_SHARE: &str = "observed_share";

/// From how many problems on folds replace leaving out one at a time.
const PROBLEMS_FOR_FOLDS: usize = 20;

/// With fewer distinct problems than this the standard error of a difference is not to be trusted.
///
/// It is estimated from the problems themselves: with C of them its square has C − 1 degrees of freedom, and two models
/// that predict equally well differ by more than two standard errors in 30 % of studies with two problems, 14 % with
/// four, 9 % with eight, and 5 % with sixty (Student's t). Eight is where that comes near what two standard errors
/// promise.
pub const LEAST_PROBLEMS: u64 = 8;

/// How problems are held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeldOutSettings {
    /// Folds of a part with 20 problems or more; 10 by default. With fewer, each problem is a fold of its own.
    pub folds: usize,
    /// Random seed of the folds.
    pub seed: u64,
}

impl Default for HeldOutSettings {
    fn default() -> Self {
        Self { folds: 10, seed: 1 }
    }
}

/// Scores of problems whose answers were held out.
///
/// ```text
/// score(c) = Σ_a n(c,a) ln P̄(a),   P̄(a) = mean over draws given the other problems of P(a | c, draw)
/// ```
///
/// * n(c,a): answers to problem c. Without binomial coefficients.
///
/// Each answer is scored by itself, ln P̄(a), and not all of a problem's answers jointly: P̄(a) is the prediction that is
/// given out for a new problem, and the joint score would let the answers to c teach the model about c, one after the
/// other. So chance and observed shares, which are single predictions too, are scored by the same rule, and ln KL is that
/// of the same P̄. Problems are held out within their part, since other parts have parameters of their own.
///
/// Cells are held out by id. Where several ask the same problem (cells that differ by a time limit only), its copies stay
/// among the others ([`HeldOutProblem::copies`]), and what is scored is the prediction of a cell, not of a new problem. A
/// model errs alike on copies, so standard errors take all cells of a problem for one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct HeldOut {
    /// Whether several problems were held out at a time.
    pub folds: bool,
    /// How many answers were scored.
    pub n: u64,
    /// Each problem that has answers and others beside it in its part.
    pub problems: Vec<HeldOutProblem>,
    /// Sums over problems: chance, the observed share of the others, and each model. Missing for a model with a fit that
    /// did not converge.
    #[schema(value_type = HashMap<String, HeldOutScore>)]
    pub scores: OrderedMap<Option<HeldOutScore>>,
}

/// Predictions of one problem from the others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct HeldOutProblem {
    /// The problem's id.
    pub problem: String,
    /// Its part.
    pub part: String,
    /// With which others it was held out: fold of the part, from 1.
    pub fold: usize,
    /// How many of the problems that it was predicted from ask the same: the same prospects under another id.
    #[serde(default)]
    pub copies: usize,
    /// How many answers it has.
    pub n: u64,
    /// Observed share of each action.
    pub observed: Vec<f64>,
    /// By chance, by the observed share of the others, and by each model.
    #[schema(value_type = HashMap<String, HeldOutPrediction>)]
    pub predictions: OrderedMap<Option<HeldOutPrediction>>,
}

/// One prediction of one problem.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct HeldOutPrediction {
    /// P̄ of each action.
    pub predicted: Vec<f64>,
    /// Σ_a n(a) ln P̄(a), in nats.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub score: f64,
    /// ln KL of the observed shares to P̄; missing where KL is 0 or infinite.
    pub ln_kl: Option<f64>,
}

/// The score of all problems that were held out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct HeldOutScore {
    /// Σ over problems, in nats.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub score: f64,
    /// √(C·Var) over the C distinct problems, the scores of each one's cells summed; missing for fewer than two.
    pub se: Option<f64>,
    /// The score divided by the number of answers.
    #[serde(deserialize_with = "null_as_nan")]
    #[schema(value_type = Option<f64>)]
    pub per_answer: f64,
    /// Mean over problems of ln KL; missing where one is.
    pub mean_ln_kl: Option<f64>,
}

/// Problems of a part that are held out together.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Fold {
    part: usize,
    number: usize,
    /// Positions in the part.
    problems: Vec<usize>,
}

/// The folds of a plan, and what everybody's predictions are measured against.
pub(super) struct Exam {
    folds: Vec<Fold>,
    has_folds: bool,
    problems: Vec<HeldOutProblem>,
    /// Which of the distinct problems each of them is.
    distinct: Vec<usize>,
    counts: Vec<Vec<u64>>,
}

impl Exam {
    /// Draws folds, and predicts by chance and by observed shares. Nothing if no part has two problems with answers.
    pub(super) fn new(plan: &PlanData, settings: &HeldOutSettings) -> Option<Self> {
        let mut exam = Self {
            folds: Vec::new(),
            has_folds: false,
            problems: Vec::new(),
            distinct: Vec::new(),
            counts: Vec::new(),
        };
        let mut known: HashMap<Vec<Vec<u64>>, usize> = HashMap::new();
        for (place, part) in plan.parts().iter().enumerate() {
            let data = part.data();
            let answered: Vec<usize> = (0..data.problems().len())
                .filter(|problem| data.totals()[*problem].iter().any(|count| *count > 0))
                .collect();
            if answered.len() < 2 {
                continue;
            }
            let drawn = if answered.len() < PROBLEMS_FOR_FOLDS {
                answered.into_iter().map(|problem| vec![problem]).collect()
            } else {
                exam.has_folds = true;
                draw_folds(data.problems(), answered, settings)
            };
            for (number, problems) in drawn.into_iter().enumerate() {
                let fold = Fold {
                    part: place,
                    number: number + 1,
                    problems,
                };
                exam.ask(part, &fold, &mut known);
                exam.folds.push(fold);
            }
        }
        (!exam.folds.is_empty()).then_some(exam)
    }

    /// * `known`: number of each distinct problem so far.
    fn ask(&mut self, part: &Part, fold: &Fold, known: &mut HashMap<Vec<Vec<u64>>, usize>) {
        let data = part.data();
        let asked = |place: usize| prospects(&data.problems()[place].problem);
        for problem in &fold.problems {
            let own = asked(*problem);
            let others = (0..data.problems().len()).filter(|other| {
                !fold.problems.contains(other)
                    && data.totals()[*other].iter().any(|count| *count > 0)
            });
            let copies = others.filter(|other| asked(*other) == own).count();
            let number = known.len();
            self.distinct.push(*known.entry(own).or_insert(number));
            let counts = &data.totals()[*problem];
            let n: u64 = counts.iter().sum();
            let observed: Vec<f64> = counts
                .iter()
                .map(|count| *count as f64 / n as f64)
                .collect();
            let even = vec![1.0 / counts.len() as f64; counts.len()];
            let shares = observed_shares(data, fold, *problem).unwrap_or_else(|| even.clone());
            let predictions = [(RANDOM, even), (OBSERVED_SHARE, shares)]
                .into_iter()
                .map(|(name, predicted)| {
                    let marked = HeldOutPrediction::of(predicted, counts, &observed);
                    (name.to_owned(), Some(marked))
                })
                .collect();
            self.problems.push(HeldOutProblem {
                problem: data.problems()[*problem].id.clone(),
                part: part.id().to_owned(),
                fold: fold.number,
                copies,
                n,
                observed,
                predictions,
            });
            self.counts.push(counts.clone());
        }
    }

    /// Lets a model predict every problem from the others.
    ///
    /// * `fits`: of all answers, one per part: what the new fits are made like.
    pub(super) fn examine(
        &mut self,
        plan: &PlanData,
        fits: &[PartFit],
        watch: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<(), FitError> {
        let Some(model) = fits.first().map(|fit| fit.model) else {
            return Ok(());
        };
        let mut next = 0;
        for fold in &self.folds {
            let data = plan.parts()[fold.part].data();
            let known = &fits[fold.part];
            let others = without(data, &fold.problems);
            let refit: PartFit =
                fit(known.model, &others, &known.settings(), &mut |_| watch())?.into();
            let asked: Vec<FittedProblem> = fold
                .problems
                .iter()
                .map(|problem| data.problems()[*problem].clone())
                .collect();
            for predicted in refit.mean_probabilities(&asked) {
                let problem = &mut self.problems[next];
                let marked =
                    HeldOutPrediction::of(predicted, &self.counts[next], &problem.observed);
                let entry = refit.summary.converged.then_some(marked);
                problem.predictions.0.push((model.id.to_owned(), entry));
                next += 1;
            }
        }
        Ok(())
    }

    /// Scores per distinct problem of one who predicted, the sum over its cells; nothing if a prediction is missing.
    pub(super) fn units(&self, name: &str) -> Option<Vec<Weighted>> {
        let distinct = self.distinct.iter().max().map_or(0, |last| last + 1);
        let mut units = vec![(1, 0.0); distinct];
        for (problem, place) in self.problems.iter().zip(&self.distinct) {
            units[*place].1 += problem.predictions.get(name)?.as_ref()?.score;
        }
        Some(units)
    }

    /// First minus second, over distinct problems.
    pub(super) fn difference(&self, first: &str, second: &str) -> Option<ScoreDifference> {
        Some(ScoreDifference::of(
            &self.units(first)?,
            &self.units(second)?,
        ))
    }

    /// How many answers are scored.
    pub(super) fn n(&self) -> u64 {
        self.problems.iter().map(|problem| problem.n).sum()
    }

    pub(super) fn report(self) -> HeldOut {
        let names: Vec<String> = self.problems[0]
            .predictions
            .iter()
            .map(|(name, _)| name.to_owned())
            .collect();
        let score = |name: &String| {
            let (score, se) = sum_and_se(&self.units(name)?);
            let count = self.problems.len() as f64;
            let ln_kl: Option<f64> = self
                .problems
                .iter()
                .map(|problem| problem.predictions.get(name)?.as_ref()?.ln_kl)
                .sum();
            Some(HeldOutScore {
                score,
                se,
                per_answer: score / self.n() as f64,
                mean_ln_kl: ln_kl.map(|sum| sum / count),
            })
        };
        let scores = names
            .iter()
            .map(|name| (name.clone(), score(name)))
            .collect();
        HeldOut {
            folds: self.has_folds,
            n: self.n(),
            scores,
            problems: self.problems,
        }
    }
}

impl HeldOutPrediction {
    fn of(predicted: Vec<f64>, counts: &[u64], observed: &[f64]) -> Self {
        let ln_predicted: Vec<f64> = predicted.iter().map(|share| share.ln()).collect();
        let pairs = counts.iter().zip(&ln_predicted);
        let score = pairs
            .filter(|(count, _)| **count > 0)
            .map(|(count, ln_p)| *count as f64 * ln_p)
            .sum();
        let ln_kl = ln_divergence(observed, &ln_predicted).filter(|ln_kl| ln_kl.is_finite());
        Self {
            predicted,
            score,
            ln_kl,
        }
    }
}

/// The data with the answers to some problems taken out. The problems stay, so that convergence is checked for what is
/// predicted of them.
fn without(data: &ChoiceData, problems: &[usize]) -> ChoiceData {
    let mut counts = data.totals().to_vec();
    for problem in problems {
        counts[*problem].fill(0);
    }
    ChoiceData::from_counts(data.problems().to_vec(), counts)
        .expect("fewer answers leave data valid")
}

/// The share of each action among the answers to the part's other problems, smoothed: (n_a + ½)/(n + A/2).
///
/// Actions are matched by name among problems with the same names; if there are none, by position among those with as
/// many actions. Nothing if there are none of these either.
fn observed_shares(data: &ChoiceData, fold: &Fold, problem: usize) -> Option<Vec<f64>> {
    let asked = &data.problems()[problem].problem;
    let others = || (0..data.problems().len()).filter(|other| !fold.problems.contains(other));
    let by_name = |other: usize| -> Option<Vec<u64>> {
        let known = &data.problems()[other].problem;
        if known.actions().len() != asked.actions().len() {
            return None;
        }
        asked
            .names()
            .map(|name| {
                known
                    .position(name)
                    .map(|place| data.totals()[other][place])
            })
            .collect()
    };
    let by_position = |other: usize| {
        let counts = &data.totals()[other];
        (counts.len() == asked.actions().len()).then(|| counts.clone())
    };
    let sum = |counts: Vec<Vec<u64>>| {
        counts.into_iter().reduce(|sum, counts| {
            let pairs = sum.iter().zip(&counts);
            pairs.map(|(left, right)| left + right).collect()
        })
    };
    let counts = sum(others().filter_map(by_name).collect())
        .or_else(|| sum(others().filter_map(by_position).collect()))?;
    Some(smoothed_shares(&counts))
}

/// Folds of about equal size in which problems of each kind are spread evenly.
///
/// A kind is the number of actions and the signs of rewards. Problems are sorted by id before they are drawn, so their
/// order in a file does not matter.
fn draw_folds(
    problems: &[FittedProblem],
    answered: Vec<usize>,
    settings: &HeldOutSettings,
) -> Vec<Vec<usize>> {
    let count = settings.folds.clamp(2, answered.len());
    let mut rng = random_stream(settings.seed, streams::FOLDS);
    let mut kinds: BTreeMap<(usize, bool, bool), Vec<usize>> = BTreeMap::new();
    for problem in answered {
        let kind = kind(&problems[problem].problem);
        kinds.entry(kind).or_default().push(problem);
    }
    let mut folds = vec![Vec::new(); count];
    let mut next = 0;
    for (_, mut members) in kinds {
        members.sort_by(|left, right| problems[*left].id.cmp(&problems[*right].id));
        members.shuffle(&mut rng);
        for problem in members {
            folds[next % count].push(problem);
            next += 1;
        }
    }
    folds
}

/// The prospects to choose from, whatever their names and order.
fn prospects(problem: &ChoiceProblem) -> Vec<Vec<u64>> {
    let bits = |value: f64| value.to_bits();
    let actions = problem.actions().iter();
    let mut prospects: Vec<Vec<u64>> = actions
        .map(|action| key(&action.prospect).into_iter().map(bits).collect())
        .collect();
    prospects.sort_unstable();
    prospects
}

/// Number of actions, whether there is a gain, whether there is a loss.
fn kind(problem: &ChoiceProblem) -> (usize, bool, bool) {
    let rewards = || {
        let actions = problem.actions().iter();
        actions
            .flat_map(|action| action.prospect.outcomes())
            .map(|outcome| outcome.reward)
    };
    (
        problem.actions().len(),
        rewards().any(|reward| reward > 0.0),
        rewards().any(|reward| reward < 0.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::choice_data::tests::data;
    use crate::inference::comparison::Unit;

    const SURE: &[(f64, f64)] = &[(1.0, 20.0)];
    const RISKY: &[(f64, f64)] = &[(0.2, 105.0), (0.8, 0.0)];
    const LOSS: &[(f64, f64)] = &[(0.5, -10.0), (0.5, 0.0)];

    #[test]
    fn chance_and_observed_shares_by_hand() {
        let data = data(&[
            ("one", &[("safe", SURE), ("risky", RISKY)], &[3, 1]),
            ("two", &[("risky", RISKY), ("safe", SURE)], &[2, 4]),
            ("three", &[("left", SURE), ("right", RISKY)], &[5, 0]),
            ("empty", &[("left", SURE), ("right", RISKY)], &[0, 0]),
        ]);
        let plan = PlanData::whole(&data, Unit::Answer);
        let exam = Exam::new(&plan, &HeldOutSettings::default()).unwrap();
        let report = exam.report();
        assert_eq!(
            (report.problems.len(), report.n, report.folds),
            (3, 15, false)
        );
        let shares = |problem: usize, name: &str| {
            let found = report.problems[problem].predictions.get(name).unwrap();
            found.clone().unwrap()
        };
        // By name: the second problem's safe 4 and risky 2.
        let first = shares(0, OBSERVED_SHARE);
        assert_eq!(first.predicted, [4.5 / 7.0, 2.5 / 7.0]);
        let expected = 3.0 * (4.5_f64 / 7.0).ln() + (2.5_f64 / 7.0).ln();
        assert!((first.score - expected).abs() < 1e-12);
        // By position: the problem without answers goes by the same names but says nothing.
        assert_eq!(shares(2, OBSERVED_SHARE).predicted, [0.5, 0.5]);
        assert!((shares(2, RANDOM).score - 5.0 * 0.5_f64.ln()).abs() < 1e-12);
        // KL((1, 0) ‖ (½, ½)) = ln 2.
        let ln_kl = shares(2, RANDOM).ln_kl.unwrap();
        assert!((ln_kl - std::f64::consts::LN_2.ln()).abs() < 1e-12);
        let total = report.scores.get(RANDOM).unwrap().unwrap();
        assert!((total.per_answer - 0.5_f64.ln()).abs() < 1e-12);
    }

    /// Differences 1 and 2 on the copies of one problem and 6 on the other are 3 and 6: sum 9, √(2 · 4.5) = 3.
    #[test]
    fn cells_of_one_problem_count_once_in_the_error() {
        let data = data(&[
            ("short", &[("safe", SURE), ("risky", RISKY)], &[3, 1]),
            ("long", &[("gamble", RISKY), ("sure", SURE)], &[2, 4]),
            ("other", &[("safe", SURE), ("risky", LOSS)], &[5, 0]),
        ]);
        let plan = PlanData::whole(&data, Unit::Answer);
        let mut exam = Exam::new(&plan, &HeldOutSettings::default()).unwrap();
        let copies: Vec<usize> = exam.problems.iter().map(|one| one.copies).collect();
        assert_eq!(copies, [1, 1, 0]);
        for (problem, more) in exam.problems.iter_mut().zip([1.0, 2.0, 6.0]) {
            let mut better = problem.predictions.get(RANDOM).unwrap().clone().unwrap();
            better.score += more;
            problem
                .predictions
                .0
                .push(("better".to_owned(), Some(better)));
        }
        let found = exam.difference("better", RANDOM).unwrap();
        assert!((found.value - 9.0).abs() < 1e-12, "{found:?}");
        assert!((found.se.unwrap() - 3.0).abs() < 1e-12, "{found:?}");
        assert_eq!(found.units, 2);
    }

    /// Nothing says how far one problem under two ids would vary.
    #[test]
    fn one_problem_twice_has_no_error() {
        let data = data(&[
            ("one", &[("safe", SURE), ("risky", RISKY)], &[20, 10]),
            ("again", &[("safe", SURE), ("risky", RISKY)], &[20, 10]),
        ]);
        let plan = PlanData::whole(&data, Unit::Answer);
        let exam = Exam::new(&plan, &HeldOutSettings::default()).unwrap();
        let found = exam.difference(OBSERVED_SHARE, RANDOM).unwrap();
        assert_eq!(
            (found.se, found.units, found.beyond_two_se),
            (None, 1, false)
        );
        assert!(
            exam.report()
                .scores
                .get(RANDOM)
                .unwrap()
                .unwrap()
                .se
                .is_none()
        );
    }

    #[test]
    fn one_problem_alone_cannot_be_predicted_from_others() {
        let data = data(&[("one", &[("safe", SURE), ("risky", RISKY)], &[3, 1])]);
        let plan = PlanData::whole(&data, Unit::Answer);
        assert!(Exam::new(&plan, &HeldOutSettings::default()).is_none());
    }

    #[test]
    fn folds_hold_each_problem_once_and_spread_each_kind() {
        let names: Vec<String> = (0..25).map(|index| format!("p{index}")).collect();
        let gains: &[(&str, &[(f64, f64)])] = &[("a", SURE), ("b", RISKY)];
        let mixed: &[(&str, &[(f64, f64)])] = &[("a", SURE), ("b", LOSS)];
        let cells: Vec<_> = names
            .iter()
            .enumerate()
            .map(|(index, name)| {
                let actions = if index % 2 == 0 { gains } else { mixed };
                (name.as_str(), actions, &[1, 1][..])
            })
            .collect();
        let problems = data(&cells).problems().to_vec();
        let drawn = |seed| {
            let settings = HeldOutSettings { folds: 5, seed };
            draw_folds(&problems, (0..25).collect(), &settings)
        };
        let folds = drawn(1);
        let mut all: Vec<usize> = folds.concat();
        all.sort_unstable();
        assert_eq!(all, (0..25).collect::<Vec<_>>());
        for fold in &folds {
            let mixed = fold.iter().filter(|problem| **problem % 2 == 1).count();
            assert!(fold.len() == 5 && (2..=3).contains(&mixed), "{fold:?}");
        }
        assert_eq!(folds, drawn(1));
        assert_ne!(folds, drawn(2));
    }
}
