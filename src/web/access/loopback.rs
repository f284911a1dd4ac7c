//! Who may see results while no account exists: whoever sits at this machine, unless the operator opened them.

use std::net::SocketAddr;

use axum::{
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use tower_http::csrf::ProtectionError;

use super::Error;

/// What proxies add to requests that they pass on.
const FORWARDED: [&str; 5] = [
    "forwarded",
    "via",
    "x-forwarded-for",
    "x-forwarded-host",
    "x-real-ip",
];

/// Whether a request comes from this machine: the listener is a loopback one and is addressed as such.
///
/// The name in `Host` counts as well as the listener, because a page of another site whose name was pointed at 127.0.0.1
/// must not read results. Behind a proxy on this machine the listener is loopback too, and some proxies put their own
/// name for us into `Host`: so whatever says that it was forwarded is refused. A proxy that says nothing at all cannot
/// be told from a browser on this machine.
pub(super) fn is_local(headers: &HeaderMap, listener: SocketAddr) -> bool {
    let host = headers
        .get(header::HOST)
        .and_then(|host| host.to_str().ok());
    let is_forwarded = FORWARDED.iter().any(|name| headers.contains_key(*name));
    listener.ip().is_loopback() && host.is_some_and(is_loopback_name) && !is_forwarded
}

/// What everybody else is told.
pub(super) fn not_here() -> Error {
    Error::Forbidden(
        "results are shown only where the server listens on this machine alone, such as 127.0.0.1:8080; make the first account with the link that the server printed when it started, or start it with --open-results to show results to everybody who can reach it".to_owned(),
    )
}

/// What a form or call from a page of another site is answered.
pub(in crate::web) fn cross_site(_: ProtectionError) -> Response {
    Error::CrossSite.into_response()
}

fn is_loopback_name(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name == "localhost"
        || name.ends_with(".localhost")
        || name
            .parse::<std::net::IpAddr>()
            .is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::is_loopback_name;

    #[test]
    fn only_names_of_this_machine_are_loopback() {
        for host in [
            "localhost:8080",
            "127.0.0.1",
            "127.0.0.1:80",
            "[::1]:8080",
            "a.localhost",
        ] {
            assert!(is_loopback_name(host), "{host}");
        }
        for host in [
            "example.org",
            "localhost.example.org",
            "10.0.0.1:8080",
            "[fe80::1]:1",
            "",
        ] {
            assert!(!is_loopback_name(host), "{host}");
        }
    }
}
