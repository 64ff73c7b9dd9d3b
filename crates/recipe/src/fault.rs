//! Faults of a recipe with their places: the four-part message of the command line.

use super::text::{SourceText, TextSpan};
use gs2e_files::escape;
use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

/// Maximum number of listed faults; the rest are counted.
pub const LISTED: usize = 20;

/// Longest excerpt of a source line, in characters.
const EXCERPT: usize = 120;

/// A fault of a recipe.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipeFault {
    message: String,
    help: Option<String>,
    text: Arc<SourceText>,
    span: Option<(usize, usize)>,
}

impl RecipeFault {
    /// Creates a fault at a place in a file. Without a place, the fault concerns the whole file.
    pub(super) fn new(
        message: String,
        help: Option<String>,
        text: Arc<SourceText>,
        place: Option<TextSpan>,
    ) -> Self {
        let span = place.map(|p| (p.start as usize, p.end.max(p.start) as usize));
        Self { message, help, text, span }
    }

    /// Creates a fault of a whole file, which may not exist.
    pub(super) fn of_file(path: &Path, message: &str, help: Option<&str>) -> Self {
        let text = SourceText { path: path.to_owned(), body: String::new() };
        Self::new(message.to_owned(), help.map(str::to_owned), Arc::new(text), None)
    }

    /// Stable code of this kind of fault.
    #[must_use]
    pub fn code(&self) -> &'static str {
        "recipe-invalid"
    }

    /// The message, in one line.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.message
    }

    /// The advice, if there is any.
    #[must_use]
    pub fn help(&self) -> Option<&str> {
        self.help.as_deref()
    }

    /// The file that contains the fault.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.text.path
    }

    /// Line and column, both from 1, columns in characters; `None` if the fault concerns the whole
    /// file.
    #[must_use]
    pub fn position(&self) -> Option<(usize, usize)> {
        self.span.map(|(start, _)| self.text.position(start))
    }

    /// The message in its four parts, without colours. Hidden characters and line breaks are
    /// visible.
    #[must_use]
    pub fn render_lines(&self) -> Vec<String> {
        let mut lines = vec![format!("error: {}", self.message), format!(" {}", self.location())];
        lines.extend(self.excerpt().into_iter().flatten());
        lines.extend(self.help.iter().map(|help| format!("help: {help}")));
        // Messages and excerpts quote bytes of files, so all lines are escaped.
        lines.iter().map(|line| escape::line(line).into_owned()).collect()
    }

    /// Returns the message as one JSON object:
    /// `level, code, message, scene, step, path, line, column, help`. Absent parts are null.
    #[must_use]
    pub fn to_json(&self) -> serde_json::Value {
        let position = self.position();
        serde_json::json!({
            "level": "error",
            "code": self.code(),
            "message": self.message,
            "scene": null,
            "step": null,
            "path": displayed_path(self.file()),
            "line": position.map(|p| p.0),
            "column": position.map(|p| p.1),
            "help": self.help,
        })
    }

    /// Returns `file:line:column`, or the file alone.
    #[must_use]
    pub fn location(&self) -> String {
        let file = displayed_path(self.file());
        self.position().map_or_else(|| file.clone(), |(line, column)| format!("{file}:{line}:{column}"))
    }

    fn excerpt(&self) -> Option<[String; 2]> {
        let (start, end) = self.span?;
        let (number, column) = self.text.position(start);
        let line: Vec<char> = self.text.line(start).chars().map(printable_char).collect();
        // A fault may span several lines; the carets stand below the first one only.
        let first = self.text.body.get(start..end).and_then(|s| s.split(['\n', '\r']).next());
        let width = first.map_or(1, |line| line.chars().count());
        // A long line is cut so that the fault is near the middle.
        let from = column.saturating_sub(EXCERPT / 2).min(line.len().saturating_sub(EXCERPT));
        let cut: String = line.iter().skip(from).take(EXCERPT).collect();
        let caret = column - 1 - from;
        let width = width.clamp(1, (EXCERPT - caret.min(EXCERPT - 1)).max(1));
        let gutter = number.to_string().len();
        let (indent, carets) = (" ".repeat(caret), "^".repeat(width));
        Some([format!("{number} │ {}", cut.trim_end()), format!("{:gutter$} │ {indent}{carets}", "")])
    }
}

/// One character for each, so that the carets stand below their text.
fn printable_char(c: char) -> char {
    match c {
        '\t' => '→',
        c if escape::is_hidden(c) => '\u{fffd}',
        c => c,
    }
}

/// A path for messages. Bytes that are no text have their visible form.
pub(super) fn displayed_path(path: &Path) -> String {
    escape::path(path)
}

impl fmt::Display for RecipeFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.location(), self.message)
    }
}

impl std::error::Error for RecipeFault {}

/// The faults of the recipes: at least one, and at most [`LISTED`] of them in full.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecipeFaults {
    listed: Vec<RecipeFault>,
    more: usize,
}

impl RecipeFaults {
    /// The faults of a list that is not empty. A fault of shared defaults is reported once.
    pub(super) fn new(mut faults: Vec<RecipeFault>) -> Self {
        let mut seen = BTreeSet::new();
        faults.retain(|fault| seen.insert(fault.to_string()));
        let more = faults.len().saturating_sub(LISTED);
        faults.truncate(LISTED);
        Self { listed: faults, more }
    }

    /// Returns the value if there are no faults.
    pub(super) fn value_or<T>(value: T, faults: Vec<RecipeFault>) -> Result<T, Self> {
        if faults.is_empty() { Ok(value) } else { Err(Self::new(faults)) }
    }

    /// The listed faults.
    #[must_use]
    pub fn listed(&self) -> &[RecipeFault] {
        &self.listed
    }

    /// Number of faults that are not listed.
    #[must_use]
    pub fn more(&self) -> usize {
        self.more
    }

    /// Returns all messages, separated by empty lines, and the number of faults that are not shown.
    #[must_use]
    pub fn render_lines(&self) -> Vec<String> {
        let mut parts: Vec<Vec<String>> = self.listed.iter().map(RecipeFault::render_lines).collect();
        if self.more > 0 {
            parts.push(vec![format!("and {} more", self.more)]);
        }
        parts.join(&String::new())
    }

    /// Returns all messages as one text that ends in a line break.
    #[must_use]
    pub fn render_text(&self) -> String {
        self.render_lines().join("\n") + "\n"
    }

    /// Returns one object per listed fault.
    #[must_use]
    pub fn to_json(&self) -> Vec<serde_json::Value> {
        self.listed.iter().map(RecipeFault::to_json).collect()
    }
}

impl fmt::Display for RecipeFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<String> = self.listed.iter().map(RecipeFault::to_string).collect();
        f.write_str(&lines.join("; "))?;
        if self.more > 0 { write!(f, "; and {} more", self.more) } else { Ok(()) }
    }
}

impl std::error::Error for RecipeFaults {}
