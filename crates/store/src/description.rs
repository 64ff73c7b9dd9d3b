//! The description of a step, from which both its key and its explanation are made.
//!
//! The parameters of a stage implement [`serde::Serialize`]; [`describe_value`] turns them into a
//! [`DescribedValue`]. The key hashes the encoding of the value, and `gs2e why` prints its lines,
//! so an explanation cannot disagree with a key.
//!
//! The encoding is typed and length-prefixed: a tag byte, the length of the payload as a
//! little-endian `u64`, and the payload. The fields of a record are sorted by name, so moving a
//! field of a struct changes no key. An absent `Option` is an absent field. Output of `Debug`, JSON
//! and serde's derive order are never hashed.

mod describer;
mod typed;

use super::Digest;
use describer::ValueDescriber;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// A described value.
#[derive(Debug, Clone, PartialEq)]
pub enum DescribedValue {
    /// Truth value.
    Bool(bool),
    /// Signed integer.
    Signed(i64),
    /// Unsigned integer.
    Unsigned(u64),
    /// Real number; finite, never -0.
    Real(f64),
    /// Text.
    Text(String),
    /// Bytes.
    Bytes(Vec<u8>),
    /// Values in order.
    List(Vec<DescribedValue>),
    /// Named values.
    Record(BTreeMap<String, DescribedValue>),
    /// One choice among several, with its content.
    Variant(String, Box<DescribedValue>),
    /// Digest of an input.
    Digest(Digest),
    /// A value that is shown, but left out of the encoding of its record.
    Implied(Box<DescribedValue>),
    /// The encoding of a value, where a reader has nothing else.
    Encoded(Vec<u8>),
}

impl DescribedValue {
    /// A record without fields.
    #[must_use]
    pub(crate) fn empty_record() -> Self {
        Self::Record(BTreeMap::new())
    }

    /// Appends the encoding to `out`.
    pub fn encode(&self, out: &mut Vec<u8>) {
        match self {
            // The tags are part of every key, so their numbers never change.
            Self::Bool(v) => write_tagged(out, 1, &[u8::from(*v)]),
            Self::Signed(v) => write_tagged(out, 2, &v.to_le_bytes()),
            Self::Unsigned(v) => write_tagged(out, 3, &v.to_le_bytes()),
            // Equal numbers have equal bits here, because the describer lets neither -0 nor NaN through.
            Self::Real(v) => write_tagged(out, 4, &v.to_bits().to_le_bytes()),
            Self::Text(v) => write_tagged(out, 5, v.as_bytes()),
            Self::Bytes(v) => write_tagged(out, 6, v),
            Self::List(values) => write_nested(out, 7, |out| values.iter().for_each(|v| v.encode(out))),
            Self::Record(fields) => write_nested(out, 8, |out| {
                for (name, value) in fields.iter().filter(|(_, value)| !matches!(value, Self::Implied(_))) {
                    write_tagged(out, 5, name.as_bytes());
                    value.encode(out);
                }
            }),
            // Only a field can be left out.
            Self::Implied(value) => value.encode(out),
            Self::Variant(name, value) => write_nested(out, 9, |out| {
                write_tagged(out, 5, name.as_bytes());
                value.encode(out);
            }),
            Self::Digest(v) => write_tagged(out, 10, v.as_bytes()),
            // These bytes are a whole encoding, and have a tag and a length of their own.
            Self::Encoded(bytes) => out.extend_from_slice(bytes),
        }
    }

    /// Marks as implied the fields that stand at one of these places and have the given text. A
    /// record without other fields is implied itself.
    #[must_use]
    pub fn with_implied(self, added: &[(&str, &str)]) -> Self {
        if added.is_empty() { self } else { self.imply("", added) }
    }

    fn imply(self, path: &str, added: &[(&str, &str)]) -> Self {
        match self {
            Self::Record(fields) if !fields.is_empty() => {
                let below =
                    |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
                let imply = |(name, value): (String, Self)| {
                    let value = value.imply(&below(&name), added);
                    (name, value)
                };
                let fields: BTreeMap<String, Self> = fields.into_iter().map(imply).collect();
                let all = fields.values().all(|value| matches!(value, Self::Implied(_)));
                let record = Self::Record(fields);
                // The description as a whole is never implied.
                if all && !path.is_empty() { Self::Implied(Box::new(record)) } else { record }
            }
            leaf if added.contains(&(path, leaf.to_string().as_str())) => Self::Implied(Box::new(leaf)),
            Self::Variant(name, value) => {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                // The choice itself counts, even if its content is implied.
                let value = match value.imply(&path, added) {
                    Self::Implied(value) => value,
                    value => Box::new(value),
                };
                Self::Variant(name, value)
            }
            leaf => leaf,
        }
    }

    /// The value as lines `path = text`, in the order of the encoding.
    #[must_use]
    pub fn lines(&self) -> Vec<ExplanationLine> {
        let mut lines = Vec::new();
        self.walk("", &mut lines);
        lines
    }

    fn walk(&self, path: &str, lines: &mut Vec<ExplanationLine>) {
        let below = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
        match self {
            Self::List(values) if !values.is_empty() => {
                for (i, value) in values.iter().enumerate() {
                    value.walk(&below(&i.to_string()), lines);
                }
            }
            Self::Record(fields) if !fields.is_empty() => {
                for (name, value) in fields {
                    value.walk(&below(name), lines);
                }
            }
            Self::Variant(name, value) if **value != Self::empty_record() => value.walk(&below(name), lines),
            Self::Implied(value) => value.walk(path, lines),
            leaf => lines.push(ExplanationLine { path: path.to_owned(), text: leaf.to_string() }),
        }
    }
}

/// One line of an explanation.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ExplanationLine {
    /// Path in the description, with parts joined by dots.
    pub path: String,
    /// The value as text.
    pub text: String,
}

/// A leaf as text. Lists and records have a text only if they are empty.
impl fmt::Display for DescribedValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(v) => write!(f, "{v}"),
            Self::Signed(v) => write!(f, "{v}"),
            Self::Unsigned(v) => write!(f, "{v}"),
            // Debug keeps the point, so that a real number differs from an integer.
            Self::Real(v) => write!(f, "{v:?}"),
            Self::Text(v) => f.write_str(v),
            Self::Bytes(v) => write!(f, "{} bytes {}", v.len(), Digest::of_bytes(v)),
            Self::List(_) => f.write_str("[]"),
            Self::Record(_) => f.write_str("{}"),
            Self::Variant(name, _) => f.write_str(name),
            Self::Digest(v) => write!(f, "{v}"),
            Self::Implied(v) => v.fmt(f),
            Self::Encoded(v) => write!(f, "encoded, {} bytes {}", v.len(), Digest::of_bytes(v)),
        }
    }
}

fn write_tagged(out: &mut Vec<u8>, tag: u8, payload: &[u8]) {
    out.push(tag);
    out.extend_from_slice(&(payload.len() as u64).to_le_bytes());
    out.extend_from_slice(payload);
}

fn write_nested(out: &mut Vec<u8>, tag: u8, fill: impl FnOnce(&mut Vec<u8>)) {
    let mut payload = Vec::new();
    fill(&mut payload);
    write_tagged(out, tag, &payload);
}

/// Describes parameters.
///
/// # Panics
/// A number is NaN or infinite, a map key is not text, or `None` stands outside a record. Stages
/// hold valid values, so each of these is an error in the definition of a stage.
#[must_use]
pub fn describe_value<T: Serialize + ?Sized>(parameters: &T) -> DescribedValue {
    parameters
        .serialize(ValueDescriber)
        .expect("stage parameters hold finite numbers and named fields")
        .expect("stage parameters are not an absent option")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(serde::Serialize)]
    struct Forward {
        a: f64,
        b: Option<u32>,
        choice: Choice,
    }

    #[derive(serde::Serialize)]
    struct Backward {
        choice: Choice,
        a: f64,
    }

    #[derive(serde::Serialize)]
    #[serde(rename_all = "kebab-case")]
    enum Choice {
        Plain,
        WithNumber(u8),
    }

    fn bytes(value: &DescribedValue) -> Vec<u8> {
        let mut out = Vec::new();
        value.encode(&mut out);
        out
    }

    #[test]
    fn neither_field_order_nor_absence_nor_negative_zero_shows() {
        let forward = describe_value(&Forward { a: -0.0, b: None, choice: Choice::Plain });
        let backward = describe_value(&Backward { choice: Choice::Plain, a: 0.0 });
        assert_eq!(bytes(&forward), bytes(&backward));
        assert_ne!(
            bytes(&forward),
            bytes(&describe_value(&Forward { a: 0.0, b: Some(0), choice: Choice::Plain }))
        );
    }

    #[test]
    fn the_encoding_is_what_the_module_says() {
        let value = describe_value(&Backward { choice: Choice::WithNumber(7), a: 1.0 });
        let mut want = Vec::new();
        // record { a: 1.0, choice: with-number(7) } = (9+1 + 9+8) + (9+6 + 9 + (9+11) + (9+8))
        // bytes of payload.
        want.extend([8]);
        want.extend((27u64 + 15 + 9 + 37).to_le_bytes());
        want.extend([5, 1, 0, 0, 0, 0, 0, 0, 0, b'a', 4, 8, 0, 0, 0, 0, 0, 0, 0]);
        want.extend(1f64.to_bits().to_le_bytes());
        want.extend([5, 6, 0, 0, 0, 0, 0, 0, 0]);
        want.extend(b"choice");
        want.extend([9, 37, 0, 0, 0, 0, 0, 0, 0, 5, 11, 0, 0, 0, 0, 0, 0, 0]);
        want.extend(b"with-number");
        want.extend([3, 8, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes(&value), want);
    }

    /// A stage before and after two parameters were added.
    #[test]
    fn a_parameter_with_its_first_value_rekeys_nothing() {
        #[derive(serde::Serialize)]
        struct Before {
            a: f64,
        }
        #[derive(serde::Serialize)]
        struct After {
            a: f64,
            gain: Choice,
            more: More,
        }
        #[derive(serde::Serialize)]
        struct More {
            depth: u8,
        }
        let before = bytes(&describe_value(&Before { a: 1.0 }));
        let added = [("gain", "plain"), ("more.depth", "3")];
        let after =
            |gain, depth| describe_value(&After { a: 1.0, gain, more: More { depth } }).with_implied(&added);
        assert_eq!(bytes(&after(Choice::Plain, 3)), before);
        for other in [after(Choice::WithNumber(1), 3), after(Choice::Plain, 4)] {
            assert_ne!(bytes(&other), before);
        }
        // Implied values are shown all the same: an edit shows the previous value.
        let text: Vec<String> =
            after(Choice::Plain, 3).lines().into_iter().map(|l| l.path + "=" + &l.text).collect();
        assert_eq!(text, ["a=1.0", "gain=plain", "more.depth=3"]);
    }

    #[test]
    fn lines_name_every_leaf() {
        let lines = describe_value(&Forward { a: 0.25, b: Some(3), choice: Choice::WithNumber(7) }).lines();
        let text: Vec<String> = lines.iter().map(|l| format!("{} = {}", l.path, l.text)).collect();
        assert_eq!(text, ["a = 0.25", "b = 3", "choice.with-number = 7"]);
    }

    #[test]
    #[should_panic(expected = "finite")]
    fn nan_has_no_place_in_a_key() {
        let _ = describe_value(&f64::NAN);
    }
}
