//! Many people at once, straight through the store: the rules of a run hold, HTTP is left out.

use std::{ops::Range, sync::Arc};

use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use riskaware::{
    jobs::{self, Catalogue},
    store::{Change, NewArrival, NewRun, Population, Store, Submission, Token, draw_run},
    study::{
        ActionId, Reply, Step, StudyId, TimeFactor,
        step::{Assessment, ClientTiming},
    },
};
use tokio::sync::broadcast::error::RecvError;
use tokio_util::sync::CancellationToken;

/// One person completes a study; `choose` is given the cell (none outside the design) and the actions on offer.
pub async fn completes(
    store: &Store,
    catalogue: &Catalogue,
    id: &StudyId,
    seed: u64,
    source: Option<&str>,
    choose: impl Fn(Option<&str>, &[ActionId]) -> ActionId,
) {
    let mut rng = ChaCha12Rng::seed_from_u64(seed);
    let (version, study) = catalogue.current(id).unwrap();
    let arrival = Token::random(&mut rng);
    let new_arrival = NewArrival {
        source: source.map(str::to_owned),
        ..NewArrival::default()
    };
    store.arrive(&arrival, id, new_arrival).await.unwrap();
    let candidates = draw_run(&study, &mut rng).unwrap();
    let plans: Vec<_> = candidates[0]
        .steps
        .iter()
        .map(|step| step.plan.clone())
        .collect();
    let run = NewRun {
        study: id.clone(),
        version,
        candidates,
        quota: None,
        time_limit_ms: None,
        refusal: None,
        factor: TimeFactor::ONE,
        language: None,
        population: Population::People,
    };
    let started = store.start(&arrival, run).await.unwrap();
    for (position, plan) in plans.iter().enumerate() {
        let (reply, consent_version) = match study.step(plan).unwrap() {
            Step::Consent(consent) => (Reply::Agreed, Some(consent.version.to_owned())),
            Step::Info(_) => (Reply::Continued, None),
            Step::Replays(_) => (Reply::Watched { viewings: vec![] }, None),
            Step::Choice(choice) => {
                let actions: Vec<ActionId> = choice
                    .actions
                    .iter()
                    .map(|action| action.id.clone())
                    .collect();
                let action = choose(choice.cell.map(|cell| cell.as_str()), &actions);
                (Reply::Chose { action }, None)
            }
            Step::Form(_) => (
                Reply::Filled {
                    values: serde_json::Map::new(),
                },
                None,
            ),
            Step::Thanks(_) => continue,
        };
        if plan.limit_ms.is_some() {
            store.visit(&started.link).await.unwrap();
        }
        let submission = Submission {
            position: u32::try_from(position).unwrap(),
            key: format!("key-{position}"),
            reply,
            timing: ClientTiming::default(),
            consent_version,
            assessment: Assessment::Passes,
        };
        store.submit(started.run, submission).await.unwrap();
    }
}

/// These people complete the driving study; those numbered below `stopping` stop in every cell, the others accelerate.
/// Outside the design everybody takes the first action.
pub async fn drives(store: &Store, catalogue: &Catalogue, people: Range<u64>, stopping: u64) {
    for person in people {
        let action = if person < stopping {
            "stop"
        } else {
            "accelerate"
        };
        completes(
            store,
            catalogue,
            &"driving".into(),
            person,
            None,
            |cell, actions| match cell {
                Some(_) => action.into(),
                None => actions[0].clone(),
            },
        )
        .await;
    }
}

/// The background work of a server, ended when dropped.
pub struct Background(CancellationToken);

impl Background {
    pub fn start(store: &Store, catalogue: &Arc<Catalogue>) -> Self {
        let stop = CancellationToken::new();
        tokio::spawn(jobs::start(store, catalogue, Population::People, &stop));
        Self(stop)
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

/// Waits for changes until `is_there` says so.
pub async fn until(store: &Store, mut is_there: impl AsyncFnMut() -> bool) {
    let mut changes = store.subscribe();
    while !is_there().await {
        match changes.recv().await {
            Ok(Change { .. }) | Err(RecvError::Lagged(_)) => {}
            Err(RecvError::Closed) => panic!("the store closed"),
        }
    }
}
