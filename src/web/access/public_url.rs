//! The address under which others reach the server.

use std::{fmt, str::FromStr};

use axum::http::{Uri, uri::Scheme};

/// An `http` or `https` address without a path, such as `https://study.example.org`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PublicUrl {
    is_https: bool,
    authority: String,
}

/// A text that is no such address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no public URL; allowed: http:// or https:// with a host, a port if needed, and nothing behind it"
)]
pub struct PublicUrlError(String);

impl PublicUrl {
    /// Whether visitors come over HTTPS.
    pub fn is_https(&self) -> bool {
        self.is_https
    }

    /// The host, with its port if one was given.
    pub(super) fn authority(&self) -> &str {
        &self.authority
    }
}

impl fmt::Display for PublicUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = if self.is_https { "https" } else { "http" };
        write!(f, "{scheme}://{}", self.authority)
    }
}

impl FromStr for PublicUrl {
    type Err = PublicUrlError;

    fn from_str(text: &str) -> Result<Self, PublicUrlError> {
        let refused = || PublicUrlError(text.to_owned());
        let uri: Uri = text.parse().map_err(|_| refused())?;
        let is_https = match uri.scheme() {
            Some(scheme) if *scheme == Scheme::HTTPS => true,
            Some(scheme) if *scheme == Scheme::HTTP => false,
            Some(_) | None => return Err(refused()),
        };
        let authority = uri.authority().ok_or_else(refused)?;
        let is_bare = matches!(uri.path(), "" | "/") && uri.query().is_none();
        if !is_bare || authority.host().is_empty() || authority.as_str().contains('@') {
            return Err(refused());
        }
        Ok(Self {
            is_https,
            authority: authority.as_str().to_ascii_lowercase(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_bare_addresses_are_public_urls() {
        for (text, shown) in [
            ("https://study.example.org", "https://study.example.org"),
            ("https://Study.example.org/", "https://study.example.org"),
            ("http://10.0.0.2:8080", "http://10.0.0.2:8080"),
        ] {
            assert_eq!(text.parse::<PublicUrl>().unwrap().to_string(), shown);
        }
        for text in [
            "",
            "study.example.org",
            "ftp://study.example.org",
            "https://",
            "https://a/b",
            "https://a?b=c",
            "https://me:secret@a",
        ] {
            assert!(text.parse::<PublicUrl>().is_err(), "{text}");
        }
    }
}
