//! Conversion of the value tree to typed values through serde, with a place for every fault.
//!
//! A plain serde reader stops at the first fault. This reader continues: it reports unknown fields
//! and skips them, and a [`super::field::Field`] with a faulty value reports it and counts as bad.

mod access;
mod number;

pub(super) use number::parse_real;

use super::field::{FIELD, LITERAL};
use super::problem::{FieldProblem, bare_text, quote_text};
use super::tree::{MappingEntry, NodeKind, TreeNode};
use access::{EnumChoice, FieldAccess, ListItems, MapEntries};
use serde::de::{Deserializer, Visitor};
use serde::forward_to_deserialize_any;
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;

/// Faults found so far.
pub(super) type Problems = RefCell<Vec<FieldProblem>>;

/// Reads one value of the tree.
#[derive(Clone, Copy)]
pub(super) struct TreeReader<'a> {
    node: &'a TreeNode,
    problems: &'a Problems,
    choices: Option<&'a ChoiceNodes>,
}

/// Values that the schema reads as an enumeration, by their address.
pub(super) type ChoiceNodes = RefCell<BTreeSet<*const TreeNode>>;

impl<'a> TreeReader<'a> {
    /// Creates a reader of `node` that adds its faults to `problems`.
    pub(super) fn new(node: &'a TreeNode, problems: &'a Problems) -> Self {
        Self { node, problems, choices: None }
    }

    /// Returns the reader that also notes each value that is read as an enumeration.
    pub(super) fn noting(self, choices: &'a ChoiceNodes) -> Self {
        Self { choices: Some(choices), ..self }
    }

    fn report(self, problem: FieldProblem) {
        self.problems.borrow_mut().push(problem.at(self.node.place));
    }

    fn of(self, node: &'a TreeNode) -> Self {
        Self { node, ..self }
    }

    /// Sets the place of a problem to this value, unless it has a place.
    fn here(self) -> impl Fn(FieldProblem) -> FieldProblem {
        move |problem| problem.at(self.node.place)
    }

    /// Creates the problem of a value that has the wrong kind.
    fn wanted(self, what: &str) -> FieldProblem {
        FieldProblem::of_field(format!("is {}, wanted {what}", self.node.kind.described()))
            .at(self.node.place)
    }

    fn entries(self) -> Result<&'a [MappingEntry], FieldProblem> {
        match &self.node.kind {
            NodeKind::Map(entries) => Ok(entries),
            _ => Err(self.wanted("a mapping")),
        }
    }

    fn items(self) -> Result<&'a [TreeNode], FieldProblem> {
        match &self.node.kind {
            NodeKind::List(items) => Ok(items),
            NodeKind::Scalar { text, .. } => {
                Err(self.wanted("a list").help(format!("write it in brackets: [{text}]")))
            }
            _ => Err(self.wanted("a list")),
        }
    }

    fn text(self, what: &str) -> Result<&'a str, FieldProblem> {
        match &self.node.kind {
            NodeKind::Scalar { text, .. } => Ok(text),
            _ => Err(self.wanted(what)),
        }
    }

    /// Returns the text of an unquoted scalar, which may be a number or a truth value.
    fn plain(self, what: &str) -> Result<&'a str, FieldProblem> {
        match &self.node.kind {
            NodeKind::Scalar { text, plain: true } => Ok(text),
            // A quoted number is a text in YAML, which surprises many authors.
            NodeKind::Scalar { text, plain: false } if number::parse_real(text).is_some() => {
                Err(self.wanted(what).help("write the number without quotes"))
            }
            _ => Err(self.wanted(what)),
        }
    }

    fn whole(self, low: i128, high: i128) -> Result<i128, FieldProblem> {
        let wanted = "a whole number";
        let text = self.plain(wanted)?;
        if let Some(digits) = number::after_zeros(text) {
            let help = format!("write {digits}, or 0o{digits} for an octal number");
            return Err(self.wanted("a whole number without zeros before it").help(help));
        }
        let whole = number::parse_whole(text).ok_or_else(|| self.wanted(wanted))?;
        let within = (low..=high).contains(&whole);
        let range = if high > i32::MAX.into() {
            format!("of at least {low}")
        } else {
            format!("from {low} to {high}")
        };
        if within { Ok(whole) } else { Err(self.wanted(&format!("{wanted} {range}"))) }
    }

    /// Returns the one key of an enumeration, or its bare word.
    fn choice(self, variants: &[&str]) -> Result<EnumChoice<'a>, FieldProblem> {
        let one_of = || format!("one of {}", variants.join(", "));
        let (name, place, value) = match &self.node.kind {
            NodeKind::Scalar { text, .. } => (text, self.node.place, None),
            NodeKind::Map(entries) => match entries.as_slice() {
                [entry] => (&entry.key, entry.place, Some(&entry.value)),
                several => {
                    let message = format!("has {} keys, wanted {}", several.len(), one_of());
                    return Err(FieldProblem::of_field(message).at(self.node.place));
                }
            },
            _ => return Err(self.wanted(&one_of())),
        };
        if !variants.contains(&name.as_str()) {
            return Err(FieldProblem::unknown_name("choice", name, variants).at(place));
        }
        Ok(EnumChoice { reader: self, name, value })
    }
}

impl NodeKind {
    /// Describes the value for a message: its kind, and its text if it has one.
    fn described(&self) -> String {
        match self {
            Self::Null | Self::Refused => "empty".into(),
            Self::Scalar { text, plain: true } => bare_text(text),
            Self::Scalar { text, plain: false } => format!("the text {}", quote_text(text)),
            Self::List(items) => format!("a list of {}", items.len()),
            Self::Map(_) => "a mapping".into(),
        }
    }
}

// All integer types go through one range check, so that all have the same message.
macro_rules! whole_numbers {
    ($($method:ident $visit:ident $ty:ty),*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
            let n = self.whole(<$ty>::MIN.into(), <$ty>::MAX.into())?;
            visitor.$visit(<$ty>::try_from(n).expect("within the type's range")).map_err(self.here())
        }
    )*};
}

impl<'de> Deserializer<'de> for TreeReader<'_> {
    type Error = FieldProblem;

    whole_numbers!(
        deserialize_u8 visit_u8 u8, deserialize_u16 visit_u16 u16, deserialize_u32 visit_u32 u32,
        deserialize_u64 visit_u64 u64, deserialize_i8 visit_i8 i8, deserialize_i16 visit_i16 i16,
        deserialize_i32 visit_i32 i32, deserialize_i64 visit_i64 i64
    );

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        match &self.node.kind {
            NodeKind::Null | NodeKind::Refused => self.deserialize_unit(visitor),
            NodeKind::List(_) => self.deserialize_seq(visitor),
            NodeKind::Map(_) => self.deserialize_map(visitor),
            NodeKind::Scalar { text, plain: true } => match text.as_str() {
                "true" | "false" => self.deserialize_bool(visitor),
                text if text.parse::<i64>().is_ok() => self.deserialize_i64(visitor),
                text if number::parse_real(text).is_some() => self.deserialize_f64(visitor),
                _ => self.deserialize_str(visitor),
            },
            NodeKind::Scalar { plain: false, .. } => self.deserialize_str(visitor),
        }
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        let value = match self.plain("true or false")? {
            "true" => true,
            "false" => false,
            text => {
                let is_yes = ["true", "yes", "on", "1"].contains(&text.to_lowercase().as_str());
                let help = format!("write {is_yes}");
                return Err(self.wanted("true or false").help(help));
            }
        };
        visitor.visit_bool(value).map_err(self.here())
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        let real =
            number::parse_real(self.plain("a number")?).ok_or_else(|| self.wanted("a finite number"))?;
        visitor.visit_f64(real).map_err(self.here())
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        visitor.visit_str(self.text("a text")?).map_err(self.here())
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        visitor.visit_some(self)
    }

    fn deserialize_unit<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        match self.node.kind {
            NodeKind::Null => visitor.visit_unit().map_err(self.here()),
            _ => Err(self.wanted("no value")),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, FieldProblem> {
        // The name tells the reader who asks: serde has no other way to pass a place.
        match name {
            FIELD => visitor.visit_seq(FieldAccess { reader: self, step: 0 }),
            LITERAL => visitor.visit_str(self.text("a number")?),
            _ => visitor.visit_newtype_struct(self),
        }
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        let items = self.items()?.iter();
        visitor.visit_seq(ListItems { reader: self, items }).map_err(self.here())
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, FieldProblem> {
        if self.items()?.len() == len {
            self.deserialize_seq(visitor)
        } else {
            Err(self.wanted(&format!("a list of {len}")))
        }
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        let last = Cell::new(self.node.place);
        let entries =
            MapEntries { reader: self, rest: self.entries()?, fields: None, value: None, last: &last };
        visitor.visit_map(entries).map_err(|problem| problem.at(last.get()))
    }

    /// All keys outside `fields` are reported here, and only here.
    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, FieldProblem> {
        let such_as = |problem: FieldProblem| match fields {
            [first, ..] => problem.help(format!("write keys in braces, such as {{ {first}: … }}")),
            [] => problem,
        };
        let entries = self.entries().map_err(such_as)?;
        for entry in entries.iter().filter(|e| !fields.contains(&e.key.as_str())) {
            self.report(FieldProblem::unknown_name("field", &entry.key, fields).at(entry.place));
        }
        let last = Cell::new(self.node.place);
        let access =
            MapEntries { reader: self, rest: entries, fields: Some(fields), value: None, last: &last };
        visitor.visit_map(access).map_err(self.here())
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, FieldProblem> {
        if let Some(choices) = self.choices {
            choices.borrow_mut().insert(self.node);
        }
        visitor.visit_enum(self.choice(variants)?).map_err(self.here())
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        visitor.visit_unit()
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldProblem> {
        self.deserialize_str(visitor)
    }

    // No type of a recipe asks for these.
    forward_to_deserialize_any! { f32 char bytes byte_buf unit_struct tuple_struct identifier }
}
