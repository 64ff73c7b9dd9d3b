//! A file's text, and places in it.

use std::path::PathBuf;
use std::sync::Arc;

/// A file that was read. It is kept as long as a message may quote it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SourceText {
    /// Path of the file, as the user named it.
    pub path: PathBuf,
    /// Content of the file; empty if it could not be read.
    pub body: String,
}

/// The files of one recipe: its own, and its defaults.
pub(super) type Texts = Vec<Arc<SourceText>>;

/// A range of bytes in one of the files of a recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct TextSpan {
    /// Index into [`Texts`].
    pub file: u32,
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

impl SourceText {
    /// Returns line and column of a byte, both from 1, columns in characters. Lines end as in YAML:
    /// at `\n`, `\r\n` or `\r`.
    pub(super) fn position(&self, offset: usize) -> (usize, usize) {
        let before = self.until(offset);
        // The first two terms both count a `\r\n`.
        let breaks =
            before.matches('\n').count() + before.matches('\r').count() - before.matches("\r\n").count();
        (breaks + 1, self.until(offset)[self.line_start(offset)..].chars().count() + 1)
    }

    /// Returns the line that contains a byte, without its end.
    pub(super) fn line(&self, offset: usize) -> &str {
        let rest = &self.body[self.line_start(offset)..];
        rest.split(['\n', '\r']).next().unwrap_or(rest)
    }

    /// Returns the byte at a line and column, both from 1; the end of the text if the place does
    /// not exist.
    pub(super) fn offset(&self, line: usize, column: usize) -> usize {
        let mut start = 0;
        for _ in 1..line {
            let Some(next) = self.body[start..].find(['\n', '\r']) else { return self.body.len() };
            let width = if self.body[start + next..].starts_with("\r\n") { 2 } else { 1 };
            start += next + width;
        }
        let rest = &self.body[start..];
        start + rest.char_indices().nth(column.saturating_sub(1)).map_or(rest.len(), |(at, _)| at)
    }

    fn line_start(&self, offset: usize) -> usize {
        self.until(offset).rfind(['\n', '\r']).map_or(0, |at| at + 1)
    }

    fn until(&self, offset: usize) -> &str {
        let mut end = offset.min(self.body.len());
        while !self.body.is_char_boundary(end) {
            end -= 1;
        }
        &self.body[..end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_positions_are_inverse() {
        let text = SourceText { path: PathBuf::new(), body: "a: é\r\n  b: 1\rc\n\nd".into() };
        let t = |line, column, offset| {
            assert_eq!(text.offset(line, column), offset);
            assert_eq!(text.position(offset), (line, column));
        };
        t(1, 1, 0);
        t(1, 4, 3);
        t(1, 5, 5);
        t(2, 3, 9);
        t(3, 1, 14);
        t(4, 1, 16);
        t(5, 1, 17);
        assert_eq!(text.line(10), "  b: 1");
        assert_eq!(text.line(16), "");
        assert_eq!(text.offset(9, 1), text.body.len());
    }
}
