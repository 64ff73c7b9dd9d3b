//! The body of a `.ply` file: rows of vertices, and numbers in a row.

use super::header::{Element, Encoding, Header, Kind, Number};
use crate::scene::SceneError;
use crate::scene::cursor::Cursor;

/// One property of the vertices, with the place of its number in a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    offset: usize,
    number: Real,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Real {
    LittleF32,
    BigF32,
    LittleF64,
    BigF64,
}

impl Column {
    /// The column of `property`: `None` if there is no such property, and an error if it is not
    /// float or double.
    pub(super) fn find(
        element: &Element,
        property: &str,
        encoding: Encoding,
        at: &Cursor,
    ) -> Result<Option<Self>, SceneError> {
        let mut offset = 0;
        for p in &element.properties {
            let number = match (p.kind, encoding) {
                (Kind::One(Number::F32), Encoding::BigEndian) => Some(Real::BigF32),
                (Kind::One(Number::F64), Encoding::BigEndian) => Some(Real::BigF64),
                (Kind::One(Number::F32), _) => Some(Real::LittleF32),
                (Kind::One(Number::F64), _) => Some(Real::LittleF64),
                _ => None,
            };
            if p.name == property {
                let wrong =
                    || at.malformed(format!("property `{property}` as {:?}", p.kind), "float or double");
                return number.ok_or_else(wrong).map(|number| Some(Self { offset, number }));
            }
            if let Kind::One(number) = p.kind {
                offset += number.size();
            }
        }
        Ok(None)
    }

    pub(super) fn is_double(self) -> bool {
        matches!(self.number, Real::LittleF64 | Real::BigF64)
    }

    /// The number in a row of the column's element. Widening is exact.
    #[inline]
    pub(super) fn get(self, row: &[u8]) -> f64 {
        match self.number {
            Real::LittleF32 => f64::from(f32::from_le_bytes(bytes(row, self.offset))),
            Real::BigF32 => f64::from(f32::from_be_bytes(bytes(row, self.offset))),
            Real::LittleF64 => f64::from_le_bytes(bytes(row, self.offset)),
            Real::BigF64 => f64::from_be_bytes(bytes(row, self.offset)),
        }
    }
}

pub(super) fn bytes<const N: usize>(row: &[u8], offset: usize) -> [u8; N] {
    let mut array = [0; N];
    array.copy_from_slice(&row[offset..offset + N]);
    array
}

/// The rows of one element, in binary.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub(super) bytes: &'a [u8],
    /// Where they begin.
    pub(super) offset: usize,
}

/// The rows of the elements with these names, empty if absent. Every element of the file is
/// visited, so that a file that ends too early or too late is reported.
pub(super) fn rows<'a, const N: usize>(
    header: &Header,
    wanted: [&str; N],
    cursor: &mut Cursor<'a>,
) -> Result<[Rows<'a>; N], SceneError> {
    let mut rows = [Rows { bytes: &[], offset: cursor.offset() }; N];
    for element in &header.elements {
        let before = cursor.clone();
        skip(element, header.encoding, cursor)?;
        if let Some(k) = wanted.iter().position(|name| element.name == *name) {
            let len = cursor.offset() - before.offset();
            rows[k] = Rows { bytes: &before.rest()[..len], offset: before.offset() };
        }
    }
    cursor.end()?;
    Ok(rows)
}

fn skip(element: &Element, encoding: Encoding, cursor: &mut Cursor) -> Result<(), SceneError> {
    let what = format!("element `{}`", element.name);
    if let Some(stride) = element.stride() {
        let len = stride.saturating_mul(element.count);
        return cursor.take(len, &what).map(|_| ());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            let len = match property.kind {
                Kind::One(number) => number.size(),
                Kind::List { length, item } => read_length(length, encoding, cursor)? * item.size(),
            };
            cursor.take(len, &what)?;
        }
    }
    Ok(())
}

/// The length before a list: an integer below 2^32.
fn read_length(number: Number, encoding: Encoding, cursor: &mut Cursor) -> Result<usize, SceneError> {
    let at = cursor.clone();
    let mut wide = [0; 4];
    let found = cursor.take(number.size(), "a list's length")?;
    if matches!(number, Number::F32 | Number::F64) {
        return Err(at.malformed("a list whose length is no integer", "a length of an integer type"));
    }
    wide[..found.len()].copy_from_slice(found);
    if encoding == Encoding::BigEndian {
        wide[..found.len()].reverse();
    }
    let negative = matches!(number, Number::I8 | Number::I16 | Number::I32) && wide[found.len() - 1] >= 0x80;
    if negative {
        return Err(at.malformed("a negative length", "a list's length"));
    }
    Ok(u32::from_le_bytes(wide) as usize)
}

/// The body at `cursor` in binary: unchanged, or in `buffer` the conversion of an ascii body.
pub(super) fn binary<'a>(
    header: &Header,
    mut cursor: Cursor<'a>,
    buffer: &'a mut Vec<u8>,
) -> Result<Cursor<'a>, SceneError> {
    if header.encoding != Encoding::Ascii {
        return Ok(cursor);
    }
    *buffer = binary_from_ascii(header, &mut cursor)?;
    Ok(Cursor::new(".ply (as binary)", buffer))
}

/// Converts the words of an ascii body into the equivalent little-endian body.
fn binary_from_ascii(header: &Header, text: &mut Cursor) -> Result<Vec<u8>, SceneError> {
    let mut out = Vec::new();
    for element in header.elements.iter().filter(|e| !e.properties.is_empty()) {
        for _ in 0..element.count {
            for property in &element.properties {
                match property.kind {
                    Kind::One(number) => transcode(text, number, &mut out)?,
                    Kind::List { .. } => {
                        return Err(text.unsupported("a list in an ascii file", "convert it to binary"));
                    }
                }
            }
        }
    }
    skip_spaces(text)?;
    text.end()?;
    Ok(out)
}

fn skip_spaces(text: &mut Cursor) -> Result<(), SceneError> {
    let spaces = text.rest().len() - text.rest().trim_ascii_start().len();
    text.take(spaces, "spaces").map(|_| ())
}

/// Appends the number in the next word to `out`. A word must be terminated, so that a file
/// truncated inside its last number is reported.
fn transcode(text: &mut Cursor, number: Number, out: &mut Vec<u8>) -> Result<(), SceneError> {
    skip_spaces(text)?;
    let at = text.clone();
    let word = text.until(u8::is_ascii_whitespace, "a number and the space after it")?;
    let pushed = std::str::from_utf8(word).ok().and_then(|word| push_number(word, number, out));
    pushed.ok_or_else(|| {
        let word = String::from_utf8_lossy(word);
        at.malformed(format!("`{word}`"), format!("a number of type {number:?}"))
    })
}

fn push_number(word: &str, number: Number, out: &mut Vec<u8>) -> Option<()> {
    match number {
        Number::I8 => out.extend(word.parse::<i8>().ok()?.to_le_bytes()),
        Number::U8 => out.extend(word.parse::<u8>().ok()?.to_le_bytes()),
        Number::I16 => out.extend(word.parse::<i16>().ok()?.to_le_bytes()),
        Number::U16 => out.extend(word.parse::<u16>().ok()?.to_le_bytes()),
        Number::I32 => out.extend(word.parse::<i32>().ok()?.to_le_bytes()),
        Number::U32 => out.extend(word.parse::<u32>().ok()?.to_le_bytes()),
        Number::F32 => out.extend(word.parse::<f32>().ok()?.to_le_bytes()),
        Number::F64 => out.extend(word.parse::<f64>().ok()?.to_le_bytes()),
    }
    Some(())
}
