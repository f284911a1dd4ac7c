//! The id under which the log tells of a request.

use std::{net::IpAddr, sync::Arc};

use axum::{
    extract::{Request, State},
    middleware::Next,
    response::Response,
};

use super::{super::Settings, address::PeerAddress};

const HEADER: &str = "x-request-id";
/// More than any proxy needs.
const LONGEST: usize = 64;

/// Takes an id from the request that no trusted proxy gave it: the server then makes its own, and nobody chooses under
/// which one the log speaks of them.
pub(in crate::web) async fn own_request_id(
    State(settings): State<Arc<Settings>>,
    mut request: Request,
    next: Next,
) -> Response {
    if !is_believed(&request, &settings.trusted_proxies) {
        request.headers_mut().remove(HEADER);
    }
    next.run(request).await
}

fn is_believed(request: &Request, trusted: &[IpAddr]) -> bool {
    let peer = request.extensions().get::<PeerAddress>();
    let is_proxy = peer.is_some_and(|peer| trusted.contains(&peer.0.ip().to_canonical()));
    let mut ids = request.headers().get_all(HEADER).iter();
    let (Some(id), None) = (ids.next(), ids.next()) else {
        return false;
    };
    let is_plain = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.');
    let id = id.as_bytes();
    is_proxy && !id.is_empty() && id.len() <= LONGEST && id.iter().all(is_plain)
}
