//! Access of serde to the parts of a value.

use super::TreeReader;
use crate::problem::FieldProblem;
use crate::text::TextSpan;
use crate::tree::{MappingEntry, NodeKind, TreeNode};
use serde::de::value::StrDeserializer;
use serde::de::{
    DeserializeSeed, Deserializer, EnumAccess, IntoDeserializer, MapAccess, SeqAccess, VariantAccess, Visitor,
};
use std::cell::Cell;

/// A [`crate::field::Field`]: its place in three numbers, then its value. A faulty value is
/// omitted.
pub(super) struct FieldAccess<'a> {
    pub(super) reader: TreeReader<'a>,
    /// Number of parts that were passed on.
    pub(super) step: usize,
}

impl<'de> SeqAccess<'de> for FieldAccess<'_> {
    type Error = FieldProblem;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, FieldProblem> {
        let TextSpan { file, start, end } = self.reader.node.place;
        self.step += 1;
        if let Some(number) = [file, start, end].get(self.step - 1) {
            return seed.deserialize(number.into_deserializer()).map(Some);
        }
        if self.reader.node.kind == NodeKind::Refused {
            return Ok(None);
        }
        // A key without a value has the same message for every type.
        if self.reader.node.kind == NodeKind::Null {
            self.reader.report(FieldProblem::of_key("has no value").help("give it one, or remove the key"));
            return Ok(None);
        }
        // The problem goes into the list and not to serde, which would stop there.
        Ok(seed.deserialize(self.reader).map_err(|problem| self.reader.report(problem)).ok())
    }
}

/// The items of a list.
pub(super) struct ListItems<'a> {
    pub(super) reader: TreeReader<'a>,
    pub(super) items: std::slice::Iter<'a, TreeNode>,
}

impl<'de> SeqAccess<'de> for ListItems<'_> {
    type Error = FieldProblem;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, FieldProblem> {
        let Some(item) = self.items.next() else { return Ok(None) };
        let reader = self.reader.of(item);
        seed.deserialize(reader).map(Some).map_err(reader.here())
    }
}

/// The entries of a mapping.
pub(super) struct MapEntries<'a> {
    pub(super) reader: TreeReader<'a>,
    pub(super) rest: &'a [MappingEntry],
    /// Known fields of a structure; unknown fields were reported before. `None` for a map.
    pub(super) fields: Option<&'static [&'static str]>,
    /// The value of the last key that was passed on.
    pub(super) value: Option<&'a TreeNode>,
    /// Place of a problem that serde detects now: the last key, or the mapping as a whole.
    pub(super) last: &'a Cell<TextSpan>,
}

impl<'de> MapAccess<'de> for MapEntries<'_> {
    type Error = FieldProblem;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, FieldProblem> {
        while let [entry, rest @ ..] = self.rest {
            self.rest = rest;
            if self.fields.is_none_or(|fields| fields.contains(&entry.key.as_str())) {
                self.value = Some(&entry.value);
                self.last.set(entry.place);
                let key: StrDeserializer<'_, FieldProblem> = entry.key.as_str().into_deserializer();
                return seed.deserialize(key).map(Some);
            }
        }
        Ok(None)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, FieldProblem> {
        let reader = self.reader.of(self.value.take().expect("serde asks for a value after its key"));
        let value = seed.deserialize(reader).map_err(reader.here())?;
        // A complaint after a value concerns the mapping as a whole, for example a missing key.
        self.last.set(self.reader.node.place);
        Ok(value)
    }
}

/// The choice of an enumeration.
pub(super) struct EnumChoice<'a> {
    pub(super) reader: TreeReader<'a>,
    pub(super) name: &'a str,
    /// The value; absent for a bare word.
    pub(super) value: Option<&'a TreeNode>,
}

impl<'a> EnumChoice<'a> {
    fn body(&self) -> Result<TreeReader<'a>, FieldProblem> {
        self.value.map(|value| self.reader.of(value)).ok_or_else(|| {
            let name = self.name;
            FieldProblem::of_field(format!("is the single word {name}, wanted a mapping"))
                .help(format!("write {name}: {{ … }}"))
        })
    }
}

impl<'de> EnumAccess<'de> for EnumChoice<'_> {
    type Error = FieldProblem;
    type Variant = Self;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), FieldProblem> {
        let name: StrDeserializer<'_, FieldProblem> = self.name.into_deserializer();
        Ok((seed.deserialize(name)?, self))
    }
}

impl<'de> VariantAccess<'de> for EnumChoice<'_> {
    type Error = FieldProblem;

    fn unit_variant(self) -> Result<(), FieldProblem> {
        let Some(value) = self.value else { return Ok(()) };
        Err(FieldProblem::of_key("takes no value").help(format!("write {}", self.name)).at(value.place))
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, FieldProblem> {
        let body = self.body()?;
        seed.deserialize(body).map_err(body.here())
    }

    fn tuple_variant<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, FieldProblem> {
        self.body()?.deserialize_tuple(len, visitor)
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, FieldProblem> {
        self.body()?.deserialize_struct("", fields, visitor)
    }
}
