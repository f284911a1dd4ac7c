//! A database of its own for one test, with two studies and people who take them.

use std::path::PathBuf;

use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use riskaware::clock::Clock;
use riskaware::store::{
    AnswerStatus, AskedProblem, CandidateRun, CellCount, DrawnStep, Error, NewArrival, NewRun,
    Options, Population, RunId, Started, Store, StudyState, Submission, Submitted, Token, Verdict,
    VersionId,
};
use riskaware::study::step::{Assessment, ClientTiming};
use riskaware::study::{
    ActionId, BlockId, QuestionId, Reply, StepData, StepKind, StepPlan, StudyId, TimeFactor,
    Timestamp,
};
use tempfile::TempDir;

pub const LIMIT_MS: i64 = 8_000;
pub const GRACE_MS: i64 = 1_500;

/// The steps of every run here: consent, start page, two timed choices, an untimed one, practice, a form, thanks.
pub const CONSENT: u32 = 0;
pub const START_PAGE: u32 = 1;
pub const TIMED_LOW: u32 = 2;
pub const TIMED_HIGH: u32 = 3;
pub const UNTIMED_LOW: u32 = 4;
pub const PRACTICE: u32 = 5;
pub const FORM: u32 = 6;
pub const THANKS: u32 = 7;

pub struct Lab {
    pub store: Store,
    pub clock: Clock,
    pub rng: ChaCha12Rng,
    pub driving: VersionId,
    pub cups: VersionId,
    folder: TempDir,
}

/// Somebody with the link of a run.
#[derive(Debug, Clone)]
pub struct Person {
    pub link: Token,
    pub run: RunId,
    keys: u32,
}

impl Lab {
    pub async fn open() -> Self {
        let folder = TempDir::new().unwrap();
        let clock = Clock::manual(Timestamp(1_700_000_000_000));
        let store = Store::open(Options::at(folder.path().join("test.db")), clock.clone())
            .await
            .unwrap();
        let driving = store
            .publish(
                &StudyId::from("driving"),
                "hash of driving",
                "id = 'driving'",
                StudyState::Open,
            )
            .await
            .unwrap();
        let cups = store
            .publish(
                &StudyId::from("cups"),
                "hash of cups",
                "id = 'cups'",
                StudyState::Open,
            )
            .await
            .unwrap();
        Self {
            store,
            clock,
            rng: ChaCha12Rng::seed_from_u64(7),
            driving,
            cups,
            folder,
        }
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().join("test.db")
    }

    /// Stops the server and starts it again on the same file.
    pub async fn restart(&mut self) {
        self.store.close().await;
        let closed = std::mem::replace(&mut self.store, Self::elsewhere().await);
        drop(closed);
        self.store = Store::open(Options::at(self.path()), self.clock.clone())
            .await
            .unwrap();
    }

    /// A store for the moment between two others, since only one may hold the file.
    async fn elsewhere() -> Store {
        let folder = TempDir::new().unwrap();
        Store::open(
            Options::at(folder.path().join("elsewhere.db")),
            Clock::start(),
        )
        .await
        .unwrap()
    }

    pub fn version(&self, study: &str) -> VersionId {
        if study == "driving" {
            self.driving
        } else {
            self.cups
        }
    }

    pub fn new_run(&self, study: &str) -> NewRun {
        NewRun {
            study: StudyId::from(study),
            version: self.version(study),
            candidates: vec![CandidateRun {
                condition: None,
                steps: steps(),
            }],
            quota: None,
            time_limit_ms: None,
            refusal: None,
            factor: TimeFactor::ONE,
            language: None,
            population: Population::People,
        }
    }

    pub async fn arrival(&mut self, study: &str, arrival: NewArrival) -> Token {
        let token = Token::random(&mut self.rng);
        self.store
            .arrive(&token, &StudyId::from(study), arrival)
            .await
            .unwrap();
        token
    }

    pub async fn start(&mut self, study: &str) -> Person {
        let run = self.new_run(study);
        self.start_as(study, run).await
    }

    pub async fn start_as(&mut self, study: &str, run: NewRun) -> Person {
        self.start_from(study, NewArrival::default(), run).await
    }

    /// Somebody who looks at a study and is never counted.
    pub async fn start_preview(&mut self, study: &str) -> Person {
        let run = self.new_run(study);
        self.start_from(study, preview(), run).await
    }

    pub async fn start_from(&mut self, study: &str, from: NewArrival, run: NewRun) -> Person {
        let arrival = self.arrival(study, from).await;
        let started = self.store.start(&arrival, run).await.unwrap();
        assert!(started.is_owner && !started.is_resumed);
        Person::of(&started)
    }

    /// A person at the first timed question, whose clock has just started.
    pub async fn start_and_reach_timed(&mut self, study: &str) -> Person {
        let mut person = self.start(study).await;
        person.says(self, CONSENT, Reply::Agreed).await.unwrap();
        person
            .says(self, START_PAGE, Reply::Continued)
            .await
            .unwrap();
        person
    }

    /// How often an action was chosen in a cell: all, and in completed runs.
    pub async fn chosen(&self, study: &str, cell: &str, action: &str) -> (u64, u64) {
        self.count(study, |count| {
            count.cell == cell
                && count.status == AnswerStatus::Answered
                && count
                    .action
                    .as_ref()
                    .is_some_and(|chosen| *chosen == action)
        })
        .await
    }

    pub async fn with_status(&self, study: &str, status: AnswerStatus) -> (u64, u64) {
        self.count(study, |count| count.status == status).await
    }

    async fn count(&self, study: &str, wanted: impl Fn(&CellCount) -> bool) -> (u64, u64) {
        let counts = self
            .store
            .cell_counts(&StudyId::from(study), Population::People)
            .await
            .unwrap();
        counts
            .iter()
            .filter(|count| wanted(count))
            .fold((0, 0), |(all, completed), count| {
                (all + count.n_all, completed + count.n_completed)
            })
    }

    /// What must hold whatever happened.
    pub async fn check(&self) {
        assert_eq!(self.store.check_answers().await.unwrap(), []);
        assert_eq!(self.store.check_counters().await.unwrap(), []);
    }
}

impl Person {
    pub fn of(started: &Started) -> Self {
        Self {
            link: started.link.clone(),
            run: started.run,
            keys: 0,
        }
    }

    /// Sends a new form.
    pub async fn says(
        &mut self,
        lab: &Lab,
        position: u32,
        reply: Reply,
    ) -> Result<Submitted, Error> {
        self.keys += 1;
        let key = format!("form {}", self.keys);
        lab.store
            .submit(self.run, form(position, &key, reply))
            .await
    }

    pub async fn chooses(&mut self, lab: &Lab, position: u32, action: &str) -> Verdict {
        self.says(lab, position, choice(action))
            .await
            .unwrap()
            .verdict
    }

    /// Everything from the first timed question to the end.
    pub async fn finishes(&mut self, lab: &Lab, action: &str) {
        for position in [TIMED_LOW, TIMED_HIGH, UNTIMED_LOW, PRACTICE] {
            assert_eq!(self.chooses(lab, position, action).await, Verdict::Answered);
        }
        let mut values = serde_json::Map::new();
        values.insert("age".to_owned(), 33.into());
        values.insert("gender".to_owned(), "woman".into());
        self.says(lab, FORM, Reply::Filled { values })
            .await
            .unwrap();
    }
}

pub fn form(position: u32, key: &str, reply: Reply) -> Submission {
    let consent_version = matches!(reply, Reply::Agreed | Reply::Declined).then(|| "1".to_owned());
    Submission {
        position,
        key: key.to_owned(),
        reply,
        timing: ClientTiming::default(),
        consent_version,
        assessment: Assessment::Passes,
    }
}

pub fn choice(action: &str) -> Reply {
    Reply::Chose {
        action: ActionId::from(action),
    }
}

pub fn steps() -> Vec<DrawnStep> {
    vec![
        plain(StepKind::Consent, "consent"),
        plain(StepKind::Info, "timed"),
        question("timed", "low", Some(8_000), Some("explicit/timed/low")),
        question("timed", "high", Some(8_000), Some("explicit/timed/high")),
        question("untimed", "low", None, Some("explicit/untimed/low")),
        question("practice", "practice", None, None),
        plain(StepKind::Form, "about"),
        plain(StepKind::Thanks, "thanks"),
    ]
}

fn plain(kind: StepKind, block: &str) -> DrawnStep {
    let block = BlockId::from(block);
    let plan = StepPlan {
        kind,
        block,
        question: None,
        limit_ms: None,
        data: StepData::default(),
    };
    DrawnStep {
        plan,
        asked: None,
        is_fitted: false,
        is_practice: false,
    }
}

fn question(block: &str, question: &str, limit_ms: Option<u64>, cell: Option<&str>) -> DrawnStep {
    DrawnStep {
        plan: StepPlan {
            kind: StepKind::Choice,
            block: BlockId::from(block),
            question: Some(QuestionId::from(question)),
            limit_ms,
            data: StepData::default(),
        },
        asked: cell.map(|cell| AskedProblem::new(cell.to_owned(), None)),
        is_fitted: false,
        is_practice: cell.is_none(),
    }
}

/// How somebody comes who only looks.
pub fn preview() -> NewArrival {
    NewArrival {
        is_preview: true,
        ..NewArrival::default()
    }
}
