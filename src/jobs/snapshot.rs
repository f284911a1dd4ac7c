//! All that a results page says about a study, read at one moment.

use std::sync::Arc;

use serde::Serialize;

use super::{
    Catalogue, FitReport, StudyCounts,
    counts::analysis_set,
    fit_input::FitInput,
    known_fits::{KnownFit, KnownFits},
    looks::{Looks, SequentialEvidence},
    plan_comparison::PlanComparison,
    snapshot_cache::fresh,
};
use crate::{
    inference::{Draws, Estimate, accuracy::CellAccuracy, comparison::Hypothesis, sequential},
    model::ChoiceModel,
    store::{
        AnalysisSet, CellCount, Error, Fit, FitOutcome, FitState, Population, Store, StudyState,
        Totals,
    },
    study::{CellId, FitPlan, Flag, PartId, PlanId, Study, StudyId},
};

/// Which data and which fits are shown. Each number moves when its half changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct Version {
    /// Moves with every change of the data.
    pub data_version: i64,
    /// Moves with every new fit.
    pub fit_version: i64,
}

impl Version {
    /// The version from the two numbers of the store. What moves the page without moving the data is a fit, or a change of
    /// the study file, after which fits are read anew as well.
    pub fn new(data_version: i64, page_version: i64) -> Self {
        Self {
            data_version,
            fit_version: page_version - data_version,
        }
    }
}

impl From<&Totals> for Version {
    fn from(totals: &Totals) -> Self {
        Self::new(totals.data_version, totals.page_version)
    }
}

/// The state of a study's data and fits.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// The current version of the study.
    pub study: Arc<Study>,
    /// Of whom.
    pub population: Population,
    /// Whether the study takes people in.
    pub state: StudyState,
    /// Which data and fits.
    pub version: Version,
    /// Who took part.
    pub people: Totals,
    /// How many people of the analysis set are left out of it for what; no flag stands for those who are left out by hand
    /// alone.
    pub exclusions: Vec<(Option<Flag>, u64)>,
    /// What they chose.
    pub counts: StudyCounts,
    /// Every part of every plan with every model, in file order.
    pub fits: Vec<PartFit>,
    /// The stored fits, for the next snapshot.
    known: KnownFits,
    comparisons: Vec<PlanComparison>,
    pub(super) sequential: Option<SequentialEvidence>,
    /// Whether it is one that strangers are shown, without what tells of few people.
    pub is_of_many: bool,
}

/// Results are hidden until enough people have finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct Blind {
    /// How many people it takes.
    pub until: u64,
    /// How many have finished.
    pub completed: u64,
}

impl Blind {
    /// What hides the results of a study of whom so many have finished; none once they may be shown. This is the one place
    /// that decides.
    pub fn of(study: &Study, people: &Totals) -> Option<Self> {
        let (until, completed) = (study.blind_until()?, people.completed);
        (completed < until).then_some(Self { until, completed })
    }
}

/// One model's fit to one part of a plan.
#[derive(Debug, Clone)]
pub struct PartFit {
    /// The plan.
    pub plan: PlanId,
    /// The plan's text on pages.
    pub plan_label: String,
    /// The part.
    pub part: PartId,
    /// The part's text on pages.
    pub part_label: String,
    /// The cells that it is fitted to.
    pub cells: Vec<CellId>,
    /// The model.
    pub model: &'static ChoiceModel,
    /// How far it is.
    pub state: PartState,
    /// The latest stored fit of the problems as they are now.
    pub fit: Option<Arc<Fit>>,
    /// What that fit found.
    report: Option<Arc<FitReport>>,
    /// Its draws, where this server made it.
    draws: Option<Arc<Draws>>,
    /// Newer answers wait to be fitted.
    pub is_behind: bool,
    /// What a fit to the answers as they are now depends on.
    pub(super) input: Arc<FitInput>,
}

/// How far the fit of a part is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PartState {
    /// Nobody has answered yet.
    Waiting,
    /// There are answers, and the first fit to them is under way.
    Running,
    /// Shown as a result.
    Converged,
    /// Shown as a state only.
    Unconverged,
    /// Broke off with a message.
    Failed,
}

/// Why a part has no fit that can be cited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NotFinal {
    /// There is none yet.
    Missing,
    /// Newer answers wait to be fitted.
    Behind,
    /// It started from the fit before it.
    Provisional,
    /// Its chains do not agree.
    Unconverged,
    /// It broke off.
    Failed,
}

impl PartState {
    /// Its name in JSON.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Running => "running",
            Self::Converged => "converged",
            Self::Unconverged => "unconverged",
            Self::Failed => "failed",
        }
    }
}

impl Snapshot {
    /// The study's counters and latest fits; `None` for a study that is not served. As long as its version does not move,
    /// this is one and the same snapshot.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn read(
        store: &Store,
        catalogue: &Catalogue,
        population: Population,
        id: &StudyId,
    ) -> Result<Option<Arc<Self>>, Error> {
        if catalogue.current(id).is_none() {
            return Ok(None);
        }
        // The version first: a change in between makes the snapshot look older than it is, and it is read again.
        let people = store.totals(id, population).await?;
        let slot = catalogue.snapshots.slot(id, population);
        let mut kept = slot.0.lock().await;
        // Under the lock, which whoever changes the version takes afterwards.
        let Some((_, study)) = catalogue.current(id) else {
            return Ok(None);
        };
        if let Some(snapshot) = fresh(kept.as_ref(), &people) {
            return Ok(Some(snapshot));
        }
        let state = store.study(id).await?.state;
        let counts = store.cell_counts(id, population).await?;
        let exclusions = match people.excluded {
            0 => Vec::new(),
            _ => {
                let set = analysis_set(&study);
                store.exclusions(id, population, set).await?
            }
        };
        let known = kept
            .as_ref()
            .map_or_else(KnownFits::default, |kept| kept.known.clone());
        let (ids, new) = store.new_fits(id, population, &known.ids()).await?;
        let compared = kept.as_ref().map_or(&[][..], |kept| &kept.comparisons);
        let hashes: Vec<&str> = compared
            .iter()
            .map(|comparison| comparison.input_hash.as_str())
            .collect();
        let newly_compared = store.comparisons(id, population, &hashes).await?;
        let compared = PlanComparison::renewed(compared, newly_compared);
        let looks = store.checkpoints(id, population).await?;
        let rule_hash = Looks::new(&study).and_then(|looks| looks.rule_hash());
        let reached = match rule_hash {
            Some(rule_hash) => store.stopping(id, population, &rule_hash).await?,
            None => None,
        };
        let live: Vec<_> = new
            .iter()
            .map(|fit| catalogue.live_fits.of(id, population, fit))
            .collect();
        // Reading fits that an earlier server made takes long enough to hold up other requests.
        let made = tokio::task::spawn_blocking(move || {
            let known = known.renewed(&ids, new.into_iter().zip(live).collect());
            let mut snapshot = Self::new(study, population, state, people, &counts, known);
            snapshot.exclusions = exclusions;
            snapshot.comparisons = compared
                .iter()
                .filter_map(|known| known.beside(&snapshot))
                .collect();
            snapshot.sequential = Looks::new(&snapshot.study)
                .map(|made| made.evidence(people.analysed(), &looks, reached));
            Arc::new(snapshot)
        });
        let snapshot = match made.await {
            Ok(snapshot) => snapshot,
            Err(error) => match error.try_into_panic() {
                Ok(panic) => std::panic::resume_unwind(panic),
                Err(_) => return Err(Error::Unavailable("the server is shutting down")),
            },
        };
        *kept = Some(snapshot.clone());
        Ok(Some(snapshot))
    }

    pub(super) fn new(
        study: Arc<Study>,
        population: Population,
        state: StudyState,
        people: Totals,
        counts: &[CellCount],
        known: KnownFits,
    ) -> Self {
        let counts = StudyCounts::new(&study, counts);
        let fits = FitInput::all(&study, &counts)
            .into_iter()
            .map(|input| {
                let known = known.iter().find(|known| input.is_of(&known.fit));
                PartFit::new(&study, input, known.cloned())
            })
            .collect();
        Self {
            version: Version::from(&people),
            study,
            population,
            state,
            people,
            exclusions: Vec::new(),
            counts,
            fits,
            known,
            comparisons: Vec::new(),
            sequential: None,
            is_of_many: false,
        }
    }

    /// What hides everything that tells how the models do; none once it may be shown. Who took part is never hidden.
    pub fn blind(&self) -> Option<Blind> {
        Blind::of(&self.study, &self.people)
    }

    /// The newest comparison of a plan's models, if one was made. Ask [`blind`](Self::blind) before it is shown.
    pub fn comparison(&self, plan: &PlanId) -> Option<&PlanComparison> {
        self.comparisons.iter().find(|known| known.plan == *plan)
    }

    /// How the evidence grew while people finished, and whether the study's rule for stopping was reached; none where
    /// nothing is followed. Ask [`blind`](Self::blind) before it is shown.
    pub fn sequential(&self) -> Option<&SequentialEvidence> {
        self.sequential.as_ref()
    }

    /// ln of the Bayes factor of one model against another on a plan, from the fits as they are: live, while a
    /// [`comparison`](Self::comparison) waits until they are final. None while a part has no converged fits of both to
    /// the same answers.
    pub fn ln_bayes_factor(&self, plan: &PlanId, first: &str, second: &str) -> Option<Estimate> {
        let of = |model: &str| -> Option<Vec<&FitReport>> {
            let parts = self.fits.iter();
            parts
                .filter(|part| part.plan == *plan && part.model.id == model)
                .map(PartFit::converged)
                .collect()
        };
        let (first, second) = (of(first)?, of(second)?);
        // Fits arrive one by one, and the evidence of other answers makes no ratio.
        let of_the_same = first
            .iter()
            .zip(&second)
            .all(|(first, second)| first.counts == second.counts);
        if !of_the_same {
            return None;
        }
        sequential::ln_bayes_factor(
            first.iter().map(|report| &report.summary),
            second.iter().map(|report| &report.summary),
        )
    }

    /// The hypothesis that the study file states.
    pub fn hypothesis(&self) -> Option<Hypothesis<'_>> {
        let stated = self.study.hypothesis()?;
        Some(Hypothesis {
            id: &stated.id,
            statement: &stated.statement,
            better: stated.better.id,
            than: stated.than.id,
        })
    }

    /// Whether there are answers, and every fit is a final one of all of them.
    pub fn is_final(&self) -> bool {
        let mut fitted = self
            .fits
            .iter()
            .filter(|part| part.input.data.n() > 0)
            .peekable();
        fitted.peek().is_some() && fitted.all(|part| !part.is_behind && !part.is_provisional())
    }

    /// The same with final fits alone, as they are to be cited, and the parts with answers that are missing in it.
    pub fn final_alone(&self) -> (Self, Vec<(&PartFit, NotFinal)>) {
        let left_out: Vec<_> = self
            .fits
            .iter()
            .filter_map(|part| Some((part, part.why_not_final()?)))
            .collect();
        let mut frozen = self.clone();
        for part in &mut frozen.fits {
            if part.why_not_final().is_some() {
                (part.fit, part.report, part.draws) = (None, None, None);
                part.state = PartState::Running;
            }
        }
        frozen
            .comparisons
            .retain(|comparison| !comparison.is_behind);
        (frozen, left_out)
    }

    /// Whose answers the study analyses.
    pub fn analysis_set(&self) -> AnalysisSet {
        analysis_set(&self.study)
    }

    /// The plan with the most parts: the closest to fitting each cell alone, which is the paper's way.
    pub fn finest_plan(&self) -> &FitPlan {
        let plans = self.study.plans();
        // The first of those with equally many parts.
        plans
            .iter()
            .rev()
            .max_by_key(|plan| plan.parts.len())
            .unwrap_or(&plans[0])
    }

    /// The plan whose curves a page shows first: of those that split at all, the one with the fewest parts, few enough to
    /// look at side by side.
    pub fn curve_plan(&self) -> &FitPlan {
        let plans = self.study.plans();
        let split = plans.iter().filter(|plan| plan.parts.len() > 1);
        split
            .min_by_key(|plan| plan.parts.len())
            .unwrap_or(&plans[0])
    }

    /// The ids of the fitted cells, in file order.
    pub fn fitted_cells(&self) -> impl Iterator<Item = &str> {
        self.study
            .cells()
            .iter()
            .filter(|cell| cell.fitted)
            .map(|cell| cell.id.as_str())
    }

    /// How a plan's converged fit does on a cell.
    pub fn accuracy(&self, plan: &PlanId, model: &str, cell: &str) -> Option<&CellAccuracy> {
        self.fits
            .iter()
            .filter(|part| part.plan == *plan && part.model.id == model)
            .find_map(|part| {
                part.converged()?
                    .accuracy
                    .iter()
                    .find(|scored| scored.problem == cell)
            })
    }
}

impl PartFit {
    fn new(study: &Study, input: FitInput, known: Option<KnownFit>) -> Self {
        // A fit of other problems (the study file was changed) says nothing about the ones asked now.
        let known = known.filter(|known| {
            let report = known.report.as_ref();
            report.is_none_or(|report| {
                report.problems == input.problems() && report.limits == input.limits
            })
        });
        let (fit, report, draws) = match known {
            Some(KnownFit { fit, report, draws }) => (Some(fit), report, draws),
            None => (None, None, None),
        };
        let plan_label = study
            .plans()
            .iter()
            .find(|plan| plan.id == input.plan)
            .map(|plan| plan.label.clone());
        Self {
            plan: input.plan.clone(),
            plan_label: plan_label.unwrap_or_default(),
            part: input.part.clone(),
            part_label: input.label.clone(),
            cells: input.cells.clone(),
            model: input.model,
            state: match fit.as_ref().map(|fit| fit.outcome.state()) {
                None if input.data.n() == 0 => PartState::Waiting,
                None => PartState::Running,
                Some(FitState::Converged) => PartState::Converged,
                Some(FitState::Unconverged) => PartState::Unconverged,
                Some(FitState::Failed) => PartState::Failed,
            },
            is_behind: input.data.n() > 0
                && fit.as_ref().is_none_or(|fit| fit.input_hash != input.hash),
            fit,
            report,
            draws,
            input: Arc::new(input),
        }
    }

    /// Why the fit is not shown, if it was tried.
    pub fn message(&self) -> Option<String> {
        match &self.fit.as_ref()?.outcome {
            FitOutcome::Converged(_) => None,
            FitOutcome::Unconverged(_) => Some("the chains do not agree yet".to_owned()),
            FitOutcome::Failed(message) => Some(message.clone()),
        }
    }

    /// Whether the fit depends on the fits before it; a final one follows once the study is idle.
    pub fn is_provisional(&self) -> bool {
        self.fit.as_ref().is_some_and(|fit| fit.is_provisional)
    }

    /// Why the fit is none to be cited; none for a final one, and where nobody has answered.
    fn why_not_final(&self) -> Option<NotFinal> {
        match self.state {
            PartState::Waiting => None,
            PartState::Running => Some(NotFinal::Missing),
            PartState::Failed => Some(NotFinal::Failed),
            PartState::Converged | PartState::Unconverged if self.is_behind => {
                Some(NotFinal::Behind)
            }
            PartState::Converged | PartState::Unconverged if self.is_provisional() => {
                Some(NotFinal::Provisional)
            }
            PartState::Unconverged => Some(NotFinal::Unconverged),
            PartState::Converged => None,
        }
    }

    /// The fit's draws, where this server made it; others are in the store.
    pub fn draws(&self) -> Option<&Arc<Draws>> {
        self.draws.as_ref()
    }

    /// What is stored of the fit.
    pub fn report(&self) -> Option<&FitReport> {
        self.report.as_deref()
    }

    /// What is stored of the fit, if it converged.
    pub fn converged(&self) -> Option<&FitReport> {
        self.report().filter(|report| report.summary.converged)
    }
}
