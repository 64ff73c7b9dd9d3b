//! The header of a `.ply` file: its elements, and the layout of their properties.
//!
//! Grammar: Greg Turk, "The PLY Polygon File Format", 1994.

mod property;

pub(super) use property::{NumberType, PlyElement, PlyProperty, PropertyKind};

use super::notes::PlyNotes;
use crate::SceneError;
use crate::cursor::ByteCursor;

/// Encoding of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BodyEncoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Maximum length of a header, bytes: ours has 1,600. The bound keeps the search for repeated names
/// short.
pub(super) const MAX_LEN: usize = 1 << 16;

#[derive(Debug)]
pub(super) struct PlyHeader {
    pub(super) encoding: BodyEncoding,
    pub(super) elements: Vec<PlyElement>,
    /// Notes in our own comments.
    pub(super) notes: PlyNotes,
}

impl PlyHeader {
    /// Reads the header, and leaves `cursor` at the body.
    pub(super) fn read(cursor: &mut ByteCursor) -> Result<Self, SceneError> {
        let at = cursor.clone();
        if cursor.line("a header line")? != "ply" {
            return Err(at.malformed("a different first line", "`ply`"));
        }
        let encoding = read_encoding(cursor)?;
        let mut header = Self { encoding, elements: Vec::new(), notes: PlyNotes::default() };
        loop {
            let at = cursor.clone();
            let line = cursor.line("a header line")?;
            if line.trim_end() == "end_header" {
                return Ok(header);
            }
            if cursor.offset() > MAX_LEN {
                return Err(at.malformed("a longer header", format!("its end by byte {MAX_LEN}")));
            }
            header.take_line(&line, &at)?;
        }
    }

    /// The element with this name.
    pub(super) fn element(&self, name: &str, at: &ByteCursor) -> Result<&PlyElement, SceneError> {
        let found = self.elements.iter().find(|e| e.name == name);
        found.ok_or_else(|| at.malformed(format!("no element `{name}`"), format!("an element `{name}`")))
    }

    fn take_line(&mut self, line: &str, at: &ByteCursor) -> Result<(), SceneError> {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            // An unknown note of our own is an error; comments of others are skipped.
            ["comment", PlyNotes::MARK, ref note @ ..] => self.notes.read(note, at),
            ["comment" | "obj_info", ..] | [] => Ok(()),
            ["element", name, count] => self.add_element(name, count, at),
            ["property", number, name] => {
                let kind = PropertyKind::One(parse_number(number, at)?);
                self.add_property(name, kind, at)
            }
            ["property", "list", length, item, name] => {
                let kind =
                    PropertyKind::List { length: parse_number(length, at)?, item: parse_number(item, at)? };
                self.add_property(name, kind, at)
            }
            _ => Err(at.malformed(format!("the line `{line}`"), "comment, element, property or end_header")),
        }
    }

    fn add_element(&mut self, name: &str, count: &str, at: &ByteCursor) -> Result<(), SceneError> {
        let count = count.parse().map_err(|_| at.malformed(format!("`{count}`"), "a number of rows"))?;
        if self.elements.iter().any(|e| e.name == name) {
            return Err(at.malformed(format!("a second element `{name}`"), "each element once"));
        }
        self.elements.push(PlyElement { name: name.to_owned(), count, properties: Vec::new() });
        Ok(())
    }

    fn add_property(&mut self, name: &str, kind: PropertyKind, at: &ByteCursor) -> Result<(), SceneError> {
        let Some(element) = self.elements.last_mut() else {
            return Err(at.malformed(format!("property `{name}` before any element"), "an element first"));
        };
        if element.has(name) {
            return Err(at.malformed(format!("a second property `{name}`"), "each property once"));
        }
        element.properties.push(PlyProperty { name: name.to_owned(), kind });
        Ok(())
    }
}

fn read_encoding(cursor: &mut ByteCursor) -> Result<BodyEncoding, SceneError> {
    let at = cursor.clone();
    let line = cursor.line("a header line")?;
    match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
        ["format", "ascii", "1.0"] => Ok(BodyEncoding::Ascii),
        ["format", "binary_little_endian", "1.0"] => Ok(BodyEncoding::LittleEndian),
        ["format", "binary_big_endian", "1.0"] => Ok(BodyEncoding::BigEndian),
        _ => Err(at.malformed(
            format!("the line `{line}`"),
            "format ascii, binary_little_endian or binary_big_endian, version 1.0",
        )),
    }
}

fn parse_number(name: &str, at: &ByteCursor) -> Result<NumberType, SceneError> {
    NumberType::from_name(name)
        .ok_or_else(|| at.malformed(format!("the type `{name}`"), "a number type such as float or uchar"))
}
