//! YAML as a tree of values, each with the place that it came from.
//!
//! Scalars keep their text: whether `2400` is an integer, a rational or a real is said by the schema that reads the
//! tree, never by the spelling.

mod parse;

use super::text::Place;

pub(super) use parse::parse;

/// Files beyond this many bytes are refused unread: hundreds of times the length of a real recipe.
pub(super) const MAX_BYTES: usize = 1 << 20;

/// A value and its place.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Node {
    /// Where it stands; of a mapping or list, its first byte.
    pub place: Place,
    /// What it is.
    pub kind: Kind,
}

/// What a value is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Kind {
    /// Nothing: `~`, `null`, or a key without a value.
    Null,
    /// A number, a word, a text.
    Scalar {
        /// As written; of a quoted or folded text, what it means.
        text: String,
        /// Not quoted: may be a number or a truth value.
        plain: bool,
    },
    /// A sequence.
    List(Vec<Node>),
    /// A mapping, in file order, keys unique.
    Map(Vec<Entry>),
}

/// A key of a mapping and its value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    /// The key.
    pub key: String,
    /// Where the key stands.
    pub place: Place,
    /// Its value.
    pub value: Node,
}

impl Node {
    /// Dotted path and key of the value that stands at a place, such as `trajectories[0].name`.
    pub(super) fn find(&self, place: Place) -> Option<(String, Option<Place>)> {
        let seek = |step: &str, key: Option<Place>, value: &Self| {
            if value.place == place {
                return Some((step.to_owned(), key));
            }
            let (path, key) = value.find(place)?;
            let joint = if path.starts_with('[') { "" } else { "." };
            Some((format!("{step}{joint}{path}"), key))
        };
        match &self.kind {
            Kind::Map(entries) => entries.iter().find_map(|e| seek(&e.key, Some(e.place), &e.value)),
            Kind::List(items) => {
                items.iter().enumerate().find_map(|(i, item)| seek(&format!("[{i}]"), None, item))
            }
            Kind::Null | Kind::Scalar { .. } => None,
        }
    }
}
