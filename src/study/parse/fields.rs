//! The fields of form blocks.

use serde_json::Value;

use super::rules;
use crate::study::document::{Fault, KeyPath, did_you_mean, list};
use crate::study::file::{RawAnswer, RawField, RawFieldKind, RawItem};
use crate::study::step::{Field, FieldKind, FieldOption, LikertItem};
use crate::study::template::Scope;

/// How many characters a line of text may have if the file sets no limit.
const DEFAULT_MAX_LENGTH: usize = 200;

/// The same for several lines.
const DEFAULT_LONG_MAX_LENGTH: usize = 2_000;

/// How many either may have at most.
const LARGEST_MAX_LENGTH: usize = 5_000;

/// How many digits a number may have after its point if the file sets none.
const DEFAULT_DIGITS: u32 = 2;

/// How many it may have at most.
const MOST_DIGITS: u32 = 6;

/// The largest size of a bound of whole numbers: up to it, each of them is exact.
const LARGEST_WHOLE: f64 = 9_007_199_254_740_992.0;

/// The largest size of a bound of decimal numbers: up to it, each one with the digits that are allowed is exact.
const LARGEST_DECIMAL: f64 = 1e9;

/// How many points a scale may have at most; wider ones fit on no phone.
const MOST_POINTS: usize = 11;

/// The keys that belong to some kinds only.
const KEYS: [(&str, &[RawFieldKind]); 13] = {
    use RawFieldKind::{Choice, Choices, Integer, Likert, LongText, Number, Text};
    [
        ("min", &[Integer, Number, Choices]),
        ("max", &[Integer, Number, Choices]),
        ("digits", &[Number]),
        ("max_length", &[Text, LongText]),
        ("options", &[Choice, Choices]),
        ("other", &[Choice]),
        ("scale", &[Likert]),
        ("points", &[Likert]),
        ("low", &[Likert]),
        ("high", &[Likert]),
        ("items", &[Likert]),
        ("correct", &[Integer, Number, Choice, Choices]),
        ("expected", &[Integer, Number, Choice, Choices]),
    ]
};

/// Reads one field.
pub(super) fn read(raw: &RawField, scope: &Scope<'_>, at: &KeyPath) -> Result<Field, Fault> {
    check_keys(raw, at)?;
    let kind = match raw.kind {
        RawFieldKind::Integer => integer(raw, at)?,
        RawFieldKind::Number => number(raw, at)?,
        RawFieldKind::Text => FieldKind::Text {
            max_length: max_length(raw, DEFAULT_MAX_LENGTH, at)?,
        },
        RawFieldKind::LongText => FieldKind::LongText {
            max_length: max_length(raw, DEFAULT_LONG_MAX_LENGTH, at)?,
        },
        RawFieldKind::Choice => FieldKind::Choice {
            options: options(raw, scope, at)?,
            other: raw.other.unwrap_or(false),
        },
        RawFieldKind::Choices => choices(raw, scope, at)?,
        RawFieldKind::Likert => likert(raw, scope, at)?,
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
    let named = |key: &str, answer: &Option<RawAnswer>| {
        answer
            .as_ref()
            .map(|answer| stored(answer, &kind, &at.key(key)))
            .transpose()
    };
    let correct = named("correct", &raw.correct)?;
    let expected = named("expected", &raw.expected)?;
    Ok(Field {
        id: raw.id.clone(),
        label: rules::filled_line(&raw.label, scope, &at.key("label"))?,
        hint: raw
            .hint
            .as_ref()
            .map(|hint| rules::filled_line(hint, scope, &at.key("hint")))
            .transpose()?,
        // An empty answer cannot be the right one, and is no attempt either.
        required: raw.required || correct.is_some(),
        kind,
        correct,
        expected,
        autocomplete: raw.autocomplete.clone(),
    })
}

/// Each kind of field has keys of its own.
fn check_keys(raw: &RawField, at: &KeyPath) -> Result<(), Fault> {
    let is_given = |key: &str| match key {
        "min" => raw.min.is_some(),
        "max" => raw.max.is_some(),
        "digits" => raw.digits.is_some(),
        "max_length" => raw.max_length.is_some(),
        "options" => raw.options.is_some(),
        "other" => raw.other.is_some(),
        "scale" => raw.scale.is_some(),
        "points" => raw.points.is_some(),
        "low" => raw.low.is_some(),
        "high" => raw.high.is_some(),
        "items" => raw.items.is_some(),
        "correct" => raw.correct.is_some(),
        "expected" => raw.expected.is_some(),
        _ => false,
    };
    for (key, kinds) in KEYS {
        if is_given(key) && !kinds.contains(&raw.kind) {
            let found = format!("`{key}` for a field of kind `{}`", kind_name(raw.kind));
            let kinds = list(kinds.iter().map(|kind| kind_name(*kind)));
            let noun = if kinds.contains(',') { "kinds" } else { "kind" };
            return Err(at
                .key(key)
                .fault(found, format!("`{key}` for the {noun} {kinds} only")));
        }
    }
    Ok(())
}

fn kind_name(kind: RawFieldKind) -> &'static str {
    match kind {
        RawFieldKind::Integer => "integer",
        RawFieldKind::Number => "number",
        RawFieldKind::Text => "text",
        RawFieldKind::LongText => "long_text",
        RawFieldKind::Choice => "choice",
        RawFieldKind::Choices => "choices",
        RawFieldKind::Likert => "likert",
    }
}

fn bounds(raw: &RawField, what: &str, largest: f64, at: &KeyPath) -> Result<(f64, f64), Fault> {
    let bound = |key: &str, value: Option<f64>| {
        let at = at.key(key);
        let value = value.ok_or_else(|| {
            let allowed = format!("{what}: the field needs a smallest and a largest one");
            at.fault("no value", allowed)
        })?;
        let is_fine = value.abs() <= largest;
        is_fine
            .then_some(value)
            .ok_or_else(|| at.fault(value, format!("{what} from -{largest} to {largest}")))
    };
    let (min, max) = (bound("min", raw.min)?, bound("max", raw.max)?);
    if min > max {
        return Err(at
            .key("max")
            .fault(max, format!("{min} or more, as `min` says")));
    }
    Ok((min, max))
}

fn integer(raw: &RawField, at: &KeyPath) -> Result<FieldKind, Fault> {
    let (min, max) = bounds(raw, "a whole number", LARGEST_WHOLE, at)?;
    for (key, bound) in [("min", min), ("max", max)] {
        if bound.fract() != 0.0 {
            return Err(at.key(key).fault(bound, "a whole number"));
        }
    }
    Ok(FieldKind::Integer {
        min: min as i64,
        max: max as i64,
    })
}

fn number(raw: &RawField, at: &KeyPath) -> Result<FieldKind, Fault> {
    let (min, max) = bounds(raw, "a number", LARGEST_DECIMAL, at)?;
    let digits = raw.digits.unwrap_or(DEFAULT_DIGITS);
    if !(1..=MOST_DIGITS).contains(&digits) {
        let allowed =
            format!("1 to {MOST_DIGITS} digits after the point; the kind `integer` for none");
        return Err(at.key("digits").fault(digits, allowed));
    }
    Ok(FieldKind::Number { min, max, digits })
}

fn max_length(raw: &RawField, default: usize, at: &KeyPath) -> Result<usize, Fault> {
    let max_length = raw.max_length.unwrap_or(default);
    if (1..=LARGEST_MAX_LENGTH).contains(&max_length) {
        Ok(max_length)
    } else {
        Err(at
            .key("max_length")
            .fault(max_length, format!("1 to {LARGEST_MAX_LENGTH} characters")))
    }
}

fn options(raw: &RawField, scope: &Scope<'_>, at: &KeyPath) -> Result<Vec<FieldOption>, Fault> {
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
            screens_out: option.screens_out,
        });
    }
    Ok(options)
}

fn choices(raw: &RawField, scope: &Scope<'_>, at: &KeyPath) -> Result<FieldKind, Fault> {
    let options = options(raw, scope, at)?;
    let count = |key: &str, value: Option<f64>, default: usize| match value {
        None => Ok(default),
        Some(value) if value.fract() == 0.0 && (0.0..=options.len() as f64).contains(&value) => {
            Ok(value as usize)
        }
        Some(value) => Err(at.key(key).fault(
            value,
            format!(
                "a whole number from 0 to {}, the number of options",
                options.len()
            ),
        )),
    };
    let is_required = raw.required || raw.correct.is_some();
    let min = count("min", raw.min, usize::from(is_required))?;
    let max = count("max", raw.max, options.len())?;
    if max == 0 {
        return Err(at.key("max").fault(max, "1 or more"));
    }
    if min > max {
        return Err(at
            .key("max")
            .fault(max, format!("{min} or more, as `min` says")));
    }
    Ok(FieldKind::Choices { options, min, max })
}

fn likert(raw: &RawField, scope: &Scope<'_>, at: &KeyPath) -> Result<FieldKind, Fault> {
    let points = points(raw, scope, at)?;
    let list_at = at.key("items");
    let raw_items = raw.items.as_deref().unwrap_or_default();
    if raw_items.is_empty() {
        return Err(list_at.fault("no item", "one item or more"));
    }
    rules::distinct_ids(
        raw_items.iter().map(|item| item.id.as_str()),
        &list_at,
        "item",
    )?;
    let items = raw_items
        .iter()
        .enumerate()
        .map(|(index, raw)| item(raw, points.len(), scope, &list_at.index(index)))
        .collect::<Result<Vec<LikertItem>, Fault>>()?;
    Ok(FieldKind::Likert { points, items })
}

fn item(
    raw: &RawItem,
    points: usize,
    scope: &Scope<'_>,
    at: &KeyPath,
) -> Result<LikertItem, Fault> {
    if let Some(expected) = raw.expected
        && !usize::try_from(expected).is_ok_and(|point| (1..=points).contains(&point))
    {
        let allowed = format!("the number of a point, from 1 to {points}");
        return Err(at.key("expected").fault(expected, allowed));
    }
    Ok(LikertItem {
        id: raw.id.clone(),
        text: rules::filled_line(&raw.text, scope, &at.key("text"))?,
        reverse: raw.reverse,
        expected: raw.expected,
    })
}

/// The texts of a scale's points: those of `scale`, or numbers with a text at each end.
fn points(raw: &RawField, scope: &Scope<'_>, at: &KeyPath) -> Result<Vec<String>, Fault> {
    let allowed = || format!("2 to {MOST_POINTS} points");
    let is_allowed = |points: usize| (2..=MOST_POINTS).contains(&points);
    match (&raw.scale, raw.points) {
        (Some(labels), None) => {
            let at = at.key("scale");
            if !is_allowed(labels.len()) {
                return Err(at.fault(format!("{} points", labels.len()), allowed()));
            }
            labels
                .iter()
                .enumerate()
                .map(|(index, label)| rules::filled_line(label, scope, &at.index(index)))
                .collect()
        }
        (None, Some(points)) => {
            if !is_allowed(points) {
                return Err(at.key("points").fault(points, allowed()));
            }
            let end = |key: &str, text: &Option<String>| match text {
                Some(text) => rules::filled_line(text, scope, &at.key(key)),
                None => Err(at
                    .key(key)
                    .fault("no text", "a text at each end of a scale of numbers")),
            };
            let (low, high) = (end("low", &raw.low)?, end("high", &raw.high)?);
            Ok((1..=points)
                .map(|point| match point {
                    1 => format!("1 {low}"),
                    last if last == points => format!("{last} {high}"),
                    between => between.to_string(),
                })
                .collect())
        }
        (Some(_), Some(_)) | (None, None) => Err(at.key("scale").fault(
            "not one of `scale` and `points`",
            "`scale`, a list of the texts of all points, or `points` with `low` and `high`",
        )),
    }
}

/// An answer in the form in which answers to this kind of field are stored.
fn stored(answer: &RawAnswer, kind: &FieldKind, at: &KeyPath) -> Result<Value, Fault> {
    let known = |id: &str, options: &[FieldOption]| {
        let ids = || options.iter().map(|option| option.id.as_str());
        if ids().any(|known| known == id) {
            return Ok(());
        }
        let found = format!("{}{}", rules::shown(id), did_you_mean(id, ids()));
        Err(at.fault(found, list(ids())))
    };
    match (kind, answer) {
        (FieldKind::Choice { options, .. }, RawAnswer::One(id)) => {
            known(id, options)?;
            Ok(Value::from(id.as_str()))
        }
        (FieldKind::Choices { options, min, max }, RawAnswer::Several(ids)) => {
            ids.iter().try_for_each(|id| known(id, options))?;
            let in_file_order: Vec<&str> = options
                .iter()
                .map(|option| option.id.as_str())
                .filter(|id| ids.iter().any(|given| given == id))
                .collect();
            if !(*min..=*max).contains(&in_file_order.len()) {
                let found = format!("{} options", in_file_order.len());
                return Err(at.fault(found, format!("as many as may be chosen: {min} to {max}")));
            }
            Ok(Value::from(in_file_order))
        }
        (FieldKind::Integer { min, max }, RawAnswer::Number(number))
            if number.fract() == 0.0 && (*min as f64..=*max as f64).contains(number) =>
        {
            Ok(Value::from(*number as i64))
        }
        (FieldKind::Number { min, max, .. }, RawAnswer::Number(number))
            if (*min..=*max).contains(number) =>
        {
            Ok(Value::from(*number))
        }
        (FieldKind::Choice { .. }, _) => Err(at.fault("no option's id", "the id of one option")),
        (FieldKind::Choices { .. }, _) => Err(at.fault("no list of ids", "a list of options' ids")),
        (FieldKind::Integer { min, max }, _) => {
            let allowed = format!("a whole number from {min} to {max}");
            Err(at.fault("another value", allowed))
        }
        (FieldKind::Number { min, max, .. }, _) => {
            Err(at.fault("another value", format!("a number from {min} to {max}")))
        }
        (FieldKind::Text { .. } | FieldKind::LongText { .. } | FieldKind::Likert { .. }, _) => {
            Err(at.fault("an answer to an open field", "no such key"))
        }
    }
}
