//! The languages of a study, and the texts that each one puts in place of the file's own.

use std::collections::{BTreeMap, BTreeSet};

use super::rules;
use crate::study::document::{Document, Fault, KeyPath, did_you_mean, list};
use crate::study::words::{self, Words};

/// Where texts stand that people read. A star stands for any key; only texts count, so numbers of `values` do not.
const TEXTS: [&str; 46] = [
    "title",
    "summary",
    "contact",
    "reward_unit.name",
    "reward_unit.prefix",
    "reward_unit.suffix",
    "values.*",
    "factor[].label",
    "factor[].level[].label",
    "factor[].level[].values.*",
    "action[].label",
    "action[].detail",
    "question.text",
    "block[].title",
    "block[].text",
    "block[].button",
    "block[].agree",
    "block[].decline",
    "block[].declined_title",
    "block[].declined_text",
    "block[].clause[].text",
    "block[].start.title",
    "block[].start.text",
    "block[].start.button",
    "block[].group[].text",
    "block[].question[].label",
    "block[].question[].text",
    "block[].question[].values.*",
    "block[].question[].actions[].label",
    "block[].question[].actions[].detail",
    "block[].hint",
    "block[].field[].label",
    "block[].field[].hint",
    "block[].field[].options[].label",
    "block[].field[].items[].text",
    "block[].field[].low",
    "block[].field[].high",
    "block[].field[].scale[]",
    "completion.title",
    "completion.text",
    "completion.screened_out.title",
    "completion.screened_out.text",
    "completion.failed_check.title",
    "completion.failed_check.text",
    "completion.timed_out.title",
    "completion.timed_out.text",
];

/// Names that are the same in most languages: they can be translated, and nobody is warned where they are not.
const SELDOM_TRANSLATED: [&str; 4] = [
    "contact",
    "reward_unit.name",
    "reward_unit.prefix",
    "reward_unit.suffix",
];

/// How many languages a study may have.
const MOST_LANGUAGES: usize = 20;

const TAG: &str = "language tags such as `en`, `de` or `pt-BR`";
const PAGE: &str = "page.";

/// One language of a study.
#[derive(Debug, Default)]
pub(super) struct Language {
    pub(super) tag: String,
    /// The paths of the file's texts, each with that of its translation.
    pub(super) texts: Vec<(KeyPath, KeyPath)>,
    /// The program's own words that are worded anew.
    pub(super) words: BTreeMap<String, String>,
    /// The texts of the file that are not translated, by their paths as the errors name them.
    pub(super) missing: Vec<String>,
}

/// Reads `languages` and `text`. The first language is that of the file's own texts.
pub(super) fn read(document: &Document<'_>) -> Result<Vec<Language>, Vec<Fault>> {
    let tags = tags(document).map_err(|fault| vec![fault])?;
    let mut faults = undeclared(document, &tags);
    let leaves = leaves(document);
    let mut languages = Vec::with_capacity(tags.len());
    for (index, tag) in tags.into_iter().enumerate() {
        languages.push(language(document, tag, index == 0, &leaves, &mut faults));
    }
    if faults.is_empty() {
        Ok(languages)
    } else {
        Err(faults)
    }
}

fn tags(document: &Document<'_>) -> Result<Vec<String>, Fault> {
    let at = KeyPath::root().key("languages");
    if !document.has(&at) {
        return Ok(vec!["en".to_owned()]);
    }
    let length = document.length_at(&at);
    if !(1..=MOST_LANGUAGES).contains(&length) {
        let allowed = format!(
            "a list of 1 to {MOST_LANGUAGES} languages, that of the file's own texts first"
        );
        return Err(at.fault("no such list", allowed));
    }
    let mut tags: Vec<String> = Vec::with_capacity(length);
    for index in 0..length {
        let at = at.index(index);
        let Some(tag) = document.text_at(&at) else {
            return Err(at.fault("no text", TAG));
        };
        if !is_tag(tag) {
            return Err(at.fault(rules::shown(tag), TAG));
        }
        if tags.iter().any(|known| known.eq_ignore_ascii_case(tag)) {
            let found = format!("{} for the second time", rules::shown(tag));
            return Err(at.fault(found, "each language once"));
        }
        tags.push(tag.to_owned());
    }
    Ok(tags)
}

/// Whether a text has the form of a language tag (RFC 5646): a language, then subtags.
fn is_tag(text: &str) -> bool {
    let mut parts = text.split('-');
    let language = parts.next().unwrap_or_default();
    let is_language =
        (2..=3).contains(&language.len()) && language.bytes().all(|byte| byte.is_ascii_lowercase());
    is_language
        && text.len() <= 20
        && parts.all(|part| {
            (2..=8).contains(&part.len()) && part.bytes().all(|byte| byte.is_ascii_alphanumeric())
        })
}

/// Texts of languages that the study does not name.
fn undeclared(document: &Document<'_>, tags: &[String]) -> Vec<Fault> {
    let at = KeyPath::root().key("text");
    if document.has(&at) && !document.is_table(&at) {
        return vec![at.fault(
            "another value",
            "a table for each language, such as [text.de]",
        )];
    }
    let mut faults = Vec::new();
    for key in document.keys_at(&at) {
        let here = at.key(&key);
        if !tags.contains(&key) {
            let known = tags.iter().map(String::as_str);
            let found = format!(
                "language {}, which `languages` does not name{}",
                rules::shown(&key),
                did_you_mean(&key, known.clone())
            );
            faults.push(here.fault(found, list(known)));
        } else if !document.is_table(&here) {
            faults.push(here.fault("another value", "a table of paths and texts"));
        }
    }
    faults
}

/// The paths of all values by the names that errors give them, each with whether it is a text for people.
fn leaves(document: &Document<'_>) -> Vec<(String, KeyPath, bool)> {
    document
        .leaves()
        .into_iter()
        .map(|path| (path.pattern(), path))
        .filter(|(pattern, _)| !pattern.starts_with("text.") && !pattern.starts_with("languages["))
        .map(|(pattern, path)| {
            let is_text = is_text(&pattern) && document.text_at(&path).is_some();
            (document.name(&path), path, is_text)
        })
        .collect()
}

fn is_text(pattern: &str) -> bool {
    if TEXTS.contains(&pattern) {
        return true;
    }
    pattern
        .rsplit_once('.')
        .is_some_and(|(table, _)| TEXTS.contains(&format!("{table}.*").as_str()))
}

fn language(
    document: &Document<'_>,
    tag: String,
    is_own: bool,
    leaves: &[(String, KeyPath, bool)],
    faults: &mut Vec<Fault>,
) -> Language {
    let table = KeyPath::root().key("text").key(&tag);
    let mut language = Language::default();
    let mut translated: BTreeSet<String> = BTreeSet::new();
    for name in document.keys_at(&table) {
        let at = table.key(&name);
        let read = match name.strip_prefix(PAGE) {
            Some(key) => page_word(document, key, &at).map(|text| {
                language.words.insert(key.to_owned(), text);
            }),
            None if is_own => Err(at.fault(
                format!("a translation into `{tag}`, the language of the file's own texts"),
                "`page.…` keys; change the file's own text in its place",
            )),
            None => own_text(document, &name, &at, leaves).map(|path| {
                language.texts.push((path, at));
                translated.insert(name);
            }),
        };
        if let Err(fault) = read {
            faults.push(fault);
        }
    }
    if !is_own {
        let missing = leaves.iter().filter(|(name, path, is_text)| {
            *is_text && !translated.contains(name) && needs_translation(document, path)
        });
        language.missing = missing.map(|(name, _, _)| name.clone()).collect();
    }
    language.tag = tag;
    language
}

/// The path of the file's own text that a translation is of.
fn own_text(
    document: &Document<'_>,
    name: &str,
    at: &KeyPath,
    leaves: &[(String, KeyPath, bool)],
) -> Result<KeyPath, Fault> {
    let texts = || {
        let texts = leaves.iter().filter(|(_, _, is_text)| *is_text);
        texts.map(|(name, _, _)| name.as_str())
    };
    let allowed = "the path of a text of this file in quotes, such as `\"title\"` or `\"block[consent].title\"`, or a `\"page.…\"` key";
    let (path, is_text) = leaves
        .iter()
        .find(|(known, _, _)| known == name)
        .map(|(_, path, is_text)| (path, *is_text))
        .ok_or_else(|| {
            let found = format!(
                "no text at {}{}",
                rules::shown(name),
                did_you_mean(name, texts())
            );
            at.fault(found, allowed)
        })?;
    if !is_text {
        let found = format!("{}, which is no text for people", rules::shown(name));
        return Err(at.fault(found, allowed));
    }
    if document.text_at(at).is_none() {
        return Err(at.fault("another value", "a text"));
    }
    Ok(path.clone())
}

/// Another wording for one of the program's own texts.
fn page_word(document: &Document<'_>, key: &str, at: &KeyPath) -> Result<String, Fault> {
    let keys = Words::keys();
    let Some(known) = Words::placeholders(key) else {
        let names = keys.iter().map(String::as_str);
        let found = format!(
            "unknown key {}{}",
            rules::shown(&format!("{PAGE}{key}")),
            did_you_mean(key, names)
        );
        return Err(at.fault(found, "a key of docs/STUDY-FORMAT.md, section `Languages`"));
    };
    let Some(text) = document.text_at(at) else {
        return Err(at.fault("another value", "a text"));
    };
    rules::line(text, at)?;
    let unknown = words::placeholders(text)
        .into_iter()
        .find(|name| !known.contains(name));
    match unknown {
        Some(name) => {
            let allowed = if known.is_empty() {
                "no placeholder".to_owned()
            } else {
                list(known.iter().map(|name| format!("{{{name}}}")))
            };
            Err(at.fault(format!("placeholder `{{{name}}}`"), allowed))
        }
        None => Ok(text.to_owned()),
    }
}

/// Whether a text holds words of its own, beside what is filled in.
fn needs_translation(document: &Document<'_>, path: &KeyPath) -> bool {
    if SELDOM_TRANSLATED.contains(&path.pattern().as_str()) {
        return false;
    }
    let text = document.text_at(path).unwrap_or_default();
    let mut depth = 0_usize;
    text.chars().any(|letter| {
        match letter {
            '{' => depth += 1,
            '}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        depth == 0 && letter.is_alphabetic()
    })
}
