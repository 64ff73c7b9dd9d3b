//! A serde serializer that makes a [`DescribedValue`] from parameters.

use super::DescribedValue;
use serde::ser::{self, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// The reason why a value cannot be described.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct DescribeError(String);

impl ser::Error for DescribeError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self(message.to_string())
    }
}

/// `None` means an absent field.
type Described = Result<Option<DescribedValue>, DescribeError>;

pub(super) struct ValueDescriber;

fn real_value(v: f64) -> Described {
    if !v.is_finite() {
        return Err(DescribeError(format!("{v} has no place in a key")));
    }
    // Adding +0 turns -0 into +0, and changes nothing else.
    Ok(Some(DescribedValue::Real(v + 0.0)))
}

impl ser::Serializer for ValueDescriber {
    type Ok = Option<DescribedValue>;
    type Error = DescribeError;
    type SerializeSeq = SequenceDescriber;
    type SerializeTuple = SequenceDescriber;
    type SerializeTupleStruct = SequenceDescriber;
    type SerializeTupleVariant = SequenceDescriber;
    type SerializeMap = FieldDescriber;
    type SerializeStruct = FieldDescriber;
    type SerializeStructVariant = FieldDescriber;

    fn serialize_bool(self, v: bool) -> Described {
        Ok(Some(DescribedValue::Bool(v)))
    }
    fn serialize_i8(self, v: i8) -> Described {
        self.serialize_i64(v.into())
    }
    fn serialize_i16(self, v: i16) -> Described {
        self.serialize_i64(v.into())
    }
    fn serialize_i32(self, v: i32) -> Described {
        self.serialize_i64(v.into())
    }
    fn serialize_i64(self, v: i64) -> Described {
        Ok(Some(DescribedValue::Signed(v)))
    }
    fn serialize_u8(self, v: u8) -> Described {
        self.serialize_u64(v.into())
    }
    fn serialize_u16(self, v: u16) -> Described {
        self.serialize_u64(v.into())
    }
    fn serialize_u32(self, v: u32) -> Described {
        self.serialize_u64(v.into())
    }
    fn serialize_u64(self, v: u64) -> Described {
        Ok(Some(DescribedValue::Unsigned(v)))
    }
    fn serialize_f32(self, v: f32) -> Described {
        real_value(v.into())
    }
    fn serialize_f64(self, v: f64) -> Described {
        real_value(v)
    }
    fn serialize_char(self, v: char) -> Described {
        Ok(Some(DescribedValue::Text(v.to_string())))
    }
    fn serialize_str(self, v: &str) -> Described {
        Ok(Some(DescribedValue::Text(v.to_owned())))
    }
    fn serialize_bytes(self, v: &[u8]) -> Described {
        Ok(Some(DescribedValue::Bytes(v.to_vec())))
    }
    fn serialize_none(self) -> Described {
        Ok(None)
    }
    fn serialize_some<T: Serialize + ?Sized>(self, v: &T) -> Described {
        v.serialize(self)
    }
    fn serialize_unit(self) -> Described {
        Ok(Some(DescribedValue::empty_record()))
    }
    fn serialize_unit_struct(self, _: &'static str) -> Described {
        self.serialize_unit()
    }
    fn serialize_unit_variant(self, _: &'static str, _: u32, variant: &'static str) -> Described {
        Ok(Some(DescribedValue::Variant(variant.to_owned(), Box::new(DescribedValue::empty_record()))))
    }
    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, v: &T) -> Described {
        v.serialize(self)
    }
    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        v: &T,
    ) -> Described {
        // An absent content is described like a variant without content.
        let content = v.serialize(self)?.unwrap_or_else(DescribedValue::empty_record);
        Ok(Some(DescribedValue::Variant(variant.to_owned(), Box::new(content))))
    }
    fn serialize_seq(self, _: Option<usize>) -> Result<SequenceDescriber, DescribeError> {
        Ok(SequenceDescriber { variant: None, values: Vec::new() })
    }
    fn serialize_tuple(self, _: usize) -> Result<SequenceDescriber, DescribeError> {
        self.serialize_seq(None)
    }
    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<SequenceDescriber, DescribeError> {
        self.serialize_seq(None)
    }
    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<SequenceDescriber, DescribeError> {
        Ok(SequenceDescriber { variant: Some(variant), values: Vec::new() })
    }
    fn serialize_map(self, _: Option<usize>) -> Result<FieldDescriber, DescribeError> {
        Ok(FieldDescriber { variant: None, fields: BTreeMap::new(), key: None })
    }
    fn serialize_struct(self, _: &'static str, _: usize) -> Result<FieldDescriber, DescribeError> {
        self.serialize_map(None)
    }
    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<FieldDescriber, DescribeError> {
        Ok(FieldDescriber { variant: Some(variant), fields: BTreeMap::new(), key: None })
    }
}

fn in_variant(variant: Option<&'static str>, content: DescribedValue) -> DescribedValue {
    match variant {
        Some(name) => DescribedValue::Variant(name.to_owned(), Box::new(content)),
        None => content,
    }
}

pub(super) struct SequenceDescriber {
    variant: Option<&'static str>,
    values: Vec<DescribedValue>,
}

impl SequenceDescriber {
    fn push<T: Serialize + ?Sized>(&mut self, v: &T) -> Result<(), DescribeError> {
        // An absent element would shift the elements after it.
        let value = v.serialize(ValueDescriber)?;
        self.values.push(value.ok_or_else(|| DescribeError("an absent value in a list".into()))?);
        Ok(())
    }

    fn close(self) -> DescribedValue {
        in_variant(self.variant, DescribedValue::List(self.values))
    }
}

pub(super) struct FieldDescriber {
    variant: Option<&'static str>,
    fields: BTreeMap<String, DescribedValue>,
    key: Option<String>,
}

impl FieldDescriber {
    fn put<T: Serialize + ?Sized>(&mut self, name: &str, v: &T) -> Result<(), DescribeError> {
        if let Some(value) = v.serialize(ValueDescriber)? {
            self.fields.insert(name.to_owned(), value);
        }
        Ok(())
    }

    fn close(self) -> DescribedValue {
        in_variant(self.variant, DescribedValue::Record(self.fields))
    }
}

macro_rules! elements {
    ($($kind:ident $add:ident),+) => {$(
        impl ser::$kind for SequenceDescriber {
            type Ok = Option<DescribedValue>;
            type Error = DescribeError;
            fn $add<T: Serialize + ?Sized>(&mut self, v: &T) -> Result<(), DescribeError> {
                self.push(v)
            }
            fn end(self) -> Described {
                Ok(Some(self.close()))
            }
        }
    )+};
}
elements!(
    SerializeSeq serialize_element, SerializeTuple serialize_element, SerializeTupleStruct serialize_field,
    SerializeTupleVariant serialize_field
);

macro_rules! fields {
    ($($kind:ident),+) => {$(
        impl ser::$kind for FieldDescriber {
            type Ok = Option<DescribedValue>;
            type Error = DescribeError;
            fn serialize_field<T: Serialize + ?Sized>(
                &mut self,
                name: &'static str,
                v: &T,
            ) -> Result<(), DescribeError> {
                self.put(name, v)
            }
            fn end(self) -> Described {
                Ok(Some(self.close()))
            }
        }
    )+};
}
fields!(SerializeStruct, SerializeStructVariant);

impl ser::SerializeMap for FieldDescriber {
    type Ok = Option<DescribedValue>;
    type Error = DescribeError;
    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), DescribeError> {
        match key.serialize(ValueDescriber)? {
            Some(DescribedValue::Text(name)) => self.key = Some(name),
            other => return Err(DescribeError(format!("a map key that is no text: {other:?}"))),
        }
        Ok(())
    }
    fn serialize_value<T: Serialize + ?Sized>(&mut self, v: &T) -> Result<(), DescribeError> {
        let name = self.key.take().expect("serde calls serialize_key first");
        self.put(&name, v)
    }
    fn end(self) -> Described {
        Ok(Some(self.close()))
    }
}
