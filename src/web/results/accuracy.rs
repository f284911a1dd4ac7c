//! `accuracy.json`: ln KL per cell and pooled, with the paper's tests and the paper's own figures (models.md, section 7).

use serde::Serialize;

use crate::{
    inference::accuracy::{TTest, paired_t_test, reference_level, welch_t_test},
    jobs::{LnKlSamples, Snapshot},
    model::{MODELS, NOISY_RATIONAL, OrderedMap, RISK_AWARE},
    study::{FactorId, FitPlan, LevelId, MeanSd, PaperFigure, Study, Timestamp},
    web::results::format::rfc3339,
};

/// How close each model comes to what people chose.
#[derive(Debug, Serialize)]
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
    pub cells: Vec<CellAccuracy>,
    /// Without cells in which everybody chose the same.
    pub pooled: Vec<PooledRow>,
    /// With shares (n_a + ½)/(n + A/2) in every cell.
    pub pooled_smoothed: Vec<PooledRow>,
    pub paper: Vec<PaperRow>,
}

#[derive(Debug, Serialize)]
pub(in crate::web) struct CellAccuracy {
    pub id: String,
    #[serde(skip)]
    pub label: String,
    pub n: u64,
    /// Everybody chose the same: ln KL has no lower bound there.
    pub unanimous: bool,
    /// What the true probabilities themselves score on average.
    pub reference: f64,
    /// Null until the model's fit has converged.
    pub models: OrderedMap<Option<Score>>,
}

/// ln KL over the independent samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
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

#[derive(Debug, Serialize)]
pub(in crate::web) struct PooledRow {
    pub label: String,
    pub levels: OrderedMap<String>,
    /// Cells that are pooled.
    pub cells: usize,
    /// Unanimous cells that are not.
    pub left_out: usize,
    pub models: OrderedMap<Option<Score>>,
    /// Of Risk-Aware minus Noisy Rational, sample by sample.
    pub paired_t: Option<TTest>,
    pub welch_t: Option<TTest>,
}

#[derive(Debug, Serialize)]
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

#[derive(Debug, Serialize)]
pub(in crate::web) struct PaperScore {
    pub mean: f64,
    pub sd: f64,
}

type Levels = Vec<(FactorId, LevelId)>;

/// A fitted cell that both models could be scored in, or not yet.
struct Scored<'a> {
    levels: &'a Levels,
    unanimous: bool,
    aware: Option<&'a LnKlSamples>,
    noisy: Option<&'a LnKlSamples>,
}

/// Which of the two observed distributions the models are compared with.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shares {
    AsObserved,
    Smoothed,
}

impl Accuracy {
    pub(in crate::web) fn new(snapshot: &Snapshot, plan: &FitPlan) -> Self {
        let study = &snapshot.study;
        let mut cells = Vec::new();
        let mut scored = Vec::new();
        for (cell, counts) in study.cells().iter().zip(&snapshot.counts.cells) {
            let n = counts.n();
            if !cell.fitted || n == 0 {
                continue;
            }
            let samples = |model| snapshot.ln_kl(&plan.id, model, cell.id.as_str());
            let unanimous = counts.actions.contains(&n);
            cells.push(CellAccuracy {
                id: cell.id.to_string(),
                label: cell.label.clone(),
                n,
                unanimous,
                reference: reference_level(cell.actions.len(), n),
                models: MODELS
                    .iter()
                    .map(|model| (model.id.to_owned(), samples(model.id).map(|samples| Score::of(&samples.as_observed))))
                    .collect(),
            });
            scored.push(Scored {
                levels: &cell.levels,
                unanimous,
                aware: samples(RISK_AWARE.id),
                noisy: samples(NOISY_RATIONAL.id),
            });
        }
        let sets = pooled_sets(study);
        let pooled = |shares| sets.iter().map(|levels| pooled_row(study, levels, &scored, shares)).collect();
        Self {
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            plan: plan.id.to_string(),
            plan_label: plan.label.clone(),
            samples: study.fit().samples,
            at: latest(snapshot, plan).map(rfc3339),
            cells,
            pooled: pooled(Shares::AsObserved),
            pooled_smoothed: pooled(Shares::Smoothed),
            paper: study.paper().iter().map(|figure| paper_row(study, figure)).collect(),
        }
    }
}

impl Score {
    /// `None` among the samples stands for KL = 0, whose logarithm has no number.
    fn of(samples: &[Option<f64>]) -> Self {
        LnKlSamples::summary_of(samples).into()
    }
}

fn latest(snapshot: &Snapshot, plan: &FitPlan) -> Option<Timestamp> {
    snapshot.fits.iter().filter(|part| part.plan == plan.id).filter_map(|part| Some(part.fit.as_ref()?.created_at)).max()
}

/// All cells together, each level of each factor, and what else the paper pools.
fn pooled_sets(study: &Study) -> Vec<Levels> {
    let mut sets = vec![Levels::new()];
    for factor in study.factors() {
        let levels = factor.levels.iter().filter(|level| {
            study.cells().iter().any(|cell| cell.fitted && cell.levels.contains(&(factor.id.clone(), level.id.clone())))
        });
        let of_factor: Vec<Levels> = levels.map(|level| vec![(factor.id.clone(), level.id.clone())]).collect();
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
        let factor = study.factors().iter().find(|factor| factor.id == *factor_id);
        let level = factor.and_then(|factor| factor.levels.iter().find(|level| level.id == *level_id));
        match (factor, level) {
            (Some(factor), Some(level)) => format!("{}: {}", factor.label, level.label.to_lowercase()),
            (Some(_), None) | (None, Some(_) | None) => format!("{factor_id}: {level_id}"),
        }
    };
    levels.iter().map(of_level).collect::<Vec<_>>().join(", ")
}

fn pooled_row(study: &Study, levels: &Levels, scored: &[Scored<'_>], shares: Shares) -> PooledRow {
    let of_set: Vec<&Scored> =
        scored.iter().filter(|cell| levels.iter().all(|level| cell.levels.contains(level))).collect();
    let used: Vec<&Scored> =
        of_set.iter().filter(|cell| shares == Shares::Smoothed || !cell.unanimous).copied().collect();
    let aware = pool(used.iter().map(|cell| cell.aware), shares);
    let noisy = pool(used.iter().map(|cell| cell.noisy), shares);
    let numbers = finite(aware.as_deref()).zip(finite(noisy.as_deref()));
    let test = |test: fn(&[f64], &[f64]) -> Option<TTest>| numbers.as_ref().and_then(|(aware, noisy)| test(aware, noisy));
    PooledRow {
        label: label(study, levels),
        levels: levels.iter().map(|(factor, level)| (factor.to_string(), level.to_string())).collect(),
        cells: used.len(),
        left_out: of_set.len() - used.len(),
        paired_t: test(paired_t_test),
        welch_t: test(welch_t_test),
        models: OrderedMap(vec![
            (NOISY_RATIONAL.id.to_owned(), noisy.map(|samples| Score::of(&samples))),
            (RISK_AWARE.id.to_owned(), aware.map(|samples| Score::of(&samples))),
        ]),
    }
}

/// The samples of all cells in a row; `None` while a cell has none, since a part of the cells is another comparison.
fn pool<'a>(cells: impl Iterator<Item = Option<&'a LnKlSamples>>, shares: Shares) -> Option<Vec<Option<f64>>> {
    let mut all = Vec::new();
    for cell in cells {
        let samples = cell?;
        all.extend_from_slice(match shares {
            Shares::AsObserved => &samples.as_observed,
            Shares::Smoothed => &samples.smoothed,
        });
    }
    (!all.is_empty()).then_some(all)
}

fn finite(samples: Option<&[Option<f64>]>) -> Option<Vec<f64>> {
    samples?.iter().copied().collect()
}

fn paper_row(study: &Study, figure: &PaperFigure) -> PaperRow {
    let score = |figure: Option<MeanSd>| figure.map(|figure| PaperScore { mean: figure.mean, sd: figure.sd });
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
