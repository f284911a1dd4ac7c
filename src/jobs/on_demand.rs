//! Work on demand: one piece at a time on a thread of low priority, kept by what it depends on.
//!
//! Such work is a pure function of its input, and takes from a tenth of a second to minutes. So it is done when somebody
//! asks for it, and the latest results are kept in memory; a restart forgets them.

use std::{
    collections::{HashMap, VecDeque},
    fmt,
    ops::ControlFlow,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use crate::inference::FitError;

/// Pieces of work that may wait for their turn.
pub(super) const QUEUE: usize = 8;
/// How many of these places strangers may take.
const QUEUE_OF_STRANGERS: usize = 2;
/// Results that are kept.
const KEPT: usize = 64;

/// Something that is made of fits.
pub trait Work: Clone + Send + 'static {
    /// What comes out.
    type Output: Send + Sync;

    /// Its name, for logs and threads.
    const NAME: &'static str;

    /// The hash of all that it depends on.
    fn hash(&self) -> &str;

    /// How many fits it takes.
    fn fits(&self) -> usize;

    /// Does it. `watch` hears how many fits are done, many times a second, and stops the work by answering `Break`.
    ///
    /// # Errors
    /// When a fit fails or was stopped.
    fn run(
        &self,
        watch: &mut dyn FnMut(usize) -> ControlFlow<()>,
    ) -> Result<Self::Output, FitError>;
}

/// Who asks for work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asker {
    /// Somebody with an account or a token, or whoever sits at this machine.
    Known,
    /// Anybody, of a public study: finds no place where researchers might need it.
    Stranger,
}

/// How far a piece of work is.
#[derive(Debug)]
pub enum WorkState<O> {
    /// Others come first, or it is being done.
    Running {
        /// Fits that are done.
        done: usize,
        /// All fits.
        of: usize,
        /// Pieces of work that come before it.
        ahead: usize,
    },
    /// Done.
    Ready(Arc<O>),
    /// Broke off with a message.
    Failed(String),
}

/// The work of one kind of one server.
pub struct OnDemand<W: Work> {
    shared: Arc<Mutex<Shared<W>>>,
    /// How many pieces came to an end.
    finished: watch::Sender<u64>,
    stop: CancellationToken,
}

struct Shared<W: Work> {
    /// The one that is being done.
    current: Option<(String, Arc<AtomicUsize>, usize)>,
    queue: VecDeque<W>,
    finished: HashMap<String, Result<Arc<W::Output>, String>>,
    /// The keys of `finished`, oldest first.
    order: VecDeque<String>,
    has_worker: bool,
}

impl<W: Work> OnDemand<W> {
    /// Nothing was asked for yet; what is being done ends with `stop`.
    pub fn new(stop: CancellationToken) -> Self {
        Self {
            shared: Arc::new(Mutex::new(Shared {
                current: None,
                queue: VecDeque::new(),
                finished: HashMap::new(),
                order: VecDeque::new(),
                has_worker: false,
            })),
            finished: watch::Sender::new(0),
            stop,
        }
    }

    /// The result of this input: there, or on its way from now on.
    pub fn ask(&self, input: &W, asker: Asker) -> WorkState<W::Output> {
        let mut shared = self.lock();
        let of = input.fits();
        match shared.finished.get(input.hash()) {
            Some(Ok(result)) => return WorkState::Ready(result.clone()),
            Some(Err(message)) => return WorkState::Failed(message.clone()),
            None => {}
        }
        if let Some((hash, done, of)) = &shared.current
            && *hash == input.hash()
        {
            return WorkState::Running {
                done: done.load(Ordering::Relaxed),
                of: *of,
                ahead: 0,
            };
        }
        let running = usize::from(shared.current.is_some());
        let waiting = shared
            .queue
            .iter()
            .position(|other| other.hash() == input.hash());
        let places = match asker {
            Asker::Known => QUEUE,
            Asker::Stranger => QUEUE_OF_STRANGERS,
        };
        let place = match waiting {
            Some(place) => place,
            // Whoever asks again gets a place once there is one.
            None if shared.queue.len() >= places => QUEUE,
            None => {
                shared.queue.push_back(input.clone());
                shared.queue.len() - 1
            }
        };
        if !shared.has_worker && !self.stop.is_cancelled() {
            let worker = self.clone();
            let started = std::thread::Builder::new()
                .name(W::NAME.to_owned())
                .spawn(move || worker.work());
            match started {
                Ok(_) => shared.has_worker = true,
                Err(error) => {
                    tracing::error!(%error, work = W::NAME, "the thread for work on demand could not be started");
                }
            }
        }
        WorkState::Running {
            done: 0,
            of,
            ahead: place + running,
        }
    }

    /// The result of this input if it is there within so much time, else how far it is.
    pub async fn wait(&self, input: &W, patience: Duration) -> WorkState<W::Output> {
        // From before the first question, so that no end is missed.
        let mut finished = self.finished.subscribe();
        let there = async {
            loop {
                match self.ask(input, Asker::Known) {
                    WorkState::Running { .. } => {}
                    state @ (WorkState::Ready(_) | WorkState::Failed(_)) => return state,
                }
                // The sender lives as long as this does.
                drop(finished.changed().await);
            }
        };
        match tokio::time::timeout(patience, there).await {
            Ok(state) => state,
            Err(_) => self.ask(input, Asker::Known),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Shared<W>> {
        // Nothing can be left half done under this lock.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Works until nothing waits.
    fn work(&self) {
        // Behind answers, pages and refits.
        if let Err(error) = rustix::process::nice(19) {
            tracing::debug!(%error, work = W::NAME, "the priority of work on demand could not be lowered");
        }
        while let Some((input, done)) = self.next() {
            let mut watch = |fits| {
                done.store(fits, Ordering::Relaxed);
                if self.stop.is_cancelled() {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            };
            let result = catch_unwind(AssertUnwindSafe(|| input.run(&mut watch)));
            let result = match result {
                Ok(Ok(result)) => Ok(Arc::new(result)),
                Ok(Err(FitError::Stopped)) => return,
                Ok(Err(error)) => Err(error.to_string()),
                Err(_) => Err("the program has a fault".to_owned()),
            };
            if let Err(error) = &result {
                tracing::error!(error, work = W::NAME, "work on demand failed");
            }
            let mut shared = self.lock();
            shared.current = None;
            if shared.order.len() >= KEPT
                && let Some(oldest) = shared.order.pop_front()
            {
                shared.finished.remove(&oldest);
            }
            shared.order.push_back(input.hash().to_owned());
            shared.finished.insert(input.hash().to_owned(), result);
            drop(shared);
            self.finished.send_modify(|ends| *ends += 1);
        }
    }

    fn next(&self) -> Option<(W, Arc<AtomicUsize>)> {
        let mut shared = self.lock();
        let next = shared.queue.pop_front();
        match next {
            Some(input) => {
                let done = Arc::new(AtomicUsize::new(0));
                shared.current = Some((input.hash().to_owned(), done.clone(), input.fits()));
                Some((input, done))
            }
            None => {
                // Under the same lock under which another request would start the next worker.
                shared.has_worker = false;
                None
            }
        }
    }
}

impl<W: Work> Clone for OnDemand<W> {
    fn clone(&self) -> Self {
        Self {
            shared: self.shared.clone(),
            finished: self.finished.clone(),
            stop: self.stop.clone(),
        }
    }
}

impl<W: Work> fmt::Debug for OnDemand<W> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "OnDemand({})", W::NAME)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts to a number; more than ten is too much for it.
    #[derive(Debug, Clone)]
    struct Count(usize, String);

    impl Count {
        fn to(number: usize) -> Self {
            Self(number, format!("to {number}"))
        }
    }

    impl Work for Count {
        type Output = usize;

        const NAME: &'static str = "count";

        fn hash(&self) -> &str {
            &self.1
        }

        fn fits(&self) -> usize {
            self.0
        }

        fn run(&self, watch: &mut dyn FnMut(usize) -> ControlFlow<()>) -> Result<usize, FitError> {
            for done in 0..self.0 {
                if watch(done).is_break() {
                    return Err(FitError::Stopped);
                }
                assert!(done < 10, "too far to count");
            }
            Ok(self.0)
        }
    }

    const LONG: Duration = Duration::from_secs(60);

    #[tokio::test]
    async fn whoever_waits_is_told_when_it_is_there() {
        let counts = OnDemand::new(CancellationToken::new());
        for number in [3, 5, 3] {
            let state = counts.wait(&Count::to(number), LONG).await;
            assert!(
                matches!(&state, WorkState::Ready(found) if **found == number),
                "{state:?}"
            );
        }
    }

    #[tokio::test]
    async fn a_fault_is_a_message_and_no_end_of_the_work() {
        let counts = OnDemand::new(CancellationToken::new());
        let state = counts.wait(&Count::to(20), LONG).await;
        assert!(matches!(state, WorkState::Failed(_)), "{state:?}");
        let state = counts.wait(&Count::to(2), LONG).await;
        assert!(matches!(state, WorkState::Ready(_)), "{state:?}");
    }

    #[tokio::test]
    async fn patience_ends_where_nobody_works() {
        let stop = CancellationToken::new();
        stop.cancel();
        let counts = OnDemand::new(stop);
        let state = counts.wait(&Count::to(3), Duration::ZERO).await;
        assert!(
            matches!(state, WorkState::Running { of: 3, .. }),
            "{state:?}"
        );
    }
}
