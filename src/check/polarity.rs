//! The share of ON events.

use super::limits;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Smallest share of ON events.
    #[serde(deserialize_with = "limits::share", skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest share of ON events.
    #[serde(deserialize_with = "limits::share", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}
