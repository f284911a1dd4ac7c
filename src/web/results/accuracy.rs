//! `accuracy.json`: ln KL per cell and pooled, with the paper's tests and the paper's own figures (models.md, section 7).

use serde::Serialize;

use super::predictive::{CheckRow, checks};
use crate::{
    inference::accuracy::{
        CellAccuracy as Scored, LnKl, Shares, TTest, compare, pooled, reference_level,
    },
    jobs::Snapshot,
    model::{NOISY_RATIONAL, OrderedMap, RISK_AWARE},
    study::{FactorId, FitPlan, LevelId, MeanSd, PaperFigure, Study, Timestamp},
    web::results::format::rfc3339,
};

/// How close each model comes to what people chose.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Accuracy {
    pub data_version: i64,
    pub fit_version: i64,
    /// The plan whose fits are scored.
    pub plan: String,
    #[serde(skip)]
    pub plan_label: String,
    /// Independent posterior samples per cell and model.
    pub samples: usize,
    /// When the latest of the fits was made.
    pub at: Option<String>,
    pub cells: Vec<CellRow>,
    /// Without cells in which everybody chose the same.
    pub pooled: Vec<PooledRow>,
    /// With shares (n_a + ½)/(n + A/2) in every cell.
    pub pooled_smoothed: Vec<PooledRow>,
    pub paper: Vec<PaperRow>,
    /// Posterior predictive checks per fitted cell.
    pub checks: Vec<CheckRow>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = AccuracyCell)]
pub(in crate::web) struct CellRow {
    pub id: String,
    #[serde(skip)]
    pub label: String,
    /// Answers that are scored; all there are while there is no score.
    pub n: u64,
    /// Everybody chose the same: ln KL has no lower bound there.
    pub unanimous: bool,
    /// What the true probabilities themselves score on average; null where unanimous.
    pub reference: Option<f64>,
    /// Null until the model's fit has converged.
    #[schema(value_type = HashMap<String, Score>)]
    pub models: OrderedMap<Option<Score>>,
}

/// ln KL over the independent samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = AccuracyScore)]
pub(in crate::web) struct Score {
    /// Null where a sample predicts the observed shares exactly.
    pub mean: Option<f64>,
    pub sd: Option<f64>,
    pub median: Option<f64>,
    pub q5: Option<f64>,
    pub q95: Option<f64>,
    /// Samples whose KL is exactly 0.
    pub zeros: usize,
}

impl From<LnKl> for Score {
    fn from(ln_kl: LnKl) -> Self {
        let LnKl {
            mean,
            sd,
            median,
            q5,
            q95,
            samples: _,
            exact_zeros: zeros,
        } = ln_kl;
        Self {
            mean,
            sd,
            median,
            q5,
            q95,
            zeros,
        }
    }
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct PooledRow {
    pub label: String,
    #[schema(value_type = HashMap<String, String>)]
    pub levels: OrderedMap<String>,
    /// Cells that are pooled.
    pub cells: usize,
    /// Unanimous cells that are not.
    pub left_out: usize,
    /// Null while a cell has no converged fit: some of the cells would be another comparison.
    #[schema(value_type = HashMap<String, Score>)]
    pub models: OrderedMap<Option<Score>>,
    /// Of Risk-Aware minus Noisy Rational, sample by sample.
    pub paired_t: Option<TTest>,
    pub welch_t: Option<TTest>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct PaperRow {
    /// The label of the pooled row that it belongs to.
    pub label: String,
    pub risk_aware: Option<PaperScore>,
    pub noisy_rational: Option<PaperScore>,
    pub t: Option<f64>,
    pub df: Option<u32>,
    pub p: Option<String>,
    pub n: Option<u32>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct PaperScore {
    pub mean: f64,
    pub sd: f64,
}

type Levels = Vec<(FactorId, LevelId)>;

/// A fitted cell with answers, and each model's score in it if its fit has converged.
struct FittedCell<'a> {
    levels: &'a Levels,
    /// In the answers of any of its scores; in those there are while there is no score.
    is_unanimous: bool,
    aware: Option<&'a Scored>,
    noisy: Option<&'a Scored>,
}

impl Accuracy {
    pub(in crate::web) fn new(snapshot: &Snapshot, plan: &FitPlan) -> Self {
        let study = &snapshot.study;
        let mut rows = Vec::new();
        let mut cells = Vec::new();
        for (cell, counts) in study.cells().iter().zip(&snapshot.counts.cells) {
            if !cell.fitted {
                continue;
            }
            let scored = |model| snapshot.accuracy(&plan.id, model, cell.id.as_str());
            let scores = || study.models().iter().filter_map(|model| scored(model.id));
            // Answers that came after a fit are in no score: what stands beside a score is of the answers it is of.
            let (n, is_unanimous, reference) = match scores().max_by_key(|scored| scored.n) {
                Some(scored) => (scored.n, scored.unanimous, scored.reference_level),
                None => {
                    let n = counts.n();
                    let is_unanimous = counts.actions.contains(&n);
                    let reference =
                        (n > 0 && !is_unanimous).then(|| reference_level(cell.actions.len(), n));
                    (n, is_unanimous, reference)
                }
            };
            if n == 0 {
                continue;
            }
            rows.push(CellRow {
                id: cell.id.to_string(),
                label: cell.label.clone(),
                n,
                unanimous: is_unanimous,
                reference,
                models: study
                    .models()
                    .iter()
                    .map(|model| {
                        (
                            model.id.to_owned(),
                            scored(model.id).map(|scored| scored.ln_kl.clone().into()),
                        )
                    })
                    .collect(),
            });
            cells.push(FittedCell {
                levels: &cell.levels,
                is_unanimous: is_unanimous || scores().any(|scored| scored.unanimous),
                aware: scored(RISK_AWARE.id),
                noisy: scored(NOISY_RATIONAL.id),
            });
        }
        let sets = pooled_sets(study);
        let pooled = |shares| {
            sets.iter()
                .map(|levels| pooled_row(study, levels, &cells, shares))
                .collect()
        };
        Self {
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            plan: plan.id.to_string(),
            plan_label: plan.label.clone(),
            samples: study.fit().samples,
            at: latest(snapshot, plan).map(rfc3339),
            cells: rows,
            pooled: pooled(Shares::Observed),
            pooled_smoothed: pooled(Shares::Smoothed),
            paper: study
                .paper()
                .iter()
                .map(|figure| paper_row(study, figure))
                .collect(),
            checks: checks(snapshot, plan),
        }
    }
}

fn latest(snapshot: &Snapshot, plan: &FitPlan) -> Option<Timestamp> {
    snapshot
        .fits
        .iter()
        .filter(|part| part.plan == plan.id)
        .filter_map(|part| Some(part.fit.as_ref()?.created_at))
        .max()
}

/// All cells together, each level of each factor, and what else the paper pools.
fn pooled_sets(study: &Study) -> Vec<Levels> {
    let mut sets = vec![Levels::new()];
    for factor in study.factors() {
        let levels = factor.levels.iter().filter(|level| {
            study.cells().iter().any(|cell| {
                cell.fitted && cell.levels.contains(&(factor.id.clone(), level.id.clone()))
            })
        });
        let of_factor: Vec<Levels> = levels
            .map(|level| vec![(factor.id.clone(), level.id.clone())])
            .collect();
        // The only level of a factor is all cells together once more.
        if of_factor.len() > 1 {
            sets.extend(of_factor);
        }
    }
    for figure in study.paper() {
        if !sets.contains(&figure.levels) {
            sets.push(figure.levels.clone());
        }
    }
    sets
}

fn label(study: &Study, levels: &Levels) -> String {
    if levels.is_empty() {
        return "Together".to_owned();
    }
    let of_level = |(factor_id, level_id): &(FactorId, LevelId)| {
        let factor = study
            .factors()
            .iter()
            .find(|factor| factor.id == *factor_id);
        let level =
            factor.and_then(|factor| factor.levels.iter().find(|level| level.id == *level_id));
        match (factor, level) {
            (Some(factor), Some(level)) => {
                format!("{}: {}", factor.label, level.label.to_lowercase())
            }
            (Some(_), None) | (None, Some(_) | None) => format!("{factor_id}: {level_id}"),
        }
    };
    levels.iter().map(of_level).collect::<Vec<_>>().join(", ")
}

fn pooled_row(
    study: &Study,
    levels: &Levels,
    cells: &[FittedCell<'_>],
    shares: Shares,
) -> PooledRow {
    let of_set: Vec<&FittedCell> = cells
        .iter()
        .filter(|cell| levels.iter().all(|level| cell.levels.contains(level)))
        .collect();
    let used: Vec<&FittedCell> = match shares {
        Shares::Observed => of_set
            .iter()
            .filter(|cell| !cell.is_unanimous)
            .copied()
            .collect(),
        Shares::Smoothed => of_set.clone(),
    };
    // Some of the cells would be another comparison: all or none.
    let aware: Option<Vec<&Scored>> = used.iter().map(|cell| cell.aware).collect();
    let noisy: Option<Vec<&Scored>> = used.iter().map(|cell| cell.noisy).collect();
    let (aware, noisy) = (
        aware.filter(|cells| !cells.is_empty()),
        noisy.filter(|cells| !cells.is_empty()),
    );
    let comparison = aware
        .as_ref()
        .zip(noisy.as_ref())
        .and_then(|(aware, noisy)| {
            let pairs: Vec<_> = aware.iter().copied().zip(noisy.iter().copied()).collect();
            // While one model's fit is older than the other's, they are scored against different answers.
            let same = |(aware, noisy): &(&Scored, &Scored)| {
                aware.n == noisy.n && aware.observed == noisy.observed
            };
            pairs
                .iter()
                .all(same)
                .then(|| compare(&pairs, shares))
                .flatten()
        });
    let score = |cells: Option<Vec<&Scored>>| cells.map(|cells| pooled(&cells, shares).into());
    PooledRow {
        label: label(study, levels),
        levels: levels
            .iter()
            .map(|(factor, level)| (factor.to_string(), level.to_string()))
            .collect(),
        cells: used.len(),
        left_out: of_set.len() - used.len(),
        paired_t: comparison.as_ref().and_then(|comparison| comparison.paired),
        welch_t: comparison.as_ref().and_then(|comparison| comparison.welch),
        models: OrderedMap(vec![
            (NOISY_RATIONAL.id.to_owned(), score(noisy)),
            (RISK_AWARE.id.to_owned(), score(aware)),
        ]),
    }
}

fn paper_row(study: &Study, figure: &PaperFigure) -> PaperRow {
    let score = |figure: Option<MeanSd>| {
        figure.map(|figure| PaperScore {
            mean: figure.mean,
            sd: figure.sd,
        })
    };
    PaperRow {
        label: label(study, &figure.levels),
        risk_aware: score(figure.risk_aware),
        noisy_rational: score(figure.noisy_rational),
        t: figure.t,
        df: figure.df,
        p: figure.p.clone(),
        n: figure.n,
    }
}
