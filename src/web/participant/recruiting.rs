//! What recruiting platforms put into a link.

use std::collections::BTreeMap;

use crate::{store::NewArrival, web::Error};

/// Platforms know ids of under 100 characters; whatever is longer was not made by one.
const LONGEST_VALUE: usize = 200;

/// The parameters that are kept, with the platform whose person a parameter names.
const KNOWN: [(&str, Option<&str>); 9] = [
    ("PROLIFIC_PID", Some("prolific")),
    ("STUDY_ID", None),
    ("SESSION_ID", None),
    ("workerId", Some("mturk")),
    ("assignmentId", None),
    ("hitId", None),
    ("turkSubmitTo", None),
    ("pid", Some("pid")),
    ("source", None),
];

/// Reads a link's query. Unknown parameters are left alone, since platforms and mail programs add their own.
///
/// # Errors
/// When a known parameter is longer than 200 characters or holds control characters; when
/// two parameters name the person.
pub(super) fn read(query: &BTreeMap<String, String>) -> Result<NewArrival, Error> {
    let mut arrival = NewArrival::default();
    for (name, platform) in KNOWN {
        let Some(value) = query.get(name).map(|value| value.trim()) else {
            continue;
        };
        // Platforms leave parameters empty that they do not know, for example in a preview.
        if value.is_empty() {
            continue;
        }
        if value.chars().count() > LONGEST_VALUE || value.chars().any(char::is_control) {
            return Err(Error::BadRequest(format!(
                "the link's parameter {name} must hold at most {LONGEST_VALUE} printable characters"
            )));
        }
        if name == "source" {
            arrival.source = Some(value.to_owned());
            continue;
        }
        if let Some(platform) = platform
            && let Some((other, _)) = arrival
                .person
                .replace((platform.to_owned(), value.to_owned()))
        {
            return Err(Error::BadRequest(format!(
                "the link names the person twice, for {other} and for {platform}"
            )));
        }
        arrival.recruiting.insert(name.to_owned(), value.to_owned());
    }
    Ok(arrival)
}
