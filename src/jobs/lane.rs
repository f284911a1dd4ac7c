//! A thread for work that takes long, so that no request waits for it.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
};

use tokio::sync::{mpsc, oneshot};

/// A thread with low priority. It does one thing after the other and ends when it is dropped.
pub(super) struct Lane {
    work: mpsc::UnboundedSender<Box<dyn FnOnce() + Send>>,
}

/// What came out of some work.
#[derive(Debug)]
pub(super) struct Done<T> {
    /// The result, or the message of a panic.
    pub(super) result: Result<T, String>,
    /// Processor time in microseconds.
    pub(super) cpu_us: u64,
}

impl<T> Done<T> {
    /// Processor time in milliseconds, rounded up: nothing is for free.
    pub(super) fn cpu_ms(&self) -> u64 {
        self.cpu_us.div_ceil(1000)
    }
}

impl Lane {
    pub(super) fn start(name: &str) -> std::io::Result<Self> {
        let (work, mut queue) = mpsc::unbounded_channel::<Box<dyn FnOnce() + Send>>();
        std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || {
                step_back();
                while let Some(work) = queue.blocking_recv() {
                    work();
                }
            })?;
        Ok(Self { work })
    }

    /// Does something after all that was asked for before. A fault in it takes nothing else along. `Err` when the lane
    /// has ended.
    pub(super) async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<Done<T>, Ended> {
        let (done, result) = oneshot::channel();
        let boxed = Box::new(move || {
            let started = processor_us();
            let result = catch_unwind(AssertUnwindSafe(work));
            let done_work = Done {
                result: result.map_err(|panic| panic_message(panic.as_ref())),
                cpu_us: processor_us().saturating_sub(started),
            };
            // Nobody waits any more when the server ends.
            drop(done.send(done_work));
        });
        self.work.send(boxed).map_err(|_| Ended)?;
        result.await.map_err(|_| Ended)
    }
}

/// The server is ending.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ended;

/// Lets answers go first: on Linux a thread has a priority of its own.
fn step_back() {
    if let Err(error) = rustix::process::nice(10) {
        tracing::debug!(%error, "the priority of background work could not be lowered");
    }
}

/// The processor time of this thread so far.
fn processor_us() -> u64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    let micros = time.tv_sec * 1_000_000 + time.tv_nsec / 1000;
    u64::try_from(micros).unwrap_or(0)
}

/// What is told of a panic: its text is for the log, pages show what is returned.
fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    tracing::error!(text, "the program has a fault");
    "the program has a fault, which its log tells".to_owned()
}
