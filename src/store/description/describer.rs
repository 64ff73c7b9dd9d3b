//! A serde serializer that makes a [`Value`] from parameters.

use super::Value;
use serde::ser::{self, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// The reason why a value cannot be described.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct Undescribable(String);

impl ser::Error for Undescribable {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self(message.to_string())
    }
}

/// `None` means an absent field.
type Described = Result<Option<Value>, Undescribable>;

pub(super) struct Describer;

fn real_value(v: f64) -> Described {
    if !v.is_finite() {
        return Err(Undescribable(format!("{v} has no place in a key")));
    }
    // Adding +0 turns -0 into +0, and changes nothing else.
    Ok(Some(Value::Real(v + 0.0)))
}

impl ser::Serializer for Describer {
    type Ok = Option<Value>;
    type Error = Undescribable;
    type SerializeSeq = Elements;
    type SerializeTuple = Elements;
    type SerializeTupleStruct = Elements;
    type SerializeTupleVariant = Elements;
    type SerializeMap = Fields;
    type SerializeStruct = Fields;
    type SerializeStructVariant = Fields;

    fn serialize_bool(self, v: bool) -> Described {
        Ok(Some(Value::Bool(v)))
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
        Ok(Some(Value::Signed(v)))
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
        Ok(Some(Value::Unsigned(v)))
    }
    fn serialize_f32(self, v: f32) -> Described {
        real_value(v.into())
    }
    fn serialize_f64(self, v: f64) -> Described {
        real_value(v)
    }
    fn serialize_char(self, v: char) -> Described {
        Ok(Some(Value::Text(v.to_string())))
    }
    fn serialize_str(self, v: &str) -> Described {
        Ok(Some(Value::Text(v.to_owned())))
    }
    fn serialize_bytes(self, v: &[u8]) -> Described {
        Ok(Some(Value::Bytes(v.to_vec())))
    }
    fn serialize_none(self) -> Described {
        Ok(None)
    }
    fn serialize_some<T: Serialize + ?Sized>(self, v: &T) -> Described {
        v.serialize(self)
    }
    fn serialize_unit(self) -> Described {
        Ok(Some(Value::empty_record()))
    }
    fn serialize_unit_struct(self, _: &'static str) -> Described {
        self.serialize_unit()
    }
    fn serialize_unit_variant(self, _: &'static str, _: u32, variant: &'static str) -> Described {
        Ok(Some(Value::Variant(variant.to_owned(), Box::new(Value::empty_record()))))
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
        let content = v.serialize(self)?.unwrap_or_else(Value::empty_record);
        Ok(Some(Value::Variant(variant.to_owned(), Box::new(content))))
    }
    fn serialize_seq(self, _: Option<usize>) -> Result<Elements, Undescribable> {
        Ok(Elements { variant: None, values: Vec::new() })
    }
    fn serialize_tuple(self, _: usize) -> Result<Elements, Undescribable> {
        self.serialize_seq(None)
    }
    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Elements, Undescribable> {
        self.serialize_seq(None)
    }
    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<Elements, Undescribable> {
        Ok(Elements { variant: Some(variant), values: Vec::new() })
    }
    fn serialize_map(self, _: Option<usize>) -> Result<Fields, Undescribable> {
        Ok(Fields { variant: None, fields: BTreeMap::new(), key: None })
    }
    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Fields, Undescribable> {
        self.serialize_map(None)
    }
    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<Fields, Undescribable> {
        Ok(Fields { variant: Some(variant), fields: BTreeMap::new(), key: None })
    }
}

fn in_variant(variant: Option<&'static str>, content: Value) -> Value {
    match variant {
        Some(name) => Value::Variant(name.to_owned(), Box::new(content)),
        None => content,
    }
}

pub(super) struct Elements {
    variant: Option<&'static str>,
    values: Vec<Value>,
}

impl Elements {
    fn push<T: Serialize + ?Sized>(&mut self, v: &T) -> Result<(), Undescribable> {
        let value = v.serialize(Describer)?;
        self.values.push(value.ok_or_else(|| Undescribable("an absent value in a list".into()))?);
        Ok(())
    }

    fn close(self) -> Value {
        in_variant(self.variant, Value::List(self.values))
    }
}

pub(super) struct Fields {
    variant: Option<&'static str>,
    fields: BTreeMap<String, Value>,
    key: Option<String>,
}

impl Fields {
    fn put<T: Serialize + ?Sized>(&mut self, name: &str, v: &T) -> Result<(), Undescribable> {
        if let Some(value) = v.serialize(Describer)? {
            self.fields.insert(name.to_owned(), value);
        }
        Ok(())
    }

    fn close(self) -> Value {
        in_variant(self.variant, Value::Record(self.fields))
    }
}

macro_rules! elements {
    ($($kind:ident $add:ident),+) => {$(
        impl ser::$kind for Elements {
            type Ok = Option<Value>;
            type Error = Undescribable;
            fn $add<T: Serialize + ?Sized>(&mut self, v: &T) -> Result<(), Undescribable> {
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
        impl ser::$kind for Fields {
            type Ok = Option<Value>;
            type Error = Undescribable;
            fn serialize_field<T: Serialize + ?Sized>(
                &mut self,
                name: &'static str,
                v: &T,
            ) -> Result<(), Undescribable> {
                self.put(name, v)
            }
            fn end(self) -> Described {
                Ok(Some(self.close()))
            }
        }
    )+};
}
fields!(SerializeStruct, SerializeStructVariant);

impl ser::SerializeMap for Fields {
    type Ok = Option<Value>;
    type Error = Undescribable;
    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Undescribable> {
        match key.serialize(Describer)? {
            Some(Value::Text(name)) => self.key = Some(name),
            other => return Err(Undescribable(format!("a map key that is no text: {other:?}"))),
        }
        Ok(())
    }
    fn serialize_value<T: Serialize + ?Sized>(&mut self, v: &T) -> Result<(), Undescribable> {
        let name = self.key.take().expect("serde calls serialize_key first");
        self.put(&name, v)
    }
    fn end(self) -> Described {
        Ok(Some(self.close()))
    }
}
