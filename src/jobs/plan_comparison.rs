//! How the models of a study compare on one plan: what that depends on, and what is stored of it.

use std::{collections::HashMap, ops::ControlFlow, sync::Arc};

use tokio_util::sync::CancellationToken;

use super::{
    Snapshot,
    fit_input::{comparison_seed, fit_settings, hash_of},
};
use crate::{
    inference::{
        ChoiceData, FitError, FitSettings, FittedProblem, Group,
        comparison::{
            Comparison, ComparisonSettings, KnownFit, PartFit, PlanData, Unit, compare_models,
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
        let report = match stored.outcome {
            Ok(text) => match serde_json::from_str(&text) {
                Ok(report) => Ok(Arc::new(report)),
                Err(error) => {
                    tracing::debug!(plan = %stored.plan, %error, "a stored comparison has another form");
                    return None;
                }
            },
            Err(message) => Err(message),
        };
        Some(Self {
            plan: stored.plan,
            report,
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

    /// The same, as it stands to the answers that there are now.
    pub(super) fn beside(&self, fits_hash: &str) -> Self {
        Self {
            is_behind: !self.input_hash.starts_with(fits_hash),
            ..self.clone()
        }
    }
}

/// Of all fits of a plan: it moves with every answer that counts there.
pub(super) fn fits_hash(snapshot: &Snapshot, plan: &PlanId) -> String {
    let of_plan = snapshot.fits.iter().filter(|part| part.plan == *plan);
    hash_of(of_plan.map(|part| part.input.hash.as_str()))
}

/// The problems that a study fits, as they are stored: whose answers are read.
#[derive(Debug)]
pub(super) struct FittedProblems {
    problems: Vec<FittedProblem>,
    /// Which problem of the list each stored one is.
    places: HashMap<ProblemId, usize>,
    /// The problem of each cell of the study.
    of_cell: Vec<Option<usize>>,
}

impl FittedProblems {
    pub(super) fn new(study: &Study, stored: &[CellCount]) -> Self {
        let mut fitted = Self {
            problems: Vec::new(),
            places: HashMap::new(),
            of_cell: Vec::new(),
        };
        for cell in study.cells() {
            let problem = cell.problem.clone().filter(|_| cell.fitted);
            fitted.of_cell.push(problem.map(|problem| {
                let asked = AskedProblem::new(cell.id.to_string(), Some(&problem));
                let rows = stored
                    .iter()
                    .filter(|row| row.cell == asked.cell && row.hash == asked.hash);
                let place = fitted.problems.len();
                fitted.places.extend(rows.map(|row| (row.problem, place)));
                fitted.problems.push(FittedProblem {
                    id: cell.id.to_string(),
                    problem,
                });
                place
            }));
        }
        fitted
    }

    /// The stored problems.
    pub(super) fn ids(&self) -> Vec<ProblemId> {
        let mut ids: Vec<ProblemId> = self.places.keys().copied().collect();
        ids.sort_unstable();
        ids
    }

    /// Everybody's answers, person by person.
    fn data(&self, patterns: &[Pattern]) -> Option<ChoiceData> {
        let groups = patterns.iter().map(|pattern| {
            let mut counts: Vec<Vec<u64>> = self
                .problems
                .iter()
                .map(|problem| vec![0; problem.problem.actions().len()])
                .collect();
            for (id, action) in &pattern.choices {
                let place = self.places.get(id).copied();
                let found = place.and_then(|place| {
                    let action = self.problems[place].problem.position(action.as_str())?;
                    Some((place, action))
                });
                if let Some((place, action)) = found {
                    counts[place][action] += 1;
                }
            }
            Group {
                weight: pattern.weight,
                counts,
            }
        });
        ChoiceData::new(self.problems.clone(), groups.collect()).ok()
    }
}

/// A comparison that can be made.
#[derive(Debug)]
pub(super) struct ComparisonInput {
    pub(super) hash: String,
    data: PlanData,
    models: Vec<&'static ChoiceModel>,
    pub(super) settings: FitSettings,
}

impl ComparisonInput {
    /// None where nobody has answered.
    pub(super) fn new(
        snapshot: &Snapshot,
        plan: &FitPlan,
        fitted: &FittedProblems,
        patterns: &[Pattern],
    ) -> Option<Self> {
        let study = &snapshot.study;
        let data = fitted.data(patterns).filter(|data| data.n() > 0)?;
        let parts = plan.parts.iter().map(|part| {
            let places = part.cells.iter().filter_map(|cell| fitted.of_cell[*cell]);
            (part.id.to_string(), places.collect())
        });
        let texts: Vec<String> = patterns
            .iter()
            .map(|pattern| format!("{}{:?}", pattern.weight, pattern.choices))
            .collect();
        let answers = hash_of(texts.iter().map(String::as_str));
        Some(Self {
            hash: format!("{}-{answers}", fits_hash(snapshot, &plan.id)),
            data: PlanData::new(&data, Unit::Participant, parts.collect()).ok()?,
            models: study.models().to_vec(),
            settings: fit_settings(study, comparison_seed(study.id(), &plan.id)),
        })
    }

    /// Compares, with the fits that there are.
    pub(super) fn compare(
        &self,
        known: &[KnownFit],
        stop: &CancellationToken,
    ) -> Result<Comparison, FitError> {
        compare_models(
            &self.data,
            &self.models,
            &self.settings,
            known,
            &ComparisonSettings::full(self.settings.seed),
            &mut |_| {
                if stop.is_cancelled() {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            },
        )
    }
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
