//! Steps between poses: no jump among neighbours.

use super::limits;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest ratio of a step to the median step of its neighbours, above 1.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}
