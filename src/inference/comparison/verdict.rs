//! One line on a hypothesis, and what it rests on.

use serde::{Deserialize, Serialize};

use super::held_out::LEAST_PROBLEMS;
use super::report::{Comparison, Pair};

/// A claim that one model predicts people better than another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hypothesis<'a> {
    /// Its name in the source, such as `H1`.
    pub id: &'a str,
    /// The claim in our own words.
    pub statement: &'a str,
    /// The id of the model that should be better.
    pub better: &'a str,
    /// The id of the other.
    pub than: &'a str,
}

/// What a comparison says on a hypothesis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = HypothesisVerdict)]
pub struct Verdict {
    /// The hypothesis' name.
    pub hypothesis: String,
    /// The claim.
    pub statement: String,
    /// The outcome by [`Verdict::CRITERION`].
    pub outcome: Outcome,
    /// What each criterion that could be asked says.
    pub criteria: Vec<Criterion>,
    /// The outcome with its numbers, one line.
    pub line: String,
    /// What each criterion asks, where they do not agree.
    pub disagreement: Option<String>,
}

/// Whether a hypothesis holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = HypothesisOutcome)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Every criterion speaks for it.
    Supported,
    /// None speaks for it, and at least one speaks against it.
    NotSupported,
    /// Anything else.
    Undecided,
}

/// One criterion and what it says.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Criterion {
    /// Which one.
    pub question: Question,
    /// The difference in nats, above 0 where the claimed model is better; missing if it has no value.
    pub value: Option<f64>,
    /// Its standard error.
    pub se: Option<f64>,
    /// Which side it takes.
    pub leaning: Leaning,
}

/// What a criterion asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = CriterionQuestion)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// Prediction of problems from other problems.
    HeldOut,
    /// Prediction of cells from other cells, some of which ask the same problem.
    HeldOutCells,
    /// Prediction of people from other people.
    LeaveOneOut,
    /// How likely the answers were beforehand.
    BayesFactor,
}

/// Which side a criterion takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Leaning {
    /// For the claim.
    For,
    /// Against it.
    Against,
    /// Neither.
    Neither,
}

impl Leaning {
    fn of(value: f64, is_clear: bool) -> Self {
        if !is_clear {
            Self::Neither
        } else if value > 0.0 {
            Self::For
        } else {
            Self::Against
        }
    }

    const fn words(self) -> &'static str {
        match self {
            Self::For => "for it",
            Self::Against => "against it",
            Self::Neither => "neither way",
        }
    }
}

impl Question {
    const fn name(self) -> &'static str {
        match self {
            Self::HeldOut => "held-out problems",
            Self::HeldOutCells => "held-out cells",
            Self::LeaveOneOut => "left-out answers",
            Self::BayesFactor => "Bayes factor",
        }
    }

    /// What it asks, in a clause.
    pub const fn asks(self) -> &'static str {
        match self {
            Self::HeldOut => {
                "held-out problems ask which model, fitted to the other problems, predicts answers to a new one"
            }
            Self::HeldOutCells => {
                "held-out cells ask which model, fitted to the other cells, predicts answers to one more cell, though not to a new problem: others ask the same"
            }
            Self::LeaveOneOut => {
                "left-out answers ask which model, fitted to everybody else, predicts more people in the same problems"
            }
            Self::BayesFactor => {
                "the Bayes factor asks under which model, with its priors, the answers were likelier before any was seen"
            }
        }
    }
}

impl Outcome {
    const fn words(self) -> &'static str {
        match self {
            Self::Supported => "supported",
            Self::NotSupported => "not supported",
            Self::Undecided => "undecided",
        }
    }
}

impl Verdict {
    /// How the outcome is found.
    pub const CRITERION: &'static str = "supported if the difference on held-out problems exceeds two standard errors with 8 distinct problems or more, the difference on left-out \
         answers exceeds 4 and two standard errors with 30 units or more, and the Bayes factor has one sign under all \
         priors tried, all for the claim; not supported if none of them speaks for it and at least one against it; \
         otherwise undecided. What could not be asked (one problem alone) is left out";

    /// The verdict of a comparison; nothing if it lacks one of the models, or asked nothing that decides.
    pub fn of(hypothesis: &Hypothesis<'_>, comparison: &Comparison) -> Option<Self> {
        let (pair, sign) = comparison.pair(hypothesis.better, hypothesis.than)?;
        let criteria = criteria(comparison, pair, sign);
        if criteria.is_empty() {
            return None;
        }
        let leanings = || criteria.iter().map(|criterion| criterion.leaning);
        let outcome = if leanings().all(|leaning| leaning == Leaning::For) {
            Outcome::Supported
        } else if leanings().all(|leaning| leaning != Leaning::For)
            && leanings().any(|leaning| leaning == Leaning::Against)
        {
            Outcome::NotSupported
        } else {
            Outcome::Undecided
        };
        let numbers: Vec<String> = criteria.iter().map(Criterion::in_words).collect();
        let agree = leanings().all(|leaning| leaning == criteria[0].leaning);
        let disagreement = (!agree).then(|| {
            let clauses: Vec<&str> = criteria.iter().map(|one| one.question.asks()).collect();
            format!("They ask different things: {}.", clauses.join("; "))
        });
        Some(Self {
            hypothesis: hypothesis.id.to_owned(),
            statement: hypothesis.statement.to_owned(),
            outcome,
            line: format!(
                "{} {}: {}",
                hypothesis.id,
                outcome.words(),
                numbers.join("; ")
            ),
            criteria,
            disagreement,
        })
    }
}

impl Criterion {
    fn in_words(&self) -> String {
        let number = match (self.value, self.se) {
            (Some(value), Some(se)) => format!("{value:+.1} ± {se:.1}"),
            (Some(value), None) => format!("{value:+.1}"),
            (None, _) => "no value".to_owned(),
        };
        format!(
            "{} {number}, {}",
            self.question.name(),
            self.leaning.words()
        )
    }
}

/// The criteria that were asked of a pair; `sign` is −1 if its first model is not the claimed one.
fn criteria(comparison: &Comparison, pair: &Pair, sign: f64) -> Vec<Criterion> {
    let mut criteria = Vec::new();
    let finite = |value: f64| Some(sign * value).filter(|value| value.is_finite());
    if let Some(held_out) = &comparison.held_out {
        let question = if held_out.problems.iter().any(|problem| problem.copies > 0) {
            Question::HeldOutCells
        } else {
            Question::HeldOut
        };
        // A fold that did not converge leaves no difference: asked, but without an answer.
        let difference = pair.held_out.as_ref();
        criteria.push(Criterion {
            question,
            value: difference.and_then(|difference| finite(difference.value)),
            se: difference.and_then(|difference| difference.se),
            leaning: difference.map_or(Leaning::Neither, |difference| {
                let is_clear = difference.beyond_two_se && difference.units >= LEAST_PROBLEMS;
                Leaning::of(sign * difference.value, is_clear)
            }),
        });
    }
    if let Some(left_out) = &pair.leave_one_out {
        let difference = left_out.difference;
        let is_clear = left_out.distinguishable && difference.beyond_two_se;
        criteria.push(Criterion {
            question: Question::LeaveOneOut,
            value: finite(difference.value),
            se: difference.se,
            leaning: Leaning::of(sign * difference.value, is_clear),
        });
    }
    // Without the table nobody knows how far it hangs on the priors.
    if let Some(factor) = pair
        .bayes_factor
        .as_ref()
        .filter(|factor| factor.sensitivity.is_some())
    {
        criteria.push(Criterion {
            question: Question::BayesFactor,
            value: finite(factor.ln.value),
            se: Some(factor.ln.se),
            leaning: Leaning::of(sign * factor.ln.value, factor.common_sign().is_some()),
        });
    }
    criteria
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::Estimate;
    use crate::inference::comparison::{
        BayesFactor, HeldOut, HeldOutProblem, LeaveOneOutDifference, ScoreDifference, Unit,
    };
    use crate::model::OrderedMap;

    fn difference(value: f64, se: f64) -> ScoreDifference {
        ScoreDifference {
            value,
            se: Some(se),
            units: 40,
            beyond_two_se: value.abs() > 2.0 * se,
        }
    }

    fn comparison(held_out: f64, left_out: f64, ln_bayes_factor: f64) -> Comparison {
        let left_out = difference(left_out, 1.0);
        Comparison {
            unit: Unit::Participant,
            units: 40,
            n: 320,
            parts: vec!["all".to_owned()],
            models: OrderedMap(Vec::new()),
            pairs: vec![Pair {
                first: "risk_aware".to_owned(),
                second: "noisy_rational".to_owned(),
                leave_one_out: Some(LeaveOneOutDifference {
                    difference: left_out,
                    distinguishable: left_out.value.abs() >= 4.0,
                }),
                bayes_factor: Some(BayesFactor {
                    ln: Estimate {
                        value: ln_bayes_factor,
                        se: 0.1,
                    },
                    sensitivity: Some(Vec::new()),
                    words: None,
                }),
                held_out: Some(difference(held_out, 1.0)),
            }],
            held_out: Some(exam(0)),
            ladder: Vec::new(),
        }
    }

    const HYPOTHESIS: Hypothesis<'static> = Hypothesis {
        id: "H1",
        statement: "one model predicts better than the other",
        better: "risk_aware",
        than: "noisy_rational",
    };

    /// One cell beside so many that ask the same.
    fn exam(copies: usize) -> HeldOut {
        HeldOut {
            folds: false,
            n: 8,
            problems: vec![HeldOutProblem {
                problem: "one".to_owned(),
                part: "all".to_owned(),
                fold: 1,
                copies,
                n: 8,
                observed: vec![0.5, 0.5],
                predictions: OrderedMap(Vec::new()),
            }],
            scores: OrderedMap(Vec::new()),
        }
    }

    #[track_caller]
    fn check(numbers: [f64; 3], expected: Outcome) -> Verdict {
        let [held_out, left_out, factor] = numbers;
        let comparison = comparison(held_out, left_out, factor);
        let found = Verdict::of(&HYPOTHESIS, &comparison).unwrap();
        assert_eq!(found.outcome, expected, "{found:?}");
        found
    }

    #[test]
    fn all_criteria_must_agree() {
        let found = check([9.0, 12.0, 7.0], Outcome::Supported);
        assert!(found.disagreement.is_none());
        assert!(
            found
                .line
                .starts_with("H1 supported: held-out problems +9.0 ± 1.0, for it")
        );
        check([-9.0, -12.0, -7.0], Outcome::NotSupported);
        check([-9.0, 0.5, -7.0], Outcome::NotSupported);
        check([0.5, 0.5, 0.1], Outcome::Undecided);
        let found = check([-9.0, 12.0, 7.0], Outcome::Undecided);
        assert!(found.disagreement.unwrap().contains("a new one"));
    }

    #[test]
    fn few_problems_take_no_side() {
        for (units, leaning) in [(7, Leaning::Neither), (8, Leaning::For)] {
            let mut comparison = comparison(9.0, 12.0, 7.0);
            comparison.pairs[0].held_out.as_mut().unwrap().units = units;
            let found = Verdict::of(&HYPOTHESIS, &comparison).unwrap();
            assert_eq!(found.criteria[0].leaning, leaning, "{units}");
            assert_eq!(found.criteria[0].value, Some(9.0));
        }
        assert!(Verdict::CRITERION.contains(&format!("{LEAST_PROBLEMS} distinct")));
    }

    /// A fold that did not converge is not a question that could not be asked.
    #[test]
    fn a_failed_criterion_stays_and_decides_nothing() {
        let mut comparison = comparison(9.0, 12.0, 7.0);
        comparison.pairs[0].held_out = None;
        let found = Verdict::of(&HYPOTHESIS, &comparison).unwrap();
        assert_eq!(found.outcome, Outcome::Undecided);
        let first = found.criteria[0];
        assert_eq!(
            (first.question, first.value, first.leaning),
            (Question::HeldOut, None, Leaning::Neither)
        );
        assert!(
            found
                .line
                .contains("held-out problems no value, neither way")
        );
        comparison.held_out = None;
        let found = Verdict::of(&HYPOTHESIS, &comparison).unwrap();
        assert_eq!(
            (found.outcome, found.criteria.len()),
            (Outcome::Supported, 2)
        );
    }

    #[test]
    fn a_cell_whose_copies_remain_is_not_called_a_new_problem() {
        let mut comparison = comparison(-9.0, 12.0, 7.0);
        comparison.held_out = Some(exam(3));
        let found = Verdict::of(&HYPOTHESIS, &comparison).unwrap();
        assert!(found.line.contains("held-out cells -9.0"), "{}", found.line);
        let text = found.disagreement.unwrap();
        assert!(
            text.contains("one more cell") && !text.contains("a new one"),
            "{text}"
        );
    }

    /// A claim for the pair's second model turns every sign.
    #[test]
    fn signs_follow_the_claim() {
        let turned = Hypothesis {
            better: "noisy_rational",
            than: "risk_aware",
            ..HYPOTHESIS
        };
        let found = Verdict::of(&turned, &comparison(-9.0, -12.0, -7.0)).unwrap();
        assert_eq!(found.outcome, Outcome::Supported);
        let unknown = Hypothesis {
            better: "oracle",
            ..turned
        };
        assert!(Verdict::of(&unknown, &comparison(1.0, 1.0, 1.0)).is_none());
    }
}
