//! The accept loop: connections with header and body limits, and an orderly end.

use std::{io, net::SocketAddr, time::Duration};

use axum::{Router, extract::Request};
use hyper::{body::Incoming, server::conn::http1};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    server::graceful::GracefulShutdown,
    service::TowerToHyperService,
};
use tokio::{net::TcpListener, sync::Semaphore};
use tower::ServiceExt;

use super::{AppState, access::PeerAddress, router};

/// A client that has not sent its whole request head by then is cut off; the same bound ends idle connections.
const HEADER_READ_TIMEOUT: Duration = Duration::from_secs(15);
/// Open connections; more wait in the kernel's accept queue.
const MAX_CONNECTIONS: usize = 4096;
/// How long requests under way may take once shutdown has begun.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(5);
/// Pause after a failed accept, such as one that ran out of file descriptors.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);

/// Serves the whole product on `listener` until `shutdown` completes, then lets requests under way finish.
///
/// The listener is bound by the caller, so that tests and the command use the same function and nobody waits for start-up.
///
/// # Errors
/// When the listener's own address cannot be read.
pub async fn serve(
    listener: TcpListener,
    state: AppState,
    shutdown: impl Future<Output = ()>,
) -> io::Result<()> {
    let stop = state.stop.clone();
    let app = router(state, listener.local_addr()?);
    let connections = GracefulShutdown::new();
    let slots = std::sync::Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let mut shutdown = std::pin::pin!(shutdown);
    loop {
        let accepted = async {
            let slot = slots.clone().acquire_owned().await;
            (slot, listener.accept().await)
        };
        let (slot, stream, peer) = tokio::select! {
            accepted = accepted => match accepted {
                (Ok(slot), Ok((stream, peer))) => (slot, stream, peer),
                (Err(_), _) => break,
                (_, Err(error)) => {
                    tracing::warn!(%error, "could not accept a connection");
                    tokio::time::sleep(ACCEPT_RETRY).await;
                    continue;
                }
            },
            () = &mut shutdown => break,
        };
        // A page turn is small and waited for: send it at once.
        if let Err(error) = stream.set_nodelay(true) {
            tracing::debug!(%error, "could not set TCP_NODELAY");
        }
        let connection = connection(&app, stream, peer);
        let connection = connections.watch(connection);
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                tracing::debug!(%error, "connection ended early");
            }
            drop(slot);
        });
    }
    stop.cancel();
    if tokio::time::timeout(DRAIN_TIMEOUT, connections.shutdown())
        .await
        .is_err()
    {
        tracing::warn!("some connections were still open after {DRAIN_TIMEOUT:?} and were cut");
    }
    Ok(())
}

fn connection(
    app: &Router,
    stream: tokio::net::TcpStream,
    peer: SocketAddr,
) -> http1::Connection<
    TokioIo<tokio::net::TcpStream>,
    TowerToHyperService<
        impl tower::Service<
            Request<Incoming>,
            Response = axum::response::Response,
            Error = std::convert::Infallible,
            Future: Send,
        > + Clone
        + use<>,
    >,
> {
    let service = app
        .clone()
        .map_request(move |mut request: Request<Incoming>| {
            request.extensions_mut().insert(PeerAddress(peer));
            request.map(axum::body::Body::new)
        });
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_READ_TIMEOUT)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(service))
}
