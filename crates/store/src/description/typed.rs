//! A description as JSON that keeps the type of each value, so that a reader can encode it again
//! and compute the key.
//!
//! Truth values, unsigned integers, texts, lists and records have their form in JSON, and a real
//! number always has a point or an exponent. The other types are objects with one member:
//! `#signed`, `#digest`, `#bytes`, and `#variant` with the name and the content. Implied fields are
//! left out, as in the encoding. JSON readers limit how deeply values nest, so a value that nests
//! deeper than [`DEEPEST`] is `#encoded`: its encoding in hexadecimal digits.

use super::DescribedValue;
use crate::Digest;
use serde::de::{Deserialize, Deserializer, Error as _};
use serde::ser::{Serialize, SerializeMap as _, Serializer};
use std::collections::BTreeMap;

impl Serialize for DescribedValue {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if levels(self) > DEEPEST {
            let mut bytes = Vec::new();
            self.encode(&mut bytes);
            return tagged(serializer, ENCODED, &to_hex(&bytes));
        }
        match self {
            Self::Bool(v) => serializer.serialize_bool(*v),
            // JSON has one type for all integers, and an untagged one is unsigned.
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
            Self::Encoded(bytes) => tagged(serializer, ENCODED, &to_hex(bytes)),
        }
    }
}

/// Maximum number of levels of JSON in a value. `serde_json` reads 128, and the file around a
/// description has its own.
const DEEPEST: usize = 64;

/// Number of levels of JSON in a value.
fn levels(value: &DescribedValue) -> usize {
    match value {
        DescribedValue::List(values) => 1 + values.iter().map(levels).max().unwrap_or(0),
        DescribedValue::Record(fields) => 1 + fields.values().map(levels).max().unwrap_or(0),
        // An object with a list in it.
        DescribedValue::Variant(_, value) => 2 + levels(value),
        DescribedValue::Implied(value) => levels(value),
        DescribedValue::Bytes(_) => 2,
        DescribedValue::Signed(_) | DescribedValue::Digest(_) | DescribedValue::Encoded(_) => 1,
        DescribedValue::Bool(_)
        | DescribedValue::Unsigned(_)
        | DescribedValue::Real(_)
        | DescribedValue::Text(_) => 0,
    }
}

fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The bytes of an even number of hexadecimal digits.
fn from_hex(text: &str) -> Option<Vec<u8>> {
    let digits: Option<Vec<u8>> =
        text.chars().map(|c| c.to_digit(16).and_then(|d| u8::try_from(d).ok())).collect();
    let (pairs, rest) = digits.as_ref()?.as_chunks::<2>();
    rest.is_empty().then(|| pairs.iter().map(|[high, low]| high << 4 | low).collect())
}

const SIGNED: &str = "#signed";
const BYTES: &str = "#bytes";
const VARIANT: &str = "#variant";
const DIGEST: &str = "#digest";
const ENCODED: &str = "#encoded";

fn tagged<S: Serializer>(serializer: S, tag: &str, value: &impl Serialize) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(1))?;
    map.serialize_entry(tag, value)?;
    map.end()
}

impl<'de> Deserialize<'de> for DescribedValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let json = serde_json::Value::deserialize(deserializer)?;
        parse(json).map_err(D::Error::custom)
    }
}

fn parse(json: serde_json::Value) -> Result<DescribedValue, String> {
    use serde_json::Value as Json;
    match json {
        Json::Null => Err("null has no place in a description".into()),
        Json::Bool(v) => Ok(DescribedValue::Bool(v)),
        Json::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(v), _) => Ok(DescribedValue::Unsigned(v)),
            (None, Some(v)) if number.is_f64() => Ok(DescribedValue::Real(v)),
            _ => Err(format!("{number} has no type: a negative integer is {{\"{SIGNED}\": {number}}}")),
        },
        Json::String(v) => Ok(DescribedValue::Text(v)),
        Json::Array(values) => {
            values.into_iter().map(parse).collect::<Result<_, _>>().map(DescribedValue::List)
        }
        Json::Object(mut fields) => match fields.keys().next().cloned() {
            Some(tag) if tag.starts_with('#') && fields.len() == 1 => {
                of_tag(&tag, fields.remove(&tag).unwrap_or_default())
            }
            _ => {
                let fields = fields.into_iter().map(|(name, value)| Ok((name, parse(value)?)));
                fields.collect::<Result<BTreeMap<_, _>, String>>().map(DescribedValue::Record)
            }
        },
    }
}

fn of_tag(tag: &str, json: serde_json::Value) -> Result<DescribedValue, String> {
    let failed = |e: serde_json::Error| format!("{tag}: {e}");
    match tag {
        SIGNED => serde_json::from_value(json).map(DescribedValue::Signed).map_err(failed),
        BYTES => serde_json::from_value(json).map(DescribedValue::Bytes).map_err(failed),
        DIGEST => serde_json::from_value::<Digest>(json).map(DescribedValue::Digest).map_err(failed),
        VARIANT => {
            let (name, value): (String, DescribedValue) = serde_json::from_value(json).map_err(failed)?;
            Ok(DescribedValue::Variant(name, Box::new(value)))
        }
        ENCODED => {
            let text: String = serde_json::from_value(json).map_err(failed)?;
            from_hex(&text)
                .map(DescribedValue::Encoded)
                .ok_or_else(|| format!("{tag}: wanted pairs of hexadecimal digits"))
        }
        _ => Err(format!("`{tag}` is not a type of values")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoded(value: &DescribedValue) -> Vec<u8> {
        let mut out = Vec::new();
        value.encode(&mut out);
        out
    }

    #[test]
    fn a_value_that_was_written_and_read_has_the_same_encoding() {
        let record = |fields: Vec<(&str, DescribedValue)>| {
            DescribedValue::Record(fields.into_iter().map(|(name, value)| (name.to_owned(), value)).collect())
        };
        let value = record(vec![
            ("truth", DescribedValue::Bool(true)),
            ("signed", DescribedValue::Signed(7)),
            ("below", DescribedValue::Signed(-7)),
            ("unsigned", DescribedValue::Unsigned(u64::MAX)),
            ("real", DescribedValue::Real(1.0)),
            ("small", DescribedValue::Real(5e-324)),
            ("third", DescribedValue::Real(1.0 / 3.0)),
            ("text", DescribedValue::Text("#signed".into())),
            ("bytes", DescribedValue::Bytes(vec![0, 255])),
            (
                "list",
                DescribedValue::List(vec![
                    DescribedValue::Unsigned(1),
                    DescribedValue::Real(1.0),
                    DescribedValue::empty_record(),
                ]),
            ),
            (
                "choice",
                DescribedValue::Variant(
                    "plain".into(),
                    Box::new(record(vec![("a", DescribedValue::Signed(1))])),
                ),
            ),
            ("input", DescribedValue::Digest(Digest::of_bytes(b"input"))),
            ("implied", DescribedValue::Implied(Box::new(DescribedValue::Bool(false)))),
        ]);
        let json = serde_json::to_string(&value).unwrap();
        let read: DescribedValue = serde_json::from_str(&json).unwrap();
        assert_eq!(encoded(&read), encoded(&value), "{json}");
        assert_eq!(serde_json::to_string(&read).unwrap(), json);
        assert!(!json.contains("implied"), "{json}");
    }

    #[test]
    fn a_deep_value_can_be_read_and_has_the_same_encoding() {
        let nest = |value, _: u32| {
            DescribedValue::Variant("negated".into(), Box::new(DescribedValue::List(vec![value])))
        };
        let value = (0..250).fold(DescribedValue::Real(0.5), nest);
        let json = serde_json::to_string(&value).unwrap();
        let read: DescribedValue = serde_json::from_str(&json).unwrap();
        assert_eq!(encoded(&read), encoded(&value));
        assert_eq!(serde_json::to_string(&read).unwrap(), json);
    }

    #[test]
    fn what_has_no_type_is_refused() {
        for json in [
            "null",
            "-1",
            "{\"#sign\": 1}",
            "{\"#signed\": 1.5}",
            "{\"#digest\": \"00\"}",
            "{\"#encoded\": \"0g\"}",
        ] {
            serde_json::from_str::<DescribedValue>(json).unwrap_err();
        }
    }
}
