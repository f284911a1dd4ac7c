//! Rules for single values.

use crate::study::document::{Fault, KeyPath};
use crate::study::markup;
use crate::study::template::Scope;

const LONGEST_ID: usize = 40;
const ID: &str = "1 to 40 of the characters a-z, 0-9 and -";
const LONGEST_CODE: usize = 40;

/// An id.
pub(super) fn id(text: &str, at: &KeyPath) -> Result<String, Fault> {
    let is_id = (1..=LONGEST_ID).contains(&text.len())
        && text
            .bytes()
            .all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-');
    if is_id {
        Ok(text.to_owned())
    } else {
        Err(at.fault(shown(text), ID))
    }
}

/// Ids of one list, each once.
pub(super) fn distinct_ids<'a>(
    ids: impl IntoIterator<Item = &'a str>,
    list: &KeyPath,
    what: &str,
) -> Result<(), Fault> {
    let mut seen = std::collections::BTreeSet::new();
    for (index, text) in ids.into_iter().enumerate() {
        let at = list.index(index).key("id");
        id(text, &at)?;
        if !seen.insert(text) {
            return Err(at.fault(
                format!("{} for the second time", shown(text)),
                format!("another id for each {what}"),
            ));
        }
    }
    Ok(())
}

/// The name of a value: what stands between the braces of a placeholder.
pub(super) fn value_name(name: &str, at: &KeyPath) -> Result<(), Fault> {
    let is_name = name.starts_with(|first: char| first.is_ascii_lowercase())
        && name
            .bytes()
            .all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_')
        && name.len() <= LONGEST_ID;
    if !is_name {
        return Err(at.fault(
            shown(name),
            "a letter a-z first, then at most 39 of a-z, 0-9 and _",
        ));
    }
    if ["title", "contact", "minutes", "limit", "rest"].contains(&name) {
        return Err(at.fault(shown(name), "another name: this one has a fixed meaning"));
    }
    Ok(())
}

/// A line of text that is not empty.
pub(super) fn line(text: &str, at: &KeyPath) -> Result<(), Fault> {
    if text.trim().is_empty() {
        return Err(at.fault("an empty text", "a line of text"));
    }
    if text.contains('\n') {
        return Err(at.fault("several lines", "one line of text"));
    }
    Ok(())
}

/// A line of text with its placeholders filled in.
pub(super) fn filled_line(text: &str, scope: &Scope<'_>, at: &KeyPath) -> Result<String, Fault> {
    let filled = filled(text, scope, at)?;
    line(&filled, at)?;
    Ok(filled)
}

/// A text with its placeholders filled in, possibly empty.
pub(super) fn filled(text: &str, scope: &Scope<'_>, at: &KeyPath) -> Result<String, Fault> {
    scope
        .fill(text)
        .map_err(|error| at.fault(error.found(), error.allowed()))
}

/// A Markdown text as HTML, placeholders filled in before.
pub(super) fn filled_markdown(
    text: &str,
    scope: &Scope<'_>,
    at: &KeyPath,
) -> Result<String, Fault> {
    Ok(markup::to_html(&filled(text, scope, at)?))
}

/// A completion code.
pub(super) fn code(text: &str, at: &KeyPath) -> Result<String, Fault> {
    let is_code = (1..=LONGEST_CODE).contains(&text.len())
        && text
            .bytes()
            .all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_');
    if is_code {
        Ok(text.to_owned())
    } else {
        Err(at.fault(shown(text), "1 to 40 letters a-z or A-Z, digits, - and _"))
    }
}

/// A text in messages.
pub(super) fn shown(text: &str) -> String {
    const LONGEST: usize = 60;
    if text.chars().count() > LONGEST {
        let start: String = text.chars().take(LONGEST).collect();
        format!("`{start}…`")
    } else {
        format!("`{text}`")
    }
}
