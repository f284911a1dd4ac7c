//! Links that open something: random tokens, and the keyed hashes made with the server's secret.

use std::fmt;
use std::str::FromStr;

use data_encoding::{BASE32_NOPAD, BASE64URL_NOPAD, HEXLOWER};
use hmac::{Hmac, KeyInit, Mac};
use rand::CryptoRng;
use sha2::{Digest, Sha256};

use super::RunId;
use crate::study::StudyId;

/// What stands in a link: 32 random bytes, written in URL-safe base64 (43 characters).
///
/// Who has it may use it, so it is never logged: `Debug` shows the beginning of its hash.
#[derive(Clone, PartialEq, Eq, Hash)]
pub struct Token([u8; 32]);

/// The SHA-256 of a token: all that the database knows of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TokenHash([u8; 32]);

/// A text that is no token.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a link's token has 43 letters, digits, - or _")]
pub struct TokenError;

impl Token {
    /// A new token.
    pub fn random(rng: &mut impl CryptoRng) -> Self {
        let mut bytes = [0; 32];
        rng.fill_bytes(&mut bytes);
        Self(bytes)
    }

    /// What is stored of it.
    pub fn hash(&self) -> TokenHash {
        TokenHash(Sha256::digest(self.0).into())
    }
}

impl TokenHash {
    /// The bytes.
    pub(super) fn as_bytes(&self) -> &[u8] {
        &self.0
    }

    /// The bytes in hexadecimal, for JSON parameters.
    pub(super) fn to_hex(self) -> String {
        HEXLOWER.encode(&self.0)
    }
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&BASE64URL_NOPAD.encode(&self.0))
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Token(hash {}..)", &self.hash().to_hex()[..8])
    }
}

impl FromStr for Token {
    type Err = TokenError;

    fn from_str(text: &str) -> Result<Self, TokenError> {
        let bytes = BASE64URL_NOPAD
            .decode(text.as_bytes())
            .map_err(|_| TokenError)?;
        Ok(Self(bytes.try_into().map_err(|_| TokenError)?))
    }
}

/// The key of the server's keyed hashes: 32 random bytes, made when the database is.
#[derive(Clone)]
pub(super) struct Secret([u8; 32]);

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(..)")
    }
}

impl Secret {
    pub(super) fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The link of the run that an arrival leads to: the same each time, so that pressing the button twice starts one
    /// run, without the link itself being stored.
    pub(super) fn run_token(&self, arrival: &Token) -> Token {
        Token(self.keyed("run", &[&arrival.0]))
    }

    /// Under which a person of a recruiting platform is known in one study, in hexadecimal.
    pub(super) fn platform_key(&self, study: &StudyId, platform: &str, person: &str) -> String {
        HEXLOWER.encode(&self.keyed(
            "platform",
            &[
                study.as_str().as_bytes(),
                platform.as_bytes(),
                person.as_bytes(),
            ],
        ))
    }

    /// What stands for a recruiting id where the study stores no plain ones: short, but long enough not to collide.
    pub(super) fn recruiting_id(&self, study: &StudyId, parameter: &str, value: &str) -> String {
        let hash = self.keyed(
            "recruiting",
            &[
                study.as_str().as_bytes(),
                parameter.as_bytes(),
                value.as_bytes(),
            ],
        );
        HEXLOWER.encode(&hash[..16])
    }

    /// A run's own completion code: ten letters and digits that nobody can guess from another run's.
    pub(super) fn completion_code(&self, run: RunId) -> String {
        let mut code = BASE32_NOPAD.encode(&self.keyed("code", &[&run.0.to_be_bytes()]));
        code.truncate(10);
        code
    }

    fn keyed(&self, purpose: &str, parts: &[&[u8]]) -> [u8; 32] {
        let mut mac =
            Hmac::<Sha256>::new_from_slice(&self.0).expect("HMAC takes keys of any length");
        mac.update(purpose.as_bytes());
        for part in parts {
            // With its length in front, no two lists of parts look alike.
            mac.update(&(part.len() as u64).to_be_bytes());
            mac.update(part);
        }
        mac.finalize().into_bytes().into()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha12Rng;

    use super::*;

    #[test]
    fn a_token_reads_back_from_its_link_and_shows_only_its_hash_in_logs() {
        let token = Token::random(&mut ChaCha12Rng::seed_from_u64(1));
        let link = token.to_string();
        assert_eq!(link.len(), 43);
        assert_eq!(link.parse(), Ok(token.clone()));
        let logged = format!("{token:?}");
        assert!(!logged.contains(&link[..8]), "{logged}");
        assert_eq!(token.hash(), link.parse::<Token>().unwrap().hash());
    }

    #[test]
    fn other_texts_are_no_tokens() {
        for text in [
            "",
            "abc",
            &"A".repeat(42),
            &"A".repeat(44),
            &"ä".repeat(43),
            "../../etc/passwd",
        ] {
            assert_eq!(text.parse::<Token>(), Err(TokenError), "{text}");
        }
    }

    #[test]
    fn keyed_hashes_depend_on_the_secret_and_on_every_part() {
        let (first, second) = (Secret::new([1; 32]), Secret::new([2; 32]));
        let (driving, cups) = (StudyId::from("driving"), StudyId::from("cups"));
        let key = first.platform_key(&driving, "prolific", "5f3");
        assert_eq!(key, first.platform_key(&driving, "prolific", "5f3"));
        assert_ne!(key, second.platform_key(&driving, "prolific", "5f3"));
        assert_ne!(key, first.platform_key(&cups, "prolific", "5f3"));
        assert_ne!(key, first.platform_key(&driving, "mturk", "5f3"));
        assert_ne!(key, first.platform_key(&driving, "prolific5", "f3"));
        assert_ne!(
            first.completion_code(RunId(1)),
            first.completion_code(RunId(2))
        );
        assert_eq!(first.completion_code(RunId(1)).len(), 10);
        let arrival = Token::random(&mut ChaCha12Rng::seed_from_u64(1));
        assert_ne!(first.run_token(&arrival), arrival);
        assert_ne!(first.run_token(&arrival), second.run_token(&arrival));
    }
}
