//! Headers that every answer carries.

use std::sync::Arc;

use axum::{
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, header},
    middleware::Next,
    response::Response,
};

use super::Settings;

/// The sites that may show a page in their frame; nobody where it does not say so.
#[derive(Debug, Clone)]
pub(super) struct FramedBy(pub(super) Vec<String>);

/// The sites beside our own that a page's form may be sent to, or led on to.
#[derive(Debug, Clone)]
pub(super) struct SubmitsTo(pub(super) Vec<String>);

/// Nothing but our own files: no inline script, no inline style. The hash is that of the constant style text which the
/// vendored Observable Plot puts into its drawings (static/vendor/README.md says how to renew it).
const OWN_FILES: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'sha256-jSYQUrW7J0b3jPqhZP9C2Xh1PyJKHKXd4s0fpGGKrww='; \
    img-src 'self' blob: data:; connect-src 'self'; font-src 'self'; manifest-src 'self'; base-uri 'none'";

const FIXED: [(HeaderName, &str); 4] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    // no-referrer would make plain-HTTP hosts off loopback send `Origin: null`, and every form would be refused.
    (header::REFERRER_POLICY, "same-origin"),
    (
        HeaderName::from_static("cross-origin-opener-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("permissions-policy"),
        "camera=(), geolocation=(), microphone=()",
    ),
];

/// Where a site could not stand in a header. Study files and links are checked before, so that this is never met.
const STRICTEST: HeaderValue =
    HeaderValue::from_static("default-src 'none'; form-action 'none'; frame-ancestors 'none'");

/// For a year, browsers ask this host over HTTPS alone. Not its subdomains, which may be somebody else's.
const STRICT_TRANSPORT: HeaderValue = HeaderValue::from_static("max-age=31536000");

pub(super) async fn set(
    State(settings): State<Arc<Settings>>,
    request: Request,
    next: Next,
) -> Response {
    let mut response = next.run(request).await;
    let policy = content_security_policy(&response);
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, policy);
    for (name, value) in FIXED {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if settings.is_https() {
        headers.insert(header::STRICT_TRANSPORT_SECURITY, STRICT_TRANSPORT);
    }
    // Only files that have their hash in their address may be kept, and what is asked for again by its tag; event streams
    // say `no-cache`, which lets be kept.
    let is_immutable = headers
        .get(header::CACHE_CONTROL)
        .and_then(|cache| cache.to_str().ok())
        .is_some_and(|cache| cache.contains("immutable"));
    if !is_immutable && !headers.contains_key(header::ETAG) {
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    if headers.contains_key(header::CONTENT_ENCODING) {
        weaken_tag(headers);
    }
    response
}

fn content_security_policy(response: &Response) -> HeaderValue {
    let framed_by = response.extensions().get::<FramedBy>();
    let framed_by = framed_by.filter(|sites| !sites.0.is_empty());
    let frames = framed_by.map_or_else(|| "'none'".to_owned(), |sites| sites.0.join(" "));
    let submits_to = response.extensions().get::<SubmitsTo>();
    let other = submits_to.map_or_else(String::new, |sites| format!(" {}", sites.0.join(" ")));
    let policy = format!("{OWN_FILES}; form-action 'self'{other}; frame-ancestors {frames}");
    HeaderValue::from_str(&policy).unwrap_or(STRICTEST)
}

/// A strong tag promises the same bytes, and compressed ones are others (RFC 9110, section 8.8.3.3).
fn weaken_tag(headers: &mut HeaderMap) {
    let strong = headers
        .get(header::ETAG)
        .and_then(|tag| tag.to_str().ok())
        .filter(|tag| tag.starts_with('"'));
    if let Some(Ok(weak)) = strong.map(|tag| HeaderValue::from_str(&format!("W/{tag}"))) {
        headers.insert(header::ETAG, weak);
    }
}
