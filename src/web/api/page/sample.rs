//! A value that a schema allows, to show what an answer looks like.

use serde_json::{Map, Value, json};

use super::{entries, list, resolved};

/// Deeper than any answer; a schema that holds itself ends here.
const DEEPEST: usize = 12;

/// The schema's example, or a value made of its parts.
pub(super) fn sample(document: &Value, schema: &Value) -> Value {
    at_depth(document, schema, 0)
}

fn at_depth(document: &Value, schema: &Value, depth: usize) -> Value {
    let schema = resolved(document, schema);
    let below = |schema: &Value| at_depth(document, schema, depth + 1);
    if depth > DEEPEST {
        return Value::Null;
    }
    if !schema["example"].is_null() {
        return schema["example"].clone();
    }
    if let Some(first) = list(&schema["enum"]).next() {
        return first.clone();
    }
    let mut choices = list(&schema["oneOf"]).chain(list(&schema["anyOf"]));
    if let Some(choice) = choices.find(|choice| choice["type"] != "null") {
        return below(choice);
    }
    if schema["allOf"].is_array() {
        let parts = list(&schema["allOf"]).map(below);
        let properties = parts.filter_map(|part| part.as_object().cloned()).flatten();
        return Value::Object(properties.collect());
    }
    let name = match &schema["type"] {
        Value::Array(names) => names.iter().find(|name| *name != "null"),
        name => Some(name),
    };
    match name.and_then(Value::as_str).unwrap_or_default() {
        "object" => {
            let mut object: Map<String, Value> = entries(&schema["properties"])
                .map(|(name, property)| (name.to_owned(), below(property)))
                .collect();
            if schema["additionalProperties"].is_object() {
                object.insert("NAME".to_owned(), below(&schema["additionalProperties"]));
            }
            Value::Object(object)
        }
        "array" => json!([below(&schema["items"])]),
        "integer" => json!(1),
        "number" => json!(0.5),
        "boolean" => json!(true),
        "string" => json!("..."),
        _ => Value::Null,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_has_every_property() {
        let document = json!({ "components": { "schemas": {
            "Estimate": { "type": "object", "properties": { "value": { "type": ["number", "null"] } } },
        } } });
        let schema = json!({ "allOf": [
            { "type": "object", "properties": {
                "estimate": { "oneOf": [{ "type": "null" }, { "$ref": "#/components/schemas/Estimate" }] },
                "counts": { "type": "array", "items": { "type": "integer" } },
            } },
            { "type": "object", "properties": { "state": { "type": "string", "enum": ["ready"] } } },
        ] });
        assert_eq!(
            sample(&document, &schema),
            json!({ "estimate": { "value": 0.5 }, "counts": [1], "state": "ready" })
        );
    }
}
