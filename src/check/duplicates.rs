//! Events that are in a stream twice.

use super::limits;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest share of events that repeat the time, pixel and polarity of another.
    #[serde(deserialize_with = "limits::share", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}
