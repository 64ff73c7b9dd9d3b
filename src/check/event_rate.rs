//! How often pixels fire.

use super::limits;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Fewest events per pixel and second.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Most events per pixel and second.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}
