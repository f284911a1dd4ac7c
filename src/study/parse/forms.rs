//! Form blocks.

use super::blocks::block_id;
use super::{fields, rules};
use crate::study::document::{Fault, KeyPath};
use crate::study::file::RawForm;
use crate::study::markup;
use crate::study::step::{Check, Field, FormStep, FormText};
use crate::study::template::Scope;
use crate::study::words::Words;

/// Names that every page's form uses for itself.
const RESERVED: [&str; 6] = ["step", "key", "action", "input", "consent", "continue"];

/// How often a comprehension check may be answered if the file does not say.
const DEFAULT_ATTEMPTS: u32 = 2;

/// More attempts than this only let people guess.
const MOST_ATTEMPTS: u32 = 10;

/// Reads a form block: its id and its text.
pub(super) fn read(
    raw: &RawForm,
    scope: &Scope<'_>,
    words: &Words,
    at: &KeyPath,
) -> Result<(String, FormText), Fault> {
    let id = block_id(&raw.id, at)?;
    let list = at.key("field");
    if raw.field.is_empty() {
        return Err(list.fault("no field", "one field or more"));
    }
    rules::distinct_ids(
        raw.field.iter().map(|field| field.id.as_str()),
        &list,
        "field",
    )?;
    let fields = raw
        .field
        .iter()
        .enumerate()
        .map(|(index, raw)| fields::read(raw, scope, &list.index(index)))
        .collect::<Result<Vec<Field>, Fault>>()?;
    check_names(&fields, &list)?;
    check_size(&fields, &list)?;
    let form = FormText {
        title: rules::filled_line(&raw.title, scope, &at.key("title"))?,
        text_html: rules::filled_markdown(&raw.text, scope, &at.key("text"))?,
        button: rules::filled_line(&raw.button, scope, &at.key("button"))?,
        check: check(raw, &fields, scope, words, at)?,
        fields,
    };
    Ok((id, form))
}

/// No value may stand under a name that the page or another field needs.
fn check_names(fields: &[Field], list: &KeyPath) -> Result<(), Fault> {
    let refuse = |index: usize, name: &str, allowed: &str| {
        let at = list.index(index).key("id");
        Err(at.fault(rules::shown(name), allowed))
    };
    let taken = |by_others_than: usize, name: &str| {
        fields
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != by_others_than)
            .any(|(_, other)| other.value_names().iter().any(|taken| taken == name))
    };
    // A field's own id first: it is the one to change where it meets a name that follows from another id.
    for (index, field) in fields.iter().enumerate() {
        if RESERVED.contains(&field.id.as_str()) || taken(index, &field.id) {
            let allowed = "another id: the page uses this one for itself";
            return refuse(index, &field.id, allowed);
        }
    }
    for (index, field) in fields.iter().enumerate() {
        for name in field.value_names() {
            if RESERVED.contains(&name.as_str()) || taken(index, &name) {
                let allowed = "other ids: two answers of this form would have the same name";
                return refuse(index, &name, allowed);
            }
        }
    }
    Ok(())
}

/// What can be written into a form is sent at once.
fn check_size(fields: &[Field], list: &KeyPath) -> Result<(), Fault> {
    let most = FormStep::MOST_CHARACTERS;
    let characters: usize = fields.iter().map(Field::max_characters).sum();
    if characters <= most {
        return Ok(());
    }
    Err(list.fault(
        format!("texts of up to {characters} characters in one form"),
        format!("up to {most}: smaller `max_length`, or a second form"),
    ))
}

fn check(
    raw: &RawForm,
    fields: &[Field],
    scope: &Scope<'_>,
    words: &Words,
    at: &KeyPath,
) -> Result<Option<Check>, Fault> {
    if !fields.iter().any(|field| field.correct.is_some()) {
        let given = [
            ("attempts", raw.attempts.is_some()),
            ("hint", raw.hint.is_some()),
            ("then", raw.then.is_some()),
        ];
        let given = given.into_iter().find(|(_, is_given)| *is_given);
        return match given {
            Some((key, _)) => Err(at.key(key).fault(
                format!("`{key}` for a form without a right answer"),
                "`correct` in one field or more, which makes the form a comprehension check",
            )),
            None => Ok(None),
        };
    }
    let attempts = raw.attempts.unwrap_or(DEFAULT_ATTEMPTS);
    if !(1..=MOST_ATTEMPTS).contains(&attempts) {
        let allowed = format!("a whole number from 1 to {MOST_ATTEMPTS}");
        return Err(at.key("attempts").fault(attempts, allowed));
    }
    let then = raw.then.ok_or_else(|| {
        at.key("then").fault(
            "no value for a form with right answers",
            "`end` or `go_on`: what follows the last wrong attempt",
        )
    })?;
    let hint_html = match &raw.hint {
        Some(hint) => rules::filled_markdown(hint, scope, &at.key("hint"))?,
        None => markup::to_html(&words.check_hint),
    };
    Ok(Some(Check {
        attempts,
        hint_html,
        then,
    }))
}
