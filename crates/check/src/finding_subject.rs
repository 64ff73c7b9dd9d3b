//! The subject of a finding.

use serde::{Deserialize, Serialize};
use std::fmt;

/// The object that a finding judges, and which of a check's statements it is. In files it is one text,
/// `place#statement`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct FindingSubject {
    /// `scene`, `scene/trajectory` or `scene/trajectory/sensor`.
    pub place: String,
    /// Name of the statement; empty for a check that makes only one.
    pub statement: String,
}

impl FindingSubject {
    /// The subject of a statement.
    #[must_use]
    pub fn new(place: impl Into<String>, statement: &str) -> Self {
        Self { place: place.into(), statement: statement.to_owned() }
    }

    /// This subject below `place`, such as a scene and a trajectory.
    #[must_use]
    pub fn below(self, place: &str) -> Self {
        Self { place: format!("{place}{}", self.place), ..self }
    }

    /// The text without `prefix`, such as the scene and the trajectory that a table is about.
    #[must_use]
    pub fn text_without(&self, prefix: &str) -> String {
        let text = self.to_string();
        let rest = text.strip_prefix(prefix).unwrap_or(&text);
        rest.strip_prefix(['/', '#']).unwrap_or(rest).to_owned()
    }

    /// Returns true if this is one of several sensors of a trajectory.
    #[must_use]
    pub fn is_of_sensor(&self, sensor: &str) -> bool {
        self.place.strip_suffix(sensor).is_some_and(|rest| rest.ends_with('/'))
    }
}

impl fmt::Display for FindingSubject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mark = if self.statement.is_empty() { "" } else { "#" };
        write!(f, "{}{mark}{}", self.place, self.statement)
    }
}

impl From<FindingSubject> for String {
    fn from(subject: FindingSubject) -> Self {
        subject.to_string()
    }
}

impl From<String> for FindingSubject {
    /// Divides a text at its last `#`: names of statements hold none, and a file's name may.
    fn from(text: String) -> Self {
        match text.rsplit_once('#') {
            Some((place, statement)) => Self::new(place, statement),
            None => Self::new(text, ""),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_come_back() {
        for text in ["", "s", "s/t", "#mean", "s/t/fine#scale", "a#b.h5#order"] {
            assert_eq!(FindingSubject::from(text.to_owned()).to_string(), text);
        }
    }

    #[test]
    fn a_table_shows_the_rest_of_a_subject() {
        let subject = FindingSubject::new("/fine", "scale").below("s/t");
        assert_eq!(subject.to_string(), "s/t/fine#scale");
        assert_eq!(subject.text_without("s/t"), "fine#scale");
        assert_eq!(FindingSubject::new("s/t", "").text_without("s/t"), "");
        assert_eq!(FindingSubject::new("s/t", "order").text_without("s/t"), "order");
    }

    #[test]
    fn a_sensor_is_a_whole_name() {
        let subject = FindingSubject::new("s/t/fine", "");
        assert!(subject.is_of_sensor("fine") && !subject.is_of_sensor("ine") && !subject.is_of_sensor("t"));
    }
}
