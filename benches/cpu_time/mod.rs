//! CPU time of this thread: on a shared machine the wall's clock measures the neighbours.

use rustix::time::{ClockId, Timespec, clock_gettime};

/// A stopwatch.
#[derive(Debug)]
pub struct CpuTime(Timespec);

impl CpuTime {
    /// Starts one.
    pub fn start() -> Self {
        Self(clock_gettime(ClockId::ThreadCPUTime))
    }

    /// CPU seconds of this thread since its start.
    pub fn seconds(&self) -> f64 {
        let now = clock_gettime(ClockId::ThreadCPUTime);
        (now.tv_sec - self.0.tv_sec) as f64 + (now.tv_nsec - self.0.tv_nsec) as f64 * 1e-9
    }
}
