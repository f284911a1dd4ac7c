//! Sweeps of a study: what may be asked for, and what is answered.

use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use crate::{
    inference::{
        FittedProblem,
        sweep::{
            DEFAULT_ANSWERS, DEFAULT_SEEDS, DEFAULT_STEPS, GapSweep, Pattern, ShareSweep,
            SweepError, Variation,
        },
        wilson_interval,
    },
    jobs::{
        Snapshot, SweepInput, SweepResult, SweepState, SweptProblem, fit_settings, swept_problems,
    },
    model::{ChoiceModel, ChoiceProblem, OrderedMap, PAPER_MODELS, model_named},
    study::{CellId, Study},
    web::Error,
};

/// The first seed: fixed, so that the command repeats what a page shows.
const SEED: u64 = 1;
const MOST_ANSWERS: u64 = 200;
const MOST_ANSWERS_OF_GAPS: u64 = 100_000;
const MOST_SEEDS: usize = 50;
const MOST_STEPS: usize = 100;
/// What one request may cost: some minutes of one processor at worst.
const MOST_FITS: usize = 8000;

/// What a share sweep is asked for with; everything has a default.
#[derive(Debug, Clone, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::web) struct ShareQuery {
    /// A fitted cell; the first one if left out.
    #[param(value_type = Option<String>, nullable = false)]
    pub cell: Option<CellId>,
    /// Answers at each point, 30 if left out.
    #[param(minimum = 2, maximum = 200, nullable = false)]
    pub n: Option<u64>,
    /// Fits at each point, 20 if left out.
    #[param(minimum = 1, maximum = 50, nullable = false)]
    pub seeds: Option<usize>,
    /// The action whose share runs; the one with the lowest expected reward if left out.
    #[param(nullable = false)]
    pub action: Option<String>,
    /// Ids separated by commas.
    #[param(nullable = false)]
    pub models: Option<String>,
}

/// What a gap sweep is asked for with; everything has a default.
#[derive(Debug, Clone, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::web) struct GapQuery {
    /// One cell's problem instead of all distinct ones.
    #[param(value_type = Option<String>, nullable = false)]
    pub cell: Option<CellId>,
    /// What varies, such as `stop:-50=-26..-474`.
    #[param(nullable = false)]
    pub vary: Option<String>,
    /// Values of what varies.
    #[param(minimum = 2, maximum = 100, nullable = false)]
    pub steps: Option<usize>,
    /// Fits at each point.
    #[param(minimum = 1, maximum = 50, nullable = false)]
    pub seeds: Option<usize>,
    /// The answers: so many of `n` on `action`, or those of the study with `pattern=observed`.
    #[param(minimum = 2, maximum = 100_000, nullable = false)]
    pub n: Option<u64>,
    /// How many of them are on `action`.
    #[param(nullable = false)]
    pub count: Option<u64>,
    /// The action that most answers are on.
    #[param(nullable = false)]
    pub action: Option<String>,
    /// Which answers there are at every point.
    #[serde(default)]
    #[param(inline)]
    pub pattern: PatternName,
    /// Ids separated by commas.
    #[param(nullable = false)]
    pub models: Option<String>,
}

/// Which answers a gap sweep has at every point.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::web) enum PatternName {
    /// `count` of `n` on one action, by default the paper's 25 of 30 on the safe one.
    #[default]
    Held,
    /// As counted in the cells with the problem.
    Observed,
}

/// A sweep with what pages and programs need to read it.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Sweep {
    pub study: String,
    /// What sets each problem apart, by its id.
    #[schema(value_type = HashMap<String, String>)]
    pub labels: OrderedMap<String>,
    /// The command that makes the same numbers; null where they depend on stored answers.
    pub command: Option<String>,
    /// The sweep, or how far it is.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// Of a gap sweep: how many chose what is best, in each question whose outcomes are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub observed: Option<Vec<ObservedRow>>,
}

/// How far a sweep is.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = SweepProgress)]
#[serde(tag = "state", rename_all = "snake_case")]
pub(in crate::web) enum Outcome {
    /// Fits that are done, of how many, and sweeps that come first.
    Running {
        done: usize,
        of: usize,
        ahead: usize,
    },
    /// All numbers.
    Ready {
        #[schema(value_type = SweepResult)]
        result: std::sync::Arc<SweepResult>,
    },
}

/// How many people chose the action with the highest expected reward.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct ObservedRow {
    pub id: String,
    pub label: String,
    pub baseline: bool,
    /// Highest expected reward minus the second highest.
    pub gap: f64,
    pub optimal: String,
    pub n: u64,
    pub n_optimal: u64,
    /// Null while nobody has answered.
    pub share: Option<f64>,
    pub low: Option<f64>,
    pub high: Option<f64>,
}

/// A sweep that can be asked for.
pub(in crate::web) struct Wanted {
    pub input: SweepInput,
    labels: OrderedMap<String>,
    command: Option<String>,
    observed: Option<Vec<ObservedRow>>,
}

impl Wanted {
    /// The share sweep of a query.
    pub(in crate::web) fn share(study: &Study, query: &ShareQuery) -> Result<Self, Error> {
        let n = within("n", query.n.unwrap_or(DEFAULT_ANSWERS), 2, MOST_ANSWERS)?;
        let seeds = within("seeds", query.seeds.unwrap_or(DEFAULT_SEEDS), 1, MOST_SEEDS)?;
        let swept = chosen(study, query.cell.as_ref())?;
        // One problem at least is there.
        let problem = swept[0].problem.clone();
        let mut command = format!(
            "riskaware sweep --study {} --cell {} --n {n} --seeds {seeds} --seed {SEED}",
            study.id(),
            problem.id
        );
        for (option, value) in [("--action", &query.action), ("--models", &query.models)] {
            if let Some(value) = value {
                command.push_str(&format!(" {option} {value}"));
            }
        }
        let sweep = ShareSweep::new(problem, query.action.as_deref(), n).map_err(unprocessable)?;
        let models = models(query.models.as_deref())?;
        let input = SweepInput::share(sweep, models, seeds, fit_settings(study, SEED))
            .map_err(unprocessable)?;
        check_cost(&input)?;
        Ok(Self {
            input,
            labels: labels(&swept[..1]),
            command: Some(command),
            observed: None,
        })
    }

    /// The gap sweep of a query.
    pub(in crate::web) fn gap(snapshot: &Snapshot, query: &GapQuery) -> Result<Self, Error> {
        let study = &snapshot.study;
        let steps = within("steps", query.steps.unwrap_or(DEFAULT_STEPS), 2, MOST_STEPS)?;
        let n = within(
            "n",
            query.n.unwrap_or(DEFAULT_ANSWERS),
            2,
            MOST_ANSWERS_OF_GAPS,
        )?;
        let count = query.count.unwrap_or(n * 5 / 6);
        let swept = chosen(study, query.cell.as_ref())?;
        let problems: Vec<FittedProblem> =
            swept.iter().map(|swept| swept.problem.clone()).collect();
        let models = models(query.models.as_deref())?;
        // A study with many problems gets fewer seeds unless it asks for more.
        let affordable = MOST_FITS / (steps * problems.len() * models.len());
        let seeds = query.seeds.unwrap_or(DEFAULT_SEEDS.min(affordable.max(1)));
        let seeds = within("seeds", seeds, 1, MOST_SEEDS)?;
        let variation: Variation = match &query.vary {
            Some(text) => text.parse().map_err(unprocessable)?,
            None => Variation::default_for(&problems).map_err(unprocessable)?,
        };
        let (pattern, command) = match query.pattern {
            PatternName::Observed => {
                if query.n.is_some() || query.count.is_some() || query.action.is_some() {
                    return Err(Error::Unprocessable(
                        "pattern=observed and n, count or action are given; allowed: one or the other".to_owned(),
                    ));
                }
                let counts = swept.iter().map(|swept| counts_of(snapshot, swept));
                (Pattern::Observed(counts.collect()), None)
            }
            PatternName::Held => {
                let mut command = format!(
                    "riskaware sweep --study {} --gap {variation} --steps {steps} --n {n} --count {count} --seeds {seeds} --seed {SEED}",
                    study.id()
                );
                let cell = query.cell.as_ref().map(ToString::to_string);
                for (option, value) in [
                    ("--cell", &cell),
                    ("--action", &query.action),
                    ("--models", &query.models),
                ] {
                    if let Some(value) = value {
                        command.push_str(&format!(" {option} {value}"));
                    }
                }
                let action = query.action.clone();
                (Pattern::Held { action, count, n }, Some(command))
            }
        };
        let sweep = GapSweep::new(&problems, variation, steps, &pattern).map_err(unprocessable)?;
        let input = SweepInput::gap(sweep, models, seeds, fit_settings(study, SEED))
            .map_err(unprocessable)?;
        check_cost(&input)?;
        Ok(Self {
            input,
            labels: labels(&swept),
            command,
            observed: Some(observed(snapshot)),
        })
    }

    /// What is answered once the sweep was asked for.
    pub(in crate::web) fn answer(self, study: &Study, state: SweepState) -> Result<Sweep, Error> {
        let outcome = match state {
            SweepState::Running { done, of, ahead } => Outcome::Running { done, of, ahead },
            SweepState::Ready(result) => Outcome::Ready { result },
            SweepState::Failed(message) => {
                return Err(Error::Internal(anyhow::anyhow!(
                    "a sweep failed: {message}"
                )));
            }
        };
        Ok(Sweep {
            study: study.id().to_string(),
            labels: self.labels,
            command: self.command,
            outcome,
            observed: self.observed,
        })
    }
}

fn unprocessable(error: SweepError) -> Error {
    Error::Unprocessable(error.to_string())
}

fn within<T: PartialOrd + std::fmt::Display>(
    name: &str,
    value: T,
    low: T,
    high: T,
) -> Result<T, Error> {
    if low <= value && value <= high {
        Ok(value)
    } else {
        Err(Error::Unprocessable(format!(
            "{name} is {value}; allowed: {low} to {high}"
        )))
    }
}

fn check_cost(input: &SweepInput) -> Result<(), Error> {
    let fits = input.fits();
    if fits <= MOST_FITS {
        return Ok(());
    }
    Err(Error::Unprocessable(format!(
        "this sweep takes {fits} fits; allowed: at most {MOST_FITS} here (fewer answers, steps, seeds or models), or use the command `riskaware sweep`"
    )))
}

fn models(names: Option<&str>) -> Result<Vec<&'static ChoiceModel>, Error> {
    let Some(names) = names else {
        return Ok(PAPER_MODELS.to_vec());
    };
    let mut models: Vec<&'static ChoiceModel> = Vec::new();
    for name in names.split(',') {
        let model =
            model_named(name.trim()).map_err(|error| Error::Unprocessable(error.to_string()))?;
        if !models.contains(&model) {
            models.push(model);
        }
    }
    Ok(models)
}

/// The cell's problem under the cell's id, or all distinct ones; at least one.
fn chosen(study: &Study, cell: Option<&CellId>) -> Result<Vec<SweptProblem>, Error> {
    let all = swept_problems(study);
    let Some(id) = cell else {
        if all.is_empty() {
            return Err(Error::Unprocessable("this study fits no cell".to_owned()));
        }
        return Ok(all);
    };
    match all.iter().find(|swept| swept.cells.contains(id)) {
        Some(swept) => Ok(vec![SweptProblem {
            problem: FittedProblem {
                id: id.to_string(),
                problem: swept.problem.problem.clone(),
            },
            ..swept.clone()
        }]),
        None => {
            let known: Vec<&str> = all
                .iter()
                .flat_map(|swept| &swept.cells)
                .map(CellId::as_str)
                .collect();
            Err(Error::Unprocessable(format!(
                "cell `{id}` is not fitted or does not exist; allowed: {}",
                known.join(", ")
            )))
        }
    }
}

fn labels(swept: &[SweptProblem]) -> OrderedMap<String> {
    swept
        .iter()
        .map(|swept| (swept.problem.id.clone(), swept.label.clone()))
        .collect()
}

/// What was chosen in all cells with this problem.
fn counts_of(snapshot: &Snapshot, swept: &SweptProblem) -> Vec<u64> {
    let mut sum = vec![0; swept.problem.problem.actions().len()];
    let cells = snapshot.study.cells().iter().zip(&snapshot.counts.cells);
    for (_, counts) in cells.filter(|(cell, _)| swept.cells.contains(&cell.id)) {
        for (total, count) in sum.iter_mut().zip(&counts.actions) {
            *total += count;
        }
    }
    sum
}

/// The optimal choices of every cell and baseline question whose outcomes are known, in file order.
fn observed(snapshot: &Snapshot) -> Vec<ObservedRow> {
    let study = &snapshot.study;
    let cells = study
        .cells()
        .iter()
        .zip(&snapshot.counts.cells)
        .filter_map(|(cell, counts)| {
            let problem = cell.problem.as_ref()?;
            let row = row(cell.id.to_string(), &cell.label, problem, &counts.actions);
            Some(row)
        });
    let baseline =
        study
            .baseline()
            .iter()
            .zip(&snapshot.counts.baseline)
            .map(|(question, counts)| ObservedRow {
                baseline: true,
                ..row(
                    question.question.to_string(),
                    &question.label,
                    &question.problem,
                    &counts.actions,
                )
            });
    cells.chain(baseline).collect()
}

fn row(id: String, label: &str, problem: &ChoiceProblem, counts: &[u64]) -> ObservedRow {
    let expected: Vec<f64> = problem
        .actions()
        .iter()
        .map(|action| action.prospect.expected_reward())
        .collect();
    let mut order: Vec<usize> = (0..expected.len()).collect();
    // Stable: the first of equally good ones stays first.
    order.sort_by(|left, right| expected[*right].total_cmp(&expected[*left]));
    let best = order[0];
    let (n, n_optimal) = (counts.iter().sum::<u64>(), counts[best]);
    let interval = (n > 0).then(|| wilson_interval(n_optimal, n));
    ObservedRow {
        id,
        label: label.to_owned(),
        baseline: false,
        gap: expected[best] - expected[order[1]],
        optimal: problem.actions()[best].name.clone(),
        n,
        n_optimal,
        share: (n > 0).then(|| n_optimal as f64 / n as f64),
        low: interval.map(|(low, _)| low),
        high: interval.map(|(_, high)| high),
    }
}
