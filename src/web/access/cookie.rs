//! The session's cookie.

use axum::http::{HeaderMap, HeaderValue, header};

use super::super::Settings;
use crate::store::{SESSION_LIFE_MS, Token};

/// The cookie's name. With `__Host-` a browser takes it from this very host over HTTPS alone, which plain HTTP cannot
/// give.
fn name(settings: &Settings) -> &'static str {
    if settings.is_https() {
        "__Host-riskaware"
    } else {
        "riskaware"
    }
}

/// The token of the session, if the browser sent one that could be one.
pub(in crate::web) fn session_token(headers: &HeaderMap, settings: &Settings) -> Option<Token> {
    let name = name(settings);
    headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|cookies| cookies.to_str().ok())
        .flat_map(|cookies| cookies.split(';'))
        .filter_map(|cookie| cookie.trim().split_once('='))
        .find(|(found, _)| *found == name)
        .and_then(|(_, token)| token.parse().ok())
}

/// The header that logs a browser in.
pub(in crate::web) fn set_session(settings: &Settings, token: &Token) -> HeaderValue {
    header_value(settings, &token.to_string(), SESSION_LIFE_MS / 1000)
}

/// The header that makes a browser forget its session.
pub(in crate::web) fn clear_session(settings: &Settings) -> HeaderValue {
    header_value(settings, "", 0)
}

fn header_value(settings: &Settings, value: &str, seconds: i64) -> HeaderValue {
    let secure = if settings.is_https() { "; Secure" } else { "" };
    let text = format!(
        "{}={value}; Path=/; HttpOnly; SameSite=Lax; Max-Age={seconds}{secure}",
        name(settings)
    );
    HeaderValue::try_from(text).expect("a token has letters, digits, - and _ alone")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(url: &str) -> Settings {
        Settings {
            public_url: Some(url.parse().unwrap()),
            ..Settings::default()
        }
    }

    #[test]
    fn the_cookie_is_bound_to_host_and_https_where_there_is_https() {
        let token: Token = "A".repeat(43).parse().unwrap();
        let secure = set_session(&at("https://study.example"), &token);
        let secure = secure.to_str().unwrap();
        assert!(secure.starts_with("__Host-riskaware=AAAA"), "{secure}");
        assert!(
            secure.contains("; Path=/; HttpOnly; SameSite=Lax;"),
            "{secure}"
        );
        assert!(secure.ends_with("; Secure"), "{secure}");
        let plain = set_session(&at("http://study.example"), &token);
        let plain = plain.to_str().unwrap();
        assert!(
            plain.starts_with("riskaware=") && !plain.contains("Secure"),
            "{plain}"
        );
    }

    #[test]
    fn only_the_own_cookie_is_read() {
        let mut headers = HeaderMap::new();
        let token = "A".repeat(43);
        let cookies = format!("a=b; riskaware={token}; __Host-riskaware=x");
        headers.insert(header::COOKIE, cookies.parse().unwrap());
        let read = session_token(&headers, &at("http://study.example"));
        assert_eq!(read.unwrap().to_string(), token);
        assert_eq!(session_token(&headers, &at("https://study.example")), None);
    }
}
