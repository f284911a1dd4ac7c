//! How the models of a study compare on one plan: what that depends on, and what is stored of it.

use std::{collections::HashMap, ops::ControlFlow, sync::Arc};

use serde::{Deserialize, Serialize};
use tokio_util::sync::CancellationToken;

use super::{
    Snapshot, StudyCounts,
    fit_input::{FitInput, comparison_seed, fit_settings, hash_of},
};
use crate::{
    inference::{
        ChoiceData, FitError, FitSettings, FittedProblem, Group,
        comparison::{
            AskedCell, BootstrapSettings, ChoiceTests, Comparison, ComparisonSettings,
            FactorLevels, KnownFit, PartFit, PlanData, Resampling, Unit, choice_tests,
            compare_models,
        },
    },
    model::ChoiceModel,
    store::{self, AskedProblem, CellCount, Pattern, ProblemId},
    study::{FitPlan, PlanId, Study, Timestamp},
};

/// A stored comparison of a plan's models.
#[derive(Debug, Clone)]
pub struct PlanComparison {
    /// The plan.
    pub plan: PlanId,
    /// What it found, or why it found nothing.
    pub report: Result<Arc<Comparison>, String>,
    /// What the choices of all cells say without a model: the same for every plan.
    pub tests: Option<Arc<ChoiceTests>>,
    /// Newer answers wait to be compared.
    pub is_behind: bool,
    /// The version of the data that it read.
    pub data_version: i64,
    /// The seed with which it can be repeated.
    pub seed: u64,
    /// The program that made it.
    pub program_version: String,
    /// When it was stored.
    pub at: Timestamp,
    pub(super) input_hash: String,
}

impl PlanComparison {
    /// What was stored; none where another version of the program wrote it in another form.
    fn read(stored: store::Comparison) -> Option<Self> {
        let (report, tests) = match stored.outcome {
            Ok(text) => match serde_json::from_str(&text) {
                Ok(StoredReport { comparison, tests }) => {
                    (Ok(Arc::new(comparison)), Some(Arc::new(tests)))
                }
                Err(error) => {
                    tracing::debug!(plan = %stored.plan, %error, "a stored comparison has another form");
                    return None;
                }
            },
            Err(message) => (Err(message), None),
        };
        Some(Self {
            plan: stored.plan,
            report,
            tests,
            is_behind: false,
            data_version: stored.data_version,
            seed: stored.seed,
            program_version: stored.program_version,
            at: stored.created_at,
            input_hash: stored.input_hash,
        })
    }

    /// Those that are stored now: the known ones, unless a new one took their place.
    pub(super) fn renewed(known: &[Self], new: Vec<store::Comparison>) -> Vec<Self> {
        let new: Vec<Self> = new.into_iter().filter_map(Self::read).collect();
        let kept = known
            .iter()
            .filter(|known| new.iter().all(|new| new.plan != known.plan))
            .cloned();
        kept.chain(new.iter().cloned()).collect()
    }

    /// What the input hash of each comparison of a plan begins with: a hash of all that its fits depend on but the answers.
    pub fn settings_hash(study: &Study, plan: &FitPlan) -> String {
        let nobody = FitInput::of_plan(study, plan, study.models(), &StudyCounts::new(study, &[]));
        hash_of(nobody.iter().map(|input| input.hash.as_str()))
    }

    /// The same, as it stands to the answers that there are now; none if it is one of other problems, models or priors,
    /// or if nobody's answers are left.
    pub(super) fn beside(&self, snapshot: &Snapshot) -> Option<Self> {
        let plans = snapshot.study.plans();
        let plan = plans.iter().find(|plan| plan.id == self.plan)?;
        let mut fitted = snapshot.fits.iter().filter(|part| part.plan == plan.id);
        let is_of_this = self
            .input_hash
            .starts_with(&Self::settings_hash(&snapshot.study, plan))
            && fitted.any(|part| part.input.data.n() > 0);
        is_of_this.then(|| Self {
            is_behind: !self.input_hash.starts_with(&fits_hash(snapshot, plan)),
            ..self.clone()
        })
    }
}

/// The same with all fits of a plan: it moves with every answer that counts there.
fn fits_hash(snapshot: &Snapshot, plan: &FitPlan) -> String {
    let of_plan = snapshot.fits.iter().filter(|part| part.plan == plan.id);
    let fits = hash_of(of_plan.map(|part| part.input.hash.as_str()));
    let settings = PlanComparison::settings_hash(&snapshot.study, plan);
    format!("{settings}-{fits}")
}

/// What is stored of a comparison.
#[derive(Debug, Serialize, Deserialize)]
struct StoredReport {
    comparison: Comparison,
    tests: ChoiceTests,
}

/// The problems of a study's cells, as they are stored: whose answers are read.
#[derive(Debug)]
pub(super) struct AskedCells {
    cells: Vec<AskedCell>,
    factors: Vec<FactorLevels>,
    /// Which cell each stored problem belongs to.
    places: HashMap<ProblemId, usize>,
    /// The fitted cells, by their place.
    fitted: Vec<(usize, FittedProblem)>,
}

impl AskedCells {
    pub(super) fn new(study: &Study, stored: &[CellCount]) -> Self {
        let mut places = HashMap::new();
        let mut fitted = Vec::new();
        for (place, cell) in study.cells().iter().enumerate() {
            let asked = AskedProblem::of(cell);
            let rows = stored
                .iter()
                .filter(|row| row.cell == asked.cell && row.hash == asked.hash);
            places.extend(rows.map(|row| (row.problem, place)));
            if let Some(problem) = cell.problem.clone().filter(|_| cell.fitted) {
                let id = cell.id.to_string();
                fitted.push((place, FittedProblem { id, problem }));
            }
        }
        let cells = study.cells().iter().map(|cell| AskedCell {
            id: cell.id.to_string(),
            label: cell.label.clone(),
            actions: cell
                .actions
                .iter()
                .map(|action| action.id.to_string())
                .collect(),
            levels: cell
                .levels
                .iter()
                .map(|(factor, level)| (factor.to_string(), level.to_string()))
                .collect(),
        });
        let factors = study.factors().iter().map(|factor| FactorLevels {
            id: factor.id.to_string(),
            levels: factor
                .levels
                .iter()
                .map(|level| level.id.to_string())
                .collect(),
        });
        Self {
            cells: cells.collect(),
            factors: factors.collect(),
            places,
            fitted,
        }
    }

    /// The stored problems.
    pub(super) fn ids(&self) -> Vec<ProblemId> {
        let mut ids: Vec<ProblemId> = self.places.keys().copied().collect();
        ids.sort_unstable();
        ids
    }

    /// Everybody's answers to all cells, person by person.
    fn groups(&self, patterns: &[Pattern]) -> Vec<Group> {
        let group = |pattern: &Pattern| {
            let mut counts: Vec<Vec<u64>> = self
                .cells
                .iter()
                .map(|cell| vec![0; cell.actions.len()])
                .collect();
            for (id, action) in &pattern.choices {
                let found = self.places.get(id).and_then(|&place| {
                    let mut actions = self.cells[place].actions.iter();
                    Some((place, actions.position(|known| *action == known.as_str())?))
                });
                if let Some((place, action)) = found {
                    counts[place][action] += 1;
                }
            }
            Group {
                weight: pattern.weight,
                counts,
            }
        };
        patterns.iter().map(group).collect()
    }

    /// The answers to the cells that are fitted.
    fn fitted_data(&self, groups: &[Group]) -> Option<ChoiceData> {
        let problems = self.fitted.iter().map(|(_, problem)| problem.clone());
        let groups = groups.iter().map(|group| Group {
            weight: group.weight,
            counts: self
                .fitted
                .iter()
                .map(|(place, _)| group.counts[*place].clone())
                .collect(),
        });
        ChoiceData::new(problems.collect(), groups.collect()).ok()
    }
}

/// A comparison that can be made.
#[derive(Debug)]
pub(super) struct ComparisonInput {
    pub(super) hash: String,
    data: PlanData,
    models: Vec<&'static ChoiceModel>,
    pub(super) settings: FitSettings,
    cells: Vec<AskedCell>,
    factors: Vec<FactorLevels>,
    groups: Vec<Group>,
}

impl ComparisonInput {
    /// None where nobody has answered.
    pub(super) fn new(
        snapshot: &Snapshot,
        plan: &FitPlan,
        asked: &AskedCells,
        patterns: &[Pattern],
    ) -> Option<Self> {
        let study = &snapshot.study;
        let groups = asked.groups(patterns);
        let data = asked.fitted_data(&groups).filter(|data| data.n() > 0)?;
        let parts = plan.parts.iter().map(|part| {
            let places = part
                .cells
                .iter()
                .filter_map(|cell| asked.fitted.iter().position(|(place, _)| place == cell));
            (part.id.to_string(), places.collect())
        });
        let texts: Vec<String> = patterns
            .iter()
            .map(|pattern| format!("{}{:?}", pattern.weight, pattern.choices))
            .collect();
        let answers = hash_of(texts.iter().map(String::as_str));
        Some(Self {
            hash: format!("{}-{answers}", fits_hash(snapshot, plan)),
            data: PlanData::new(&data, Unit::Participant, parts.collect()).ok()?,
            models: study.models().to_vec(),
            settings: fit_settings(study, comparison_seed(study.id(), &plan.id)),
            cells: asked.cells.clone(),
            factors: asked.factors.clone(),
            groups,
        })
    }

    /// Compares, with the fits that there are, and gives what is stored of it.
    pub(super) fn compare(
        &self,
        known: &[KnownFit],
        stop: &CancellationToken,
    ) -> Result<String, ComparisonFailure> {
        let seed = self.settings.seed;
        let wanted = ComparisonSettings {
            // People drawn anew are fitted anew, part by part: only the plan of one part is cheap enough.
            bootstrap: (self.data.parts().len() == 1).then(|| BootstrapSettings {
                seed,
                ..BootstrapSettings::default()
            }),
            ..ComparisonSettings::full(seed)
        };
        let mut watch = |_| {
            if stop.is_cancelled() {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let comparison = compare_models(
            &self.data,
            &self.models,
            &self.settings,
            known,
            &wanted,
            &mut watch,
        )?;
        let resampling = Resampling {
            seed,
            ..Resampling::default()
        };
        let tests = choice_tests(
            &self.cells,
            &self.factors,
            &self.groups,
            self.data.unit(),
            &resampling,
        );
        Ok(serde_json::to_string(&StoredReport { comparison, tests })?)
    }
}

/// Why there is no comparison.
#[derive(Debug, thiserror::Error)]
pub(super) enum ComparisonFailure {
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error("the result could not be written as JSON: {0}")]
    Report(#[from] serde_json::Error),
}

/// The plan's fits that have converged, each with its draws, as far as they can be read.
pub(super) async fn known_fits(
    store: &store::Store,
    snapshot: &Snapshot,
    plan: &FitPlan,
) -> Result<Vec<KnownFit>, store::Error> {
    let mut known = Vec::new();
    for fit in snapshot.fits.iter().filter(|fit| fit.plan == plan.id) {
        let (Some(report), Some(stored)) = (fit.converged(), &fit.fit) else {
            continue;
        };
        let draws = match fit.draws() {
            Some(draws) => Some(draws.as_ref().clone()),
            None => match store.fit_draws(stored.id).await {
                Ok(blob) => report.draws(&blob),
                Err(store::Error::NotFound(_)) => None,
                Err(error) => return Err(error),
            },
        };
        let part = plan.parts.iter().position(|part| part.id == fit.part);
        known.extend(part.zip(draws).map(|(part, draws)| KnownFit {
            part,
            fit: PartFit {
                model: fit.model,
                draws,
                summary: report.summary.clone(),
            },
        }));
    }
    Ok(known)
}
