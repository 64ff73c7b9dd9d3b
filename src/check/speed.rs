//! How well the path follows the speed law.

use super::limits;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest relative deviation of a step from its share of the path, as arc length.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub arc: Option<f64>,
    /// The same, as chord.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub chord: Option<f64>,
}
