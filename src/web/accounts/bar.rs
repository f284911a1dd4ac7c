//! The line on top of researchers' pages: who is logged in, and where to from here.

use super::super::{
    Error,
    access::{Caller, Need},
};
use crate::{store::Store, study::StudyId};

/// What the line shows.
#[derive(Debug, Clone)]
pub(in crate::web) struct Bar {
    pub(in crate::web) who: Who,
    /// The study whose publicity may be changed here.
    pub(in crate::web) sharing: Option<Sharing>,
}

/// Who reads the page.
#[derive(Debug, Clone)]
pub(in crate::web) enum Who {
    /// No account exists: nothing to log in to.
    NoAccounts,
    /// Nobody is logged in.
    Visitor,
    /// Somebody is.
    SignedIn {
        /// The account's name.
        name: String,
        /// Whether it may change accounts and read the log.
        is_admin: bool,
    },
}

/// Whether a study's aggregates are shown to everybody, and where to change it.
#[derive(Debug, Clone)]
pub(in crate::web) struct Sharing {
    pub(in crate::web) study: String,
    pub(in crate::web) is_public: bool,
}

impl Bar {
    /// The line of a page that belongs to no study.
    pub(in crate::web) async fn of(store: &Store, caller: &Caller) -> Result<Self, Error> {
        let who = match caller {
            Caller::Account(account) => Who::SignedIn {
                name: account.name.clone(),
                is_admin: caller.may(Need::Admin),
            },
            Caller::Local => Who::NoAccounts,
            Caller::Nobody | Caller::Token(_) if store.has_accounts().await? => Who::Visitor,
            Caller::Nobody | Caller::Token(_) => Who::NoAccounts,
        };
        Ok(Self { who, sharing: None })
    }

    /// The line of a study's results.
    pub(in crate::web) async fn of_study(
        store: &Store,
        caller: &Caller,
        study: &StudyId,
    ) -> Result<Self, Error> {
        let bar = Self::of(store, caller).await?;
        let sharing = match caller {
            Caller::Account(_) if caller.may(Need::Manage) => Some(Sharing {
                study: study.to_string(),
                is_public: store.is_public(study).await?,
            }),
            Caller::Account(_) | Caller::Local | Caller::Nobody | Caller::Token(_) => None,
        };
        Ok(Self { sharing, ..bar })
    }
}
