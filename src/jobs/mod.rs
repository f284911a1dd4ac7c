//! Work behind the pages.

mod catalogue;
pub mod closing;

pub use catalogue::{Catalogue, CatalogueError};

use std::sync::Arc;

use tokio_util::sync::CancellationToken;

use crate::store::{Population, Store};

/// Starts the background work; the future completes once all of it has ended after `stop`.
pub fn start(
    store: &Store,
    _catalogue: &Arc<Catalogue>,
    _population: Population,
    stop: &CancellationToken,
) -> impl Future<Output = ()> + use<> {
    let closing = tokio::spawn(closing::run(store.clone(), stop.clone()));
    async move { drop(closing.await) }
}
