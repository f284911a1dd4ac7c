//! Pages and JSON over HTTP: participants, results, and the API.
//!
//! Each area owns a `router()`; this module joins them and puts the common layers around.

pub mod access;
mod accounts;
mod api;
pub mod assets;
mod error;
mod events;
mod headers;
mod home;
mod participant;
mod peers;
mod problem;
mod query;
mod replays;
mod results;
mod server;
mod studies;

use std::{
    net::{IpAddr, SocketAddr},
    sync::Arc,
    time::Duration,
};

use axum::{
    Router,
    extract::{DefaultBodyLimit, FromRef, MatchedPath, Request},
    middleware,
    routing::get,
};
use tokio_util::sync::CancellationToken;
use tower::ServiceBuilder;
use tower_http::{
    compression::CompressionLayer,
    csrf::CsrfLayer,
    request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer},
    timeout::RequestBodyDeadlineLayer,
    trace::TraceLayer,
};

pub use self::{
    access::{Limits, PublicUrl},
    api::document,
    error::{ApiError, Error},
    replays::Replays,
    results::{FitReportPage, analysis_json},
    server::serve,
};
use crate::{
    chance::Chance,
    jobs::{Catalogue, SourceFits, Sweeps},
    store::{Population, Store},
};

/// The largest body that any page or API call needs, with room to spare; forms of studies have a limit of their own.
const BODY_LIMIT: usize = 64 * 1024;
/// A body must have arrived by then, however slowly it dribbles.
const BODY_DEADLINE: Duration = Duration::from_secs(20);

/// What handlers share; each takes only the part it uses.
#[derive(Clone, FromRef)]
pub struct AppState {
    /// The database.
    pub store: Store,
    /// The studies by id and version.
    pub catalogue: Arc<Catalogue>,
    /// Where tokens and orders come from.
    pub chance: Chance,
    /// How this server was started.
    pub settings: Arc<Settings>,
    /// How often somebody may try.
    pub limits: Arc<Limits>,
    /// Simulated sweeps, computed when somebody asks for them.
    pub sweeps: Arc<Sweeps>,
    /// The models fitted to people from each source, computed when somebody asks for them.
    pub source_fits: Arc<SourceFits>,
    /// The replays that studies show.
    pub replays: Arc<Replays>,
    /// Cancelled when the server stops, so that event streams end.
    pub stop: CancellationToken,
}

/// How a server was started, as far as pages depend on it.
#[derive(Debug, Clone)]
pub struct Settings {
    /// While no account exists, results and API may be read on any address, not on loopback alone.
    pub open_results: bool,
    /// Whose answers this server takes and shows; where they are simulated, every page of results says so.
    pub population: Population,
    /// Under which address others reach the server, if the operator said so.
    pub public_url: Option<PublicUrl>,
    /// Proxies that are believed when they say whom a request is from.
    pub trusted_proxies: Vec<IpAddr>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            open_results: false,
            population: Population::People,
            public_url: None,
            trusted_proxies: Vec::new(),
        }
    }
}

impl Settings {
    /// Whether visitors come over HTTPS.
    pub fn is_https(&self) -> bool {
        self.public_url.as_ref().is_some_and(PublicUrl::is_https)
    }

    /// Who may read results, in a sentence: on the first page and in the terminal.
    pub fn access(&self, has_accounts: bool) -> &'static str {
        if has_accounts {
            "Results need an account, the API a token; studies that were made public show their aggregates to everybody."
        } else if self.open_results {
            "Results and API are open to everybody who can reach this server (--open-results)."
        } else {
            "Results and API are shown where the server listens on this machine alone (such as 127.0.0.1:8080), or with --open-results."
        }
    }
}

fn router(state: AppState, address: SocketAddr) -> Router {
    let guard = access::Guard {
        app: state.clone(),
        listener: address,
        released: Arc::default(),
    };
    Router::new()
        .route("/healthz", get(health))
        .merge(home::router())
        .merge(participant::router())
        .merge(replays::router())
        .merge(accounts::router())
        .merge(studies::router())
        .merge(results::router())
        .merge(api::router())
        .merge(api::router_of_pages())
        .merge(api::description())
        .merge(assets::router())
        .fallback(|| async { Error::NotFound("page") })
        .method_not_allowed_fallback(|| async { Error::MethodNotAllowed })
        .layer(middleware::from_fn_with_state(guard, access::guard))
        .layer(
            ServiceBuilder::new()
                .layer(middleware::from_fn_with_state(
                    state.settings.clone(),
                    access::own_request_id,
                ))
                .layer(SetRequestIdLayer::x_request_id(MakeRequestUuid))
                .layer(
                    TraceLayer::new_for_http()
                        .make_span_with(span)
                        .on_failure(()),
                )
                .layer(PropagateRequestIdLayer::x_request_id())
                .layer(middleware::from_fn_with_state(
                    state.settings.clone(),
                    headers::set,
                ))
                .layer(CompressionLayer::new())
                .layer(middleware::from_fn(problem::complete))
                .layer(middleware::from_fn(participant::tell))
                .layer(CsrfLayer::new().with_rejection_response(access::cross_site))
                .layer(RequestBodyDeadlineLayer::new(BODY_DEADLINE))
                .layer(DefaultBodyLimit::max(BODY_LIMIT)),
        )
        .with_state(state)
}

/// A request in the log: the route, never the path, which may hold a token.
fn span(request: &Request) -> tracing::Span {
    let route = request
        .extensions()
        .get::<MatchedPath>()
        .map_or("unmatched", MatchedPath::as_str);
    let id = request
        .headers()
        .get("x-request-id")
        .and_then(|id| id.to_str().ok())
        .unwrap_or("");
    tracing::info_span!("request", method = %request.method(), route, id)
}

async fn health(
    axum::extract::State(store): axum::extract::State<Store>,
) -> Result<&'static str, Error> {
    // Reading shows that the database answers.
    store.studies().await?;
    if !store.is_taking_answers() {
        return Err(crate::store::Error::Busy.into());
    }
    Ok("ok\n")
}
