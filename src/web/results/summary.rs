//! `summary.json`: who took part, what they chose, and how far the fits are. Read from counters, never counted anew.

use serde::Serialize;

use crate::{
    inference::wilson_interval,
    jobs::{Blind, FitReport, PartFit, PartState, QuestionCounts, Snapshot},
    model::OrderedMap,
    study::{Cell, Factor, Flag, exclusions_in_words},
    web::results::{evidence::announcement, verdict::Verdict},
};

/// Everything about a study that is no curve and no accuracy.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Summary {
    pub study: StudyHead,
    pub data_version: i64,
    pub fit_version: i64,
    pub simulated: bool,
    /// Why no distribution of choices, no fit and no verdict is told; null where all is.
    pub blind: Option<Blind>,
    /// That the study's rule for stopping was reached, in words.
    pub stopping: Option<String>,
    pub people: People,
    pub answers: Answers,
    pub factors: Vec<Labelled<Labels>>,
    pub actions: Vec<Labels>,
    pub cells: Vec<CellRow>,
    pub checks: Checks,
    pub fits: Vec<FitRow>,
    /// The models that the study fits, from the plainest to the richest.
    pub models: Vec<Labels>,
    pub plans: Vec<PlanRow>,
    pub verdict: Verdict,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct StudyHead {
    pub id: String,
    pub title: String,
    pub reward_unit: RewardUnit,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct RewardUnit {
    pub name: String,
    pub prefix: String,
    pub suffix: String,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct People {
    pub started: u64,
    pub completed: u64,
    pub declined: u64,
    pub withdrawn: u64,
    /// Who completed it and is not left out of the analysis.
    pub analysed: u64,
    /// Who is left out of the analysis set.
    pub excluded: u64,
    /// The same by reason.
    pub exclusions: Vec<ExclusionRow>,
    /// The same in words.
    pub exclusions_text: String,
}

/// How many people are left out of the analysis for what.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct ExclusionRow {
    /// The first flag of the study's rule that they have; null for those who are left out by hand alone.
    pub flag: Option<Flag>,
    pub n: u64,
}

/// Answers to the questions of the design.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = AnswerCounts)]
pub(in crate::web) struct Answers {
    /// In the analysis set.
    pub counted: u64,
    /// Valid ones of everybody, before the rule of inclusion and before anybody is left out.
    pub before_exclusions: u64,
    pub late: u64,
    pub timed_out: u64,
}

#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Labels {
    pub id: String,
    pub label: String,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Factor)]
pub(in crate::web) struct Labelled<T> {
    pub id: String,
    pub label: String,
    pub levels: Vec<T>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = SummaryCell)]
pub(in crate::web) struct CellRow {
    pub id: String,
    #[serde(skip)]
    pub label: String,
    #[schema(value_type = HashMap<String, String>)]
    pub levels: OrderedMap<String>,
    pub fitted: bool,
    pub n: u64,
    pub before_exclusions: u64,
    pub late: u64,
    pub timed_out: u64,
    pub actions: Vec<ActionRow>,
    #[schema(value_type = HashMap<String, Option<HashMap<String, Share>>>)]
    pub predicted: OrderedMap<Option<OrderedMap<Share>>>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct ActionRow {
    pub id: String,
    #[serde(skip)]
    pub label: String,
    pub n: u64,
    /// Null while nobody has answered.
    pub share: Option<f64>,
    pub low: Option<f64>,
    pub high: Option<f64>,
}

/// A predicted share with its 90 % interval.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Share {
    pub mean: f64,
    pub q5: f64,
    pub q95: f64,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Checks {
    /// Null in a study without baseline questions.
    pub baseline: Option<BaselineCheck>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct BaselineCheck {
    pub problems: Vec<BaselineRow>,
    pub n: u64,
    pub n_optimal: u64,
    pub share: Option<f64>,
    pub low: Option<f64>,
    pub high: Option<f64>,
    /// The source paper's share.
    pub paper: Option<f64>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct BaselineRow {
    pub id: String,
    pub label: String,
    pub optimal: String,
    pub n: u64,
    pub n_optimal: u64,
    pub share: Option<f64>,
    pub low: Option<f64>,
    pub high: Option<f64>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct FitRow {
    pub plan: String,
    pub part: String,
    #[serde(skip)]
    pub plan_label: String,
    #[serde(skip)]
    pub part_label: String,
    pub model: &'static str,
    #[serde(skip)]
    pub model_label: &'static str,
    pub state: PartState,
    /// The stored fit behind this row, for `/fits/{id}`.
    pub id: Option<i64>,
    /// Newer answers wait to be fitted.
    pub is_behind: bool,
    /// It started from the fit before it; a final one follows once the study is idle.
    pub provisional: bool,
    pub rhat_max: Option<f64>,
    pub ess_min: Option<f64>,
    pub draws: Option<u64>,
    pub seed: Option<u64>,
    pub message: Option<String>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct PlanRow {
    pub id: String,
    pub label: String,
    pub parts: Vec<String>,
}

impl Summary {
    pub(in crate::web) fn new(snapshot: &Snapshot) -> Self {
        let study = &snapshot.study;
        let unit = study.reward_unit();
        let counts = &snapshot.counts.cells;
        let blind = snapshot.blind();
        let sum = |of: fn(&QuestionCounts) -> u64| counts.iter().map(of).sum();
        Self {
            study: StudyHead {
                id: study.id().to_string(),
                title: study.title().to_owned(),
                reward_unit: RewardUnit {
                    name: unit.name.clone(),
                    prefix: unit.prefix.clone(),
                    suffix: unit.suffix.clone(),
                },
            },
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            simulated: snapshot.population.is_simulated(),
            blind,
            stopping: announcement(snapshot).filter(|_| blind.is_none()),
            people: People::new(snapshot),
            answers: Answers {
                counted: sum(QuestionCounts::n),
                before_exclusions: sum(|cell| cell.before_exclusions),
                late: sum(|cell| cell.late),
                timed_out: sum(|cell| cell.timed_out),
            },
            factors: study.factors().iter().map(factor).collect(),
            actions: actions(study.cells()),
            cells: study
                .cells()
                .iter()
                .zip(counts)
                .map(|(cell, counts)| cell_row(snapshot, cell, counts))
                .collect(),
            checks: Checks {
                baseline: baseline(snapshot).filter(|_| blind.is_none()),
            },
            fits: match blind {
                Some(_) => Vec::new(),
                None => snapshot.fits.iter().map(FitRow::new).collect(),
            },
            models: study
                .models()
                .iter()
                .map(|model| Labels {
                    id: model.id.to_owned(),
                    label: model.label.to_owned(),
                })
                .collect(),
            plans: study
                .plans()
                .iter()
                .map(|plan| PlanRow {
                    id: plan.id.to_string(),
                    label: plan.label.clone(),
                    parts: plan.parts.iter().map(|part| part.id.to_string()).collect(),
                })
                .collect(),
            verdict: Verdict::new(snapshot),
        }
    }
}

impl People {
    fn new(snapshot: &Snapshot) -> Self {
        let (people, exclusions) = (&snapshot.people, &snapshot.exclusions);
        let excluded = exclusions.iter().map(|(_, n)| n).sum();
        Self {
            started: people.started,
            completed: people.completed,
            declined: people.declined,
            withdrawn: people.withdrawn,
            analysed: people.analysed(),
            excluded,
            exclusions: exclusions
                .iter()
                .map(|&(flag, n)| ExclusionRow { flag, n })
                .collect(),
            exclusions_text: match excluded {
                0 => "nobody left out".to_owned(),
                _ => format!("{excluded} left out: {}", exclusions_in_words(exclusions)),
            },
        }
    }
}

impl FitRow {
    fn new(part: &PartFit) -> Self {
        let report = part.report();
        Self {
            plan: part.plan.to_string(),
            part: part.part.to_string(),
            plan_label: part.plan_label.clone(),
            part_label: part.part_label.clone(),
            model: part.model.id,
            model_label: part.model.label,
            state: part.state,
            id: part.fit.as_ref().map(|fit| fit.id.get()),
            is_behind: part.is_behind,
            provisional: part.is_provisional(),
            rhat_max: report.and_then(FitReport::rhat_max),
            ess_min: report.and_then(FitReport::ess_min),
            draws: report.map(|report| (report.summary.chains * report.summary.draws) as u64),
            seed: part.fit.as_ref().map(|fit| fit.seed),
            message: part.message(),
        }
    }
}

fn factor(factor: &Factor) -> Labelled<Labels> {
    Labelled {
        id: factor.id.to_string(),
        label: factor.label.clone(),
        levels: factor
            .levels
            .iter()
            .map(|level| Labels {
                id: level.id.to_string(),
                label: level.label.clone(),
            })
            .collect(),
    }
}

/// All actions of the design, each once, in file order.
fn actions(cells: &[Cell]) -> Vec<Labels> {
    let mut found: Vec<Labels> = Vec::new();
    for action in cells.iter().flat_map(|cell| &cell.actions) {
        if !found.iter().any(|known| action.id == known.id.as_str()) {
            found.push(Labels {
                id: action.id.to_string(),
                label: action.label.clone(),
            });
        }
    }
    found
}

fn cell_row(snapshot: &Snapshot, cell: &Cell, counts: &QuestionCounts) -> CellRow {
    let n = counts.n();
    let is_blind = snapshot.blind().is_some();
    CellRow {
        id: cell.id.to_string(),
        label: cell.label.clone(),
        levels: cell
            .levels
            .iter()
            .map(|(factor, level)| (factor.to_string(), level.to_string()))
            .collect(),
        fitted: cell.fitted,
        n,
        before_exclusions: counts.before_exclusions,
        late: counts.late,
        timed_out: counts.timed_out,
        actions: cell
            .actions
            .iter()
            .zip(&counts.actions)
            .filter(|_| !is_blind)
            .map(|(action, &count)| {
                let (share, low, high) = share(count, n);
                ActionRow {
                    id: action.id.to_string(),
                    label: action.label.clone(),
                    n: count,
                    share,
                    low,
                    high,
                }
            })
            .collect(),
        predicted: snapshot
            .study
            .models()
            .iter()
            .filter(|_| !is_blind)
            .map(|model| (model.id.to_owned(), predicted(snapshot, cell, model.id)))
            .collect(),
    }
}

/// What the finest plan's fit of this model predicts for the cell.
fn predicted(snapshot: &Snapshot, cell: &Cell, model: &str) -> Option<OrderedMap<Share>> {
    let plan = snapshot.finest_plan();
    let part = snapshot.fits.iter().find(|part| {
        part.plan == plan.id && part.model.id == model && part.cells.contains(&cell.id)
    })?;
    let shares = part
        .converged()?
        .summary
        .predicted
        .as_ref()?
        .get(cell.id.as_str())?;
    Some(
        shares
            .iter()
            .map(|(action, share)| {
                (
                    action.to_owned(),
                    Share {
                        mean: share.mean,
                        q5: share.q5,
                        q95: share.q95,
                    },
                )
            })
            .collect(),
    )
}

fn baseline(snapshot: &Snapshot) -> Option<BaselineCheck> {
    let study = &snapshot.study;
    if study.baseline().is_empty() {
        return None;
    }
    let problems: Vec<BaselineRow> = study
        .baseline()
        .iter()
        .zip(&snapshot.counts.baseline)
        .map(|(question, counts)| {
            let position = question.problem.position(question.optimal.as_str());
            let (n, n_optimal) = (
                counts.n(),
                position.map_or(0, |position| counts.actions[position]),
            );
            let (share, low, high) = share(n_optimal, n);
            BaselineRow {
                id: question.question.to_string(),
                label: question.label.clone(),
                optimal: question.optimal.to_string(),
                n,
                n_optimal,
                share,
                low,
                high,
            }
        })
        .collect();
    let n = problems.iter().map(|row| row.n).sum();
    let n_optimal = problems.iter().map(|row| row.n_optimal).sum();
    let (share, low, high) = share(n_optimal, n);
    Some(BaselineCheck {
        problems,
        n,
        n_optimal,
        share,
        low,
        high,
        paper: study.baseline_share(),
    })
}

fn share(count: u64, n: u64) -> (Option<f64>, Option<f64>, Option<f64>) {
    if n == 0 {
        return (None, None, None);
    }
    let (low, high) = wilson_interval(count, n);
    (Some(count as f64 / n as f64), Some(low), Some(high))
}
