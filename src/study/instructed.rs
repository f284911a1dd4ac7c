//! Form fields that ask for one certain answer, to see whether people read.

use serde_json::Value;

use super::definition::BlockBody;
use super::step::FieldKind;
use super::{BlockId, Study};

/// A form field, or an item of a scale, that asks for one certain answer. Another one is accepted and stored.
#[derive(Debug, Clone, PartialEq)]
pub struct InstructedItem {
    /// The form.
    pub block: BlockId,
    /// The name under which its answers stand: the id of the field or item.
    pub field: String,
    /// The text of the field or item.
    pub label: String,
    /// The answer that it asks for, as it is stored: an option's id, a list of them, or a number.
    pub expected: Value,
}

impl Study {
    /// The instructed-response items of all forms, in file order.
    pub fn instructed_items(&self) -> Vec<InstructedItem> {
        let mut items = Vec::new();
        for block in &self.blocks {
            let BlockBody::Form(form) = &block.body else {
                continue;
            };
            for field in &form.fields {
                let mut add = |field: &str, label: &str, expected: Value| {
                    items.push(InstructedItem {
                        block: block.id.clone(),
                        field: field.to_owned(),
                        label: label.to_owned(),
                        expected,
                    });
                };
                if let Some(expected) = &field.expected {
                    add(&field.id, &field.label, expected.clone());
                }
                if let FieldKind::Likert { items, .. } = &field.kind {
                    for item in items {
                        if let Some(expected) = item.expected {
                            add(&item.id, &item.text, Value::from(expected));
                        }
                    }
                }
            }
        }
        items
    }
}
