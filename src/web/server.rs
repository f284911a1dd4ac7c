//! The accept loop: connections with header and body limits, and an orderly end.

use std::{io, net::SocketAddr, pin::Pin, time::Duration};

use axum::{Router, extract::Request};
use hyper::{body::Incoming, server::conn::http1};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    server::graceful::GracefulShutdown,
    service::TowerToHyperService,
};
use tokio::{
    io::{AsyncRead, AsyncWrite},
    net::TcpListener,
    sync::Semaphore,
};
use tokio_io_timeout::TimeoutStream;
use tower::ServiceExt;

use super::{AppState, access::PeerAddress, peers::Peers, router};

/// A client that has not sent its whole request head by then is cut off; the same bound ends idle connections.
const HEADER_READ_TIMEOUT: Duration = Duration::from_secs(15);
/// Open connections; more wait in the kernel's accept queue.
const MAX_CONNECTIONS: usize = 4096;
/// A client that takes no byte of its answer for so long is cut off: it would hold its connection for ever.
const WRITE_TIMEOUT: Duration = Duration::from_secs(45);
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
    let peers = Peers::new(state.settings.trusted_proxies.clone());
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
        let Some(counted) = peers.count(peer.ip()) else {
            tracing::debug!(%peer, "too many connections from one address");
            continue;
        };
        // A page turn is small and waited for: send it at once.
        if let Err(error) = stream.set_nodelay(true) {
            tracing::debug!(%error, "could not set TCP_NODELAY");
        }
        let connection = connection(&app, stream, peer, WRITE_TIMEOUT);
        let connection = connections.watch(connection);
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                tracing::debug!(%error, "connection ended early");
            }
            drop((slot, counted));
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

/// A stream whose other end has to take what is written.
type Patient<S> = TokioIo<Pin<Box<TimeoutStream<S>>>>;

fn connection<S: AsyncRead + AsyncWrite>(
    app: &Router,
    stream: S,
    peer: SocketAddr,
    write_timeout: Duration,
) -> http1::Connection<
    Patient<S>,
    TowerToHyperService<
        impl tower::Service<
            Request<Incoming>,
            Response = axum::response::Response,
            Error = std::convert::Infallible,
            Future: Send,
        > + Clone
        + use<S>,
    >,
> {
    let service = app
        .clone()
        .map_request(move |mut request: Request<Incoming>| {
            request.extensions_mut().insert(PeerAddress(peer));
            request.map(axum::body::Body::new)
        });
    // Each byte that is taken begins the time anew; a stream with nothing to send has nothing to wait for.
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(write_timeout));
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_READ_TIMEOUT)
        .serve_connection(
            TokioIo::new(Box::pin(stream)),
            TowerToHyperService::new(service),
        )
}

#[cfg(test)]
mod tests {
    use axum::routing::get;
    use tokio::io::AsyncWriteExt;

    use super::*;

    #[tokio::test]
    async fn whoever_reads_nothing_is_cut_off() {
        let app = Router::new().route("/", get(|| async { "a".repeat(1 << 20) }));
        let (mut client, server) = tokio::io::duplex(1024);
        let peer = "192.0.2.1:1".parse().unwrap();
        let served = connection(&app, server, peer, Duration::from_millis(1));
        let request = b"GET / HTTP/1.1\r\nhost: x\r\n\r\n";
        client.write_all(request).await.unwrap();
        // Without the timeout this would wait for ever, as `client` stays open.
        let ended = tokio::time::timeout(Duration::from_secs(60), served).await;
        assert!(ended.expect("it is cut off").is_err());
        drop(client);
    }
}
