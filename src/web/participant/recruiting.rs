//! What recruiting platforms put into a link.

use std::collections::BTreeMap;

use crate::{
    store::NewArrival,
    study::{LinkParameter, Mturk, NotMturk, Words},
};

/// Platforms know ids of under 100 characters; whatever is longer was not made by one.
const LONGEST_VALUE: usize = 200;

/// A label for tables by where people come from; it names nobody.
const SOURCE: &str = "source";

/// Why a link cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum BadLink {
    /// A known parameter is too long or holds control characters.
    Value(&'static str),
    /// The platform left a placeholder in a parameter.
    Placeholder(&'static str),
    /// Two parameters name different people, for these platforms.
    Persons(String, String),
    /// Assignments are to be sent anywhere but to MTurk.
    Site(NotMturk),
}

impl BadLink {
    /// The same in words.
    pub(super) fn text(&self, words: &Words) -> String {
        match self {
            Self::Value(name) => words.error_link_value(name, LONGEST_VALUE),
            Self::Placeholder(name) => words.error_link_placeholder(name),
            Self::Persons(one, other) => words.error_link_persons(one, other),
            Self::Site(NotMturk { found, allowed }) => words.error_link_site(found, allowed),
        }
    }
}

/// Reads a link's query. Unknown parameters are left alone, since platforms and mail programs add their own.
///
/// # Errors
/// When a known parameter is longer than 200 characters or holds control characters; when
/// two parameters name the person; when assignments are to be sent anywhere but to MTurk.
pub(super) fn read(query: &BTreeMap<String, String>, mturk: &Mturk) -> Result<NewArrival, BadLink> {
    let mut arrival = NewArrival {
        source: value(query, SOURCE)?.map(str::to_owned),
        ..NewArrival::default()
    };
    for parameter in LinkParameter::ALL {
        let Some(value) = value(query, parameter.name())? else {
            continue;
        };
        if let Some(platform) = parameter.platform() {
            name_person(&mut arrival, platform, value)?;
        }
        let kept = match parameter {
            LinkParameter::MturkSubmitTo => mturk.taking_site(value).map_err(BadLink::Site)?,
            LinkParameter::ProlificPid
            | LinkParameter::ProlificStudy
            | LinkParameter::ProlificSession
            | LinkParameter::MturkWorker
            | LinkParameter::MturkAssignment
            | LinkParameter::MturkHit
            | LinkParameter::SonaSurveyCode
            | LinkParameter::SonaId
            | LinkParameter::Pid => value,
        };
        let name = parameter.name().to_owned();
        arrival.recruiting.insert(name, kept.to_owned());
    }
    Ok(arrival)
}

/// Whether somebody looks at the task on MTurk without having accepted it.
pub(super) fn is_look(arrival: &NewArrival) -> bool {
    let assignment = LinkParameter::MturkAssignment.name();
    let assignment = arrival.recruiting.get(assignment);
    assignment.is_some_and(|id| id == LinkParameter::MTURK_LOOK)
}

/// A parameter's value. Platforms leave parameters empty that they do not know, for example in a preview.
fn value<'a>(
    query: &'a BTreeMap<String, String>,
    name: &'static str,
) -> Result<Option<&'a str>, BadLink> {
    let value = query.get(name).map(|value| value.trim());
    let Some(value) = value.filter(|value| !value.is_empty()) else {
        return Ok(None);
    };
    if value.chars().count() > LONGEST_VALUE || value.chars().any(char::is_control) {
        return Err(BadLink::Value(name));
    }
    if value.contains("{{") {
        return Err(BadLink::Placeholder(name));
    }
    Ok(Some(value))
}

fn name_person(arrival: &mut NewArrival, platform: &str, value: &str) -> Result<(), BadLink> {
    let person = (platform.to_owned(), value.to_owned());
    match &arrival.person {
        Some(named) if *named != person => {
            Err(BadLink::Persons(named.0.clone(), platform.to_owned()))
        }
        Some(_) | None => {
            arrival.person = Some(person);
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(query: &[(&str, &str)]) -> Result<NewArrival, BadLink> {
        let owned = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        read(&query.iter().map(owned).collect(), &Mturk::default())
    }

    #[track_caller]
    fn check(query: &[(&str, &str)], platform: &str, person: &str) {
        let arrival = link(query).expect("the link can be read");
        let expected = Some((platform.to_owned(), person.to_owned()));
        assert_eq!(arrival.person, expected, "{query:?}");
    }

    #[test]
    fn each_platform_names_its_person() {
        check(
            &[("PROLIFIC_PID", "5f3"), ("STUDY_ID", "s")],
            "prolific",
            "5f3",
        );
        check(&[("workerId", "A1"), ("assignmentId", "3X")], "mturk", "A1");
        check(&[("survey_code", "4711")], "sona", "4711");
        check(&[("id", "4711")], "sona", "4711");
        check(&[("survey_code", "4711"), ("id", "4711")], "sona", "4711");
        check(&[("pid", " anna ")], "pid", "anna");
    }

    #[test]
    fn sources_and_unknown_parameters_name_nobody() {
        let arrival = link(&[("source", "poster"), ("utm_id", "9"), ("PROLIFIC_PID", "")]).unwrap();
        assert_eq!(arrival.person, None);
        assert_eq!(arrival.source.as_deref(), Some("poster"));
        assert!(arrival.recruiting.is_empty());
    }

    #[test]
    fn two_names_for_one_person_are_refused() {
        for query in [
            [("PROLIFIC_PID", "5f3"), ("pid", "anna")],
            [("survey_code", "1"), ("id", "2")],
        ] {
            let refused = link(&query).unwrap_err();
            assert!(matches!(refused, BadLink::Persons(..)), "{refused:?}");
        }
    }

    #[test]
    fn a_task_that_was_not_accepted_is_only_looked_at() {
        assert!(is_look(
            &link(&[("assignmentId", LinkParameter::MTURK_LOOK)]).unwrap()
        ));
        assert!(!is_look(&link(&[("assignmentId", "3X")]).unwrap()));
        assert!(!is_look(&link(&[]).unwrap()));
    }
}
