//! Randomness, handed down from the binary: the operating system's there, a fixed seed in tests.

use std::sync::{Arc, Mutex, PoisonError};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha20Rng;

/// A source of random numbers that handlers share.
#[derive(Clone, Debug)]
pub struct Chance(Arc<Mutex<ChaCha20Rng>>);

impl Chance {
    /// Seeded by the operating system; the only such place in the program.
    ///
    /// # Panics
    /// When the operating system has no randomness to give: no token could be trusted then.
    pub fn from_system() -> Self {
        Self::new(ChaCha20Rng::from_rng(&mut rand::rng()))
    }

    /// The same sequence for the same seed.
    pub fn from_seed(seed: u64) -> Self {
        Self::new(ChaCha20Rng::seed_from_u64(seed))
    }

    fn new(rng: ChaCha20Rng) -> Self {
        Self(Arc::new(Mutex::new(rng)))
    }

    /// 32 random bytes, for a token.
    pub fn bytes(&self) -> [u8; 32] {
        self.with(|rng| rng.random())
    }

    /// A generator of its own for one task, so that no lock is held while it is used.
    pub fn fork(&self) -> ChaCha20Rng {
        self.with(ChaCha20Rng::from_rng)
    }

    fn with<T>(&self, draw: impl FnOnce(&mut ChaCha20Rng) -> T) -> T {
        draw(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_repeats_and_forks_differ() {
        let (one, two) = (Chance::from_seed(1), Chance::from_seed(1));
        assert_eq!(one.bytes(), two.bytes());
        let (mut a, mut b) = (one.fork(), one.fork());
        assert_ne!(a.random::<u64>(), b.random::<u64>());
    }
}
