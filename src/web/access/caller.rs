//! Who is calling.

use super::Need;
use crate::store::{Account, ApiToken, Role, Scope};

/// Who is calling, as an extension of the request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Caller {
    /// Somebody without account and token.
    Nobody,
    /// Whoever sits at this machine, or everybody with `--open-results`, while no account exists.
    Local,
    /// Somebody who is logged in.
    Account(Account),
    /// A program with a token.
    Token(ApiToken),
}

impl Caller {
    /// Under which name the log speaks of it.
    pub fn name(&self) -> String {
        match self {
            Self::Nobody | Self::Local => "nobody".to_owned(),
            Self::Account(account) => account.name.clone(),
            Self::Token(token) => match &token.owner {
                Some((_, owner, _)) => format!("{owner}, token {} ({})", token.id, token.name),
                None => format!("token {} ({})", token.id, token.name),
            },
        }
    }

    /// Whether it may do this. A token may do what its scopes say, as far as its owner may.
    pub fn may(&self, need: Need) -> bool {
        match self {
            Self::Nobody => false,
            Self::Local => need != Need::Admin,
            Self::Account(account) => role_may(account.role, need),
            Self::Token(token) => {
                let has_scope = scope(need).is_some_and(|scope| token.scopes.contains(&scope));
                let is_owner_let = token
                    .owner
                    .as_ref()
                    .is_none_or(|(_, _, role)| role_may(*role, need));
                has_scope && is_owner_let
            }
        }
    }

    pub(super) fn must_change_password(&self) -> bool {
        match self {
            Self::Account(account) => account.must_change_password,
            Self::Nobody | Self::Local | Self::Token(_) => false,
        }
    }
}

/// What a token needs for this. Accounts are nothing for tokens.
pub(super) fn scope(need: Need) -> Option<Scope> {
    match need {
        Need::Results => Some(Scope::Results),
        Need::Data => Some(Scope::Data),
        Need::Manage => Some(Scope::Manage),
        Need::Admin => None,
    }
}

fn role_may(role: Role, need: Need) -> bool {
    match (role, need) {
        (Role::Admin, _) | (_, Need::Results) => true,
        (Role::Researcher, Need::Data | Need::Manage) => true,
        (Role::Researcher, Need::Admin) => false,
        (Role::Viewer, Need::Data | Need::Manage | Need::Admin) => false,
    }
}
