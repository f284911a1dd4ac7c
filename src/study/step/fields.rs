//! What a page posted.

use std::collections::BTreeMap;

use serde::Deserialize;

/// The fields of one posted form by name. Checkboxes post one name several times: all values are kept, in order.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(from = "Vec<(String, String)>")]
pub struct Fields(BTreeMap<String, Vec<String>>);

impl Fields {
    /// A form without fields.
    pub fn new() -> Self {
        Self::default()
    }

    /// The value of a field; the last one where it was posted several times.
    pub fn get(&self, name: &str) -> Option<&String> {
        self.0.get(name)?.last()
    }

    /// All values of a field, in the order in which they were posted.
    pub fn all(&self, name: &str) -> &[String] {
        self.0.get(name).map_or(&[], Vec::as_slice)
    }
}

impl FromIterator<(String, String)> for Fields {
    fn from_iter<I: IntoIterator<Item = (String, String)>>(posted: I) -> Self {
        let mut fields = Self::default();
        for (name, value) in posted {
            fields.0.entry(name).or_default().push(value);
        }
        fields
    }
}

impl From<Vec<(String, String)>> for Fields {
    fn from(posted: Vec<(String, String)>) -> Self {
        posted.into_iter().collect()
    }
}

impl<const N: usize> From<[(String, String); N]> for Fields {
    fn from(posted: [(String, String); N]) -> Self {
        posted.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_is_posted_twice_keeps_both_values() {
        let posted = [("a", "1"), ("b", "2"), ("a", "3")];
        let fields: Fields = posted
            .map(|(name, value)| (name.to_owned(), value.to_owned()))
            .into();
        assert_eq!(fields.all("a"), ["1", "3"]);
        assert_eq!(fields.get("a").map(String::as_str), Some("3"));
        assert_eq!(fields.get("b").map(String::as_str), Some("2"));
        assert_eq!((fields.get("c"), fields.all("c").len()), (None, 0));
    }
}
