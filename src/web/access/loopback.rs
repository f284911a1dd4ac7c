//! Who may see results while no account exists: whoever sits at this machine, unless the operator opened them.

use std::net::SocketAddr;

use axum::{
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use tower_http::csrf::ProtectionError;

use super::{super::Settings, Error};

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
/// be told from a browser on this machine: where the server was told of a proxy, or of an address that others use, nobody
/// counts as sitting here.
pub(super) fn is_local(headers: &HeaderMap, listener: SocketAddr, settings: &Settings) -> bool {
    let public = settings.public_url.as_ref();
    if !settings.trusted_proxies.is_empty()
        || !public.is_none_or(|url| is_loopback_name(url.authority()))
    {
        return false;
    }
    let host = headers
        .get(header::HOST)
        .and_then(|host| host.to_str().ok());
    let is_forwarded = FORWARDED.iter().any(|name| headers.contains_key(*name));
    listener.ip().is_loopback() && host.is_some_and(is_loopback_name) && !is_forwarded
}

/// What everybody else is told.
pub(super) fn not_here() -> Error {
    Error::Forbidden(
        "results are shown only where the server listens on this machine alone, such as 127.0.0.1:8080, and was told of no proxy and no public address; make the first account with the link that the server printed when it started, or start it with --open-results to show results to everybody who can reach it".to_owned(),
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
    use super::*;

    #[test]
    fn nobody_sits_at_this_machine_where_a_proxy_or_a_public_address_was_named() {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, "127.0.0.1:8080".parse().unwrap());
        let listener = "127.0.0.1:8080".parse().unwrap();
        let is_local = |url: Option<&str>, proxies: &[&str]| {
            let settings = Settings {
                public_url: url.map(|url| url.parse().unwrap()),
                trusted_proxies: proxies.iter().map(|proxy| proxy.parse().unwrap()).collect(),
                ..Settings::default()
            };
            is_local(&headers, listener, &settings)
        };
        assert!(is_local(None, &[]));
        assert!(is_local(Some("http://localhost:8080"), &[]));
        assert!(!is_local(Some("https://study.example"), &[]));
        assert!(!is_local(None, &["127.0.0.1"]));
    }

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
