//! Form fields that ask for one certain answer, to see whether people read.

use super::definition::BlockBody;
use super::step::FieldKind;
use super::{BlockId, Study};

/// A form field that asks for one certain option. Choosing another one is accepted and stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InstructedItem {
    /// The form.
    pub block: BlockId,
    /// The field's id.
    pub field: String,
    /// The field's text.
    pub label: String,
    /// The id of the option that it asks for.
    pub expected: String,
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
                if let FieldKind::Choice {
                    expected: Some(expected),
                    ..
                } = &field.kind
                {
                    items.push(InstructedItem {
                        block: block.id.clone(),
                        field: field.id.clone(),
                        label: field.label.clone(),
                        expected: expected.clone(),
                    });
                }
            }
        }
        items
    }
}
