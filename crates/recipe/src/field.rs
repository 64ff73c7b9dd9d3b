//! A field of the schema: its value with its place, or the reason for its absence.

use super::text::TextSpan;
use serde::de::{self, Deserialize, Deserializer, IgnoredAny, SeqAccess, Visitor};
use std::fmt;
use std::marker::PhantomData;

/// Newtype name by which [`super::reader::TreeReader`] recognizes a [`Field`].
pub(super) const FIELD: &str = "gs2e recipe field";

/// Newtype name by which the reader recognizes a [`NumberLiteral`].
pub(super) const LITERAL: &str = "gs2e recipe literal";

/// A field of a mapping, or an item of a list.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) enum Field<T> {
    /// The field is absent.
    #[default]
    Absent,
    /// The field is present but faulty. The fault is already reported.
    Bad,
    /// The field is present and valid.
    Given(T, TextSpan),
}

impl<T> Field<T> {
    /// Returns the value, if it is valid.
    pub(super) fn given(&self) -> Option<(&T, TextSpan)> {
        match self {
            Self::Given(value, place) => Some((value, *place)),
            Self::Absent | Self::Bad => None,
        }
    }

    /// Returns the place of the valid value.
    pub(super) fn place(&self) -> Option<TextSpan> {
        self.given().map(|(_, place)| place)
    }

    /// Returns true if the recipe does not contain the field.
    pub(super) fn is_absent(&self) -> bool {
        matches!(self, Self::Absent)
    }

    /// Resolves a field that may be absent; `None` if it is faulty.
    pub(super) fn optional<U>(&self, resolve: impl FnOnce(&Self) -> Option<U>) -> Option<Option<U>> {
        if self.is_absent() { Some(None) } else { resolve(self).map(Some) }
    }
}

impl<T: Clone> Field<T> {
    /// Returns the value, or the default if the field is absent; `None` if it is faulty.
    pub(super) fn or(&self, default: T) -> Option<T> {
        match self {
            Self::Absent => Some(default),
            Self::Bad => None,
            Self::Given(value, _) => Some(value.clone()),
        }
    }

    /// Like [`Self::or`], with the default of the type: a section without keys.
    pub(super) fn or_default(&self) -> Option<T>
    where
        T: Default,
    {
        self.or(T::default())
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Field<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_newtype_struct(FIELD, FieldVisitor(PhantomData))
    }
}

struct FieldVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for FieldVisitor<T> {
    type Value = Field<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a place and a value")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut parts: A) -> Result<Field<T>, A::Error> {
        // The reader gives the place in three numbers, and then the value unless it is faulty.
        let mut number = || parts.next_element()?.ok_or_else(|| de::Error::custom("a field without a place"));
        let place = TextSpan { file: number()?, start: number()?, end: number()? };
        Ok(parts.next_element()?.map_or(Field::Bad, |value| Field::Given(value, place)))
    }
}

/// A number as written, because it must not pass through floating point.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct NumberLiteral(pub String);

impl<'de> Deserialize<'de> for NumberLiteral {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct TextField;

        impl Visitor<'_> for TextField {
            type Value = NumberLiteral;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number")
            }

            fn visit_str<E>(self, text: &str) -> Result<NumberLiteral, E> {
                Ok(NumberLiteral(text.to_owned()))
            }
        }

        deserializer.deserialize_newtype_struct(LITERAL, TextField)
    }
}

/// A field of a feature that is not built yet. Any value is read, and the field is refused by name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct UnsupportedField;

impl<'de> Deserialize<'de> for UnsupportedField {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        IgnoredAny::deserialize(deserializer).map(|_| Self)
    }
}
