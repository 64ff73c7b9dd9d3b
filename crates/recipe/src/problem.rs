//! A fault before its files are known, as reported by readers of the value tree.

use super::fault::RecipeFault;
use super::nearest::nearest_word;
use super::text::{TextSpan, Texts};
use super::tree::TreeNode;
use gs2e_files::escape::is_hidden;
use serde::de;
use std::fmt;

/// A fault and its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct FieldProblem {
    message: String,
    about: FieldContext,
    help: Option<String>,
    /// The value, key or mapping with the fault.
    place: Option<TextSpan>,
    /// The part of it to be shown, if smaller.
    part: Option<TextSpan>,
}

/// Relation between the message and the name of the field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FieldContext {
    /// The message is complete: `unknown field "treshold"`.
    Itself,
    /// The message continues the name: `"sampling.rate" is 0, wanted …`.
    Field,
    /// The message continues the name, and the place is the key instead of the value.
    Key,
    /// The message is the name of an absent field: `missing field "camera.width"`.
    Missing,
    /// The message is a sentence about the field: `"checks.speed.max": a limit is …`.
    Sentence,
}

impl FieldProblem {
    /// Creates a complete message.
    pub(super) fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), about: FieldContext::Itself, help: None, place: None, part: None }
    }

    /// Creates a message that continues the path of the field at the problem's place.
    pub(super) fn of_field(message: impl Into<String>) -> Self {
        Self { about: FieldContext::Field, ..Self::new(message) }
    }

    /// Like [`Self::of_field`], but points to the field's key.
    pub(super) fn of_key(message: impl Into<String>) -> Self {
        Self { about: FieldContext::Key, ..Self::new(message) }
    }

    /// Creates a problem for a field that is missing in the mapping at the problem's place.
    pub(super) fn missing_field(field: &str) -> Self {
        Self { about: FieldContext::Missing, ..Self::new(field) }
    }

    /// Creates a problem for an unknown name. The help lists all known names and suggests the
    /// nearest.
    pub(super) fn unknown_name(what: &str, found: &str, known: &[&str]) -> Self {
        let all = format!("{what}s here: {}", known.join(", "));
        let help = match nearest_word(found, known) {
            Some(near) => format!("did you mean \"{near}\"? {all}"),
            None => all,
        };
        Self::new(format!("unknown {what} {}", quote_text(found))).help(help)
    }

    /// Adds the advice.
    pub(super) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Sets the place, unless a place nearer to the cause is known.
    pub(super) fn at(mut self, place: TextSpan) -> Self {
        self.place = self.place.or(Some(place));
        self
    }

    /// Appends a remark to the message.
    pub(super) fn noting(mut self, remark: &str) -> Self {
        self.message.push_str(remark);
        self
    }

    /// Points to a part of the text at `place`, given as a byte range of `text`. The part is set
    /// only if the file contains the text unchanged: plain, or in quotes without an escape. The
    /// problem must be `at` the same place.
    pub(super) fn in_text(mut self, place: TextSpan, text: &str, bytes: std::ops::Range<usize>) -> Self {
        let written = (place.end - place.start) as usize;
        // Quotes add one byte on either side. Any other length means that the text is not in the
        // file as it is.
        let quote = if written == text.len() { 0 } else { 1 };
        if written == text.len() + 2 * quote && bytes.end <= text.len() {
            let at = |byte: usize| place.start + u32::try_from(quote + byte).unwrap_or(0);
            self.part = Some(TextSpan { start: at(bytes.start), end: at(bytes.end), ..place });
        }
        self
    }

    /// Creates the fault. The name of the field is found in the tree that was read.
    pub(super) fn fault(self, texts: &Texts, root: Option<&TreeNode>) -> RecipeFault {
        let (path, key) = self.place.and_then(|p| root?.find(p)).unwrap_or_default();
        let place =
            if self.about == FieldContext::Key { key.or(self.place) } else { self.part.or(self.place) };
        let name = if path.is_empty() { "the recipe".to_owned() } else { format!("\"{path}\"") };
        let message = match self.about {
            FieldContext::Itself => self.message,
            FieldContext::Field | FieldContext::Key => format!("{name} {}", self.message),
            FieldContext::Sentence => format!("{name}: {}", self.message),
            FieldContext::Missing if path.is_empty() => format!("missing field \"{}\"", self.message),
            FieldContext::Missing => format!("missing field \"{path}.{}\"", self.message),
        };
        let text = &texts[place.map_or(0, |p| p.file as usize)];
        RecipeFault::new(message, self.help, text.clone(), place)
    }

    /// Order of the faults of one recipe in the output.
    pub(super) fn order(&self) -> Option<TextSpan> {
        self.place
    }
}

/// A text of a recipe in a message: quoted, short, and without hidden characters.
pub(super) fn quote_text(text: &str) -> String {
    format!("\"{}\"", bare_text(text))
}

/// Like [`quote_text`], without the quotes.
pub(super) fn bare_text(text: &str) -> String {
    const MAX_CHARS: usize = 60;
    let mut short = String::new();
    for c in text.chars().take(MAX_CHARS) {
        if is_hidden(c) || c == '"' { short.extend(c.escape_debug()) } else { short.push(c) }
    }
    if text.chars().nth(MAX_CHARS).is_some() {
        short.push('…');
    }
    short
}

impl fmt::Display for FieldProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for FieldProblem {}

impl de::Error for FieldProblem {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self { about: FieldContext::Sentence, ..Self::new(message.to_string()) }
    }

    fn invalid_type(found: de::Unexpected<'_>, wanted: &dyn de::Expected) -> Self {
        Self::of_field(format!("is {found}, wanted {wanted}"))
    }

    fn invalid_value(found: de::Unexpected<'_>, wanted: &dyn de::Expected) -> Self {
        Self::of_field(format!("is {found}, wanted {wanted}"))
    }

    fn invalid_length(found: usize, wanted: &dyn de::Expected) -> Self {
        Self::of_field(format!("has {found} values, wanted {wanted}"))
    }

    fn unknown_field(found: &str, known: &'static [&'static str]) -> Self {
        Self::unknown_name("field", found, known)
    }

    fn missing_field(name: &'static str) -> Self {
        Self::missing_field(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_in_messages_are_short_and_harmless() {
        assert_eq!(quote_text("dvs346"), "\"dvs346\"");
        assert_eq!(quote_text("a\u{1b}[31m\n\"é'"), "\"a\\u{1b}[31m\\n\\\"é'\"");
        assert_eq!(bare_text(&"x".repeat(100)).chars().count(), 61);
    }
}
