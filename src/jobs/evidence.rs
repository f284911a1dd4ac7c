//! What belongs beside the fits, in the background: looks at the first people's answers, and comparisons of the models.
//!
//! A look is about people who have finished, so newer answers do not touch it: it is made whenever it is due. A comparison
//! is about all answers, and takes long: it waits until the fits are final, and is given up when new answers arrive.

use std::{collections::HashMap, sync::Arc, time::Duration};

use tokio::{
    sync::broadcast::{self, error::RecvError},
    time::sleep,
};
use tokio_util::sync::CancellationToken;

use super::{
    Catalogue, RuleText, Snapshot,
    lane::{Done, Ended, Lane},
    looks::{Looks, bound},
    plan_comparison::{AskedCells, ComparisonFailure, ComparisonInput, known_fits},
};
use crate::{
    inference::{FitError, sequential::Look},
    store::{
        self, Change, Checkpoint, NewCheckpoints, NewComparison, Population, Reached, Store,
        VersionId,
    },
    study::{PlanId, StudyId},
};

/// A change whose notice was missed is found by then.
const POLL_INTERVAL: Duration = Duration::from_secs(30);
/// Pause after the database failed.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// So many looks are stored together: a long history appears bit by bit.
const LOOKS_AT_ONCE: usize = 8;

/// Makes looks and comparisons of the current studies of one population, until `stop`.
pub async fn run(
    store: Store,
    catalogue: Arc<Catalogue>,
    population: Population,
    stop: CancellationToken,
) {
    let changes = store.subscribe();
    let lane = match Lane::start("evidence") {
        Ok(lane) => lane,
        Err(error) => {
            tracing::error!(%error, "the thread for comparisons could not be started; nothing is compared");
            return;
        }
    };
    let mut evidence = Evidence {
        store,
        catalogue,
        population,
        stop: stop.clone(),
        lane,
        changes,
        looked: HashMap::new(),
        compared: HashMap::new(),
    };
    while !stop.is_cancelled() {
        match evidence.step().await {
            Ok(true) => continue,
            Ok(false) => {}
            Err(error) => {
                if !stop.is_cancelled() && !matches!(error, store::Error::Busy) {
                    tracing::error!(%error, "comparisons could not read or write the database");
                }
                tokio::select! {
                    () = sleep(RETRY_PAUSE) => {}
                    () = stop.cancelled() => {}
                }
            }
        }
        tokio::select! {
            change = evidence.changes.recv() => match change {
                Ok(_) | Err(RecvError::Lagged(_)) => {}
                Err(RecvError::Closed) => return,
            },
            () = sleep(POLL_INTERVAL) => {}
            () = stop.cancelled() => {}
        }
    }
}

type Compared = Result<String, ComparisonFailure>;

struct Evidence {
    store: Store,
    catalogue: Arc<Catalogue>,
    population: Population,
    stop: CancellationToken,
    lane: Lane,
    changes: broadcast::Receiver<Change>,
    /// Under which version of its file, how many people had finished and withdrawn, and when one was last left out by hand,
    /// when the looks of a study were last complete.
    looked: HashMap<StudyId, (VersionId, u64, u64, i64)>,
    /// The version of its study's file and the data version at which the comparison of a plan was last found to be of the
    /// answers that there were.
    compared: HashMap<(StudyId, PlanId), (VersionId, i64)>,
}

impl Evidence {
    /// Does what is due first. Says whether anything was.
    async fn step(&mut self) -> Result<bool, store::Error> {
        let catalogue = self.catalogue.clone();
        for study in catalogue.studies() {
            let read = Snapshot::read(&self.store, &catalogue, self.population, study.id());
            let Some((snapshot, (version, current))) =
                read.await?.zip(catalogue.current(study.id()))
            else {
                continue;
            };
            // A version that came in between: the next turn reads it.
            if current.hash() != snapshot.study.hash() {
                return Ok(true);
            }
            if self.look(&snapshot, version).await? || self.compare(&snapshot, version).await? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Makes the looks of a study that are due, in their order.
    async fn look(
        &mut self,
        snapshot: &Snapshot,
        version: VersionId,
    ) -> Result<bool, store::Error> {
        let id = snapshot.study.id();
        let people = &snapshot.people;
        let analysed = people.analysed();
        let looked_at = (
            version,
            analysed,
            people.withdrawn,
            people.exclusion_version,
        );
        if self.looked.get(id) == Some(&looked_at) {
            return Ok(false);
        }
        let Some(looks) = Looks::new(&snapshot.study).filter(|looks| looks.count(analysed) > 0)
        else {
            self.looked.insert(id.clone(), looked_at);
            return Ok(false);
        };
        let sequential = snapshot.study.sequential();
        let text = RuleText::new(sequential);
        let rule = match (text, looks.rule_hash(), sequential.rule) {
            (Some(text), Some(hash), Some(rule)) => Some((json(&text)?, hash, bound(rule))),
            (None, _, _) | (_, None, _) | (_, _, None) => None,
        };
        let mut is_reached = match &rule {
            Some((_, hash, _)) => {
                let reached = self.store.stopping(id, self.population, hash).await?;
                reached.is_some()
            }
            None => false,
        };
        let stored = self.store.checkpoints(id, self.population).await?;
        let chosen = self
            .store
            .look_counts(
                id,
                self.population,
                sequential.minimum,
                sequential.check_every,
            )
            .await?;
        let wanted = looks.wanted(analysed, is_reached);
        let shown = looks.wanted(analysed, true);
        let mut new = NewCheckpoints {
            study: id.clone(),
            population: self.population,
            // Read before the counts were: whoever withdrew or was left out in between makes it too old.
            data_version: snapshot.version.data_version,
            checkpoints: Vec::new(),
            reached: None,
        };
        let inputs = {
            let (study, wanted) = (snapshot.study.clone(), wanted.clone());
            // Many hashes, with every person who finishes.
            let made = self
                .lane
                .run(move || Looks::new(&study).map(|looks| looks.inputs(&wanted, &chosen)));
            match made.await.map(|done| done.result) {
                Ok(Ok(inputs)) => inputs.unwrap_or_default(),
                Ok(Err(message)) => {
                    tracing::error!(study = %id, message, "what looks depend on could not be read");
                    return Ok(false);
                }
                Err(Ended) => return Ok(false),
            }
        };
        for (number, input) in wanted.iter().zip(inputs) {
            // Once the rule is reached the other looks only draw a line.
            if is_reached && !shown.contains(number) {
                continue;
            }
            let kept = stored
                .iter()
                .find(|row| row.n == input.n && row.input_hash == input.hash)
                .and_then(|row| serde_json::from_str::<Look>(&row.result).ok());
            let look = match kept {
                Some(look) => look,
                None => {
                    let (n, input_hash) = (input.n, input.hash.clone());
                    let stop = self.stop.clone();
                    let made = self.lane.run(move || input.look(&stop)).await;
                    let look = match made {
                        Ok(Done {
                            result: Ok(Ok(look)),
                            ..
                        }) => look,
                        Err(Ended)
                        | Ok(Done {
                            result: Ok(Err(FitError::Stopped)),
                            ..
                        }) => return Ok(false),
                        Ok(Done {
                            result: Ok(Err(error)),
                            ..
                        }) => {
                            tracing::error!(study = %id, n, %error, "a look at the first people failed");
                            return self.give_up(new).await;
                        }
                        Ok(Done {
                            result: Err(message),
                            ..
                        }) => {
                            tracing::error!(study = %id, n, message, "a look at the first people failed");
                            return self.give_up(new).await;
                        }
                    };
                    new.checkpoints.push(Checkpoint {
                        n,
                        input_hash,
                        result: json(&look)?,
                    });
                    look
                }
            };
            if let Some((text, hash, bound)) = &rule
                && !is_reached
                && bound.is_reached(&look)
            {
                is_reached = true;
                new.reached = bound.value(&look).map(|value| Reached {
                    rule_hash: hash.clone(),
                    rule: text.clone(),
                    n: look.n,
                    value,
                });
            }
            if new.checkpoints.len() >= LOOKS_AT_ONCE || new.reached.is_some() {
                self.save(&mut new).await?;
            }
        }
        if !new.checkpoints.is_empty() {
            self.save(&mut new).await?;
        }
        self.looked.insert(id.clone(), looked_at);
        Ok(true)
    }

    /// Ends at a look that failed: no later one may announce that a rule was reached first there. It is tried again with
    /// the next change.
    async fn give_up(&self, mut made: NewCheckpoints) -> Result<bool, store::Error> {
        if !made.checkpoints.is_empty() {
            self.save(&mut made).await?;
        }
        Ok(false)
    }

    async fn save(&self, new: &mut NewCheckpoints) -> Result<(), store::Error> {
        let nothing = NewCheckpoints {
            study: new.study.clone(),
            population: new.population,
            data_version: new.data_version,
            checkpoints: Vec::new(),
            reached: None,
        };
        let new = std::mem::replace(new, nothing);
        let (study, reached) = (new.study.clone(), new.reached.clone());
        let is_first = self.store.save_checkpoints(new).await?;
        if let Some(reached) = reached.filter(|_| is_first) {
            // Without the value: a study may be blind.
            tracing::info!(%study, people = reached.n, rule = reached.rule, "the study's rule for stopping is reached");
        }
        Ok(())
    }

    /// Compares the models on one plan of a study, if all its fits are final.
    async fn compare(
        &mut self,
        snapshot: &Snapshot,
        version: VersionId,
    ) -> Result<bool, store::Error> {
        if !snapshot.is_final() {
            return Ok(false);
        }
        let id = snapshot.study.id();
        let data_version = snapshot.version.data_version;
        let mut plans: Vec<_> = snapshot.study.plans().iter().collect();
        // The plan with the fewest parts tells most, and is compared soonest.
        plans.sort_by_key(|plan| plan.parts.len());
        plans.retain(|plan| {
            let place = (id.clone(), plan.id.clone());
            self.compared.get(&place) != Some(&(version, data_version))
        });
        let Some(plan) = plans.first() else {
            return Ok(false);
        };
        let place = (id.clone(), plan.id.clone());
        let counts = self.store.cell_counts(id, self.population).await?;
        let asked = AskedCells::new(&snapshot.study, &counts);
        let patterns = self
            .store
            .patterns(id, self.population, snapshot.analysis_set(), &asked.ids())
            .await?;
        let input = ComparisonInput::new(snapshot, plan, &asked, &patterns);
        let Some(input) = input.filter(|input| {
            let stored = snapshot.comparison(&plan.id);
            stored.is_none_or(|stored| stored.input_hash != input.hash)
        }) else {
            self.compared.insert(place, (version, data_version));
            return Ok(true);
        };
        let known = known_fits(&self.store, snapshot, plan).await?;
        let mut new = NewComparison {
            study: id.clone(),
            population: self.population,
            plan: plan.id.clone(),
            input_hash: input.hash.clone(),
            data_version,
            version,
            seed: input.settings.seed,
            outcome: Err(String::new()),
            cpu_ms: 0,
        };
        let cancel = self.stop.child_token();
        let work = {
            let cancel = cancel.clone();
            move || input.compare(&known, &cancel)
        };
        let done = Self::unless_changed(
            &mut self.changes,
            new.study.clone(),
            self.population,
            data_version,
            &cancel,
            self.lane.run(work),
        )
        .await;
        let Ok(done) = done else {
            return Ok(false);
        };
        new.cpu_ms = done.cpu_ms();
        new.outcome = match done.result {
            Ok(Ok(report)) => Ok(report),
            Ok(Err(ComparisonFailure::Fit(FitError::Stopped))) => {
                return Ok(!self.stop.is_cancelled());
            }
            Ok(Err(error)) => Err(error.to_string()),
            Err(panic) => Err(panic),
        };
        if let Err(message) = &new.outcome {
            tracing::error!(study = %id, plan = %plan.id, message, "a comparison failed");
        }
        self.store.save_comparison(new).await?;
        self.compared.insert(place, (version, data_version));
        Ok(true)
    }

    /// Waits for work, and gives it up as soon as the study has newer data.
    async fn unless_changed(
        changes: &mut broadcast::Receiver<Change>,
        study: StudyId,
        population: Population,
        data_version: i64,
        cancel: &CancellationToken,
        work: impl Future<Output = Result<Done<Compared>, Ended>>,
    ) -> Result<Done<Compared>, Ended> {
        tokio::pin!(work);
        loop {
            tokio::select! {
                done = &mut work => return done,
                change = changes.recv(), if !cancel.is_cancelled() => match change {
                    Ok(change) => {
                        if change.study == study
                            && change.population == population
                            && change.data_version > data_version
                        {
                            cancel.cancel();
                        }
                    }
                    // What was missed may have been of this study.
                    Err(RecvError::Lagged(_) | RecvError::Closed) => cancel.cancel(),
                },
            }
        }
    }
}

fn json(value: &impl serde::Serialize) -> Result<String, store::Error> {
    serde_json::to_string(value).map_err(|error| {
        tracing::error!(%error, "a result could not be written as JSON");
        store::Error::Unavailable("a result could not be written as JSON")
    })
}
