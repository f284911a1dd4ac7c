//! The address that people follow when they are through.

use std::collections::BTreeMap;

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};

use super::{LinkParameter, RecruitingIds};

/// What may stand in a query's value as it is.
const ENCODED: &AsciiSet = &NON_ALPHANUMERIC
    .remove(b'-')
    .remove(b'_')
    .remove(b'.')
    .remove(b'~');

/// An `https` address with places for the code and for recruiting parameters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RedirectTarget {
    parts: Vec<Part>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    Text(String),
    Code,
    Parameter(LinkParameter),
}

/// What is wrong with an address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::study) enum RedirectFault {
    /// It is no address that people can be sent to.
    Address,
    /// A placeholder that means nothing.
    Unknown(String),
    /// A parameter that is stored under a keyed hash, so that nobody can tell it any more.
    Hashed(LinkParameter),
}

impl RedirectTarget {
    /// Reads an address of a study that stores ids in this way.
    pub(in crate::study) fn parse(
        address: &str,
        ids: RecruitingIds,
    ) -> Result<Self, RedirectFault> {
        let rest = address
            .strip_prefix("https://")
            .ok_or(RedirectFault::Address)?;
        let host = rest.split(['/', '?', '#']).next().unwrap_or_default();
        if host.is_empty() || host.contains(['@', '{']) {
            return Err(RedirectFault::Address);
        }
        let mut parts = Vec::new();
        let mut left = address;
        while let Some((before, behind)) = left.split_once('{') {
            let (name, after) = behind.split_once('}').ok_or(RedirectFault::Address)?;
            parts.push(text(before)?);
            parts.push(placeholder(name, ids)?);
            left = after;
        }
        parts.push(text(left)?);
        Ok(Self { parts })
    }

    /// Whether the code has a place in it.
    pub fn names_code(&self) -> bool {
        self.parts.contains(&Part::Code)
    }

    /// The address for a person with this code, who came with these recruiting parameters; nothing where it names one
    /// that they did not come with.
    pub fn address(
        &self,
        code: Option<&str>,
        parameters: &BTreeMap<String, String>,
    ) -> Option<String> {
        let mut address = String::new();
        for part in &self.parts {
            match part {
                Part::Text(text) => address.push_str(text),
                Part::Code => address.push_str(code?),
                Part::Parameter(parameter) => {
                    let value = parameters.get(parameter.name())?;
                    address.extend(utf8_percent_encode(value, ENCODED));
                }
            }
        }
        Some(address)
    }
}

fn text(text: &str) -> Result<Part, RedirectFault> {
    let is_plain = text
        .bytes()
        .all(|byte| byte.is_ascii_graphic() && !b"{}\"<>\\^`|".contains(&byte));
    if is_plain {
        Ok(Part::Text(text.to_owned()))
    } else {
        Err(RedirectFault::Address)
    }
}

fn placeholder(name: &str, ids: RecruitingIds) -> Result<Part, RedirectFault> {
    if name == "code" {
        return Ok(Part::Code);
    }
    let known = LinkParameter::ALL
        .into_iter()
        .find(|parameter| parameter.name() == name)
        .ok_or_else(|| RedirectFault::Unknown(name.to_owned()))?;
    if known.is_plain(ids) {
        Ok(Part::Parameter(known))
    } else {
        Err(RedirectFault::Hashed(known))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(address: &str) -> Result<RedirectTarget, RedirectFault> {
        RedirectTarget::parse(address, RecruitingIds::Plain)
    }

    #[test]
    fn code_and_parameters_are_filled_in_and_encoded() {
        let target = plain("https://a.example/done?cc={code}&who={survey_code}#end").unwrap();
        let came_with = BTreeMap::from([("survey_code".to_owned(), "4 2&x=ü".to_owned())]);
        assert_eq!(
            target.address(Some("C1"), &came_with).unwrap(),
            "https://a.example/done?cc=C1&who=4%202%26x%3D%C3%BC#end"
        );
        assert!(target.names_code());
    }

    #[test]
    fn whoever_came_without_a_parameter_is_sent_nowhere() {
        let target = plain("https://a.example/?p={PROLIFIC_PID}").unwrap();
        assert_eq!(target.address(Some("C1"), &BTreeMap::new()), None);
        let target = plain("https://a.example/?cc={code}").unwrap();
        assert_eq!(target.address(None, &BTreeMap::new()), None);
    }

    #[test]
    fn hashed_parameters_cannot_be_named_but_the_assignment_can() {
        let hashed = |address| RedirectTarget::parse(address, RecruitingIds::Hashed);
        assert_eq!(
            hashed("https://a.example/?p={PROLIFIC_PID}"),
            Err(RedirectFault::Hashed(LinkParameter::ProlificPid))
        );
        assert!(hashed("https://a.example/?a={assignmentId}&c={code}").is_ok());
    }

    #[test]
    fn other_placeholders_and_addresses_are_refused() {
        assert_eq!(
            plain("https://a.example/?{else}"),
            Err(RedirectFault::Unknown("else".to_owned()))
        );
        for address in [
            "http://a.example/",
            "https://",
            "https:///path",
            "https://{code}.example/",
            "https://me@a.example/",
            "https://a.example/{code",
            "https://a.example/}",
            "https://a.example/a b",
            "https://a.example/\"",
        ] {
            assert_eq!(plain(address), Err(RedirectFault::Address), "{address}");
        }
    }
}
