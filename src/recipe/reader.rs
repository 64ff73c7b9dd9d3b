//! From the value tree to typed values, through serde, with every fault on its place.
//!
//! A plain serde reader stops at the first fault. This one goes on: unknown fields are reported and passed over, and a
//! [`super::field::Field`] whose value is faulty reports it and counts as bad.

use super::field::MARK;
use super::nearest::nearest;
use super::problem::{Problem, quoted};
use super::text::Place;
use super::tree::{Entry, Kind, Node};
use serde::de::{self, DeserializeSeed, IntoDeserializer, Visitor};
use std::cell::RefCell;

/// Faults found so far.
pub(super) type Problems = RefCell<Vec<Problem>>;

/// Reads one value of the tree.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a> {
    node: &'a Node,
    problems: &'a Problems,
}

impl<'a> Reader<'a> {
    /// A reader of `node` that leaves what it finds in `problems`.
    pub(super) fn new(node: &'a Node, problems: &'a Problems) -> Self {
        Self { node, problems }
    }

    fn report(&self, problem: Problem) {
        self.problems.borrow_mut().push(problem);
    }

    fn of(self, node: &'a Node) -> Self {
        Self { node, ..self }
    }

    fn at(self) -> impl Fn(Problem) -> Problem {
        move |problem| problem.at(self.node.place)
    }

    /// The value is not of the kind that is wanted.
    fn wanted(&self, what: &str) -> Problem {
        Problem::of_field(format!("is {}, wanted {what}", self.node.kind.described())).at(self.node.place)
    }

    fn entries(&self) -> Result<&'a [Entry], Problem> {
        match &self.node.kind {
            Kind::Map(entries) => Ok(entries),
            _ => Err(self.wanted("a mapping")),
        }
    }

    fn items(&self) -> Result<&'a [Node], Problem> {
        match &self.node.kind {
            Kind::List(items) => Ok(items),
            _ => Err(self.wanted("a list")),
        }
    }

    fn text(&self, what: &str) -> Result<&'a str, Problem> {
        match &self.node.kind {
            Kind::Scalar { text, .. } => Ok(text),
            _ => Err(self.wanted(what)),
        }
    }

    /// The text of a scalar that may be a number: not quoted.
    fn number(&self, what: &str) -> Result<&'a str, Problem> {
        match &self.node.kind {
            Kind::Scalar { text, plain: true } => Ok(text),
            Kind::Scalar { text, plain: false } if text.parse::<f64>().is_ok() => {
                Err(self.wanted(what).help("write the number without quotes"))
            }
            _ => Err(self.wanted(what)),
        }
    }

    fn whole(&self, low: i128, high: i128) -> Result<i128, Problem> {
        let wanted = format!("a whole number from {low} to {high}");
        let text = self.number(&wanted)?;
        let n = whole(text).ok_or_else(|| self.wanted(&wanted))?;
        if (low..=high).contains(&n) { Ok(n) } else { Err(self.wanted(&wanted)) }
    }

    fn real(&self) -> Result<f64, Problem> {
        let text = self.number("a number")?;
        let spelled = text.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
        let value: f64 = text.parse().map_err(|_| self.wanted("a number"))?;
        if !spelled || !value.is_finite() {
            return Err(self.wanted("a finite number"));
        }
        Ok(if value == 0.0 { 0.0 } else { value })
    }

    /// Reports every key that is not among `fields`.
    fn refuse_unknown(&self, entries: &[Entry], fields: &'static [&'static str]) {
        for entry in entries.iter().filter(|e| !fields.contains(&e.key.as_str())) {
            self.report(unknown("field", &entry.key, fields).at(entry.place));
        }
    }
}

/// A whole number of YAML's core schema, or a real without a fraction: the schema says what a number is, not its
/// spelling. Reals are exact up to 2^53.
fn whole(text: &str) -> Option<i128> {
    if let Some(digits) = text.strip_prefix("0x") {
        return i128::from_str_radix(digits, 16).ok();
    }
    if let Some(digits) = text.strip_prefix("0o") {
        return i128::from_str_radix(digits, 8).ok();
    }
    text.parse().ok().or_else(|| {
        let real: f64 = text.parse().ok()?;
        let exact = real.fract() == 0.0 && real.abs() <= 9_007_199_254_740_992.0;
        #[expect(clippy::cast_possible_truncation, reason = "a whole number below 2^53")]
        exact.then_some(real as i128)
    })
}

/// `unknown field "treshold"`, with the nearest name and all names.
pub(super) fn unknown(what: &str, found: &str, known: &[&str]) -> Problem {
    let fields = if what == "field" { "fields here" } else { "one of" };
    let all = format!("{fields}: {}", known.join(", "));
    let help = match nearest(found, known) {
        Some(near) => format!("did you mean \"{near}\"? {all}"),
        None => all,
    };
    Problem::new(format!("unknown {what} {}", quoted(found))).help(help)
}

impl Kind {
    /// The value in a message: what kind it is, and its text where it has one.
    pub(super) fn described(&self) -> String {
        match self {
            Self::Null => "empty".into(),
            Self::Scalar { text, plain: true } => quoted(text).trim_matches('"').to_owned(),
            Self::Scalar { text, plain: false } => format!("the text {}", quoted(text)),
            Self::List(items) => format!("a list of {}", items.len()),
            Self::Map(_) => "a mapping".into(),
        }
    }
}

macro_rules! whole_numbers {
    ($($method:ident $visit:ident $ty:ty),*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
            let n = self.whole(<$ty>::MIN.into(), <$ty>::MAX.into())?;
            visitor.$visit(<$ty>::try_from(n).expect("within the type's range")).map_err(self.at())
        }
    )*};
}

impl<'de> de::Deserializer<'de> for Reader<'_> {
    type Error = Problem;

    whole_numbers!(
        deserialize_u8 visit_u8 u8, deserialize_u16 visit_u16 u16, deserialize_u32 visit_u32 u32,
        deserialize_u64 visit_u64 u64, deserialize_i8 visit_i8 i8, deserialize_i16 visit_i16 i16,
        deserialize_i32 visit_i32 i32, deserialize_i64 visit_i64 i64
    );

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        match &self.node.kind {
            Kind::Null => visitor.visit_unit().map_err(self.at()),
            Kind::List(_) => self.deserialize_seq(visitor),
            Kind::Map(_) => self.deserialize_map(visitor),
            Kind::Scalar { text, plain: true } if matches!(text.as_str(), "true" | "false") => {
                self.deserialize_bool(visitor)
            }
            Kind::Scalar { text, plain: true } if text.parse::<i64>().is_ok() => {
                self.deserialize_i64(visitor)
            }
            Kind::Scalar { text, plain: true } if text.parse::<f64>().is_ok() => {
                self.deserialize_f64(visitor)
            }
            Kind::Scalar { .. } => self.deserialize_str(visitor),
        }
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        let value = match &self.node.kind {
            Kind::Scalar { text, plain: true } if text == "true" => true,
            Kind::Scalar { text, plain: true } if text == "false" => false,
            _ => return Err(self.wanted("true or false")),
        };
        visitor.visit_bool(value).map_err(self.at())
    }

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        self.deserialize_f64(visitor)
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_f64(self.real()?).map_err(self.at())
    }

    fn deserialize_char<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        self.deserialize_str(visitor)
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_str(self.text("a text")?).map_err(self.at())
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        self.deserialize_str(visitor)
    }

    fn deserialize_bytes<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        self.deserialize_str(visitor)
    }

    fn deserialize_byte_buf<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        self.deserialize_str(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_some(self)
    }

    fn deserialize_unit<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        match self.node.kind {
            Kind::Null => visitor.visit_unit().map_err(self.at()),
            _ => Err(self.wanted("nothing")),
        }
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Problem> {
        self.deserialize_unit(visitor)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Problem> {
        if name == MARK {
            return visitor.visit_seq(FieldAccess { reader: self, step: 0 });
        }
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        let items = self.items()?.iter();
        visitor.visit_seq(Items { reader: self, items }).map_err(self.at())
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, Problem> {
        let found = self.items()?.len();
        if found != len {
            return Err(self.wanted(&format!("a list of {len}")));
        }
        self.deserialize_seq(visitor)
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        len: usize,
        visitor: V,
    ) -> Result<V::Value, Problem> {
        self.deserialize_tuple(len, visitor)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        let entries = Entries { reader: self, rest: self.entries()?, fields: None, value: None };
        visitor.visit_map(entries).map_err(self.at())
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Problem> {
        let entries = self.entries()?;
        self.refuse_unknown(entries, fields);
        let access = Entries { reader: self, rest: entries, fields: Some(fields), value: None };
        visitor.visit_map(access).map_err(self.at())
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Problem> {
        let choice = self.choice(variants)?;
        visitor.visit_enum(choice).map_err(self.at())
    }

    fn deserialize_identifier<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        self.deserialize_str(visitor)
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Problem> {
        visitor.visit_unit()
    }
}

impl<'a> Reader<'a> {
    /// The one key of an enumeration, or its bare word.
    fn choice(self, variants: &'static [&'static str]) -> Result<Choice<'a>, Problem> {
        let one_of = || format!("one of {}", variants.join(", "));
        let (name, place, value) = match &self.node.kind {
            Kind::Scalar { text, .. } => (text, self.node.place, None),
            Kind::Map(entries) => match entries.as_slice() {
                [entry] => (&entry.key, entry.place, Some(&entry.value)),
                several => {
                    let problem =
                        Problem::of_field(format!("has {} keys, wanted {}", several.len(), one_of()));
                    return Err(problem.at(self.node.place));
                }
            },
            _ => return Err(self.wanted(&one_of())),
        };
        if !variants.contains(&name.as_str()) {
            return Err(unknown("choice", name, variants).at(place));
        }
        Ok(Choice { reader: self, name, value })
    }
}

/// A [`super::field::Field`]: its place in three numbers, then its value, or nothing where the value is faulty.
struct FieldAccess<'a> {
    reader: Reader<'a>,
    step: u8,
}

impl<'de> de::SeqAccess<'de> for FieldAccess<'_> {
    type Error = Problem;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Problem> {
        let Place { file, start, end } = self.reader.node.place;
        self.step += 1;
        if let Some(number) = [file, start, end].get(usize::from(self.step) - 1) {
            return seed.deserialize(number.into_deserializer()).map(Some);
        }
        if self.reader.node.kind == Kind::Null {
            let problem = Problem::of_key("has no value").help("give it one, or remove the key");
            self.reader.report(problem.at(self.reader.node.place));
            return Ok(None);
        }
        match seed.deserialize(self.reader) {
            Ok(value) => Ok(Some(value)),
            Err(problem) => {
                self.reader.report(problem.at(self.reader.node.place));
                Ok(None)
            }
        }
    }
}

struct Items<'a> {
    reader: Reader<'a>,
    items: std::slice::Iter<'a, Node>,
}

impl<'de> de::SeqAccess<'de> for Items<'_> {
    type Error = Problem;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Problem> {
        self.items.next().map(|item| seed.deserialize(self.reader.of(item))).transpose()
    }
}

struct Entries<'a> {
    reader: Reader<'a>,
    rest: &'a [Entry],
    /// Of a structure: the fields that it has; others were reported before.
    fields: Option<&'static [&'static str]>,
    value: Option<&'a Node>,
}

impl<'de> de::MapAccess<'de> for Entries<'_> {
    type Error = Problem;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Problem> {
        while let [entry, rest @ ..] = self.rest {
            self.rest = rest;
            if self.fields.is_none_or(|fields| fields.contains(&entry.key.as_str())) {
                self.value = Some(&entry.value);
                let key: de::value::StrDeserializer<'_, Problem> = entry.key.as_str().into_deserializer();
                return seed.deserialize(key).map(Some);
            }
        }
        Ok(None)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Problem> {
        let value = self.value.take().expect("serde asks for a value after its key");
        seed.deserialize(self.reader.of(value)).map_err(|problem| problem.at(value.place))
    }
}

struct Choice<'a> {
    reader: Reader<'a>,
    name: &'a str,
    value: Option<&'a Node>,
}

impl<'de, 'a> de::EnumAccess<'de> for Choice<'a> {
    type Error = Problem;
    type Variant = Self;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), Problem> {
        let name: de::value::StrDeserializer<'_, Problem> = self.name.into_deserializer();
        Ok((seed.deserialize(name)?, self))
    }
}

impl<'a> Choice<'a> {
    fn body(&self) -> Result<Reader<'a>, Problem> {
        let missing = || {
            let name = self.name;
            Problem::of_field(format!("is the word {name}, wanted a mapping"))
                .help(format!("write {name}: {{ … }}"))
        };
        self.value.map(|value| self.reader.of(value)).ok_or_else(missing)
    }
}

impl<'de> de::VariantAccess<'de> for Choice<'_> {
    type Error = Problem;

    fn unit_variant(self) -> Result<(), Problem> {
        match self.value {
            None => Ok(()),
            Some(value) => {
                Err(Problem::of_field("takes no value").help(format!("write {}", self.name)).at(value.place))
            }
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Problem> {
        let body = self.body()?;
        seed.deserialize(body).map_err(body.at())
    }

    fn tuple_variant<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, Problem> {
        de::Deserializer::deserialize_tuple(self.body()?, len, visitor)
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Problem> {
        de::Deserializer::deserialize_struct(self.body()?, "", fields, visitor)
    }
}
