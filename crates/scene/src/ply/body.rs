//! The body of a `.ply` file: rows of vertices, and numbers in a row.

use super::header::{BodyEncoding, NumberType, PlyElement, PlyHeader, PropertyKind};
use crate::SceneError;
use crate::cursor::ByteCursor;
use gs2e_files::budget::ByteBudget;

/// One property of the vertices, with the place of its number in a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct VertexColumn {
    offset: usize,
    number: RealKind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RealKind {
    LittleF32,
    BigF32,
    LittleF64,
    BigF64,
}

impl VertexColumn {
    /// The column of `property`: `None` if there is no such property, and an error if it is not
    /// float or double.
    pub(super) fn find_column(
        element: &PlyElement,
        property: &str,
        encoding: BodyEncoding,
        at: &ByteCursor,
    ) -> Result<Option<Self>, SceneError> {
        let mut offset = 0;
        for p in &element.properties {
            let number = match (p.kind, encoding) {
                (PropertyKind::One(NumberType::F32), BodyEncoding::BigEndian) => Some(RealKind::BigF32),
                (PropertyKind::One(NumberType::F64), BodyEncoding::BigEndian) => Some(RealKind::BigF64),
                (PropertyKind::One(NumberType::F32), _) => Some(RealKind::LittleF32),
                (PropertyKind::One(NumberType::F64), _) => Some(RealKind::LittleF64),
                _ => None,
            };
            if p.name == property {
                let wrong =
                    || at.malformed(format!("property `{property}` of type {:?}", p.kind), "float or double");
                return number.ok_or_else(wrong).map(|number| Some(Self { offset, number }));
            }
            // A list has no fixed size. Elements with a list are refused before columns are used.
            if let PropertyKind::One(number) = p.kind {
                offset += number.size();
            }
        }
        Ok(None)
    }

    pub(super) fn is_double(self) -> bool {
        matches!(self.number, RealKind::LittleF64 | RealKind::BigF64)
    }

    /// The number in a row of the column's element. Widening is exact.
    #[inline]
    pub(super) fn get(self, row: &[u8]) -> f64 {
        match self.number {
            RealKind::LittleF32 => f64::from(f32::from_le_bytes(field_bytes(row, self.offset))),
            RealKind::BigF32 => f64::from(f32::from_be_bytes(field_bytes(row, self.offset))),
            RealKind::LittleF64 => f64::from_le_bytes(field_bytes(row, self.offset)),
            RealKind::BigF64 => f64::from_be_bytes(field_bytes(row, self.offset)),
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
pub(super) struct ElementRows<'a> {
    pub(super) bytes: &'a [u8],
    /// Offset of the first row.
    pub(super) offset: usize,
}

/// The rows of the elements with these names, empty if absent. Every element of the file is
/// visited, so that a file that ends too early or too late is reported.
pub(super) fn element_rows<'a, const N: usize>(
    header: &PlyHeader,
    wanted: [&str; N],
    cursor: &mut ByteCursor<'a>,
) -> Result<[ElementRows<'a>; N], SceneError> {
    let mut rows = [ElementRows { bytes: &[], offset: cursor.offset() }; N];
    for element in &header.elements {
        let before = cursor.clone();
        skip_element(element, header.encoding, cursor)?;
        if let Some(k) = wanted.iter().position(|name| element.name == *name) {
            let len = cursor.offset() - before.offset();
            rows[k] = ElementRows { bytes: &before.rest()[..len], offset: before.offset() };
        }
    }
    cursor.end()?;
    Ok(rows)
}

fn skip_element(
    element: &PlyElement,
    encoding: BodyEncoding,
    cursor: &mut ByteCursor,
) -> Result<(), SceneError> {
    let what = format!("element `{}`", element.name);
    if let Some(stride) = element.stride() {
        // A product that overflows is larger than the file too, so it is reported as its end.
        let len = stride.saturating_mul(element.count);
        return cursor.take(len, &what).map(|_| ());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            let len = match property.kind {
                PropertyKind::One(number) => number.size(),
                PropertyKind::List { length, item } => read_length(length, encoding, cursor)? * item.size(),
            };
            cursor.take(len, &what)?;
        }
    }
    Ok(())
}

/// The length before a list: an integer below 2^32.
fn read_length(
    number: NumberType,
    encoding: BodyEncoding,
    cursor: &mut ByteCursor,
) -> Result<usize, SceneError> {
    let at = cursor.clone();
    let mut wide = [0; 4];
    let found = cursor.take(number.size(), "a list's length")?;
    if matches!(number, NumberType::F32 | NumberType::F64) {
        return Err(at.malformed("a list length of type float or double", "an integer type"));
    }
    wide[..found.len()].copy_from_slice(found);
    if encoding == BodyEncoding::BigEndian {
        wide[..found.len()].reverse();
    }
    // The highest byte that was read holds the sign, whatever the width.
    let negative =
        matches!(number, NumberType::I8 | NumberType::I16 | NumberType::I32) && wide[found.len() - 1] >= 0x80;
    if negative {
        return Err(at.malformed("a negative length", "a list's length"));
    }
    Ok(u32::from_le_bytes(wide) as usize)
}

/// The body at `cursor` in binary: unchanged, or in `buffer` the conversion of an ascii body.
pub(super) fn binary_body<'a>(
    header: &PlyHeader,
    mut cursor: ByteCursor<'a>,
    buffer: &'a mut Vec<u8>,
) -> Result<ByteCursor<'a>, SceneError> {
    if header.encoding != BodyEncoding::Ascii {
        return Ok(cursor);
    }
    // Short words can become long numbers. If the numbers exceed the budget, a first pass keeps
    // nothing, so that a broken file takes no memory.
    let mut budget = ByteBudget::of(cursor.rest().len());
    if header
        .elements
        .iter()
        .any(|element| budget.take(element.count, element.stride().unwrap_or(0)).is_err())
    {
        binary_from_ascii(header, &mut cursor.clone(), &mut |_| ())?;
    }
    binary_from_ascii(header, &mut cursor, &mut |number| buffer.extend_from_slice(number))?;
    Ok(ByteCursor::new(".ply (as binary)", buffer))
}

/// Converts the words of an ascii body into the same body in little-endian binary, number by
/// number.
fn binary_from_ascii(
    header: &PlyHeader,
    text: &mut ByteCursor,
    put: &mut dyn FnMut(&[u8]),
) -> Result<(), SceneError> {
    // An element without properties has no words, whatever count it states.
    for element in header.elements.iter().filter(|e| !e.properties.is_empty()) {
        for _ in 0..element.count {
            for property in &element.properties {
                match property.kind {
                    PropertyKind::One(number) => transcode_word(text, number, put)?,
                    PropertyKind::List { .. } => {
                        return Err(text.unsupported("a list in an ascii file", "convert it to binary"));
                    }
                }
            }
        }
    }
    skip_spaces(text)?;
    text.end()
}

fn skip_spaces(text: &mut ByteCursor) -> Result<(), SceneError> {
    let spaces = text.rest().len() - text.rest().trim_ascii_start().len();
    text.take(spaces, "spaces").map(|_| ())
}

/// Puts the number of the next word. A word counts only if white space follows it, so that a file
/// cut off inside its last number is an error.
fn transcode_word(
    text: &mut ByteCursor,
    number: NumberType,
    put: &mut dyn FnMut(&[u8]),
) -> Result<(), SceneError> {
    skip_spaces(text)?;
    let at = text.clone();
    let word = text.until(u8::is_ascii_whitespace, "a number and the space after it")?;
    let pushed = std::str::from_utf8(word).ok().and_then(|word| put_number(word, number, put));
    pushed.ok_or_else(|| {
        let word = String::from_utf8_lossy(word);
        at.malformed(format!("`{word}`"), format!("a number of type {number:?}"))
    })
}

fn put_number(word: &str, number: NumberType, put: &mut dyn FnMut(&[u8])) -> Option<()> {
    match number {
        NumberType::I8 => put(&word.parse::<i8>().ok()?.to_le_bytes()),
        NumberType::U8 => put(&word.parse::<u8>().ok()?.to_le_bytes()),
        NumberType::I16 => put(&word.parse::<i16>().ok()?.to_le_bytes()),
        NumberType::U16 => put(&word.parse::<u16>().ok()?.to_le_bytes()),
        NumberType::I32 => put(&word.parse::<i32>().ok()?.to_le_bytes()),
        NumberType::U32 => put(&word.parse::<u32>().ok()?.to_le_bytes()),
        NumberType::F32 => put(&word.parse::<f32>().ok()?.to_le_bytes()),
        NumberType::F64 => put(&word.parse::<f64>().ok()?.to_le_bytes()),
    }
    Some(())
}
