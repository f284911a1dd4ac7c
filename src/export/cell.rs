//! What a cell of a table may hold.

use serde_json::Value;

/// A text as a cell that no spreadsheet takes for a formula: an apostrophe goes before `=`, `+`, `-`, `@`, a tab or a
/// carriage return at its start. Numbers are written without this function.
pub(super) fn text(text: &str) -> String {
    if text.starts_with(['=', '+', '-', '@', '\t', '\r']) {
        format!("'{text}")
    } else {
        text.to_owned()
    }
}

/// A number, or nothing.
pub(super) fn number<N: ToString>(value: Option<N>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// An answer to a field. Several values are joined by `|`.
pub(super) fn value(value: Option<&Value>) -> String {
    match value {
        None | Some(Value::Null) => String::new(),
        Some(Value::String(words)) => text(words),
        Some(Value::Bool(flag)) => flag.to_string(),
        Some(Value::Number(number)) => number.to_string(),
        Some(Value::Array(values)) => {
            let parts: Vec<String> = values
                .iter()
                .map(|value| match value {
                    Value::String(words) => words.clone(),
                    Value::Null
                    | Value::Bool(_)
                    | Value::Number(_)
                    | Value::Array(_)
                    | Value::Object(_) => value.to_string(),
                })
                .collect();
            text(&parts.join("|"))
        }
        Some(object @ Value::Object(_)) => object.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn no_text_is_a_formula() {
        for formula in ["=1+1", "+1", "-cmd", "@x", "\tx", "\rx"] {
            assert_eq!(text(formula), format!("'{formula}"));
        }
        assert_eq!(text("prolific"), "prolific");
        assert_eq!(value(Some(&json!(["=a", "b"]))), "'=a|b");
    }

    #[test]
    fn numbers_stay_numbers() {
        assert_eq!(value(Some(&json!(-5))), "-5");
        assert_eq!(number(Some(-500)), "-500");
        assert_eq!(number::<u64>(None), "");
        assert_eq!(value(None), "");
    }
}
