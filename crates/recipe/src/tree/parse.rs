//! Parser of YAML text into the tree.

use super::{MAX_BYTES, MappingEntry, NodeKind, TreeNode};
use crate::problem::{FieldProblem, quote_text};
use crate::text::{SourceText, TextSpan};
use serde::Deserialize;
use serde::de::{self, Visitor};
use serde_saphyr::{MergeKeyPolicy, NonFiniteFloatPolicy, Spanned};
use std::fmt;
use unicode_normalization::is_nfc;

/// Parses a file that contains one mapping, or nothing (`None`). `file` is the index for its
/// places.
pub(crate) fn parse_tree(text: &SourceText, file: u32) -> Result<Option<TreeNode>, Vec<FieldProblem>> {
    let body = text.body.as_str();
    refuse_tabs(body, file).map_err(|problem| vec![problem])?;
    let raw: RawValue = serde_saphyr::from_str_with_options(body, parser_options(body))
        .map_err(|e| vec![problem_of(&e, text, file)])?;
    let mut problems = Vec::new();
    let mut node = raw.settle(body, file, &mut problems);
    restore_switch_keys(&mut node);
    match node.kind {
        _ if !problems.is_empty() => Err(problems),
        NodeKind::Null => Ok(None),
        NodeKind::Map(_) => Ok(Some(node)),
        NodeKind::Scalar { .. } | NodeKind::Refused | NodeKind::List(_) => {
            let help = "write keys with values, such as version: 1";
            Err(vec![FieldProblem::new("the file is not a mapping").help(help).at(node.place)])
        }
    }
}

/// Restores the keys `on` and `off` of thresholds. In YAML 1.1 they are truth values, so tools such as
/// PyYAML write them back as `true` and `false`.
fn restore_switch_keys(node: &mut TreeNode) {
    match &mut node.kind {
        NodeKind::List(items) => items.iter_mut().for_each(restore_switch_keys),
        NodeKind::Map(entries) => {
            for MappingEntry { key, value, .. } in entries {
                if let (true, NodeKind::Map(sides)) = (key == "threshold", &mut value.kind) {
                    restore_sides(sides);
                }
                restore_switch_keys(value);
            }
        }
        NodeKind::Null | NodeKind::Refused | NodeKind::Scalar { .. } => {}
    }
}

fn restore_sides(entries: &mut [MappingEntry]) {
    for (written, key) in [("true", "on"), ("false", "off")] {
        // Both spellings at once are a mistake, which the reader reports.
        if entries.iter().all(|entry| entry.key != key) {
            let entry = entries.iter_mut().find(|entry| entry.key == written);
            entry.into_iter().for_each(|entry| entry.key = key.to_owned());
        }
    }
}

/// Bytes that the aliases of a file repeat together.
const MAX_REPEATED: usize = 8 << 20;

/// Options of the parser. The limits are far above any recipe and far below sizes that cost time or
/// memory. `<<` is refused, because values are shared through `defaults.yaml`.
fn parser_options(body: &str) -> serde_saphyr::Options {
    // The library counts what aliases repeat in values, not in bytes.
    let max_aliases = (MAX_REPEATED / body.len().max(1)).min(100);
    serde_saphyr::options! {
        emit_comments: false,
        merge_keys: MergeKeyPolicy::Error,
        non_finite_float_policy: NonFiniteFloatPolicy::PassThrough,
        reject_unsupported_tags: true,
        strict_booleans: true,
        with_snippet: false,
        budget: serde_saphyr::budget! {
            max_aliases: max_aliases,
            max_anchors: 100,
            max_depth: 32,
            max_documents: 1,
            max_events: 50_000,
            max_nodes: 20_000,
            max_recorded_anchor_events: 20_000,
            max_recorded_anchor_bytes: MAX_BYTES,
        },
    }
}

/// Refuses tabs. YAML forbids them in indentation, and tools disagree on their width elsewhere.
fn refuse_tabs(body: &str, file: u32) -> Result<(), FieldProblem> {
    let Some(at) = body.match_indices('\t').map(|(at, _)| at).find(|at| !in_comment(body, *at)) else {
        return Ok(());
    };
    let start = u32::try_from(at).unwrap_or(u32::MAX);
    Err(FieldProblem::new("a tab character").help("indent and separate with spaces").at(TextSpan {
        file,
        start,
        end: start + 1,
    }))
}

fn in_comment(body: &str, at: usize) -> bool {
    // A `#` in the middle of a word begins no comment.
    let line = &body[body[..at].rfind(['\n', '\r']).map_or(0, |i| i + 1)..at];
    line.starts_with('#') || line.contains(" #")
}

/// Translates the YAML reader's message into clearer words where they exist.
fn problem_of(error: &serde_saphyr::Error, text: &SourceText, file: u32) -> FieldProblem {
    let place = error.location().map(|location| {
        let start = text.offset(usize_of(location.line()), usize_of(location.column()));
        let bytes = location.span().byte_len().map_or(1, usize_of);
        TextSpan { file, start: short_offset(start), end: short_offset(start + bytes) }
    });
    let problem = parser_problem(error.without_snippet());
    place.into_iter().fold(problem, FieldProblem::at)
}

fn parser_problem(error: &serde_saphyr::Error) -> FieldProblem {
    use serde_saphyr::Error as E;
    use serde_saphyr::budget::BudgetBreach;
    match error {
        E::AliasError { error, .. } => parser_problem(error.without_snippet()),
        E::DuplicateMappingKey { key, .. } => {
            let key = key.as_deref().map_or_else(String::new, |key| format!(" {}", quote_text(key)));
            FieldProblem::new(format!("duplicate key{key}")).help("write each key once in a mapping")
        }
        E::MultipleDocuments { .. } | E::Budget { breach: BudgetBreach::Documents { .. }, .. } => {
            FieldProblem::new("a second document").help("one file holds one recipe")
        }
        E::Budget { .. }
        | E::AliasReplayLimitExceeded { .. }
        | E::AliasReplayStackDepthExceeded { .. }
        | E::AliasExpansionLimitExceeded { .. } => {
            FieldProblem::new("more values, anchors or levels than a recipe has").help("is it a recipe?")
        }
        E::MergeKeyNotAllowed { .. } => FieldProblem::new("merge keys (<<) are not part of a recipe")
            .help("write shared values into defaults.yaml"),
        E::UnknownAnchor { .. } => FieldProblem::new("not valid YAML: an alias without its anchor"),
        other => FieldProblem::new(format!("not valid YAML: {}", parser_sentence(other))),
    }
}

/// Returns the reader's message without its ` at line L, column C`.
fn parser_sentence(error: &serde_saphyr::Error) -> String {
    let full = error.render_with_formatter(&serde_saphyr::UserMessageFormatter);
    // The fault states the place itself.
    let head = full.rsplit_once(" at line ").map_or(full.as_str(), |(head, _)| head);
    head.lines().next().unwrap_or_default().to_owned()
}

fn usize_of(n: u64) -> usize {
    usize::try_from(n).unwrap_or(usize::MAX)
}

/// Converts an offset. Offsets fit because files are shorter than [`MAX_BYTES`].
fn short_offset(offset: usize) -> u32 {
    u32::try_from(offset).unwrap_or(u32::MAX)
}

/// A value as the YAML reader returns it.
struct RawValue(Spanned<ValueShape>);

enum ValueShape {
    Null,
    /// A scalar whose type shows only in its text.
    Typed,
    Text(String),
    List(Vec<RawValue>),
    Map(Vec<(Spanned<String>, RawValue)>),
}

impl RawValue {
    fn settle(self, body: &str, file: u32, problems: &mut Vec<FieldProblem>) -> TreeNode {
        let place = place_of(&self.0.defined, file);
        let written = body.get(place.start as usize..place.end as usize).unwrap_or_default();
        let kind = match self.0.value {
            ValueShape::Null => NodeKind::Null,
            // The text as written, because a number of the parser has lost its digits.
            ValueShape::Typed => NodeKind::Scalar { text: written.to_owned(), plain: true },
            ValueShape::Text(text) => {
                refuse_other_forms(&text, place, problems);
                // Quotes and escapes make the written text differ from the decoded one.
                let plain = written == text;
                NodeKind::Scalar { text, plain }
            }
            ValueShape::List(items) => {
                NodeKind::List(items.into_iter().map(|item| item.settle(body, file, problems)).collect())
            }
            ValueShape::Map(entries) => NodeKind::Map(
                entries
                    .into_iter()
                    .map(|(key, value)| {
                        let place = place_of(&key.defined, file);
                        refuse_other_forms(&key.value, place, problems);
                        MappingEntry { key: key.value, place, value: value.settle(body, file, problems) }
                    })
                    .collect(),
            ),
        };
        TreeNode { place, kind }
    }
}

/// Refuses text in other Unicode forms. Two spellings that look the same would be two names.
fn refuse_other_forms(text: &str, place: TextSpan, problems: &mut Vec<FieldProblem>) {
    if !is_nfc(text) {
        let help = "write it in Unicode's composed form (NFC), as keyboards do";
        problems.push(FieldProblem::new("a text that is not in Unicode normal form C").help(help).at(place));
    }
}

fn place_of(location: &serde_saphyr::Location, file: u32) -> TextSpan {
    let span = location.span();
    let start = span.byte_offset().map_or(0, usize_of);
    let end = start + span.byte_len().map_or(0, usize_of);
    TextSpan { file, start: short_offset(start), end: short_offset(end) }
}

impl<'de> Deserialize<'de> for RawValue {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Spanned::deserialize(deserializer).map(Self)
    }
}

impl<'de> Deserialize<'de> for ValueShape {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ShapeVisitor)
    }
}

struct ShapeVisitor;

impl<'de> Visitor<'de> for ShapeVisitor {
    type Value = ValueShape;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_unit<E>(self) -> Result<ValueShape, E> {
        Ok(ValueShape::Null)
    }

    fn visit_bool<E>(self, _: bool) -> Result<ValueShape, E> {
        Ok(ValueShape::Typed)
    }

    fn visit_i64<E>(self, _: i64) -> Result<ValueShape, E> {
        Ok(ValueShape::Typed)
    }

    fn visit_u64<E>(self, _: u64) -> Result<ValueShape, E> {
        Ok(ValueShape::Typed)
    }

    fn visit_f64<E>(self, _: f64) -> Result<ValueShape, E> {
        Ok(ValueShape::Typed)
    }

    fn visit_str<E>(self, text: &str) -> Result<ValueShape, E> {
        Ok(ValueShape::Text(text.to_owned()))
    }

    fn visit_seq<A: de::SeqAccess<'de>>(self, mut items: A) -> Result<ValueShape, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(ValueShape::List(list))
    }

    fn visit_map<A: de::MapAccess<'de>>(self, mut entries: A) -> Result<ValueShape, A::Error> {
        let mut map = Vec::new();
        while let Some(entry) = entries.next_entry()? {
            map.push(entry);
        }
        Ok(ValueShape::Map(map))
    }
}
