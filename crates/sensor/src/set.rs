//! The set of sensors that share one rendering.

use super::SensorChoice;
use std::collections::BTreeMap;

/// The sensors that share one rendering.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a recipe has one set")]
pub enum SensorSet {
    /// One sensor, without a name.
    One(SensorChoice),
    /// Several sensors by name.
    Named(BTreeMap<String, SensorChoice>),
}

impl SensorSet {
    /// Each sensor with its name, if it has one, in the order of names.
    pub fn iter(&self) -> impl Iterator<Item = (Option<&str>, &SensorChoice)> {
        let (one, named) = match self {
            Self::One(sensor) => (Some((None, sensor)), None),
            Self::Named(sensors) => (None, Some(sensors.iter().map(|(name, s)| (Some(name.as_str()), s)))),
        };
        one.into_iter().chain(named.into_iter().flatten())
    }
}
