//! How often somebody may try: logins, starts, answers, calls of the API.

use std::{
    collections::VecDeque,
    fmt,
    hash::Hash,
    net::IpAddr,
    num::NonZeroU32,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU32, Ordering},
    },
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
    store::{AccountId, ApiTokenId, Token, TokenHash},
};

/// Logins per address and per name: so many at once, then one per half minute.
const LOGINS: u32 = 10;
const LOGINS_WITHIN: Duration = Duration::from_secs(300);
/// Calls of the API per token, or per address without one.
const CALLS_PER_MINUTE: u32 = 600;
/// Refusals of strangers that are written to the log, per address: it is never shortened, and each entry is a commit.
const REFUSALS_NOTED_PER_MINUTE: u32 = 10;
/// The same per account and per token: more than anybody is refused who does not try it.
const REFUSALS_OF_KNOWN_NOTED_PER_MINUTE: u32 = 30;
/// Places of logins that are remembered, over all accounts.
const KNOWN_LOGINS: usize = 1024;
/// Arrivals per address for each start that is let: links are opened by previews too, and again and again. A campus is one address.
const ARRIVALS_PER_START: u32 = 5;
/// Answers per run: more than anybody can give.
const ANSWERS_PER_MINUTE: u32 = 120;
const MINUTE: Duration = Duration::from_secs(60);

/// After so many checks, what is full again is forgotten.
const SWEEP_EVERY: u32 = 1024;

/// Which limit a route of participants has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Limited {
    /// Arrivals per address: what a look at a study's link writes.
    Arrival,
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
    /// Who logged in from where, the newest last: nobody else can use up their tries.
    known_logins: Mutex<VecDeque<(String, IpAddr)>>,
    passwords_by_account: Limiter<AccountId>,
    arrivals: Limiter<IpAddr>,
    starts: Limiter<IpAddr>,
    answers: Limiter<TokenHash>,
    calls_by_address: Limiter<IpAddr>,
    calls_by_token: Limiter<ApiTokenId>,
    refusals: Limiter<IpAddr>,
    refusals_of_known: Limiter<String>,
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
            known_logins: Mutex::default(),
            passwords_by_account: Limiter::new(clock, LOGINS, LOGINS_WITHIN),
            arrivals: Limiter::new(
                clock,
                starts_per_minute.saturating_mul(ARRIVALS_PER_START),
                MINUTE,
            ),
            starts: Limiter::new(clock, starts_per_minute, MINUTE),
            answers: Limiter::new(clock, ANSWERS_PER_MINUTE, MINUTE),
            calls_by_address: Limiter::new(clock, CALLS_PER_MINUTE, MINUTE),
            calls_by_token: Limiter::new(clock, CALLS_PER_MINUTE, MINUTE),
            refusals: Limiter::new(clock, REFUSALS_NOTED_PER_MINUTE, MINUTE),
            refusals_of_known: Limiter::new(clock, REFUSALS_OF_KNOWN_NOTED_PER_MINUTE, MINUTE),
        }
    }

    /// Counts an attempt to log in: by its address, and by its name, where nobody of this name has logged in from this
    /// address. So whoever knows a name cannot keep its owner out of the places from which they work.
    pub(in crate::web) fn check_login(
        &self,
        name: &str,
        client: ClientAddress,
    ) -> Result<(), Error> {
        self.logins_by_address.check(&client.counted_as())?;
        let login = login(name, client);
        if self.known_logins().contains(&login) {
            return Ok(());
        }
        self.logins_by_name.check(&login.0)
    }

    /// Remembers from where somebody logged in, until the server ends.
    pub(in crate::web) fn note_login(&self, name: &str, client: ClientAddress) {
        let login = login(name, client);
        let mut known = self.known_logins();
        known.retain(|known| *known != login);
        if known.len() == KNOWN_LOGINS {
            known.pop_front();
        }
        known.push_back(login);
    }

    /// Counts that somebody who is logged in gave the password again.
    pub(in crate::web) fn check_own_password(
        &self,
        account: AccountId,
        client: ClientAddress,
    ) -> Result<(), Error> {
        self.logins_by_address.check(&client.counted_as())?;
        self.passwords_by_account.check(&account)
    }

    fn known_logins(&self) -> MutexGuard<'_, VecDeque<(String, IpAddr)>> {
        self.known_logins
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts what a participant does that writes. Whoever sits at this machine is not counted as an address: a proxy
    /// here that was not named stands for everybody.
    pub(super) fn check_participant(
        &self,
        route: &Route,
        is_get: bool,
        path: &str,
        client: ClientAddress,
    ) -> Result<(), Error> {
        match (route.limited, is_get) {
            (None, _) | (Some(Limited::Start | Limited::Answer), true) => Ok(()),
            (Some(Limited::Arrival | Limited::Start), _) if client.is_this_machine() => Ok(()),
            (Some(Limited::Arrival), _) => self.arrivals.check(&client.counted_as()),
            (Some(Limited::Start), false) => self.starts.check(&client.counted_as()),
            (Some(Limited::Answer), false) => {
                match segment(route.path, path, "{token}").map(str::parse::<Token>) {
                    Some(Ok(token)) => self.answers.check(&token.hash()),
                    // Opens nothing anyway.
                    Some(Err(_)) | None => Ok(()),
                }
            }
        }
    }

    /// Whether a refusal is written to the log: so many a minute for each who is refused.
    pub(super) fn may_be_noted(&self, caller: &Caller, client: ClientAddress) -> bool {
        match caller {
            Caller::Token(_) | Caller::Account(_) => {
                self.refusals_of_known.check(&caller.name()).is_ok()
            }
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

/// The start of a name is enough to count by, and nobody fills the memory with long ones.
fn login(name: &str, client: ClientAddress) -> (String, IpAddr) {
    (name.trim().chars().take(64).collect(), client.counted_as())
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
        let here = ClientAddress::at("192.0.2.1");
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
        let there = ClientAddress::at("192.0.2.2");
        limits.check_login("anna", there).unwrap_err();
        limits.check_login("berta", here).unwrap_err();
        limits.check_login("berta", there).unwrap();
        clock.advance(30_000);
        limits.check_login("anna", here).unwrap();
        limits.check_login("anna", here).unwrap_err();
    }

    #[test]
    fn whoever_logged_in_from_a_place_is_not_kept_out_of_it_by_others() {
        let clock = Clock::manual(Timestamp(1_767_225_600_000));
        let limits = Limits::new(&clock, 60);
        let office = ClientAddress::at("192.0.2.1");
        limits.check_login("anna", office).unwrap();
        limits.note_login("anna", office);
        for last in 2..=12 {
            // A stranger at many addresses, who knows the name alone.
            let _ = limits.check_login("anna", ClientAddress::at(&format!("198.51.100.{last}")));
        }
        let elsewhere = ClientAddress::at("203.0.113.1");
        limits.check_login("anna", elsewhere).unwrap_err();
        limits.check_login("anna", office).unwrap();
        // The place is one for this name alone, and its tries are counted as any other's.
        limits.note_login("berta", elsewhere);
        limits
            .check_login("anna", ClientAddress::at("203.0.113.2"))
            .unwrap_err();
        for _ in 0..8 {
            limits.check_login("anna", office).unwrap();
        }
        limits.check_login("anna", office).unwrap_err();
    }

    #[test]
    fn strangers_cannot_fill_the_log_with_refusals() {
        let clock = Clock::manual(Timestamp(1_767_225_600_000));
        let limits = Limits::new(&clock, 60);
        let here = ClientAddress::at("192.0.2.1");
        let noted = |caller: &Caller, client, tries: u32| {
            let noted = (0..tries).filter(|_| limits.may_be_noted(caller, client));
            noted.count()
        };
        let most = REFUSALS_NOTED_PER_MINUTE as usize;
        assert_eq!(noted(&Caller::Nobody, here, 10_000), most);
        // Nor from this machine before there are accounts; other addresses are noted as ever, accounts a little more.
        assert_eq!(noted(&Caller::Local, here, 10), 0);
        let there = ClientAddress::at("192.0.2.2");
        assert_eq!(noted(&Caller::Nobody, there, 1), 1);
        let account = Caller::Account(Account {
            id: AccountId::from(1),
            name: "anna".to_owned(),
            role: Role::Viewer,
            must_change_password: false,
            created_at: clock.now(),
            disabled_at: None,
        });
        let most_of_known = REFUSALS_OF_KNOWN_NOTED_PER_MINUTE as usize;
        assert_eq!(noted(&account, here, 10_000), most_of_known);
        clock.advance(60_000);
        assert_eq!(noted(&Caller::Nobody, here, 10_000), most);
    }
}
