//! The clock that everything with a deadline reads.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use crate::study::Timestamp;

/// Tells the time. Clones tell the same time.
///
/// The real clock reads the wall clock once, at its start, and from then on adds what a monotonic clock measured. So a
/// deadline does not move when the machine's clock is set while the server runs, and times stored before a restart
/// can still be compared with those after it.
#[derive(Debug, Clone)]
pub struct Clock(Source);

#[derive(Debug, Clone)]
enum Source {
    Anchored {
        started: Instant,
        started_at: Timestamp,
    },
    Manual(Arc<AtomicI64>),
}

impl Clock {
    /// A clock that runs with the machine's.
    pub fn start() -> Self {
        // Before 1970 or after the year 292 million a machine's clock is wrong anyway.
        let since_1970 = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let started_at = Timestamp(i64::try_from(since_1970.as_millis()).unwrap_or(i64::MAX));
        Self(Source::Anchored {
            started: Instant::now(),
            started_at,
        })
    }

    /// A clock that stands still until [`advance`](Self::advance) moves it and all its clones: for tests.
    pub fn manual(start: Timestamp) -> Self {
        Self(Source::Manual(Arc::new(AtomicI64::new(start.0))))
    }

    /// The time now.
    pub fn now(&self) -> Timestamp {
        match &self.0 {
            Source::Anchored {
                started,
                started_at,
            } => {
                let elapsed = i64::try_from(started.elapsed().as_millis()).unwrap_or(i64::MAX);
                Timestamp(started_at.0.saturating_add(elapsed))
            }
            Source::Manual(now) => Timestamp(now.load(Ordering::SeqCst)),
        }
    }

    /// Moves a manual clock on by `millis`. A clock that runs by itself is not moved.
    pub fn advance(&self, millis: i64) {
        match &self.0 {
            Source::Anchored { .. } => {}
            Source::Manual(now) => {
                now.fetch_add(millis, Ordering::SeqCst);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manual_clock_moves_only_when_told_and_with_its_clones() {
        let clock = Clock::manual(Timestamp(1_000));
        let clone = clock.clone();
        assert_eq!(clock.now(), Timestamp(1_000));
        clock.advance(250);
        assert_eq!(clone.now(), Timestamp(1_250));
    }

    #[test]
    fn a_running_clock_starts_at_the_wall_time_and_never_goes_back() {
        let wall = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap()
            .as_millis();
        let clock = Clock::start();
        let first = clock.now();
        assert!(u128::try_from(first.0).unwrap() >= wall);
        assert!((0..1_000).all(|_| clock.now() >= first));
        clock.advance(-1_000_000);
        assert!(clock.now() >= first);
    }
}
