//! Limits as recipes write them.

use super::{EXACT, KEYS, Limits};
use crate::{NAMES, is_waivable};
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;

pub(super) struct LimitsVisitor;

impl<'de> Visitor<'de> for LimitsVisitor {
    type Value = Limits;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a mapping from check names to limits")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Limits, A::Error> {
        let mut limits = Limits::default();
        let mut seen = Vec::new();
        while let Some(key) = map.next_key::<String>()? {
            // A derived implementation refuses a repeated key; this one must do so itself.
            if seen.contains(&key) {
                return Err(A::Error::custom(format_args!("duplicate field `{key}`")));
            }
            limits.read(&key, &mut map)?;
            seen.push(key);
        }
        Ok(limits)
    }
}

pub(super) fn refusal_message<E: Error>(key: &str) -> E {
    // The name is known, so the message for unknown fields would mislead.
    if EXACT.contains(&key) {
        E::custom(format_args!(
            "the check `{key}` has no limit to set: it is exact, or its limits follow from the data"
        ))
    } else {
        E::unknown_field(key, KEYS)
    }
}

pub(super) fn pass_name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    // A misspelt name would accept nothing, and not say so.
    let known: Vec<&str> = NAMES.into_iter().filter(|name| is_waivable(name)).collect();
    if known.contains(&name.as_str()) {
        Ok(name)
    } else {
        Err(D::Error::custom(format_args!("no check is named `{name}`; the checks are {}", known.join(", "))))
    }
}

/// Placeholder of the reason in a waiver that a message proposes.
pub const REASON: &str = "your reason";

pub(super) fn parse_reason<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let because = String::deserialize(deserializer)?;
    if because.trim().is_empty() {
        return Err(D::Error::custom("a check is waived only with a reason, and this one is empty"));
    }
    if because.trim() == REASON {
        return Err(D::Error::custom(format!(
            "`{REASON}` is a placeholder; write why the fault is acceptable"
        )));
    }
    Ok(because)
}

/// The reason for not running a pass of another program that the recipe does not request.
pub(crate) fn not_asked(name: &str) -> String {
    format!("the recipe does not request it; `checks: {{ {name}: {{}} }}` does")
}

/// A limit: a finite number above zero.
pub(crate) fn parse_positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    let limit = f64::deserialize(deserializer)?;
    if limit.is_finite() && limit > 0.0 {
        Ok(Some(limit))
    } else {
        Err(D::Error::custom(format_args!("a limit is a finite number above 0, not {limit}")))
    }
}

/// A share: a number from 0 to 1.
pub(crate) fn parse_share<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    let limit = f64::deserialize(deserializer)?;
    if (0.0..=1.0).contains(&limit) {
        Ok(Some(limit))
    } else {
        Err(D::Error::custom(format_args!("a share is a number from 0 to 1, not {limit}")))
    }
}
