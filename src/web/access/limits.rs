//! How often somebody may try: logins, starts, answers, calls of the API.

use std::{
    fmt,
    hash::Hash,
    net::IpAddr,
    num::NonZeroU32,
    sync::atomic::{AtomicU32, Ordering},
    time::Duration,
};

use governor::{
    Quota, RateLimiter,
    clock::{self, Clock as _},
    middleware::NoOpMiddleware,
    state::keyed::DashMapStateStore,
};

use super::{Caller, ClientAddress, Error, Route, routes::segment};
use crate::{
    clock::Clock,
    store::{ApiTokenId, Token, TokenHash},
};

/// Logins per address and per name: so many at once, then one per half minute.
const LOGINS: u32 = 10;
const LOGINS_WITHIN: Duration = Duration::from_secs(300);
/// Calls of the API per token, or per address without one.
const CALLS_PER_MINUTE: u32 = 600;
/// Refusals of strangers that are written to the log, per address: it is never shortened, and each entry is a commit.
const REFUSALS_NOTED_PER_MINUTE: u32 = 10;
/// Answers per run: more than anybody can give.
const ANSWERS_PER_MINUTE: u32 = 120;
const MINUTE: Duration = Duration::from_secs(60);

/// After so many checks, what is full again is forgotten.
const SWEEP_EVERY: u32 = 1024;

/// Which limit a route of participants has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Limited {
    /// Starts per address.
    Start,
    /// Answers per run.
    Answer,
}

/// The server's clock, as the limiters read it.
#[derive(Debug, Clone)]
struct Handed(Clock);

impl clock::Clock for Handed {
    type Instant = Duration;

    fn now(&self) -> Duration {
        Duration::from_millis(u64::try_from(self.0.now().0).unwrap_or_default())
    }
}

struct Limiter<K: Hash + Eq + Clone> {
    limiter: RateLimiter<K, DashMapStateStore<K>, Handed, NoOpMiddleware<Duration>>,
    clock: Handed,
    checks: AtomicU32,
}

impl<K: Hash + Eq + Clone> Limiter<K> {
    fn new(clock: &Clock, times: u32, within: Duration) -> Self {
        let times = NonZeroU32::new(times).unwrap_or(NonZeroU32::MIN);
        let quota = Quota::with_period(within / times.get())
            .expect("no limit is so loose that its period is nothing")
            .allow_burst(times);
        let clock = Handed(clock.clone());
        Self {
            limiter: RateLimiter::dashmap_with_clock(quota, clock.clone()),
            clock,
            checks: AtomicU32::new(0),
        }
    }

    /// Counts one more, or says after how many seconds the next one is let.
    fn check(&self, key: &K) -> Result<(), Error> {
        if self.checks.fetch_add(1, Ordering::Relaxed) % SWEEP_EVERY == SWEEP_EVERY - 1 {
            self.limiter.retain_recent();
        }
        self.limiter.check_key(key).map_err(|until| {
            let wait = until.wait_time_from(self.clock.now());
            Error::TooMany {
                retry_after_s: wait.as_secs() + 1,
            }
        })
    }
}

/// All limits of a server.
pub struct Limits {
    logins_by_address: Limiter<IpAddr>,
    logins_by_name: Limiter<String>,
    starts: Limiter<IpAddr>,
    answers: Limiter<TokenHash>,
    calls_by_address: Limiter<IpAddr>,
    calls_by_token: Limiter<ApiTokenId>,
    refusals: Limiter<IpAddr>,
}

impl fmt::Debug for Limits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Limits(..)")
    }
}

impl Limits {
    /// Limits that measure with this clock.
    pub fn new(clock: &Clock, starts_per_minute: u32) -> Self {
        Self {
            logins_by_address: Limiter::new(clock, LOGINS, LOGINS_WITHIN),
            logins_by_name: Limiter::new(clock, LOGINS, LOGINS_WITHIN),
            starts: Limiter::new(clock, starts_per_minute, MINUTE),
            answers: Limiter::new(clock, ANSWERS_PER_MINUTE, MINUTE),
            calls_by_address: Limiter::new(clock, CALLS_PER_MINUTE, MINUTE),
            calls_by_token: Limiter::new(clock, CALLS_PER_MINUTE, MINUTE),
            refusals: Limiter::new(clock, REFUSALS_NOTED_PER_MINUTE, MINUTE),
        }
    }

    /// Counts an attempt to log in, or to give the password again.
    pub(in crate::web) fn check_login(
        &self,
        name: &str,
        client: ClientAddress,
    ) -> Result<(), Error> {
        self.logins_by_address.check(&client.counted_as())?;
        // The start of a name is enough to count by, and nobody fills the memory with long ones.
        let name = name.trim().chars().take(64).collect();
        self.logins_by_name.check(&name)
    }

    /// Counts a form of a participant. Whoever sits at this machine is not counted as an address: a proxy here that
    /// was not named stands for everybody.
    pub(super) fn check_post(
        &self,
        route: &Route,
        path: &str,
        client: ClientAddress,
    ) -> Result<(), Error> {
        match route.limited {
            None => Ok(()),
            Some(Limited::Start) if client.is_this_machine() => Ok(()),
            Some(Limited::Start) => self.starts.check(&client.counted_as()),
            Some(Limited::Answer) => {
                match segment(route.path, path, "{token}").map(str::parse::<Token>) {
                    Some(Ok(token)) => self.answers.check(&token.hash()),
                    // Opens nothing anyway.
                    Some(Err(_)) | None => Ok(()),
                }
            }
        }
    }

    /// Whether a refusal is written to the log: those of accounts and tokens always, those of strangers so many a minute.
    pub(super) fn may_be_noted(&self, caller: &Caller, client: ClientAddress) -> bool {
        match caller {
            Caller::Token(_) | Caller::Account(_) => true,
            Caller::Nobody | Caller::Local => self.refusals.check(&client.counted_as()).is_ok(),
        }
    }

    /// Counts a call of the API.
    pub(super) fn check_caller(&self, caller: &Caller, client: ClientAddress) -> Result<(), Error> {
        match caller {
            Caller::Token(token) => self.calls_by_token.check(&token.id),
            Caller::Nobody | Caller::Local | Caller::Account(_) => {
                self.calls_by_address.check(&client.counted_as())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        store::{Account, AccountId, Role},
        study::Timestamp,
    };

    #[test]
    fn after_ten_logins_one_is_let_every_half_minute() {
        let clock = Clock::manual(Timestamp(1_767_225_600_000));
        let limits = Limits::new(&clock, 60);
        let here = ClientAddress("192.0.2.1".parse().unwrap());
        for _ in 0..10 {
            limits.check_login("anna", here).unwrap();
        }
        let refused = limits.check_login("anna", here).unwrap_err();
        assert!(
            matches!(
                refused,
                Error::TooMany {
                    retry_after_s: 1..=31
                }
            ),
            "{refused:?}"
        );
        // Another address does not help with the same name, nor another name at the same address.
        let there = ClientAddress("192.0.2.2".parse().unwrap());
        limits.check_login("anna", there).unwrap_err();
        limits.check_login("berta", here).unwrap_err();
        limits.check_login("berta", there).unwrap();
        clock.advance(30_000);
        limits.check_login("anna", here).unwrap();
        limits.check_login("anna", here).unwrap_err();
    }

    #[test]
    fn strangers_cannot_fill_the_log_with_refusals() {
        let clock = Clock::manual(Timestamp(1_767_225_600_000));
        let limits = Limits::new(&clock, 60);
        let here = ClientAddress("192.0.2.1".parse().unwrap());
        let noted = |caller: &Caller, client, tries: u32| {
            let noted = (0..tries).filter(|_| limits.may_be_noted(caller, client));
            noted.count()
        };
        let most = REFUSALS_NOTED_PER_MINUTE as usize;
        assert_eq!(noted(&Caller::Nobody, here, 10_000), most);
        // Nor from this machine before there are accounts; other addresses and accounts are noted as ever.
        assert_eq!(noted(&Caller::Local, here, 10), 0);
        let there = ClientAddress("192.0.2.2".parse().unwrap());
        assert_eq!(noted(&Caller::Nobody, there, 1), 1);
        let account = Caller::Account(Account {
            id: AccountId::from(1),
            name: "anna".to_owned(),
            role: Role::Viewer,
            must_change_password: false,
            created_at: clock.now(),
            disabled_at: None,
        });
        assert_eq!(noted(&account, here, 10_000), 10_000);
        clock.advance(60_000);
        assert_eq!(noted(&Caller::Nobody, here, 10_000), most);
    }
}
