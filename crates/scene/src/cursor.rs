//! A position in the bytes of a scene file.

use super::SceneError;
use std::borrow::Cow;

/// Bytes of a scene file, and the position up to which they are read. All numbers are little
/// endian.
#[derive(Debug, Clone)]
pub(super) struct ByteCursor<'a> {
    format: &'static str,
    bytes: &'a [u8],
    offset: usize,
}

impl<'a> ByteCursor<'a> {
    /// A cursor at the start of `bytes`. Errors use `format` as its name.
    pub(super) fn new(format: &'static str, bytes: &'a [u8]) -> Self {
        Self { format, bytes, offset: 0 }
    }

    /// Number of bytes read so far.
    pub(super) fn offset(&self) -> usize {
        self.offset
    }

    /// A cursor over the same bytes at `offset`, for an error at that place.
    pub(super) fn at(&self, offset: usize) -> Self {
        Self { offset, ..self.clone() }
    }

    /// The bytes that are not read yet.
    pub(super) fn rest(&self) -> &'a [u8] {
        &self.bytes[self.offset..]
    }

    /// The next `len` bytes. `what` names them in errors.
    pub(super) fn take(&mut self, len: usize, what: &str) -> Result<&'a [u8], SceneError> {
        let Some(taken) = self.rest().get(..len) else {
            let left = self.rest().len();
            let found =
                if left == 0 { "the end of the data".into() } else { format!("{left} bytes before the end") };
            return Err(self.malformed(found, format!("{len} bytes of {what}")));
        };
        self.offset += len;
        Ok(taken)
    }

    /// The next `N` bytes.
    pub(super) fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], SceneError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    /// The next four bytes as a number.
    pub(super) fn u32(&mut self, what: &str) -> Result<u32, SceneError> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    /// The next eight bytes as a number.
    pub(super) fn u64(&mut self, what: &str) -> Result<u64, SceneError> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    /// The bytes before the next `ends` byte, which is consumed too. `what` names them in errors.
    pub(super) fn until(&mut self, ends: impl Fn(&u8) -> bool, what: &str) -> Result<&'a [u8], SceneError> {
        let Some(len) = self.rest().iter().position(ends) else {
            return Err(self.malformed("the end of the data", what));
        };
        Ok(&self.take(len + 1, what)?[..len])
    }

    /// The next line without its line feed, and without a carriage return before it. Bytes that are
    /// not UTF-8 are replaced.
    pub(super) fn line(&mut self, what: &str) -> Result<Cow<'a, str>, SceneError> {
        let line = self.until(|&b| b == b'\n', what)?;
        Ok(String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(line)))
    }

    /// Returns an error unless everything has been read.
    pub(super) fn end(&self) -> Result<(), SceneError> {
        match self.rest().len() {
            0 => Ok(()),
            n => Err(self.malformed(format!("{n} more bytes"), "the end of the data")),
        }
    }

    /// The error that says `found` where `wanted` was expected.
    pub(super) fn malformed(&self, found: impl Into<String>, wanted: impl Into<String>) -> SceneError {
        SceneError::Malformed {
            format: self.format,
            offset: self.offset,
            found: found.into(),
            wanted: wanted.into(),
        }
    }

    /// The error that the variant found here is not supported.
    pub(super) fn unsupported(&self, what: impl Into<String>, hint: &'static str) -> SceneError {
        SceneError::Unsupported { format: self.format, offset: self.offset, what: what.into(), hint }
    }
}
