//! What kind of value a schema allows, in a few words.

use serde_json::Value;

use super::{list, text};

/// Words with the name of another schema between them, which the page links.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Kind {
    pub before: String,
    pub name: Option<String>,
    pub after: String,
}

impl Kind {
    pub(super) fn new(schema: &Value) -> Self {
        if let Some(name) = schema["$ref"]
            .as_str()
            .and_then(|path| path.rsplit('/').next())
        {
            return Self {
                name: Some(name.to_owned()),
                ..Self::default()
            };
        }
        let choices = list(&schema["oneOf"]).chain(list(&schema["anyOf"]));
        let (null, values): (Vec<&Value>, Vec<&Value>) =
            choices.partition(|choice| choice["type"] == "null");
        if let [one] = values[..] {
            let or_null = if null.is_empty() { "" } else { " or null" };
            return Self::new(one).followed_by(or_null);
        }
        if !values.is_empty() {
            let words: Vec<String> = values
                .into_iter()
                .map(|value| Self::new(value).words())
                .collect();
            return Self::plain(words.join(", or "));
        }
        let names: Vec<&str> = match &schema["type"] {
            Value::Array(names) => names.iter().map(text).collect(),
            name => vec![text(name)],
        };
        let is_nullable = names.contains(&"null");
        let name = names
            .into_iter()
            .find(|name| *name != "null")
            .unwrap_or_default();
        let kind = match name {
            "array" => Self::new(&schema["items"]).preceded_by("list of "),
            "object" if schema["additionalProperties"].is_object() => {
                Self::new(&schema["additionalProperties"]).preceded_by("by name: ")
            }
            "" if schema["allOf"].is_array() => Self::plain("object".to_owned()),
            "" => Self::plain("any JSON".to_owned()),
            _ if schema["enum"].is_array() => {
                let values: Vec<String> = list(&schema["enum"]).map(Value::to_string).collect();
                Self::plain(values.join(" or "))
            }
            name => Self::plain(format!("{name}{}", bounds(schema))),
        };
        kind.followed_by(if is_nullable { " or null" } else { "" })
    }

    fn plain(before: String) -> Self {
        Self {
            before,
            ..Self::default()
        }
    }

    fn preceded_by(mut self, words: &str) -> Self {
        self.before.insert_str(0, words);
        self
    }

    fn followed_by(mut self, words: &str) -> Self {
        self.after.push_str(words);
        self
    }

    fn words(self) -> String {
        format!(
            "{}{}{}",
            self.before,
            self.name.unwrap_or_default(),
            self.after
        )
    }
}

fn bounds(schema: &Value) -> String {
    match (&schema["minimum"], &schema["maximum"]) {
        (Value::Null, Value::Null) => String::new(),
        (low, Value::Null) => format!(", {low} or more"),
        (Value::Null, high) => format!(", up to {high}"),
        (low, high) => format!(", {low} to {high}"),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn kinds_are_told_in_words() {
        for (schema, words) in [
            (json!({ "type": "string" }), "string"),
            (json!({ "type": ["number", "null"] }), "number or null"),
            (
                json!({ "type": "integer", "minimum": 1, "maximum": 200 }),
                "integer, 1 to 200",
            ),
            (
                json!({ "type": "array", "items": { "$ref": "#/components/schemas/Pair" } }),
                "list of Pair",
            ),
            (
                json!({ "oneOf": [{ "type": "null" }, { "$ref": "#/components/schemas/Pair" }] }),
                "Pair or null",
            ),
            (
                json!({ "type": "object", "additionalProperties": { "type": "number" } }),
                "by name: number",
            ),
            (
                json!({ "type": "string", "enum": ["a", "b"] }),
                "\"a\" or \"b\"",
            ),
            (json!(true), "any JSON"),
        ] {
            assert_eq!(Kind::new(&schema).words(), words);
        }
    }
}
