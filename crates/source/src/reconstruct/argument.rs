//! Arguments of a program: texts with placeholders in braces, for example `{capture}`. `{{` and
//! `}}` are literal braces. No shell reads them.

use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt;
use std::path::PathBuf;

/// A text with placeholders.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ArgumentTemplate(Vec<ArgumentPiece>);

#[derive(Debug, Clone, PartialEq, Eq)]
enum ArgumentPiece {
    Text(String),
    Place(String),
}

/// The reason why a text is not an argument.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArgumentError {
    /// An unknown name in braces.
    #[error("{{{0}}}")]
    Unknown(String),
    /// A brace without a matching brace.
    #[error("an unmatched brace")]
    Alone,
}

impl ArgumentTemplate {
    /// Parses a text whose placeholders must be in `known`. A placeholder with a known value is
    /// filled.
    ///
    /// # Errors
    /// A placeholder is unknown, or a brace has no matching brace.
    pub fn parse(text: &str, known: &BTreeMap<&str, Option<String>>) -> Result<Self, ArgumentError> {
        let mut pieces = Vec::new();
        let mut rest = text;
        while let Some(at) = rest.find(['{', '}']) {
            let (before, braces) = rest.split_at(at);
            append_text(&mut pieces, before);
            // Doubled braces come first, because `{{` would otherwise begin a placeholder.
            rest = if let Some(after) = braces.strip_prefix("{{") {
                append_text(&mut pieces, "{");
                after
            } else if let Some(after) = braces.strip_prefix("}}") {
                append_text(&mut pieces, "}");
                after
            } else {
                let inside = braces.strip_prefix('{').and_then(|rest| rest.split_once('}'));
                let (name, after) = inside.ok_or(ArgumentError::Alone)?;
                match known.get(name) {
                    // A known value becomes text, and thereby part of the serialised command.
                    Some(Some(value)) => append_text(&mut pieces, value),
                    Some(None) => pieces.push(ArgumentPiece::Place(name.to_owned())),
                    None => return Err(ArgumentError::Unknown(name.to_owned())),
                }
                after
            };
        }
        append_text(&mut pieces, rest);
        Ok(Self(pieces))
    }

    /// Fills the placeholders. Placeholders without a value remain.
    #[must_use]
    pub fn fill(&self, places: &BTreeMap<&str, PathBuf>) -> OsString {
        let mut filled = OsString::new();
        for piece in &self.0 {
            match piece {
                ArgumentPiece::Text(text) => filled.push(text),
                ArgumentPiece::Place(name) => match places.get(name.as_str()) {
                    Some(path) => filled.push(path),
                    None => filled.push(format!("{{{name}}}")),
                },
            }
        }
        filled
    }

    /// Returns true if this placeholder is still open.
    #[must_use]
    pub fn names(&self, place: &str) -> bool {
        self.0.iter().any(|piece| matches!(piece, ArgumentPiece::Place(name) if name == place))
    }
}

fn append_text(pieces: &mut Vec<ArgumentPiece>, text: &str) {
    // Neighbouring texts merge, so that equal arguments compare equal however they were spelled.
    match pieces.last_mut() {
        Some(ArgumentPiece::Text(before)) => before.push_str(text),
        _ if text.is_empty() => {}
        _ => pieces.push(ArgumentPiece::Text(text.to_owned())),
    }
}

/// Canonical spelling: equal arguments are displayed identically.
impl fmt::Display for ArgumentTemplate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|piece| match piece {
            ArgumentPiece::Text(text) => f.write_str(&text.replace('{', "{{").replace('}', "}}")),
            ArgumentPiece::Place(name) => write!(f, "{{{name}}}"),
        })
    }
}

impl Serialize for ArgumentTemplate {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<ArgumentTemplate, ArgumentError> {
        let known = [("out", None), ("capture", None), ("seed", Some("7".to_owned()))];
        ArgumentTemplate::parse(text, &known.into_iter().collect())
    }

    #[test]
    fn places_are_filled_and_braces_are_kept() {
        let places = [("out", PathBuf::from("/o ut")), ("capture", PathBuf::from("/c"))];
        let places: BTreeMap<&str, PathBuf> = places.into_iter().collect();
        let t = |text: &str, filled: &str, written: &str| {
            let argument = parse(text).unwrap();
            assert_eq!(argument.fill(&places), filled, "{text}");
            assert_eq!(argument.to_string(), written, "{text}");
            assert_eq!(parse(written).unwrap(), argument, "what is written is read back");
        };
        t("", "", "");
        t("-n", "-n", "-n");
        t("{out}/a.ply", "/o ut/a.ply", "{out}/a.ply");
        t("{capture}:{out}", "/c:/o ut", "{capture}:{out}");
        t("$(touch x) `y` *", "$(touch x) `y` *", "$(touch x) `y` *");
        t("{{out}}", "{out}", "{{out}}");
        t("{{{out}}}", "{/o ut}", "{{{out}}}");
        t("--seed={seed}", "--seed=7", "--seed=7");
        assert!(parse("{out}/x").unwrap().names("out") && !parse("{{out}}").unwrap().names("out"));
    }

    #[test]
    fn what_nothing_has_is_refused() {
        let t = |text: &str, wanted: ArgumentError| assert_eq!(parse(text), Err(wanted), "{text}");
        t("{home}", ArgumentError::Unknown("home".into()));
        t("{}", ArgumentError::Unknown(String::new()));
        t("{Out}", ArgumentError::Unknown("Out".into()));
        t("{out", ArgumentError::Alone);
        t("out}", ArgumentError::Alone);
        t("{{out}", ArgumentError::Alone);
    }
}
