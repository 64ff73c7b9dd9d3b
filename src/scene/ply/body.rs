//! The body of a `.ply` file: rows of vertices, and numbers in a row.

use super::header::{Element, Encoding, Header, Kind, Number};
use crate::budget::Budget;
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
    pub(super) fn find_column(
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
            Real::LittleF32 => f64::from(f32::from_le_bytes(field_bytes(row, self.offset))),
            Real::BigF32 => f64::from(f32::from_be_bytes(field_bytes(row, self.offset))),
            Real::LittleF64 => f64::from_le_bytes(field_bytes(row, self.offset)),
            Real::BigF64 => f64::from_be_bytes(field_bytes(row, self.offset)),
        }
    }
}

pub(super) fn field_bytes<const N: usize>(row: &[u8], offset: usize) -> [u8; N] {
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
pub(super) fn element_rows<'a, const N: usize>(
    header: &Header,
    wanted: [&str; N],
    cursor: &mut Cursor<'a>,
) -> Result<[Rows<'a>; N], SceneError> {
    let mut rows = [Rows { bytes: &[], offset: cursor.offset() }; N];
    for element in &header.elements {
        let before = cursor.clone();
        skip_element(element, header.encoding, cursor)?;
        if let Some(k) = wanted.iter().position(|name| element.name == *name) {
            let len = cursor.offset() - before.offset();
            rows[k] = Rows { bytes: &before.rest()[..len], offset: before.offset() };
        }
    }
    cursor.end()?;
    Ok(rows)
}

fn skip_element(element: &Element, encoding: Encoding, cursor: &mut Cursor) -> Result<(), SceneError> {
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
pub(super) fn binary_body<'a>(
    header: &Header,
    mut cursor: Cursor<'a>,
    buffer: &'a mut Vec<u8>,
) -> Result<Cursor<'a>, SceneError> {
    if header.encoding != Encoding::Ascii {
        return Ok(cursor);
    }
    // Short words stand for long numbers: what takes more than its budget is read twice, first to nothing.
    let mut budget = Budget::of(cursor.rest().len());
    if header
        .elements
        .iter()
        .any(|element| budget.take(element.count, element.stride().unwrap_or(0)).is_err())
    {
        binary_from_ascii(header, &mut cursor.clone(), &mut |_| ())?;
    }
    binary_from_ascii(header, &mut cursor, &mut |number| buffer.extend_from_slice(number))?;
    Ok(Cursor::new(".ply (as binary)", buffer))
}

/// Turns the words of an ascii body into the little-endian body that they stand for, number by number.
fn binary_from_ascii(
    header: &Header,
    text: &mut Cursor,
    put: &mut dyn FnMut(&[u8]),
) -> Result<(), SceneError> {
    for element in header.elements.iter().filter(|e| !e.properties.is_empty()) {
        for _ in 0..element.count {
            for property in &element.properties {
                match property.kind {
                    Kind::One(number) => transcode_word(text, number, put)?,
                    Kind::List { .. } => {
                        return Err(text.unsupported("a list in an ascii file", "convert it to binary"));
                    }
                }
            }
        }
    }
    skip_spaces(text)?;
    text.end()
}

fn skip_spaces(text: &mut Cursor) -> Result<(), SceneError> {
    let spaces = text.rest().len() - text.rest().trim_ascii_start().len();
    text.take(spaces, "spaces").map(|_| ())
}

/// Puts the number of the next word. A word counts only when something ends it, so that a file cut
/// inside its last number is told.
fn transcode_word(text: &mut Cursor, number: Number, put: &mut dyn FnMut(&[u8])) -> Result<(), SceneError> {
    skip_spaces(text)?;
    let at = text.clone();
    let word = text.until(u8::is_ascii_whitespace, "a number and the space after it")?;
    let pushed = std::str::from_utf8(word).ok().and_then(|word| put_number(word, number, put));
    pushed.ok_or_else(|| {
        let word = String::from_utf8_lossy(word);
        at.malformed(format!("`{word}`"), format!("a number of type {number:?}"))
    })
}

fn put_number(word: &str, number: Number, put: &mut dyn FnMut(&[u8])) -> Option<()> {
    match number {
        Number::I8 => put(&word.parse::<i8>().ok()?.to_le_bytes()),
        Number::U8 => put(&word.parse::<u8>().ok()?.to_le_bytes()),
        Number::I16 => put(&word.parse::<i16>().ok()?.to_le_bytes()),
        Number::U16 => put(&word.parse::<u16>().ok()?.to_le_bytes()),
        Number::I32 => put(&word.parse::<i32>().ok()?.to_le_bytes()),
        Number::U32 => put(&word.parse::<u32>().ok()?.to_le_bytes()),
        Number::F32 => put(&word.parse::<f32>().ok()?.to_le_bytes()),
        Number::F64 => put(&word.parse::<f64>().ok()?.to_le_bytes()),
    }
    Some(())
}
