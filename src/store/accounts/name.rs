//! Names of accounts and of API tokens.

use std::fmt;
use std::str::FromStr;

/// 1 to 64 printable characters, without spaces at its ends.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct AccountName(String);

/// A text that is no name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a name has 1 to 64 printable characters, and is neither `nobody` nor `command`")]
pub struct AccountNameError;

impl AccountName {
    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for AccountName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for AccountName {
    type Err = AccountNameError;

    fn from_str(text: &str) -> Result<Self, AccountNameError> {
        let name = text.trim();
        let length = name.chars().count();
        // These stand in the log for others.
        let is_taken = ["nobody", "command"].contains(&name.to_lowercase().as_str());
        if (1..=64).contains(&length) && !name.chars().any(is_unprintable) && !is_taken {
            Ok(Self(name.to_owned()))
        } else {
            Err(AccountNameError)
        }
    }
}

/// Control characters, and marks that turn the direction of writing or have no width: two names that look alike would
/// differ by them.
fn is_unprintable(letter: char) -> bool {
    letter.is_control()
        || matches!(
            letter,
            '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{2069}' | '\u{feff}'
        )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_printable_and_of_bounded_length() {
        for name in ["a", "Anna Müller", "研究者", &"é".repeat(64)] {
            assert_eq!(name.parse::<AccountName>().unwrap().as_str(), name);
        }
        assert_eq!(" anna ".parse::<AccountName>().unwrap().as_str(), "anna");
        for name in ["", "  ", "a\nb", "a\u{202e}b", &"a".repeat(65)] {
            assert_eq!(name.parse::<AccountName>(), Err(AccountNameError), "{name}");
        }
    }
}
