//! Passwords: how long they are, and how they are hashed.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use argon2::password_hash::{PasswordHasher, PasswordVerifier};
use argon2::{Algorithm, Argon2, Params, Version};
use tokio::sync::Semaphore;
use tokio::time::timeout;

use super::super::Error;

/// Argon2id's cost: 19 MiB of memory, two passes, one lane (OWASP's password storage cheat sheet).
const MEMORY_KIB: u32 = 19_456;
const PASSES: u32 = 2;
const LANES: u32 = 1;

/// Hashes that are computed at once: each takes 19 MiB and a core, and answers of participants go first.
static AT_WORK: Semaphore = Semaphore::const_new(2);

/// How long a password waits for its turn. Longer queues are not worth their memory: whoever waits tries again.
const TURN: Duration = Duration::from_secs(5);

/// What a password is compared with where no account has the name, so that both cases take equally long. It is the hash
/// of no password: its 32 bytes are 0 to 31.
const DECOY: &str = "$argon2id$v=19$m=19456,t=2,p=1$bm9ib2R5IGxvZ3MgaW4gIA$AAECAwQFBgcICQoLDA0ODxAREhMUFRYXGBkaGxwdHh8";

/// A password of allowed length: 12 to 128 characters, whatever they are.
#[derive(Clone, PartialEq, Eq)]
pub struct Password(String);

/// A password that is too short or too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a password has 12 to 128 characters; this one has {0}")]
pub struct PasswordError(usize);

/// An Argon2id hash in PHC form: all that is stored of a password.
#[derive(Clone, PartialEq, Eq)]
pub struct PasswordHash(String);

impl FromStr for Password {
    type Err = PasswordError;

    fn from_str(text: &str) -> Result<Self, PasswordError> {
        let length = text.chars().count();
        if (12..=128).contains(&length) {
            Ok(Self(text.to_owned()))
        } else {
            Err(PasswordError(length))
        }
    }
}

impl fmt::Debug for Password {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Password(..)")
    }
}

impl fmt::Debug for PasswordHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("PasswordHash(..)")
    }
}

impl PasswordHash {
    /// Hashes a password with a random salt, away from the threads that answer requests.
    ///
    /// # Errors
    /// `Unavailable` where the memory for it cannot be had, `Busy` where too many wait for theirs.
    pub async fn of(password: Password, salt: [u8; 16]) -> Result<Self, Error> {
        at_work(&AT_WORK, TURN, move || {
            hasher()
                .hash_password_with_salt(password.0.as_bytes(), &salt)
                .map(|hash| Self(hash.to_string()))
                .map_err(|_| Error::Unavailable("a password could not be hashed"))
        })
        .await?
    }

    /// One that the database holds.
    pub(super) fn stored(text: String) -> Self {
        Self(text)
    }

    pub(super) fn as_str(&self) -> &str {
        &self.0
    }
}

/// Whether `password` is the one that was hashed. Without a stored hash it is compared with a decoy and never right.
pub(super) async fn is_right(password: String, stored: Option<String>) -> Result<bool, Error> {
    at_work(&AT_WORK, TURN, move || {
        let is_known = stored.is_some();
        let hash = stored.as_deref().unwrap_or(DECOY);
        let is_equal =
            PasswordVerifier::<str>::verify_password(&hasher(), password.as_bytes(), hash).is_ok();
        is_known && is_equal
    })
    .await
}

fn hasher() -> Argon2<'static> {
    let params =
        Params::new(MEMORY_KIB, PASSES, LANES, None).expect("the cost is within Argon2's bounds");
    Argon2::new(Algorithm::Argon2id, Version::V0x13, params)
}

async fn at_work<T: Send + 'static>(
    places: &'static Semaphore,
    wait: Duration,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Error> {
    let place = timeout(wait, places.acquire())
        .await
        .map_err(|_| Error::Busy)?
        .map_err(|_| Error::Unavailable("the server is shutting down"))?;
    // The place goes with the work: whoever hangs up meanwhile does not end it, and its memory and core stay taken.
    let done = tokio::task::spawn_blocking(move || {
        let _place = place;
        work()
    });
    done.await
        .map_err(|_| Error::Unavailable("the server is shutting down"))
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[tokio::test]
    async fn a_place_stays_taken_until_the_work_is_done_though_nobody_waits_for_it() {
        static PLACES: Semaphore = Semaphore::const_new(1);
        let (begun, has_begun) = tokio::sync::oneshot::channel();
        let (finish, may_finish) = mpsc::channel::<()>();
        let (finished, has_finished) = mpsc::channel();
        let asked = tokio::spawn(at_work(&PLACES, TURN, move || {
            begun.send(()).unwrap();
            let told = may_finish.recv();
            finished.send(told).unwrap();
        }));
        has_begun.await.unwrap();
        asked.abort();
        assert!(asked.await.unwrap_err().is_cancelled());
        assert_eq!(PLACES.available_permits(), 0);
        // The next one is told to come back instead of waiting for ever.
        let next = at_work(&PLACES, Duration::ZERO, || ()).await;
        assert!(matches!(next, Err(Error::Busy)), "{next:?}");
        finish.send(()).unwrap();
        tokio::task::spawn_blocking(move || has_finished.recv().unwrap().unwrap())
            .await
            .unwrap();
        at_work(&PLACES, TURN, || ()).await.unwrap();
    }

    #[test]
    fn only_the_length_of_a_password_is_judged() {
        for password in ["aaaaaaaaaaaa", "        12345678", &"ä".repeat(128)] {
            assert!(password.parse::<Password>().is_ok(), "{password}");
        }
        assert_eq!("short".parse::<Password>(), Err(PasswordError(5)));
        assert_eq!("ä".repeat(129).parse::<Password>(), Err(PasswordError(129)));
    }

    #[tokio::test]
    async fn a_hash_is_of_its_password_and_salt_at_the_stated_cost() {
        let password: Password = "correct horse battery".parse().unwrap();
        let hash = PasswordHash::of(password.clone(), [1; 16]).await.unwrap();
        assert!(
            hash.0.starts_with("$argon2id$v=19$m=19456,t=2,p=1$"),
            "{}",
            hash.0
        );
        assert_ne!(hash, PasswordHash::of(password, [2; 16]).await.unwrap());
        let stored = Some(hash.0);
        assert!(
            is_right("correct horse battery".to_owned(), stored.clone())
                .await
                .unwrap()
        );
        assert!(
            !is_right("correct horse batterz".to_owned(), stored)
                .await
                .unwrap()
        );
    }

    #[tokio::test]
    async fn the_decoy_costs_what_a_hash_costs_and_is_never_right() {
        let own = PasswordHash::of("correct horse battery".parse().unwrap(), [1; 16])
            .await
            .unwrap();
        let cost = |hash: &str| {
            let hash = argon2::password_hash::phc::PasswordHash::new(hash).unwrap();
            (
                hash.algorithm,
                hash.version,
                hash.params,
                hash.hash.unwrap().len(),
                hash.salt.unwrap().len(),
            )
        };
        assert_eq!(cost(DECOY), cost(&own.0));
        assert!(
            !is_right("correct horse battery".to_owned(), None)
                .await
                .unwrap()
        );
    }
}
