//! Who may use the server: accounts, sessions, API tokens, and the log of who did what.
//!
//! * `password`, `name`: what is allowed, and how passwords are hashed,
//! * `people`: accounts and the one-time link with which the first one is made,
//! * `sessions`, `tokens`: what a browser and a program show instead of a password,
//! * `audit`: the log,
//! * `change`: all of these as jobs of the writer.
//!
//! Secrets are never stored: of passwords there are Argon2id hashes, of everything else SHA-256 hashes of random tokens.

mod audit;
mod change;
mod name;
mod password;
mod people;
mod sessions;
mod tokens;

pub(super) use audit::append;
pub use audit::{AuditEntry, AuditRow};
pub(super) use change::AccountChange;
pub(super) use change::write;
pub use name::{AccountName, AccountNameError};
pub use password::{Password, PasswordError, PasswordHash};
pub use people::{Account, NewAccount, Verified};
pub use sessions::{SESSION_IDLE_MS, SESSION_LIFE_MS, Session};
pub use tokens::{ApiToken, NewApiToken, TokenState};

/// How often a use is written down at most, so that reading does not write each time.
const USE_NOTED_MS: i64 = 60_000;
