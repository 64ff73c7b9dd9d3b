//! YAML as a tree of values, each with its place in the file.
//!
//! Scalars keep their text. The schema that reads the tree decides if `2400` is an integer, a
//! rational or a real; the spelling never decides.

mod parse;

use super::text::TextSpan;

pub(super) use parse::parse_tree;

/// Maximum file size in bytes, hundreds of times the length of a real recipe. Larger files are
/// refused unread.
pub(super) const MAX_BYTES: usize = 1 << 20;

/// A value and its place.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TreeNode {
    /// Place of the value; of a mapping or list, its first byte.
    pub place: TextSpan,
    /// Kind and content.
    pub kind: NodeKind,
}

/// Kind and content of a value.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum NodeKind {
    /// No value: `~`, `null`, or a key without a value.
    Null,
    /// A number, a word or a text.
    Scalar {
        /// The text as written; the decoded text of a quoted or folded scalar.
        text: String,
        /// True if not quoted; the scalar may then be a number or a truth value.
        plain: bool,
    },
    /// A sequence.
    List(Vec<TreeNode>),
    /// A mapping, in file order, keys unique.
    Map(Vec<MappingEntry>),
    /// A value with a fault that is already reported.
    Refused,
}

/// A key of a mapping and its value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MappingEntry {
    /// The key.
    pub key: String,
    /// Place of the key.
    pub place: TextSpan,
    /// Its value.
    pub value: TreeNode,
}

impl TreeNode {
    /// Returns the dotted path of the value at a place, for example `trajectories[0].name`, and the
    /// place of its key.
    pub(super) fn find(&self, place: TextSpan) -> Option<(String, Option<TextSpan>)> {
        let seek = |step: &str, key: Option<TextSpan>, value: &Self| {
            if value.place == place {
                return Some((step.to_owned(), key));
            }
            let (path, key) = value.find(place)?;
            let joint = if path.starts_with('[') { "" } else { "." };
            Some((format!("{step}{joint}{path}"), key))
        };
        match &self.kind {
            NodeKind::Map(entries) => entries.iter().find_map(|e| seek(&e.key, Some(e.place), &e.value)),
            NodeKind::List(items) => {
                items.iter().enumerate().find_map(|(i, item)| seek(&format!("[{i}]"), None, item))
            }
            NodeKind::Null | NodeKind::Refused | NodeKind::Scalar { .. } => None,
        }
    }
}
