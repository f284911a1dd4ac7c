//! The file as a tree that knows where each key stands, so that errors can point there.

use std::fmt;
use std::ops::Range;

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::ParseError;

/// A study file's text, its name and its tree of keys.
pub(super) struct Document<'t> {
    file: &'t str,
    text: &'t str,
    root: Spanned<DeTable<'t>>,
    /// Set where texts of another language stand in place of the file's own.
    translation: Option<Translation>,
}

/// Which texts come from where.
struct Translation {
    language: String,
    /// The paths of texts, each with the path of the text in its place.
    replaced: Vec<(KeyPath, KeyPath)>,
}

/// Where a key stands, from the root of the file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct KeyPath(Vec<Segment>);

#[derive(Debug, Clone, PartialEq, Eq)]
enum Segment {
    Key(String),
    Index(usize),
}

/// Something in the file that is not allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) at: KeyPath,
    pub(super) found: String,
    pub(super) allowed: String,
}

impl KeyPath {
    pub(super) fn root() -> Self {
        Self::default()
    }

    /// The key `name` of the table here.
    pub(super) fn key(&self, name: &str) -> Self {
        self.with(Segment::Key(name.to_owned()))
    }

    /// The element `index` of the array here.
    pub(super) fn index(&self, index: usize) -> Self {
        self.with(Segment::Index(index))
    }

    /// A refusal of what stands here.
    pub(super) fn fault(&self, found: impl fmt::Display, allowed: impl fmt::Display) -> Fault {
        Fault {
            at: self.clone(),
            found: found.to_string(),
            allowed: allowed.to_string(),
        }
    }

    /// The path without ids and numbers: `block[].field[].label`.
    pub(super) fn pattern(&self) -> String {
        let mut pattern = String::new();
        for segment in &self.0 {
            match segment {
                Segment::Key(_) if !pattern.is_empty() => pattern.push('.'),
                Segment::Key(_) | Segment::Index(_) => {}
            }
            match segment {
                Segment::Key(key) => pattern.push_str(key),
                Segment::Index(_) => pattern.push_str("[]"),
            }
        }
        pattern
    }

    fn with(&self, segment: Segment) -> Self {
        Self(self.0.iter().cloned().chain([segment]).collect())
    }
}

/// What TOML does not allow, with the piece of text that it is about where that is short.
fn invalid_toml(text: &str, error: &toml::de::Error) -> String {
    let piece = error.span().and_then(|span| text.get(span));
    match piece.map(str::trim) {
        Some(piece) if (1..=40).contains(&piece.len()) && !piece.contains('\n') => {
            format!("invalid TOML: {} at `{piece}`", error.message())
        }
        Some(_) | None => format!("invalid TOML: {}", error.message()),
    }
}

impl<'t> Document<'t> {
    pub(super) fn parse(file: &'t str, text: &'t str) -> Result<Self, ParseError> {
        match DeTable::parse(text) {
            Ok(root) => Ok(Self {
                file,
                text,
                root,
                translation: None,
            }),
            Err(error) => Err(ParseError {
                file: file.to_owned(),
                line: error.span().map(|span| line_at(text, span.start)),
                key: String::new(),
                found: invalid_toml(text, &error),
                allowed: "TOML 1.0".to_owned(),
            }),
        }
    }

    /// Reads the whole file as a `T`.
    pub(super) fn read<T: DeserializeOwned>(&self) -> Result<T, ParseError> {
        let root = Spanned::new(
            self.root.span(),
            DeValue::Table(self.root.get_ref().clone()),
        );
        T::deserialize(ValueDeserializer::from(root)).map_err(|error| self.refuse_type(&error))
    }

    /// The same file with texts of another language: each text at the first path is the one at the second.
    pub(super) fn translated(&self, language: &str, replaced: Vec<(KeyPath, KeyPath)>) -> Self {
        let mut root = self.root.clone();
        for (own, other) in &replaced {
            let place = value_mut(root.get_mut(), &own.0);
            if let (Some(place), Some(text)) = (place, self.value_at(other)) {
                *place.get_mut() = text.clone();
            }
        }
        Self {
            file: self.file,
            text: self.text,
            root,
            translation: Some(Translation {
                language: language.to_owned(),
                replaced,
            }),
        }
    }

    /// The paths of all values that are neither tables nor lists, in file order.
    pub(super) fn leaves(&self) -> Vec<KeyPath> {
        let mut leaves = Vec::new();
        for (key, value) in self.root.get_ref() {
            collect_leaves(value, &KeyPath::root().key(key.get_ref()), &mut leaves);
        }
        leaves.sort_by_key(|(start, _)| *start);
        leaves.into_iter().map(|(_, path)| path).collect()
    }

    /// The names of the keys in the table at `path`, in file order; none where there is no table.
    pub(super) fn keys_at(&self, path: &KeyPath) -> Vec<String> {
        let table = self.value_at(path).and_then(|value| value.as_table());
        let mut keys: Vec<(usize, String)> = table
            .into_iter()
            .flatten()
            .map(|(key, _)| (key.span().start, key.get_ref().to_string()))
            .collect();
        keys.sort();
        keys.into_iter().map(|(_, key)| key).collect()
    }

    /// Whether a table stands at `path`.
    pub(super) fn is_table(&self, path: &KeyPath) -> bool {
        self.value_at(path).is_some_and(|value| value.is_table())
    }

    /// Whether anything stands at `path`.
    pub(super) fn has(&self, path: &KeyPath) -> bool {
        self.value_at(path).is_some()
    }

    /// Reads the whole file as a `T`, leaving out the keys at the top that cannot be read: each is one of the errors.
    /// Nothing is read where a required one is missing or faulty.
    pub(super) fn read_in_part<T: DeserializeOwned>(&self) -> (Option<T>, Vec<ParseError>) {
        let mut table = self.root.get_ref().clone();
        let mut errors = Vec::new();
        loop {
            let root = Spanned::new(self.root.span(), DeValue::Table(table.clone()));
            let error = match T::deserialize(ValueDeserializer::from(root)) {
                Ok(read) => return (Some(read), errors),
                Err(error) => error,
            };
            let path = error.span().map(|span| self.path_at(&span));
            let is_left_out = match path.as_ref().and_then(|path| path.0.first()) {
                Some(Segment::Key(key)) => table.remove(key.as_str()).is_some(),
                Some(Segment::Index(_)) | None => false,
            };
            // A key that is missing because it was left out was told already.
            if is_left_out || errors.is_empty() {
                errors.push(self.refuse_type(&error));
            }
            if !is_left_out {
                return (None, errors);
            }
        }
    }

    /// The text of the key `name` in the table at `path`.
    pub(super) fn text_at(&self, path: &KeyPath) -> Option<&str> {
        self.value_at(path)?.as_str()
    }

    /// The whole number of the key at `path`.
    pub(super) fn integer_at(&self, path: &KeyPath) -> Option<i64> {
        let number = self.value_at(path)?.as_integer()?;
        i64::from_str_radix(number.as_str(), number.radix()).ok()
    }

    /// How many elements the list at `path` has; none where there is no list.
    pub(super) fn length_at(&self, path: &KeyPath) -> usize {
        let list = self.value_at(path).and_then(|value| value.as_array());
        list.map_or(0, |list| list.len())
    }

    /// Reads the table at `path` as a `T`, leaving out the key `except`.
    pub(super) fn read_table<T: DeserializeOwned>(
        &self,
        path: &KeyPath,
        except: &str,
    ) -> Result<T, ParseError> {
        let Some((span, DeValue::Table(table))) = self.walk(path).pop() else {
            return Err(self.refuse(&path.fault("something else", "a table")));
        };
        let mut table = table.clone();
        table.remove(except);
        T::deserialize(ValueDeserializer::from(Spanned::new(
            span,
            DeValue::Table(table),
        )))
        .map_err(|error| self.refuse_type(&error))
    }

    /// The error for a fault, with the line of its key or of the nearest table around it.
    pub(super) fn refuse(&self, fault: &Fault) -> ParseError {
        let line = self
            .walk(&fault.at)
            .last()
            .map(|(span, _)| line_at(self.text, span.start));
        let found = match &self.translation {
            None => fault.found.clone(),
            Some(translation) => {
                let mut replaced = translation.replaced.iter();
                if let Some((_, source)) = replaced.find(|(own, _)| *own == fault.at) {
                    return self.refuse(&Fault {
                        at: source.clone(),
                        ..fault.clone()
                    });
                }
                // Where a file's own text is at fault, it is for what a translated value puts into it. What stands
                // below `text` says by itself which language it is of.
                if fault.at.0.first() == Some(&Segment::Key("text".to_owned())) {
                    fault.found.clone()
                } else {
                    format!("{} in the language `{}`", fault.found, translation.language)
                }
            }
        };
        ParseError {
            file: self.file.to_owned(),
            line,
            key: self.name(&fault.at),
            found,
            allowed: fault.allowed.clone(),
        }
    }

    /// The error for a key or value that is not of the kind that belongs there.
    fn refuse_type(&self, error: &toml::de::Error) -> ParseError {
        let path = error
            .span()
            .map(|span| self.path_at(&span))
            .unwrap_or_default();
        let line = error.span().map(|span| line_at(self.text, span.start));
        let (found, allowed) = match error.message().split_once(", expected ") {
            Some((found, allowed)) => (found, plain_type(allowed)),
            None => (error.message(), "a value for each key that is required"),
        };
        let found = found
            .replace("unknown field", "unknown key")
            .replace("missing field", "no key");
        let found = ["invalid type: ", "invalid value: ", "invalid length: "]
            .iter()
            .find_map(|prefix| found.strip_prefix(prefix))
            .unwrap_or(&found);
        let found = match quoted(found).first() {
            Some(name) if found.starts_with("unknown") => {
                format!("{found}{}", did_you_mean(name, quoted(allowed)))
            }
            Some(_) | None => found.to_owned(),
        };
        ParseError {
            file: self.file.to_owned(),
            line,
            key: self.name(&path),
            found,
            allowed: allowed.to_owned(),
        }
    }

    fn value_at(&self, path: &KeyPath) -> Option<&DeValue<'t>> {
        let found = self.walk(path);
        let is_whole = found.len() == path.0.len();
        found.last().filter(|_| is_whole).map(|(_, value)| *value)
    }

    /// Spans and values along a path, as far as it exists. The span of a key's value starts at the key.
    fn walk(&self, path: &KeyPath) -> Vec<(Range<usize>, &DeValue<'t>)> {
        let mut found: Vec<(Range<usize>, &DeValue<'t>)> = Vec::new();
        for segment in &path.0 {
            let table = match found.last() {
                None => Some(self.root.get_ref()),
                Some((_, value)) => value.as_table(),
            };
            let next = match segment {
                Segment::Key(name) => table
                    .and_then(|table| table.get_key_value(name.as_str()))
                    .map(|(key, value)| (key.span(), value.get_ref())),
                Segment::Index(index) => found
                    .last()
                    .and_then(|(_, value)| value.as_array())
                    .and_then(|array| array.get(*index))
                    .map(|value| (value.span(), value.get_ref())),
            };
            match next {
                Some(next) => found.push(next),
                None => break,
            }
        }
        found
    }

    /// The innermost key or element whose text holds `span`.
    fn path_at(&self, span: &Range<usize>) -> KeyPath {
        let mut best = (usize::MAX, KeyPath::root());
        search_table(self.root.get_ref(), &KeyPath::root(), span, &mut best);
        best.1
    }

    /// A path as people read it: `block[timed].limit_s`. An element without an id is named by its number.
    pub(super) fn name(&self, path: &KeyPath) -> String {
        let mut name = String::new();
        for (depth, segment) in path.0.iter().enumerate() {
            match segment {
                Segment::Key(key) => {
                    if !name.is_empty() {
                        name.push('.');
                    }
                    if key.contains(['.', '[', '"']) {
                        name.push_str(&format!("{key:?}"));
                    } else {
                        name.push_str(key);
                    }
                }
                Segment::Index(index) => {
                    let prefix = KeyPath(path.0[..=depth].to_vec());
                    match self.text_at(&prefix.key("id")) {
                        Some(id) => name.push_str(&format!("[{id}]")),
                        None => name.push_str(&format!("[#{}]", index + 1)),
                    }
                }
            }
        }
        name
    }
}

/// The closest of `known` to `name` as a question to append, or nothing.
pub(super) fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    known
        .into_iter()
        .map(|candidate| (strsim::jaro_winkler(name, candidate), candidate))
        .filter(|(similarity, _)| *similarity > 0.8)
        .max_by(|left, right| left.0.total_cmp(&right.0))
        .map(|(_, candidate)| format!(", did you mean `{candidate}`?"))
        .unwrap_or_default()
}

/// Names as a list for messages: `a`, `b`, `c`.
pub(super) fn list<T: AsRef<str>>(names: impl IntoIterator<Item = T>) -> String {
    let names: Vec<String> = names
        .into_iter()
        .map(|name| format!("`{}`", name.as_ref()))
        .collect();
    names.join(", ")
}

fn collect_leaves(
    value: &Spanned<DeValue<'_>>,
    path: &KeyPath,
    leaves: &mut Vec<(usize, KeyPath)>,
) {
    match value.get_ref() {
        DeValue::Table(table) => {
            for (key, value) in table {
                collect_leaves(value, &path.key(key.get_ref()), leaves);
            }
        }
        DeValue::Array(array) => {
            for (index, element) in array.iter().enumerate() {
                collect_leaves(element, &path.index(index), leaves);
            }
        }
        DeValue::String(_)
        | DeValue::Integer(_)
        | DeValue::Float(_)
        | DeValue::Boolean(_)
        | DeValue::Datetime(_) => leaves.push((value.span().start, path.clone())),
    }
}

fn value_mut<'d, 't>(
    table: &'d mut DeTable<'t>,
    path: &[Segment],
) -> Option<&'d mut Spanned<DeValue<'t>>> {
    let (Segment::Key(key), rest) = path.split_first()? else {
        return None;
    };
    let mut value = table.get_mut(key.as_str())?;
    for segment in rest {
        value = match (segment, value.get_mut()) {
            (Segment::Key(key), DeValue::Table(table)) => table.get_mut(key.as_str())?,
            (Segment::Index(index), DeValue::Array(array)) => array.get_mut(*index)?,
            (Segment::Key(_) | Segment::Index(_), _) => return None,
        };
    }
    Some(value)
}

fn search_table(
    table: &DeTable<'_>,
    path: &KeyPath,
    span: &Range<usize>,
    best: &mut (usize, KeyPath),
) {
    for (key, value) in table {
        let here = path.key(key.get_ref());
        keep_if_inside(&key.span(), &here, span, best);
        search_value(value, &here, span, best);
    }
}

fn search_value(
    value: &Spanned<DeValue<'_>>,
    path: &KeyPath,
    span: &Range<usize>,
    best: &mut (usize, KeyPath),
) {
    keep_if_inside(&value.span(), path, span, best);
    match value.get_ref() {
        DeValue::Table(table) => search_table(table, path, span, best),
        DeValue::Array(array) => {
            for (index, element) in array.iter().enumerate() {
                search_value(element, &path.index(index), span, best);
            }
        }
        DeValue::String(_)
        | DeValue::Integer(_)
        | DeValue::Float(_)
        | DeValue::Boolean(_)
        | DeValue::Datetime(_) => {}
    }
}

fn keep_if_inside(
    outer: &Range<usize>,
    path: &KeyPath,
    span: &Range<usize>,
    best: &mut (usize, KeyPath),
) {
    let is_inside = outer.start <= span.start && span.end <= outer.end;
    // Of equally long spans the later one is the deeper one: an element of an array of tables spans its header, as
    // the array does.
    if is_inside && outer.len() <= best.0 {
        *best = (outer.len(), path.clone());
    }
}

fn line_at(text: &str, offset: usize) -> usize {
    text.bytes()
        .take(offset)
        .filter(|byte| *byte == b'\n')
        .count()
        + 1
}

/// The names of Rust types in words.
fn plain_type(name: &str) -> &str {
    match name {
        "u32" | "u64" | "usize" => "a whole number, 0 or more",
        "i64" => "a whole number",
        "f64" => "a number",
        "a sequence" => "a list",
        "a map" => "a table",
        other => other,
    }
}

/// The parts of a message that stand between backticks.
fn quoted(message: &str) -> Vec<&str> {
    message.split('`').skip(1).step_by(2).collect()
}
