//! A fault before its files are at hand: what readers of the value tree report.

use super::fault::Fault;
use super::text::{Place, Texts};
use super::tree::Node;
use serde::de;
use std::fmt;

/// What is wrong, and at which place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Problem {
    message: String,
    /// The message goes on from the name of the field: `"sampling.rate" is 0, wanted …`.
    names_field: bool,
    /// The key is meant, not its value.
    on_key: bool,
    help: Option<String>,
    place: Option<Place>,
}

impl Problem {
    /// A complete message.
    pub(super) fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), names_field: false, on_key: false, help: None, place: None }
    }

    /// A message that goes on from the path of the field at the problem's place.
    pub(super) fn of_field(message: impl Into<String>) -> Self {
        Self { names_field: true, ..Self::new(message) }
    }

    /// The same, pointing to the field's key.
    pub(super) fn of_key(message: impl Into<String>) -> Self {
        Self { on_key: true, ..Self::of_field(message) }
    }

    /// Adds what to do.
    pub(super) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Sets the place, unless one nearer to the cause is known.
    pub(super) fn at(mut self, place: Place) -> Self {
        self.place = self.place.or(Some(place));
        self
    }

    /// The fault, with the field's name found in the tree that was read.
    pub(super) fn fault(self, texts: &Texts, root: Option<&Node>) -> Fault {
        let found = self.place.and_then(|p| root?.find(p));
        let place = match &found {
            Some((_, Some(key))) if self.on_key => Some(*key),
            _ => self.place,
        };
        let message = match &found {
            Some((path, _)) if self.names_field => format!("\"{path}\" {}", self.message),
            _ if self.names_field => format!("the recipe {}", self.message),
            _ => self.message,
        };
        let file = place.map_or(0, |p| p.file as usize);
        Fault::new(message, self.help, texts[file].clone(), place)
    }

    /// Order in which faults of one recipe are shown.
    pub(super) fn order(&self) -> Option<Place> {
        self.place
    }
}

/// A text of a recipe in a message: quoted, short, and without control characters.
pub(super) fn quoted(text: &str) -> String {
    let mut short: String = text.chars().take(60).flat_map(char::escape_debug).collect();
    if text.chars().nth(60).is_some() {
        short.push('…');
    }
    format!("\"{short}\"").replace("\\'", "'")
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Problem {}

impl de::Error for Problem {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::new(message.to_string())
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

    fn missing_field(name: &'static str) -> Self {
        Self::new(format!("missing field \"{name}\""))
    }
}
