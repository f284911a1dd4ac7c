//! What somebody who reads results is shown: the study as it is, or what of it is released to everybody.

use std::{convert::Infallible, sync::Arc};

use axum::{extract::FromRequestParts, http::request::Parts};

use super::Error;
use crate::{
    jobs::{Asker, Catalogue, Snapshot},
    store::Store,
    study::StudyId,
    web::{Settings, results},
};

/// What the guard lets a stranger see of a public study: an extension of the request.
#[derive(Clone)]
pub(super) struct ReleasedTo(pub(super) Arc<Snapshot>);

/// Who reads results. Each route that strangers may use reads through this.
pub(in crate::web) struct Reader {
    released: Option<Arc<Snapshot>>,
}

impl<S: Sync> FromRequestParts<S> for Reader {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let released = parts.extensions.get::<ReleasedTo>();
        Ok(Self {
            released: released.map(|released| released.0.clone()),
        })
    }
}

impl Reader {
    /// The state of a study, see [`results::snapshot`].
    pub(in crate::web) async fn snapshot(
        &self,
        store: &Store,
        catalogue: &Catalogue,
        settings: &Settings,
        study: &StudyId,
    ) -> Result<Arc<Snapshot>, Error> {
        match &self.released {
            Some(released) => Ok(released.clone()),
            None => results::snapshot(store, catalogue, settings, study).await,
        }
    }

    /// The state of a study whose results may be shown, see [`results::shown`].
    pub(in crate::web) async fn shown(
        &self,
        store: &Store,
        catalogue: &Catalogue,
        settings: &Settings,
        study: &StudyId,
    ) -> Result<Arc<Snapshot>, Error> {
        let snapshot = self.snapshot(store, catalogue, settings, study).await?;
        results::unless_blind(snapshot)
    }

    /// What a stranger is shown; none for everybody else.
    pub(in crate::web) fn released(&self) -> Option<&Snapshot> {
        self.released.as_deref()
    }

    /// Who asks for a sweep.
    pub(in crate::web) fn asker(&self) -> Asker {
        match &self.released {
            Some(_) => Asker::Stranger,
            None => Asker::Known,
        }
    }
}
