//! A description as JSON that keeps the type of each value, so that a reader can encode it again and find the key.
//!
//! Truth values, unsigned integers, texts, lists and records are what JSON has for them, and a real number always has a
//! point or an exponent. The other types are objects of one member: `#signed`, `#digest`, `#bytes`, and `#variant` with
//! the name and the content. Implied fields are left out, as in the encoding.

use super::Value;
use crate::store::Digest;
use serde::de::{Deserialize, Deserializer, Error as _};
use serde::ser::{Serialize, SerializeMap as _, Serializer};
use std::collections::BTreeMap;

impl Serialize for Value {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Bool(v) => serializer.serialize_bool(*v),
            Self::Signed(v) => tagged(serializer, SIGNED, v),
            Self::Unsigned(v) => serializer.serialize_u64(*v),
            Self::Real(v) => serializer.serialize_f64(*v),
            Self::Text(v) => serializer.serialize_str(v),
            Self::Bytes(v) => tagged(serializer, BYTES, v),
            Self::List(values) => serializer.collect_seq(values),
            Self::Record(fields) => {
                serializer.collect_map(fields.iter().filter(|(_, value)| !matches!(value, Self::Implied(_))))
            }
            Self::Variant(name, value) => tagged(serializer, VARIANT, &(name, value)),
            Self::Digest(v) => tagged(serializer, DIGEST, v),
            Self::Implied(value) => value.serialize(serializer),
        }
    }
}

const SIGNED: &str = "#signed";
const BYTES: &str = "#bytes";
const VARIANT: &str = "#variant";
const DIGEST: &str = "#digest";

fn tagged<S: Serializer>(serializer: S, tag: &str, value: &impl Serialize) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(1))?;
    map.serialize_entry(tag, value)?;
    map.end()
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let json = serde_json::Value::deserialize(deserializer)?;
        parse(json).map_err(D::Error::custom)
    }
}

fn parse(json: serde_json::Value) -> Result<Value, String> {
    use serde_json::Value as Json;
    match json {
        Json::Null => Err("null has no place in a description".into()),
        Json::Bool(v) => Ok(Value::Bool(v)),
        Json::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(v), _) => Ok(Value::Unsigned(v)),
            (None, Some(v)) if number.is_f64() => Ok(Value::Real(v)),
            _ => Err(format!("{number} has no type: a negative integer is {{\"{SIGNED}\": {number}}}")),
        },
        Json::String(v) => Ok(Value::Text(v)),
        Json::Array(values) => values.into_iter().map(parse).collect::<Result<_, _>>().map(Value::List),
        Json::Object(mut fields) => match fields.keys().next().cloned() {
            Some(tag) if tag.starts_with('#') && fields.len() == 1 => {
                of_tag(&tag, fields.remove(&tag).unwrap_or_default())
            }
            _ => {
                let fields = fields.into_iter().map(|(name, value)| Ok((name, parse(value)?)));
                fields.collect::<Result<BTreeMap<_, _>, String>>().map(Value::Record)
            }
        },
    }
}

fn of_tag(tag: &str, json: serde_json::Value) -> Result<Value, String> {
    let failed = |e: serde_json::Error| format!("{tag}: {e}");
    match tag {
        SIGNED => serde_json::from_value(json).map(Value::Signed).map_err(failed),
        BYTES => serde_json::from_value(json).map(Value::Bytes).map_err(failed),
        DIGEST => serde_json::from_value::<Digest>(json).map(Value::Digest).map_err(failed),
        VARIANT => {
            let (name, value): (String, Value) = serde_json::from_value(json).map_err(failed)?;
            Ok(Value::Variant(name, Box::new(value)))
        }
        _ => Err(format!("`{tag}` is not a type of values")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoded(value: &Value) -> Vec<u8> {
        let mut out = Vec::new();
        value.encode(&mut out);
        out
    }

    #[test]
    fn a_value_that_was_written_and_read_has_the_same_encoding() {
        let record = |fields: Vec<(&str, Value)>| {
            Value::Record(fields.into_iter().map(|(name, value)| (name.to_owned(), value)).collect())
        };
        let value = record(vec![
            ("truth", Value::Bool(true)),
            ("signed", Value::Signed(7)),
            ("below", Value::Signed(-7)),
            ("unsigned", Value::Unsigned(u64::MAX)),
            ("real", Value::Real(1.0)),
            ("small", Value::Real(5e-324)),
            ("third", Value::Real(1.0 / 3.0)),
            ("text", Value::Text("#signed".into())),
            ("bytes", Value::Bytes(vec![0, 255])),
            ("list", Value::List(vec![Value::Unsigned(1), Value::Real(1.0), Value::empty()])),
            ("choice", Value::Variant("plain".into(), Box::new(record(vec![("a", Value::Signed(1))])))),
            ("input", Value::Digest(Digest::of(b"input"))),
            ("implied", Value::Implied(Box::new(Value::Bool(false)))),
        ]);
        let json = serde_json::to_string(&value).unwrap();
        let read: Value = serde_json::from_str(&json).unwrap();
        assert_eq!(encoded(&read), encoded(&value), "{json}");
        assert_eq!(serde_json::to_string(&read).unwrap(), json);
        assert!(!json.contains("implied"), "{json}");
    }

    #[test]
    fn what_has_no_type_is_refused() {
        for json in ["null", "-1", "{\"#sign\": 1}", "{\"#signed\": 1.5}", "{\"#digest\": \"00\"}"] {
            serde_json::from_str::<Value>(json).unwrap_err();
        }
    }
}
