//! A field of the schema: its value with its place, or what became of it.

use super::text::Place;
use serde::de::{self, Deserialize, Deserializer, IgnoredAny, SeqAccess, Visitor};
use std::fmt;
use std::marker::PhantomData;

/// Name of the newtype by which [`super::reader::Reader`] knows that it reads a [`Field`].
pub(super) const MARK: &str = "gs2e recipe field";

/// A field of a mapping, or an item of a list.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Field<T> {
    /// Not there.
    Absent,
    /// There, and faulty, which was reported where it was seen.
    Bad,
    /// There.
    Given(T, Place),
}

impl<T> Default for Field<T> {
    fn default() -> Self {
        Self::Absent
    }
}

impl<T> Field<T> {
    /// The value, where there is a sound one.
    pub(super) fn given(&self) -> Option<(&T, Place)> {
        match self {
            Self::Given(value, place) => Some((value, *place)),
            Self::Absent | Self::Bad => None,
        }
    }

    /// Whether the recipe does not name it.
    pub(super) fn is_absent(&self) -> bool {
        matches!(self, Self::Absent)
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Field<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_newtype_struct(MARK, FieldVisitor(PhantomData))
    }
}

struct FieldVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for FieldVisitor<T> {
    type Value = Field<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a place and a value")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut parts: A) -> Result<Field<T>, A::Error> {
        let mut number = || parts.next_element()?.ok_or_else(|| de::Error::custom("a field without a place"));
        let place = Place { file: number()?, start: number()?, end: number()? };
        Ok(parts.next_element()?.map_or(Field::Bad, |value| Field::Given(value, place)))
    }
}

/// The place of a field whose feature is not there yet: any value is read, and refused by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Later;

impl<'de> Deserialize<'de> for Later {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        IgnoredAny::deserialize(deserializer).map(|_| Self)
    }
}
