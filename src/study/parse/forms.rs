//! Form blocks.

use std::collections::BTreeSet;

use super::blocks::block_id;
use super::rules;
use crate::study::document::{Fault, KeyPath, did_you_mean, list};
use crate::study::file::{RawField, RawFieldKind, RawForm};
use crate::study::step::{Field, FieldKind, FieldOption, FormText};
use crate::study::template::Scope;

/// Names that every page's form uses for itself.
const RESERVED: [&str; 5] = ["step", "key", "action", "input", "consent"];

/// How many characters a line of text may have if the file sets no limit.
const DEFAULT_MAX_LENGTH: usize = 200;

/// How many it may have at most.
const LARGEST_MAX_LENGTH: usize = 5_000;

/// Reads a form block: its id and its text.
pub(super) fn read(
    raw: &RawForm,
    scope: &Scope<'_>,
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
        .map(|(index, raw)| field(raw, scope, &list.index(index)))
        .collect::<Result<Vec<Field>, Fault>>()?;
    check_names(&fields, &list)?;
    let form = FormText {
        title: rules::filled_line(&raw.title, scope, &at.key("title"))?,
        text_html: rules::filled_markdown(&raw.text, scope, &at.key("text"))?,
        button: rules::filled_line(&raw.button, scope, &at.key("button"))?,
        fields,
    };
    Ok((id, form))
}

/// No field may take a name that the page or the own words of another field need.
fn check_names(fields: &[Field], list: &KeyPath) -> Result<(), Fault> {
    let own_words: BTreeSet<String> = fields
        .iter()
        .filter(|field| matches!(field.kind, FieldKind::Choice { other: true, .. }))
        .map(Field::other_name)
        .collect();
    for (index, field) in fields.iter().enumerate() {
        if RESERVED.contains(&field.id.as_str()) || own_words.contains(&field.id) {
            let at = list.index(index).key("id");
            return Err(at.fault(
                rules::shown(&field.id),
                "another id: the page uses this one for itself",
            ));
        }
    }
    Ok(())
}

fn field(raw: &RawField, scope: &Scope<'_>, at: &KeyPath) -> Result<Field, Fault> {
    check_keys(raw, at)?;
    let kind = match raw.kind {
        RawFieldKind::Integer => integer(raw, at)?,
        RawFieldKind::Text => text(raw, at)?,
        RawFieldKind::Choice => choice(raw, scope, at)?,
    };
    if let Some(purpose) = &raw.autocomplete {
        let is_token = !purpose.is_empty()
            && purpose
                .bytes()
                .all(|byte| byte.is_ascii_lowercase() || byte == b'-');
        if !is_token {
            let allowed = "a purpose that HTML's autocomplete knows, such as `country-name`";
            return Err(at.key("autocomplete").fault(rules::shown(purpose), allowed));
        }
    }
    Ok(Field {
        id: raw.id.clone(),
        label: rules::filled_line(&raw.label, scope, &at.key("label"))?,
        hint: raw
            .hint
            .as_ref()
            .map(|hint| rules::filled_line(hint, scope, &at.key("hint")))
            .transpose()?,
        required: raw.required,
        kind,
        autocomplete: raw.autocomplete.clone(),
    })
}

/// Each kind of field has keys of its own.
fn check_keys(raw: &RawField, at: &KeyPath) -> Result<(), Fault> {
    let kinds_of_keys = [
        ("min", raw.min.is_some(), RawFieldKind::Integer),
        ("max", raw.max.is_some(), RawFieldKind::Integer),
        ("max_length", raw.max_length.is_some(), RawFieldKind::Text),
        ("options", raw.options.is_some(), RawFieldKind::Choice),
        ("other", raw.other.is_some(), RawFieldKind::Choice),
        ("expected", raw.expected.is_some(), RawFieldKind::Choice),
    ];
    for (key, is_given, kind) in kinds_of_keys {
        if is_given && kind != raw.kind {
            let found = format!("`{key}` for a field of kind {}", kind_name(raw.kind));
            return Err(at.key(key).fault(
                found,
                format!("`{key}` for the kind {} only", kind_name(kind)),
            ));
        }
    }
    Ok(())
}

fn kind_name(kind: RawFieldKind) -> &'static str {
    match kind {
        RawFieldKind::Integer => "`integer`",
        RawFieldKind::Text => "`text`",
        RawFieldKind::Choice => "`choice`",
    }
}

fn integer(raw: &RawField, at: &KeyPath) -> Result<FieldKind, Fault> {
    let bound = |key: &str, value: Option<i64>| {
        value.ok_or_else(|| {
            at.key(key).fault(
                "no value",
                "a whole number: the field needs a smallest and a largest one",
            )
        })
    };
    let (min, max) = (bound("min", raw.min)?, bound("max", raw.max)?);
    if min > max {
        return Err(at
            .key("max")
            .fault(max, format!("{min} or more, as `min` says")));
    }
    Ok(FieldKind::Integer { min, max })
}

fn text(raw: &RawField, at: &KeyPath) -> Result<FieldKind, Fault> {
    let max_length = raw.max_length.unwrap_or(DEFAULT_MAX_LENGTH);
    if !(1..=LARGEST_MAX_LENGTH).contains(&max_length) {
        return Err(at
            .key("max_length")
            .fault(max_length, format!("1 to {LARGEST_MAX_LENGTH} characters")));
    }
    Ok(FieldKind::Text { max_length })
}

fn choice(raw: &RawField, scope: &Scope<'_>, at: &KeyPath) -> Result<FieldKind, Fault> {
    let list_at = at.key("options");
    let raw_options = raw.options.as_deref().unwrap_or_default();
    let other = raw.other.unwrap_or(false);
    if raw_options.len() + usize::from(other) < 2 {
        return Err(list_at.fault(
            format!("{} options", raw_options.len()),
            "two options or more",
        ));
    }
    rules::distinct_ids(
        raw_options.iter().map(|option| option.id.as_str()),
        &list_at,
        "option",
    )?;
    let mut options = Vec::with_capacity(raw_options.len());
    for (index, option) in raw_options.iter().enumerate() {
        let at = list_at.index(index);
        if other && option.id == Field::OTHER {
            let allowed = "another id: `other = true` adds this option by itself";
            return Err(at.key("id").fault(rules::shown(&option.id), allowed));
        }
        let label = rules::filled_line(&option.label, scope, &at.key("label"))?;
        options.push(FieldOption {
            id: option.id.clone(),
            label,
        });
    }
    if let Some(expected) = &raw.expected {
        let ids = || options.iter().map(|option| option.id.as_str());
        if !ids().any(|id| id == expected) {
            let found = format!(
                "{}{}",
                rules::shown(expected),
                did_you_mean(expected, ids())
            );
            return Err(at.key("expected").fault(found, list(ids())));
        }
    }
    Ok(FieldKind::Choice {
        options,
        other,
        expected: raw.expected.clone(),
    })
}
